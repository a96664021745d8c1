"""A team as a Gymnasium environment, and many flights of it at once (the extra `gym`).

The action is a wrench that the leader asks for besides its own, in shares of stated limits; the pilot below it stays.
The observation is what the pilot knows: estimates, reference, asked and estimated forces, each over a stated bound and
cut there. It is put together by a part of the pilot, which never sees the truth; the reward is the truth's.

`gymnasium.make("colift.integrations.gymnasium_env:colift/Transport-v0", scenario="paper")`, and the same with `make_vec`.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from colift import scenario
from colift.closed_loop import simulator, termination
from colift.math import linalg, so3
from colift.math.pytree import pytree
from colift.models import grasp
from colift.onboard import interfaces
from colift.onboard.control import tracking
from colift.scenario import experiment

try:
    import gymnasium
    from gymnasium.utils import seeding
    from gymnasium.vector import AutoresetMode
    from gymnasium.vector.utils import batch_space
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("Gymnasium is not installed: pip install 'colift[gym]'", name="gymnasium") from error

BOUNDS = {  # of what is observed, in this order
    "e_p": 1.0,  # m, estimated position less the reference's
    "e_v": 2.0,  # m/s
    "e_R": 1.0,  # 1, estimated
    "e_omega": 3.0,  # rad/s
    "a": 5.0,  # m/s^2, estimated acceleration of the payload less the reference's
    "v_d": 3.0,  # m/s, of the reference
    "a_d": 5.0,  # m/s^2
    "W": 2.0,  # force asked for in the last tick over the payload's weight, world
    "b": 1.0,  # 1, thrust direction of each agent, world
    "lam": 2.0,  # estimated force of each contact over the payload's weight, world
}
NEAR_M, NEAR = 0.05, 0.05  # of e_p, m, and of e_R: where a reward falls to a half


@pytree
class ResidualWrenchController:
    """Another leader, the wrench that is asked for besides, and a memory of what is known on board."""

    base: interfaces.PayloadController
    wrench: Float[Array, "6"]  # N, world; N m, payload frame
    initial_observation: Float[Array, " seen"]  # what is known before the first tick: nothing

    def begin(self) -> Any:
        """Nothing seen, and the other's memory."""
        return self.initial_observation, self.base.init()

    def lead(self, state: Any, context: interfaces.ControlContext) -> tuple[tracking.AccelerationCommand, Any]:
        """`a + F / m_L`, `alpha + J_L^-1 tau`: the desired wrench grows by `(F, tau)`."""
        to, of_other = self.base.compute(state[1], context)
        load = context.team.payload
        alpha = to.alpha + linalg.solve(load.inertia, self.wrench[3:, None])[:, 0]
        to = dataclasses.replace(to, a=to.a + self.wrench[:3] / load.mass, alpha=alpha)
        return to, (observation(context), of_other)


def observation(context: interfaces.ControlContext) -> Float[Array, " seen"]:
    """What is known on board, each entry over its bound (`BOUNDS`), cut at 1 in size."""
    q, d, load = context.estimate.payload, context.setpoint, context.team.payload
    weight = load.mass * jnp.sqrt((context.team.gravity * context.team.gravity).sum())
    parts = {
        "e_p": q.p - d.p,
        "e_v": q.v - d.v,
        "e_R": so3.e_R(q.R, d.R),
        "e_omega": so3.e_omega(q.R, q.omega, d.R, d.omega),
        "a": context.estimate.a_L[:3] - d.a,
        "v_d": d.v,
        "a_d": d.a,
        "W": context.last_wrench.F / weight,
        "b": jnp.concatenate([agent.R[:, :, 2].reshape(-1) for agent in context.estimate.agents]),
        "lam": grasp.stack_contacts(context.estimate.lam).reshape(-1) / weight,
    }
    seen = jnp.concatenate([parts[name] / bound for name, bound in BOUNDS.items()])
    return jnp.where(jnp.isfinite(seen), jnp.clip(seen, -1.0, 1.0), 0.0)


def reward(e_p: Float[Array, "ticks 3"], e_R: Float[Array, "ticks 3"]) -> Float[Array, "ticks"]:
    """`1 / (1 + |e_p|^2 / NEAR_M^2 + |e_R|^2 / NEAR^2)`, 0 where an error is not finite."""
    off = (e_p * e_p).sum(1) / NEAR_M**2 + (e_R * e_R).sum(1) / NEAR**2
    return jnp.where(jnp.isfinite(off), 1 / (1 + off), 0.0)


@dataclasses.dataclass(frozen=True)
class TransportTask:
    """What single and batched environments share."""

    setup: simulator.LoopConfig  # with a `Guided` leader
    initial_states: simulator.LoopState
    action_scale: np.ndarray  # (6,) N and N m, wrench of an action of 1
    frame_skip: int  # of a step
    max_episode_steps: int  # until an episode is truncated


def make_task(
    name: str, case: str, changes: Sequence[str], step_s: float, force_N: float, moment_Nm: float
) -> TransportTask:
    """A scenario as an environment flies it; raises as `Transport` does."""
    flight_experiment = experiment.make_experiment(scenario.load_scenario(name, changes), case)
    if flight_experiment.update_times:
        raise ValueError(f"case {case!r} learns on the way, which a step does not: one without updates, as C1")
    ticks = round(step_s / flight_experiment.dt)
    if not (ticks >= 1 and abs(ticks * flight_experiment.dt - step_s) <= 1e-9):
        raise ValueError(f"step_s = {step_s:g}: must be a multiple of the control period, {flight_experiment.dt:g} s")
    for setting, value in (("force_N", force_N), ("moment_Nm", moment_Nm)):
        if not 0 <= value < np.inf:
            raise ValueError(f"{setting} = {value:g}: must be finite and not negative")
    team = flight_experiment.world.team
    heldout = jnp.zeros(3 * (len(BOUNDS) - 2 + sum(team.sizes) + team.contacts))
    leader = ResidualWrenchController(
        base=flight_experiment.controller.payload_controller, wrench=jnp.zeros(6), initial_observation=heldout
    )
    setup = dataclasses.replace(
        flight_experiment.loop_config,
        controller=dataclasses.replace(flight_experiment.controller, payload_controller=leader),
    )
    return TransportTask(
        setup=setup,
        initial_states=simulator.reset(setup, flight_experiment.initial_state),
        action_scale=np.array([force_N] * 3 + [moment_Nm] * 3),
        frame_skip=ticks,
        max_episode_steps=round(flight_experiment.duration / flight_experiment.dt) // ticks,
    )


@pytree
class StepResult:
    """A flight after one step of the environment."""

    loop: simulator.LoopState
    observation: Float[Array, "*flights seen"]
    reward: Float[Array, "*flights"]
    e_p: Float[Array, "*flights"]  # m, RMS of the true error over the step


@functools.partial(jax.jit, static_argnums=0)
def step(
    ticks: int, setup: simulator.LoopConfig, loop: simulator.LoopState, wrench: Float[Array, "6"], seed: Int[Array, "2"]
) -> StepResult:
    """One step of one flight; seed: of its episode's noise, and how many steps it has flown."""
    leader = dataclasses.replace(setup.controller.payload_controller, wrench=wrench)
    setup = dataclasses.replace(setup, controller=dataclasses.replace(setup.controller, payload_controller=leader))
    noise = setup.world.sample_noise(jax.random.fold_in(jax.random.key(seed[0]), seed[1]), ticks)
    then, rows = simulator.rollout(setup, loop, noise, jnp.asarray(ticks))
    flown = then.tick - loop.tick
    good, off = (
        jnp.where(jnp.arange(ticks) < flown, x, 0.0) for x in (reward(rows.e_p, rows.e_R), (rows.e_p * rows.e_p).sum(1))
    )
    e_p = jnp.sqrt(off.sum() / jnp.maximum(flown, 1).astype(off.dtype))
    return StepResult(loop=then, observation=then.controller.payload_controller[0], reward=good.mean(), e_p=e_p)


@functools.partial(jax.jit, static_argnums=0)
def vector_step(
    ticks: int,
    setup: simulator.LoopConfig,
    loops: simulator.LoopState,
    wrenches: Float[Array, "flights 6"],
    seeds: Int[Array, "flights 2"],
    fresh: simulator.LoopState,
    anew: Bool[Array, "flights"],
) -> StepResult:
    """One step of many flights; those that are begun anew take `fresh`, and no wrench."""

    def begun(new: Array, past: Array) -> Array:
        return jnp.where(anew.reshape(-1, *[1] * (past.ndim - 1)), new[None], past)

    def one(loop: simulator.LoopState, wrench: Float[Array, "6"], seed: Int[Array, "2"]) -> StepResult:
        return step(ticks, setup, loop, wrench, seed)

    return jax.vmap(one)(jax.tree.map(begun, fresh, loops), jnp.where(anew[:, None], 0.0, wrenches), seeds)


class TransportEnv(gymnasium.Env):
    """One flight: the leader's residual wrench in, what the pilot knows out.

    action (6): force, world, over `force_N`, and moment, payload frame, over `moment_Nm`, each in [-1, 1]. Observation:
    `BOUNDS`, in [-1, 1]; agents and contacts in team order. Reward: the mean over a step of `reward` of the true
    errors, 0 after the flight has ended. It is terminated where a limit of the scenario is met, `info["cause"]` says
    which (`limits.Cause`), and truncated after the scenario's duration; `info["e_p_m"]` is the RMS of the true position
    error over the step. A reset flies one step without action, so that something is known.

    name, changes: as `scenario.load`; case: a pilot that does not learn on the way. Raises as `study.plan`, and
    ValueError for a case with updates and a step that is not a multiple of the control period.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012, as Gymnasium declares it

    def __init__(
        self,
        scenario: str = "paper",
        case: str = "C1",
        changes: Sequence[str] = (),
        step_s: float = 0.02,
        force_N: float = 2.0,
        moment_Nm: float = 0.2,
    ) -> None:
        self.task = make_task(scenario, case, changes, step_s, force_N, moment_Nm)
        self.action_space, self.observation_space = _spaces(self.task)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """A flight from the scenario's start under noise of its own, and what is known after a step without action."""
        super().reset(seed=seed, options=options)
        self._noise, self._steps, self._loop = _noise(self.np_random), 0, self.task.initial_states
        seen, _, _, _, info = self.step(np.zeros(6, np.float32))
        return seen, info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Fly one step; returns observation, reward, terminated, truncated, info."""
        wrench, seed = _wrench(self.task, action), jnp.array([self._noise, self._steps])
        done = step(self.task.frame_skip, self.task.setup, self._loop, wrench, seed)
        self._loop, self._steps = done.loop, self._steps + 1
        cause = termination.TerminationCause(int(done.loop.termination))
        ended, over = cause != termination.TerminationCause.NONE, self._steps >= self.task.max_episode_steps
        info = {"cause": cause, "e_p_m": float(done.e_p)}
        return np.asarray(done.observation, np.float32), float(done.reward), ended, over and not ended, info


class TransportVecEnv(gymnasium.vector.VectorEnv):
    """Many flights of `Transport` at once, batched by `jax.vmap`.

    A flight that has ended is begun anew in the next step, whose action it does not see and whose reward is 0.
    `info["cause"]` is an array of `limits.Cause` values, `info["e_p_m"]` of RMS errors, m.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str = "paper",
        case: str = "C1",
        changes: Sequence[str] = (),
        step_s: float = 0.02,
        force_N: float = 2.0,
        moment_Nm: float = 0.2,
    ) -> None:
        self.task, self.num_envs = make_task(scenario, case, changes, step_s, force_N, moment_Nm), num_envs
        alone = _spaces(self.task)
        self.single_action_space, self.single_observation_space = alone
        self.action_space, self.observation_space = (batch_space(space, num_envs) for space in alone)
        self._generators: list[np.random.Generator] = []

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None) -> Any:
        """All flights from the start; seed: of each, or of the first, the others' being the next integers."""
        alone = range(seed, seed + self.num_envs) if isinstance(seed, int) else [None] * self.num_envs
        seeds = seed if isinstance(seed, Sequence) else alone
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: {len(seeds)} given for {self.num_envs} flights")
        kept = self._generators or [None] * self.num_envs
        self._generators = [
            old if old is not None and each is None else seeding.np_random(each)[0]
            for old, each in zip(kept, seeds, strict=True)
        ]
        n = self.num_envs
        self._loops = jax.tree.map(lambda x: jnp.repeat(x[None], n, axis=0), self.task.initial_states)
        self._noise, self._steps, self._over = np.zeros(n, int), np.zeros(n, int), np.ones(n, bool)
        seen, _, _, _, info = self.step(np.zeros((n, 6), np.float32))
        return seen, info

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Fly one step of each, or begin it anew where it had ended."""
        anew = self._over
        for i in np.flatnonzero(anew):
            self._noise[i], self._steps[i] = _noise(self._generators[i]), 0
        seeds = jnp.asarray(np.stack([self._noise, self._steps], axis=1))
        wrenches, fresh = _wrench(self.task, actions), self.task.initial_states
        done = vector_step(
            self.task.frame_skip, self.task.setup, self._loops, wrenches, seeds, fresh, jnp.asarray(anew)
        )
        self._loops, self._steps = done.loop, self._steps + 1
        cause = np.asarray(done.loop.termination)
        ended = cause > 0
        truncated = (self._steps >= self.task.max_episode_steps) & ~ended
        self._over = ended | truncated
        rewards = np.where(anew, 0.0, np.asarray(done.reward))
        info = {"cause": cause, "e_p_m": np.asarray(done.e_p)}
        return np.asarray(done.observation, np.float32), rewards, ended, truncated, info


def _spaces(of: TransportTask) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Of actions and of observations."""
    seen = of.setup.controller.payload_controller.initial_observation.shape
    return gymnasium.spaces.Box(-1.0, 1.0, (6,), np.float32), gymnasium.spaces.Box(-1.0, 1.0, seen, np.float32)


def _wrench(of: TransportTask, action: np.ndarray) -> Float[Array, "*flights 6"]:
    return jnp.asarray(np.clip(np.asarray(action, float), -1.0, 1.0) * of.action_scale)


def _noise(generator: np.random.Generator) -> int:
    """The seed of an episode's noise."""
    return int(generator.integers(2**63 - 1))


gymnasium.register(
    "colift/Transport-v0",
    entry_point="colift.integrations.gymnasium_env:Transport",
    vector_entry_point="colift.integrations.gymnasium_env:Transports",
)
