"""Tests of the MuJoCo plant: force balance, soft-contact forces, and motion compared with the rigid-contact plant."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import signals
from colift.models import grasp, mjcf
from colift.models.parameters import Team
from colift.models.state import AgentInput, GeneralizedForce, ResidualForces, State, Wrench
from colift.runtime import extras
from colift.scenario import experiment
from colift.simulation import contact_dynamics, mujoco_plant
from tests.support import payload_motions as motion
from tests.support import random_teams as teams
from tests.support import small_team as light
from tests.support.pinocchio_team import PinocchioTeam

STRUCTURES = (teams.POOL[2], teams.POOL[3])
CASES = [(structure, seed) for structure in STRUCTURES for seed in range(3)]
DT = 2e-3
SOLVED = 1e-7  # N, N m: MuJoCo's solver stops where its cost falls by less than 1e-14; forces enter it squared
in_mujoco = jax.jit(lambda plant, *args: plant.forward_dynamics(*args), static_argnums=0)
accelerate, left = jax.jit(contact_dynamics.forward_dynamics), jax.jit(signals.true_residual)


def random_forces(rng: np.random.Generator, team: Team) -> tuple[contact_dynamics.TeamInputs, ResidualForces]:
    """Return random inputs about hover and random residual forces on every body."""
    draw = lambda *shape: jnp.array(rng.normal(size=shape))  # noqa: E731
    shapes = [(size, group.tree.joints) for size, group in zip(team.sizes, team.agent_groups, strict=True)]
    inputs = tuple(AgentInput(u=20 + 5 * draw(n), tau=draw(n, 3), tau_r=draw(n, k)) for n, k in shapes)
    f = ResidualForces(
        agents=tuple(GeneralizedForce(f_x=draw(n, 3), f_w=draw(n, 3), f_r=draw(n, k)) for n, k in shapes),
        payload=Wrench(F=draw(3), tau=draw(3)),
    )
    return inputs, f


def forced_team(structure: tuple, seed: int) -> tuple[Team, State, contact_dynamics.TeamInputs, ResidualForces]:
    """Return a random team at a random state under random forces."""
    team, z = motion.moving_team(seed, structure)
    return team, z, *random_forces(np.random.default_rng(seed + 1000), team)


def assert_close(found: object, expected: object, tolerance: float) -> None:
    """Assert that all leaves agree, relative to the largest entry of each or 1."""
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * max(1.0, np.abs(b).max(initial=0)))


# At a state -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("structure", "seed"), CASES)
def test_force_balance_holds_with_mujoco_accelerations(structure: tuple, seed: int) -> None:
    """The residual of colift's equations is the applied residual, exactly and for any contact softness."""
    team, z, inputs, f = forced_team(structure, seed)
    a, lam = in_mujoco(mujoco_plant.mujoco_plant(team, z), team, z, inputs, f)
    assert_close(left(team, z, a, lam, inputs), f, SOLVED)


@pytest.mark.parametrize(("structure", "seed"), CASES)
def test_contact_forces_follow_the_stated_softness(structure: tuple, seed: int) -> None:
    """`(A + S) lam = A lam_rigid`, with A and the rigid forces from Pinocchio and S as documented by MuJoCo."""
    team, z, inputs, f = forced_team(structure, seed)
    plant, model = mujoco_plant.mujoco_plant(team, z), PinocchioTeam(team)
    lam = grasp.stack_contacts(in_mujoco(plant, team, z, inputs, f)[1])
    q, _ = model.coordinates(z)
    J = model.jacobian(q)
    A, S = J @ np.linalg.solve(model.mass_matrix(q), J.T), np.diag(plant.session.data.efc_R)
    rigid = model.solve_kkt(z, inputs, f).lam
    soft = np.linalg.solve(A + S, A @ rigid.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(lam, soft, rtol=0, atol=SOLVED * np.abs(soft).max())


def test_difference_to_rigid_contacts_vanishes() -> None:
    """The difference is first order in `(1 - d) / d`: each further nine of d divides it by ten."""
    team, z = motion.moving_reference_team(1)
    inputs, f = random_forces(np.random.default_rng(1), team)
    exact = accelerate(team, z, inputs, f)
    errors = []
    for d in (0.99, 0.999, 0.9999):
        softness = mjcf.ContactSoftness(time_constant=1e-3, impedance=d)
        found = in_mujoco(mujoco_plant.mujoco_plant(team, z, softness=softness), team, z, inputs, f)
        errors.append(
            [np.abs(a - b).max() for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(exact), strict=True)]
        )
    before, after, last = np.array(errors)
    assert (last < 0.11 * after).all()
    assert (after < 0.15 * before).all()
    assert max(last) > 0


@pytest.mark.parametrize(("structure", "seed"), CASES)
def test_inputs_and_residuals_have_equal_power(structure: tuple, seed: int) -> None:
    """In MuJoCo's coordinates: `f_x . v + f_w . omega + f_r . r_dot`, `R e3 u . v_o + tau . omega + tau_r . r_dot`."""
    team, z, inputs, f = forced_team(structure, seed)
    session = mujoco_plant.mujoco_plant(team, z).session
    session.forward_dynamics(*(np.asarray(x).ravel() for x in mujoco_plant._rows(z, inputs, f)))
    d = session.data
    applied = d.qfrc_smooth + d.qfrc_bias - d.qfrc_passive - d.qfrc_actuator
    load = z.payload
    expected = f.payload.F @ load.v + f.payload.tau @ load.omega
    for q, g in zip(z.agents, f.agents, strict=True):
        expected += (g.f_x * q.v).sum() + (g.f_w * q.omega).sum() + (g.f_r * q.r_dot).sum()
    assert applied @ d.qvel == pytest.approx(float(expected), rel=1e-11)
    expected = sum((u.tau * q.omega).sum() + (u.tau_r * q.r_dot).sum() for q, u in zip(z.agents, inputs, strict=True))
    thrust = np.concatenate([u.u for u in inputs])
    for name, u in enumerate(thrust):
        base = d.body(f"agent {name + 1}")
        expected += u * base.xmat.reshape(3, 3)[:, 2] @ d.joint(f"agent {name + 1}").qvel[:3]
    assert d.qfrc_actuator @ d.qvel == pytest.approx(float(expected), rel=1e-11)


@pytest.mark.parametrize("structure", teams.POOL)
def test_state_conversion_round_trip(structure: tuple) -> None:
    rng = np.random.default_rng(7)
    team, z = teams.team(rng, structure), teams.free_state(rng, structure)
    session = mujoco_plant.mujoco_plant(team, z).session
    rows = [np.asarray(x).ravel() for x in mujoco_plant._state_rows(z)]
    session._place(*rows)
    for before, after in zip(rows, session._state(), strict=True):
        np.testing.assert_allclose(
            np.ravel(after), before, rtol=0, atol=1e-14 * max(1.0, np.abs(before).max(initial=0))
        )


# In motion ------------------------------------------------------------------------------------------------------------


def drag(c: jax.Array, z: State) -> ResidualForces:
    """Residual that depends on the state: linear drag, including the joints."""
    return ResidualForces(
        agents=tuple(GeneralizedForce(f_x=-c * q.v, f_w=-c / 25 * q.omega, f_r=-c / 25 * q.r_dot) for q in z.agents),
        payload=Wrench(F=-c * z.payload.v, tau=-c / 25 * z.payload.omega),
    )


STEPS = 250


@jax.jit
def simulate_rigid(team: Team, z: State, inputs: contact_dynamics.TeamInputs, c: jax.Array) -> State:
    """Return the state after half a second of the rigid-contact plant."""

    def step(_: int, z: State) -> State:
        unknown = lambda z, _: drag(c, z)  # noqa: E731
        return contact_dynamics.project_to_constraints(
            team, contact_dynamics.rkmk4_step(team, z, inputs, unknown, jnp.array(DT))
        )

    return jax.lax.fori_loop(0, STEPS, step, z)


@functools.partial(jax.jit, static_argnums=0)
def simulate_mujoco(
    plant: mujoco_plant.MujocoPlant, team: Team, z: State, inputs: contact_dynamics.TeamInputs, c: jax.Array
) -> State:
    """Return the state after half a second of the MuJoCo plant."""
    unknown = lambda z, _: drag(c, z)  # noqa: E731
    return jax.lax.fori_loop(0, STEPS, lambda _, z: plant.step(team, z, inputs, unknown, jnp.array(DT)), z)


def state_distance(a: State, b: State) -> float:
    """Return the largest distance between positions [m], attitudes and joints."""
    pose = lambda z: jax.tree.leaves((z.payload.p, z.payload.R, [(q.x, q.R, q.r) for q in z.agents]))  # noqa: E731
    return max(float(jnp.abs(x - y).max()) for x, y in zip(pose(a), pose(b), strict=True))


@pytest.fixture(scope="module")
def initial_motion() -> tuple[Team, State, contact_dynamics.TeamInputs, list[mujoco_plant.MujocoPlant]]:
    """The reference team at 1 m/s and 1 rad/s under constant thrusts; plants of 1, 2 and 4 substeps."""
    team, z = motion.moving_reference_team(2)
    inputs = tuple(dataclasses.replace(u, u=12.0 + u.u) for u in motion.zero_inputs(team))
    return team, z, inputs, [mujoco_plant.mujoco_plant(team, z, DT, substeps) for substeps in (1, 2, 4)]


@pytest.mark.long
def test_motion_agrees_to_second_order_in_the_substep(initial_motion: tuple) -> None:
    """Without a residual only the gap of soft contacts remains, proportional to the square of the time constant."""
    team, z, inputs, plants = initial_motion
    expected = simulate_rigid(team, z, inputs, jnp.array(0.0))
    errors = [state_distance(simulate_mujoco(plant, team, z, inputs, jnp.array(0.0)), expected) for plant in plants]
    assert errors[0] < 1e-5
    for coarse, fine in itertools.pairwise(errors):
        assert 3.5 < coarse / fine < 4.5


def test_motion_with_drag_agrees_to_first_order(initial_motion: tuple) -> None:
    """The difference is first order in the substep, over which the drag is held constant."""
    team, z, inputs, plants = initial_motion
    c = jnp.array(0.5)
    expected, free = simulate_rigid(team, z, inputs, c), simulate_rigid(team, z, inputs, 0 * c)
    errors = [state_distance(simulate_mujoco(plant, team, z, inputs, c), expected) for plant in plants]
    assert errors[0] < 1e-2 * state_distance(expected, free)
    for coarse, fine in itertools.pairwise(errors):
        assert 1.8 < coarse / fine < 2.2


# Use in programs ----------------------------------------------------------------------------------------------------


def test_result_is_stateless_and_batches_agree() -> None:
    """A result does not depend on earlier calls, and batched results equal single ones."""
    team, z, inputs, f = forced_team(teams.POOL[2], 0)
    plant = mujoco_plant.mujoco_plant(team, z)
    first = in_mujoco(plant, team, z, inputs, f)
    other = jax.tree.map(lambda x: 2 * x, f)
    both = jax.vmap(plant.forward_dynamics, in_axes=(None, None, None, 0))(
        team, z, inputs, jax.tree.map(lambda *x: jnp.stack(x), other, f)
    )
    for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(both), strict=True):
        np.testing.assert_array_equal(a, b[1])
        assert np.abs(a - b[0]).max() > 1e-3


def test_inputs_are_not_limited_and_nan_propagates() -> None:
    """The plant does not limit inputs, and values that are not finite stay so."""
    team, z, inputs, f = forced_team(teams.POOL[2], 1)
    plant = mujoco_plant.mujoco_plant(team, z)
    strong = tuple(dataclasses.replace(u, u=10 * u.u) for u in inputs)
    assert float(strong[0].u.max()) > float(team.agent_groups[0].thrust_max.max())
    a, lam = in_mujoco(plant, team, z, strong, f)
    assert_close(left(team, z, a, lam, strong), f, SOLVED)
    lost = dataclasses.replace(z, payload=dataclasses.replace(z.payload, v=z.payload.v * jnp.nan))
    after = plant.step(team, lost, inputs, lambda _z, _t: f, jnp.array(DT))
    assert not np.isfinite(after.payload.p).all()


def test_scenario_selects_mujoco() -> None:
    """The plant of a scenario with `physics: mujoco` is MuJoCo, as stiff as its substeps allow."""
    settings = light.settings(physics={"kind": "mujoco", "substeps": 2}, control_Hz=400.0)
    plant = experiment.make_experiment(settings, "C1").world.plant
    assert isinstance(plant, mujoco_plant.MujocoPlant)
    assert plant.substeps == 2
    option = plant.session.model.opt
    assert option.timestep == pytest.approx(1 / 800)
    assert mjcf.stiffest_contact(1 / 800).time_constant == pytest.approx(plant.session.model.eq_solref[0, 0])


def test_invalid_plant_arguments_are_refused() -> None:
    team, z = motion.moving_reference_team(0)
    with pytest.raises(ValueError, match="substeps = 0: must be at least 1"):
        mujoco_plant.mujoco_plant(team, z, substeps=0)


def test_missing_mujoco_is_reported_with_the_extra() -> None:
    code = "import sys; sys.modules['mujoco'] = None; import colift.simulation.mujoco_plant"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1
    told = f"ModuleNotFoundError: MuJoCo is not installed: {extras.install_command('mujoco')}"
    assert told in done.stderr
