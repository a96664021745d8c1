"""Batches: 1024 teams with different masses and states; steps per second compared with `mujoco.rollout`.

Each copy of the reference team has random masses (0.9 to 1.1 times the nominal ones) and velocities that are consistent
with its grasp. Times are wall-clock seconds, with two threads and with one; the code is compiled once.
"""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import mujoco
import mujoco.rollout
import numpy as np

from benchmarks import Outcome, microseconds, peers, plant, ratios, rounds, table
from colift import codegen
from colift.simulation import contact_dynamics

TEAMS, STEPS, THREADS = 1024, 25, 2


def teams(case: plant.Case) -> plant.Case:
    """Return the batch: all values have a leading axis; masses of the agents' bodies and velocities differ."""
    rng = np.random.default_rng(0)
    team, z, inputs = jax.tree.map(lambda x: jnp.repeat(x[None], TEAMS, 0), case)
    mass = team.agent_groups[0].mass * rng.uniform(0.9, 1.1, team.agent_groups[0].mass.shape)
    team = replace(team, agent_groups=(replace(team.agent_groups[0], mass=mass),))
    (agents,) = z.agents
    turning = replace(agents, omega=jnp.asarray(rng.normal(0, 0.1, agents.omega.shape)))
    payload = replace(z.payload, v=jnp.asarray(rng.normal(0, 0.1, z.payload.v.shape)))
    z = jax.jit(jax.vmap(contact_dynamics.project_to_constraints))(team, replace(z, agents=(turning,), payload=payload))
    return team, z, inputs


def run(seconds: float) -> Outcome:
    """Measure seconds per step and team."""
    case = plant.supported_team(2)
    varied = teams(case)
    leaves, tree = jax.tree.flatten(varied)

    def rollout(*x: jax.Array) -> list[jax.Array]:
        return jax.tree.leaves(plant.rollout(STEPS)(*jax.tree.unflatten(tree, x), jnp.array(plant.DT)))

    ours = {n: jax.jit(jax.vmap(codegen.compile(rollout, threads=n))) for n in (1, THREADS)}

    model = peers.mujoco_team(case[0])
    data = peers.mujoco_state(model, case)  # the pose before masses changed: contact speeds off by 3e-4 m/s
    on_host, models, states = jax.tree.map(np.asarray, varied[0]), [], []
    for i, velocity in enumerate(peers.mujoco_velocities(varied)):
        other = peers.mujoco_team(jax.tree.map(lambda x, i=i: x[i], on_host))
        other.eq_data[:] = model.eq_data
        data.qvel = velocity
        state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        models.append(other)
        states.append(state)
    start, control = np.array(states), np.tile(data.ctrl, (TEAMS, STEPS, 1))
    workers = [mujoco.MjData(model) for _ in range(THREADS)]
    with mujoco.rollout.Rollout(nthread=THREADS) as peer, mujoco.rollout.Rollout(nthread=1) as single:
        contenders = {
            "native": (lambda: jax.block_until_ready(ours[THREADS](*leaves)), TEAMS * STEPS),
            "mujoco.rollout": (lambda: peer.rollout(models, workers, start, control), TEAMS * STEPS),
            "native, one thread": (lambda: jax.block_until_ready(ours[1](*leaves)), TEAMS * STEPS),
            "mujoco.rollout, one thread": (
                lambda: single.rollout(models, workers[:1], start, control),
                TEAMS * STEPS,
            ),
        }
        times = rounds(contenders, seconds)
    table(f"wall-clock time, {TEAMS} teams on {THREADS} threads and on one", "a step and team", times, "native")
    ratio = ratios(times, "native")["mujoco.rollout"]
    one_thread = ratios(times, "native, one thread")["mujoco.rollout, one thread"]
    return Outcome(
        figures={
            "time_per_step_and_team_us": microseconds(times),
            "ratio_to_native": ratios(times, "native"),
            "steps_per_second": {name: 1e6 / t for name, t in microseconds(times).items()},
            "threads": THREADS,
            "ratio_with_one_thread": one_thread,
        },
        targets={f"native {ratio:.1f}x mujoco.rollout, at least 15x": ratio >= 15},
    )
