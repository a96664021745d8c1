"""Runs of the plant and conserved quantities, for tests and evidence."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from colift.models import aerial_manipulator, grasp
from colift.models.parameters import Team
from colift.models.state import AgentInput, ResidualForces, State, TeamInputs, zero_residual
from colift.simulation import contact_dynamics
from tests.support import random_teams as teams
from tests.support.pinocchio_team import PinocchioTeam


def zero_inputs(team: Team) -> TeamInputs:
    """Return inputs without thrust and torque."""
    return tuple(
        AgentInput(u=jnp.zeros(n), tau=jnp.zeros((n, 3)), tau_r=jnp.zeros((n, group.tree.joints)))
        for n, group in zip(team.sizes, team.agent_groups, strict=True)
    )


def moving_team(seed: int, structure: tuple = teams.POOL[2]) -> tuple[Team, State]:
    """Return a random team that moves at about 1 m/s and 1 rad/s."""
    rng = np.random.default_rng(seed)
    return PinocchioTeam(teams.team(rng, structure)).on_grasp(teams.free_state(rng, structure))


def moving_reference_team(seed: int) -> tuple[Team, State]:
    """Return the reference team at about 1 m/s and 1 rad/s with every admissible velocity excited."""
    team = teams.reference_team()
    z = contact_dynamics.consistent_initial_state(team, teams.reference_guess())
    model, rng = PinocchioTeam(team), np.random.default_rng(seed)
    q, v = model.coordinates(z)
    A = model.jacobian(q)
    v = v + rng.normal(size=v.shape)
    return team, model.state(z, v - np.linalg.pinv(A) @ (A @ v))


def energy(team: Team, z: State) -> tuple[jax.Array, jax.Array]:
    """Return kinetic and potential energy [J]."""
    load, J = z.payload, team.payload.inertia
    kinetic = team.payload.mass * (load.v @ load.v) / 2 + load.omega @ J @ load.omega / 2
    potential = -team.payload.mass * (team.gravity @ load.p)
    for group, a in zip(team.agent_groups, z.agents, strict=True):
        xi = jnp.concatenate([a.omega, a.r_dot], axis=1)
        mass = group.mass.sum(1)
        kinetic += (xi * jax.vmap(aerial_manipulator.momenta)(group, a.r, xi)).sum() / 2 + (
            mass * (a.v * a.v).sum(1)
        ).sum() / 2
        potential -= (mass * (a.x @ team.gravity)).sum()
    return kinetic, potential


def momentum(team: Team, z: State) -> jax.Array:
    """Return linear and angular momentum about the world origin [kg m/s, kg m^2/s]."""
    load = z.payload
    P = team.payload.mass * load.v
    L = jnp.cross(load.p, P) + load.R @ team.payload.inertia @ load.omega
    for group, a in zip(team.agent_groups, z.agents, strict=True):
        xi = jnp.concatenate([a.omega, a.r_dot], axis=1)
        mu = jax.vmap(aerial_manipulator.momenta)(group, a.r, xi)[:, :3]
        p = group.mass.sum(1)[:, None] * a.v
        P, L = P + p.sum(0), L + (jnp.cross(a.x, p) + (a.R @ mu[:, :, None])[:, :, 0]).sum(0)
    return jnp.concatenate([P, L])


def step(team: Team, z: State, inputs: TeamInputs, f: ResidualForces, dt: jax.Array, projected: jax.Array) -> State:
    """Return the state after one step, optionally without projection."""
    z = contact_dynamics.rkmk4_step(team, z, inputs, lambda _z, _t: f, dt)
    return jax.lax.cond(projected, lambda z: contact_dynamics.project_to_constraints(team, z), lambda z: z, z)


@jax.jit
def run(
    team: Team, z: State, inputs: TeamInputs, f: ResidualForces, dt: jax.Array, steps: jax.Array, projected: jax.Array
) -> State:
    """Return the state after a number of steps under constant inputs."""
    return jax.lax.fori_loop(0, steps, lambda _, z: step(team, z, inputs, f, dt, projected), z)


@functools.partial(jax.jit, static_argnames=("samples", "every"))
def track(
    team: Team, z: State, dt: jax.Array, projected: jax.Array, *, samples: int, every: int
) -> tuple[State, dict[str, jax.Array]]:
    """Return a sampled free motion, with the energy that the projection added and its sum of absolute values [J]."""
    inputs, f = zero_inputs(team), zero_residual(team)

    def inner(_: int, carry: tuple) -> tuple:
        z, work, rough = carry
        free = contact_dynamics.rkmk4_step(team, z, inputs, lambda _z, _t: f, dt)
        z = jax.lax.cond(projected, lambda z: contact_dynamics.project_to_constraints(team, z), lambda z: z, free)
        added = sum(energy(team, z)) - sum(energy(team, free))
        return z, work + added, rough + jnp.abs(added)

    def outer(carry: tuple, _: None) -> tuple:
        carry = jax.lax.fori_loop(0, every, inner, carry)
        return carry, observe(carry)

    def observe(carry: tuple) -> dict[str, jax.Array]:
        z, work, rough = carry
        kinetic, potential = energy(team, z)
        return {
            "kinetic": kinetic,
            "potential": potential,
            "momentum": momentum(team, z),
            "Phi": jnp.abs(grasp.constraint_residual(team, z)).max(),
            "Phi_dot": jnp.abs(grasp.constraint_rate(team, z)).max(),
            "grip": grasp.min_delassus_singular_value(team, z).min(),
            "rate": jnp.stack([jnp.abs(x).max() for a in z.agents for x in (a.omega, a.r_dot) if x.size]).max(),
            "work": work,
            "rough": rough,
        }

    start = (z, jnp.zeros(()), jnp.zeros(()))
    (z, _, _), seen = jax.lax.scan(outer, start, None, length=samples)
    return z, jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), observe(start), seen)


def forced(team: Team, seed: int, hover: float = 1.0) -> tuple[TeamInputs, ResidualForces]:
    """Return constant inputs near hover and a constant force on the payload."""
    rng, f = np.random.default_rng(seed), zero_residual(team)
    mass = float(team.payload.mass + sum(group.mass.sum() for group in team.agent_groups))
    hover *= 9.81 * mass / sum(team.sizes)
    inputs = tuple(
        AgentInput(
            u=hover + jnp.array(rng.normal(size=n)),
            tau=jnp.array(0.02 * rng.normal(size=(n, 3))),
            tau_r=jnp.array(0.05 * rng.normal(size=(n, group.tree.joints))),
        )
        for n, group in zip(team.sizes, team.agent_groups, strict=True)
    )
    pull = dataclasses.replace(f.payload, F=jnp.array(rng.normal(size=3)))
    return inputs, dataclasses.replace(f, payload=pull)


def convergence(team: Team, z: State, seed: int, projected: bool, hover: float = 1.0) -> dict[str, object]:
    """Return errors of state and contact force after 0.4 s over five step sizes, and their logarithmic slopes."""
    inputs, f = forced(team, seed, hover)

    def end(steps: int) -> tuple[np.ndarray, np.ndarray]:
        final = run(team, z, inputs, f, jnp.array(0.4 / steps), jnp.array(steps), jnp.array(projected))
        _, lam = jax.jit(contact_dynamics.forward_dynamics)(team, final, inputs, f)
        return np.concatenate([np.ravel(x) for x in jax.tree.leaves(final)]), np.asarray(
            grasp.stack_contacts(lam)
        ).ravel()

    counts = [20, 40, 80, 160, 320]
    state, force = end(5120)
    errors = [[float(np.abs(a - b).max()) for a, b in zip(end(n), (state, force), strict=True)] for n in counts]
    step = [0.4 / n for n in counts]
    slopes = np.polyfit(np.log(step), np.log(errors), 1)[0]
    return {"step_s": step, "errors": errors, "state": float(slopes[0]), "force": float(slopes[1])}


@functools.partial(jax.jit, static_argnames="steps")
def final_value(team: Team, z: State, inputs: TeamInputs, f: ResidualForces, *, steps: int) -> jax.Array:
    """Return a smooth scalar of payload and agent positions and velocities after some steps."""
    dt = jnp.array(1e-3)

    def body(z: State, _: None) -> tuple[State, None]:
        return contact_dynamics.project_to_constraints(
            team, contact_dynamics.rkmk4_step(team, z, inputs, lambda _z, _t: f, dt)
        ), None

    z, _ = jax.lax.scan(body, z, None, length=steps)
    parts = [x.ravel() for x in jax.tree.leaves(z)]
    return sum(jnp.sin((1.0 + i) * part + 0.1 * jnp.arange(float(len(part)))).sum() for i, part in enumerate(parts))


def _varied(s: jax.Array, case: tuple) -> tuple[Team, State, TeamInputs, ResidualForces]:
    """Return the case with masses, inertias, velocities, inputs and forces changed by s, on the same grasp."""
    team, z, inputs, f, turns, F = case
    scale = lambda x, k: x * (1 + s * k)  # noqa: E731
    groups = tuple(
        dataclasses.replace(group, mass=scale(group.mass, 0.3), inertia=scale(group.inertia, -0.2))
        for group in team.agent_groups
    )
    load = dataclasses.replace(team.payload, mass=scale(team.payload.mass, 0.5))
    faster = tuple(
        dataclasses.replace(a, omega=a.omega + s * turn, r_dot=scale(a.r_dot, 0.4), v=scale(a.v, 0.2))
        for a, (turn, _) in zip(z.agents, turns, strict=True)
    )
    commanded = tuple(
        dataclasses.replace(u, u=scale(u.u, 0.1), tau=u.tau + s * tau)
        for u, (_, tau) in zip(inputs, turns, strict=True)
    )
    pulled = dataclasses.replace(f, payload=dataclasses.replace(f.payload, F=f.payload.F + s * F))
    varied = dataclasses.replace(team, agent_groups=groups, payload=load)
    return varied, dataclasses.replace(z, agents=faster), commanded, pulled


@functools.partial(jax.jit, static_argnames="steps")
def _value(s: jax.Array, case: tuple, *, steps: int) -> jax.Array:
    return final_value(*_varied(s, case), steps=steps)


@functools.partial(jax.jit, static_argnames="steps")
def _forward(case: tuple, *, steps: int) -> jax.Array:
    return jax.jvp(lambda s: _value(s, case, steps=steps), (jnp.zeros(()),), (jnp.ones(()),))[1]


@functools.partial(jax.jit, static_argnames="steps")
def _reverse(case: tuple, *, steps: int) -> jax.Array:
    return jax.grad(lambda s: _value(s, case, steps=steps))(jnp.zeros(()))


def gradient_errors(team: Team, z: State, seed: int, steps: int, hover: float = 1.0) -> dict[str, float]:
    """Return relative errors of forward- and reverse-mode derivatives against central differences."""
    rng = np.random.default_rng(seed + 1)
    turns = tuple(jnp.array(0.1 * rng.normal(size=(2, *a.omega.shape))) for a in z.agents)
    case = (team, z, *forced(team, seed, hover), turns, jnp.array(rng.normal(size=3)))
    forward, reverse = float(_forward(case, steps=steps)), float(_reverse(case, steps=steps))
    expected, error_estimate = differences(lambda s: float(_value(jnp.array(s), case, steps=steps)))
    return {
        "forward": abs(forward / expected - 1),
        "reverse": abs(reverse / expected - 1),
        "finite_difference_error": abs(error_estimate / expected),
        "derivative": expected,
    }


def differences(value: Callable[[float], float]) -> tuple[float, float]:
    """Return the derivative at 0 by extrapolated central differences (Ridders 1982) and its error estimate.

    One step size would be wrong by curvature where the motion is lively, by rounding where it is not.
    """
    table: list[list[float]] = []
    best, error_estimate = 0.0, np.inf
    for i in range(12):
        h = 1e-3 / 2**i
        row = [(value(h) - value(-h)) / (2 * h)]
        for j, above in enumerate(table[-1] if table else []):
            row.append((4 ** (j + 1) * row[j] - above) / (4 ** (j + 1) - 1))
            error = max(abs(row[-1] - row[j]), abs(row[-1] - above))
            if error < error_estimate:
                best, error_estimate = row[-1], error
        table.append(row)
    return best, error_estimate
