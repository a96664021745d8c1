"""Tests of the settings of the allocation within limits."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.models import aerial_manipulator, grasp, parameters
from colift.models.state import zero_residual
from colift.onboard import controller
from colift.onboard.control import cone_program, constrained_allocation
from colift.onboard.learning import residual_predictors
from colift.scenario import ScenarioError, controllers, initial_states, team
from colift.workflows import python_api

NORMAL = {"front/left": [0, -1, 0], "front/right": [0, 2, 0], "rear/left": [0, -1, 0], "rear/right": [0, 1, 0]}


def load(**allocation):
    return python_api.load_scenario("paper", {"allocation": {"kind": "constrained", **allocation}})


def build(**allocation):
    settings = load(**allocation)
    _, nominal = team.team(settings)
    return controllers.make_controller(settings, nominal).allocator


def test_settings_reach_the_allocator():
    contact = {"friction": 0.6, "normal": NORMAL, "min_force_N": 2, "max_force_N": 20}
    part = build(tilt_deg=30, contact=contact)
    assert isinstance(part, constrained_allocation.ConstrainedAllocator)
    assert float(part.tan_tilt) == pytest.approx(np.tan(np.pi / 6))
    np.testing.assert_array_equal(part.contacts.axis[1], [0, 1, 0])
    for name, expected in (("tan", 0.6), ("minimum", 2), ("maximum", 20)):
        np.testing.assert_array_equal(getattr(part.contacts, name), [expected] * 4)


def test_contacts_without_limits_have_none():
    part = build()
    np.testing.assert_array_equal(part.contacts.tan, [cone_program.UNLIMITED] * 4)
    np.testing.assert_array_equal(part.contacts.minimum, [-cone_program.UNLIMITED] * 4)


def test_friction_implies_contacts_that_only_press():
    np.testing.assert_array_equal(build(contact={"friction": 0.6, "normal": NORMAL}).contacts.minimum, np.zeros(4))


@pytest.mark.parametrize(
    ("allocation", "message"),
    [
        ({"tilt_deg": 0.5}, "allocation.tilt_deg"),
        (
            {"contact": {"friction": 0.6}},
            "contact.friction: requires `contact.normal` of every contact; missing: front/",
        ),
        ({"contact": {"normal": {"front/lift": [0, 1, 0]}}}, "did you mean 'front/left'"),
        ({"contact": {"normal": {**NORMAL, "front/left": [0, 0, 0]}}}, "must not be zero"),
        (
            {"contact": {"normal": NORMAL, "min_force_N": 5, "max_force_N": 4}},
            "contact.min_force_N.* must not exceed max_force_N = 4, got 5",
        ),
    ],
)
def test_contradictory_settings_are_refused(allocation, message):
    with pytest.raises(ScenarioError, match=message.replace("(", r"\(")):
        load(**allocation)


def test_bound_of_the_position_error_reaches_the_controller():
    settings = scenario.load_scenario("paper", ["control.position_error_bound_m=0.3"])
    _, nominal = team.team(settings)
    assert float(controllers.make_controller(settings, nominal).payload_controller.position_error_bound) == 0.3


MOTORS = {
    "kind": "motors",
    "bandwidth_Hz": 20.0,
    "rotors": {"num_rotors": 4, "radius_m": 0.25, "moment_ratio_m": 0.016},
}


TURNED = {"reference.rpy_deg": [8, -12, 50]}


@pytest.mark.parametrize(("name", "changes"), [("paper", {}), ("uneven", {}), ("trio", {}), ("plate", TURNED)])
def test_yaw_torques_of_rotors_are_moments_about_the_bases(name, changes):
    """The expected values are moments of random contact forces about each base, at rest on the reference."""
    settings = python_api.load_scenario(name, {"actuators": MOTORS, **changes})
    _, nominal = team.team(settings)
    state = initial_states.equilibrium_state(settings, nominal)
    lam = np.random.default_rng(0).normal(size=(len(grasp.contact_points(nominal)), 3))
    forces, expected = iter(lam @ np.asarray(state.payload.R).T), []
    for group, agents in zip(nominal.agent_groups, state.agents, strict=True):
        for j in range(len(agents.x)):
            agent, q = parameters.select_agent(group, j), jax.tree.map(lambda x, j=j: x[j], agents)
            base = q.x - q.R @ aerial_manipulator.center_of_mass(agent, q.r)
            tips = np.asarray(aerial_manipulator.tip_positions(agent, q) - base[None])
            expected.append(np.cross(tips, [next(forces) for _ in tips]).sum(0)[2])
    found = controllers.yaw_torques(settings, nominal)
    np.testing.assert_allclose(found.levers @ lam.ravel(), expected, atol=1e-2)  # postures at rest differ by 1e-3 rad
    assert found.moment_ratio == 0.016
    assert controllers.yaw_torques(python_api.load_scenario(name), nominal) is None


def test_agents_with_rotors_need_little_yaw_torque():
    """A yaw moment of the payload requires yaw torques with least squares only."""
    settings = python_api.load_scenario("paper", {"allocation.kind": "constrained", "actuators": MOTORS})
    _, nominal = team.team(settings)
    rotors, plain = controllers.make_controller(settings, nominal).allocator.base.allocation, build().base.allocation
    levers, W = controllers.yaw_torques(settings, nominal).levers, np.array([0, 0, 0, 0, 0, 1.0])
    required = [np.abs(levers @ np.asarray(x.right_inverse) @ W).max() for x in (plain, rotors)]
    assert (required[0] > 0.1, required[1] < 1e-3, plain.yaw_gain is None) == (True, True, True)


@pytest.mark.parametrize(("actuators", "share"), [(MOTORS, 0.0), ({"kind": "ideal"}, 1.0)])
def test_internal_forces_cancel_residual_yaw_torques_of_rotors(actuators, share):
    """Without rotors, the body torques compensate all of the residual yaw torques; agents and payload are turned."""
    changes = {"allocation.kind": "constrained", "actuators": actuators, **TURNED}
    settings = python_api.load_scenario("trio", changes)
    _, nominal = team.team(settings)
    onboard = controllers.make_controller(settings, nominal)
    state = initial_states.equilibrium_state(settings, nominal)
    now = controller.context_at(onboard, state, jnp.zeros(6), jnp.zeros(()))

    def residual(f, _state, _command, _t):
        zero = zero_residual(nominal)
        agents = tuple(dataclasses.replace(x, f_w=jnp.zeros((3, 3)).at[:, 2].set(f)) for x in zero.agents)
        return dataclasses.replace(zero, agents=agents)

    @jax.jit
    def yaw_torques(f):
        predictor = residual_predictors.TrueResidual(function=jax.tree_util.Partial(residual, f))
        law = dataclasses.replace(onboard, residual_predictor=predictor)
        inputs, _, _ = law.control_law(law.init_control_law(), now)
        return jnp.concatenate([part.tau[:, 2] for part in inputs])

    f = jnp.array([0.05, -0.04, 0.02])
    np.testing.assert_allclose(yaw_torques(f) - yaw_torques(0 * f), -share * f, atol=2e-3)
