"""Tests of limits of the contact forces: onset of slip, of pull and of overload against statics, and the reason."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.closed_loop import flight, termination
from colift.closed_loop.termination import ContactLimits, TerminationCause
from colift.scenario import experiment, schema
from colift.workflows import python_api
from tests.support import small_team as light

UP = np.tile([0.0, 0.0, 1.0], (3, 1))
NAMES = ("n0/hook", "n1/hook", "n2/hook")


def limits(friction: float = np.inf, least: float = -np.inf, most: float = np.inf) -> ContactLimits:
    friction, least, most = (jnp.asarray(x) for x in (friction, least, most))
    return ContactLimits(normal=jnp.asarray(UP), friction=friction, min_force=least, max_force=most)


def cause(of: ContactLimits, forces: np.ndarray) -> TerminationCause:
    """Return the cause of contact forces in a flight without other limits."""
    free = termination.TerminationLimits(
        min_delassus=jnp.zeros(1),
        max_distance=jnp.array(np.inf),
        min_height=jnp.array(-np.inf),
        max_attitude_error=jnp.array(np.inf),
        max_tilt=jnp.array(np.inf),
        max_saturation_time=jnp.array(np.inf),
        contacts=of,
    )
    values = termination.MonitoredValues(
        finite=jnp.array(True),
        delassus=jnp.ones(1),
        distance=jnp.zeros(()),
        heights=jnp.zeros(2),
        attitude=jnp.zeros(()),
        tilt=jnp.zeros(1),
        saturated=jnp.zeros(1),
        contact_forces=jnp.asarray(forces),
    )
    return TerminationCause(int(termination.check_termination(free, values)))


@pytest.mark.parametrize("angle", np.linspace(0.0, 2 * np.pi, 7))
@pytest.mark.parametrize("friction", [0.1, 0.6, 2.0])
def test_slip_starts_at_the_friction_cone(friction, angle):
    side = friction * 5.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
    forces = 5 * UP
    forces[1] += 0.999 * side
    assert cause(limits(friction, least=0.0), forces) == TerminationCause.NONE
    forces[1] = 5 * UP[1] + 1.001 * side
    assert cause(limits(friction, least=0.0), forces) == TerminationCause.SLIP


def test_a_contact_that_would_pull_opens():
    forces = 5 * UP
    forces[2, 2] = -1e-3
    assert cause(limits(0.5, least=0.0), forces) == TerminationCause.CONTACT_OPENS
    assert cause(limits(least=-1.0), forces) == TerminationCause.NONE
    assert cause(limits(least=1.0), 0.99 * UP) == TerminationCause.CONTACT_OPENS


def test_an_open_contact_of_a_fault_is_no_slip():
    """Rounding of a force of zero neither slips nor pulls."""
    assert cause(limits(0.5, least=0.0), 1e-11 * np.array([[1.0, 0, -1], [0, 1, 1], [1, 1, 0]])) == 0


@pytest.mark.parametrize(
    ("of", "force", "message"),
    [
        (limits(0.5, 0.0), [3, 0, 4], "contact n1/hook slips: tangential force 3 N, normal force 4 N at t = 2.000 s"),
        (limits(0.5, 0.0), [0, 0, -2], "contact n1/hook opens: normal force -2 N at t = 2.000 s"),
        (limits(most=4.0), [3, 0, 4], "contact n1/hook bears 5 N at t = 2.000 s, beyond physics.contact.max_force_N"),
    ],
)
def test_the_reason_names_contact_forces_and_limit(of, force, message):
    forces = 1.0 * UP
    forces[1] = force
    text = termination.format_contact_cause(cause(of, forces), of, forces, 2.0, NAMES)
    assert text.startswith(message)
    assert "beyond physics.contact." in text


def test_settings_reach_the_flight():
    names = ("front/left", "front/right", "rear/left", "rear/right")
    normal = {name: [0, -2, 0] if "left" in name else [0, 2, 0] for name in names}
    given = {"kind": "rigid", "contact": {"friction": 0.6, "normal": normal}}
    setup = experiment.make_experiment(python_api.load_scenario("paper", {"physics": given}), "C1")
    found = setup.termination_limits.contacts
    np.testing.assert_array_equal(found.normal[:, 1], [-1, 1, -1, 1])
    assert (float(found.friction), float(found.min_force), float(found.max_force)) == (0.6, 0.0, np.inf)
    assert setup.contact_names == names
    assert experiment.make_experiment(python_api.load_scenario("paper"), "C1").termination_limits.contacts is None
    with pytest.raises(scenario.ScenarioError, match=r"physics.contact.friction.*requires `contact.normal`"):
        python_api.load_scenario("paper", {"physics": {"kind": "rigid", "contact": {"friction": 0.6}}})


SOFT_BEAM = {
    "agent_types.one_arm.arms": [
        {"name": "tip", "joint": "elbow", "tip_position_m": [0, 0, -0.12], "contact": "soft_finger"}
    ],
    "physics": {"kind": "rigid", "contact": {"normal": {f"agent_{j}/tip": [0, 0, 1] for j in (1, 2, 3, 4)}}},
}


def test_a_soft_finger_bears_a_moment_until_it_slips():
    setup = experiment.make_experiment(python_api.load_scenario("beam", SOFT_BEAM), "C1")
    rows = flight.run_experiment(dataclasses.replace(setup, duration=2.0))
    assert not rows.termination_reason
    moments = np.asarray(rows.records.contact_moment)
    assert np.abs(moments[..., 2]).max() > 0.02
    assert np.abs(moments[..., :2]).max() < 1e-12  # the contact bears no other moment
    forces = np.einsum("tci,tij->tcj", rows.records.lam, rows.records.R_L)
    largest = float((np.abs(moments[..., 2]) / forces[..., 2]).max())
    limited = {"physics.contact.torsional_friction_m": 0.9 * largest}
    setup = experiment.make_experiment(python_api.load_scenario("beam", SOFT_BEAM | limited), "C1")
    found = flight.run_experiment(dataclasses.replace(setup, duration=2.0))
    assert "slips about its normal: moment" in found.termination_reason
    assert "physics.contact.torsional_friction_m" in found.termination_reason


def test_torsional_friction_limits_soft_fingers_alone():
    """A contact of another type does not slip about its normal, also where it pulls."""
    of = dataclasses.replace(limits(), torsional_friction=jnp.array([0.01, np.inf, np.inf]))
    forces, moments = 5.0 * UP, np.zeros((3, 3))
    forces[1, 2], moments[2, 2] = -5.0, 3.0
    assert np.array(termination.contact_excess(of, jnp.asarray(forces), jnp.asarray(moments))[3]).max() < 0
    moments[0, 2] = 0.051
    assert termination.contact_excess(of, jnp.asarray(forces), jnp.asarray(moments))[3][0] > 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"physics": {"kind": "rigid"}},
            "requires `normal` of every contact of type soft_finger; missing",
        ),
        ({"physics.contact.torsional_friction_m": -1}, "torsional_friction_m"),
    ],
)
def test_settings_of_soft_fingers_are_checked(changes, message):
    with pytest.raises(scenario.ScenarioError, match=message):
        python_api.load_scenario("beam", SOFT_BEAM | changes)
    with pytest.raises(scenario.ScenarioError, match="requires a contact of type soft_finger"):
        python_api.load_scenario("beam", {"physics": {"kind": "rigid", "contact": {"torsional_friction_m": 0.01}}})


@pytest.mark.long
@pytest.mark.parametrize("limit", ["friction", "max_force"])
def test_onset_in_a_flight_agrees_with_newtons_law(limit):
    """A horizontal force on the payload, or a growing mass, stops a hovering team at the analytical value within 2 %.

    The team is symmetric: with the contacts at the height of the center of mass each of three contacts bears a third of
    the horizontal force and of the weight, and the payload stays level. Tangential over normal force is F / (m g).
    """
    setup = _hovering(limit)
    rows = flight.run_experiment(setup)
    weight = 9.81 * float(setup.world.team.payload.mass)
    if limit == "friction":
        ratio = np.linalg.norm(rows.records.f_L[-1, :2]) / weight
        assert "slips" in rows.termination_reason
        np.testing.assert_allclose(ratio, float(setup.termination_limits.contacts.friction), rtol=0.02)
    else:
        mass = float(setup.world.team_at(jnp.asarray(rows.records.t[-1])).payload.mass)
        assert "max_force_N" in rows.termination_reason
        np.testing.assert_allclose(9.81 * mass / 3, float(setup.termination_limits.contacts.max_force), rtol=0.02)


def _hovering(limit: str) -> flight.Experiment:
    """Return a flight at rest in which the limit is reached slowly."""
    contacts = ((0.4, 0.0, 0.0), (-0.2, 0.34641016, 0.0), (-0.2, -0.34641016, 0.0))
    given = light.settings()
    agents = tuple(
        agent.model_copy(update={"contact_positions_m": (c,)}) for agent, c in zip(given.agents, contacts, strict=True)
    )
    raw = light.settings(agents=agents, disturbances=()).model_dump(mode="json", exclude_none=True)
    raw |= {"initial_state": {}, "nominal": {}, "reference": {**raw["reference"], "amplitude_m": [0, 0, 0]}}
    raw["sensors"] = {
        name: 0.0 for name in schema.Sensors.model_fields if name not in ("tip_force_bandwidth_Hz", "models")
    }
    if limit == "friction":
        normal = {name: [0, 0, 1] for name in NAMES}
        gust = {"amplitude_mps": [4, 0, 0], "wave_vector_radpm": [0, 0, 1e-3], "period_s": 100}
        wind = {"name": "wind", "kind": "wind", "acts_on": "payload", "linear_drag_Nspm": 1, "gusts": [gust]}
        raw |= {"physics": {"kind": "rigid", "contact": {"friction": 0.1, "normal": normal}}, "disturbances": [wind]}
    else:
        step = {"mass_kg": 0.5, "start_s": 1.0, "ramp_time_s": 8.0}
        raw |= {"physics": {"kind": "rigid", "contact": {"max_force_N": 5.5}}, "payload_mass_step": step}
    return experiment.make_experiment(scenario.Scenario.model_validate(raw), "true_residual")
