"""Tests of termination limits against rules in plain Python, and of hover thrust against statics."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colift.closed_loop import termination
from colift.closed_loop.termination import MonitoredValues, TerminationCause, TerminationLimits
from colift.models.state import GeneralizedForce, ResidualForces, Wrench
from colift.onboard.control import allocation
from tests.support import random_teams as teams

AGENTS = 3
NAMES = ("east", "north", "west")
LIMITS = TerminationLimits(
    min_delassus=jnp.array([0.1, 0.2, 0.3]),
    max_distance=jnp.array(3.0),
    min_height=jnp.array(0.5),
    max_attitude_error=jnp.array(1.5),
    max_tilt=jnp.array(1.2),
    max_saturation_time=jnp.array(2.0),
)
exceeded = jax.jit(termination.check_termination)


def monitored(
    finite: bool,
    delassus: list[float],
    distance: float,
    heights: list[float],
    attitude: float,
    tilt: list,
    saturated: list,
) -> MonitoredValues:
    return MonitoredValues(
        finite=jnp.asarray(finite),
        delassus=jnp.asarray(delassus),
        distance=jnp.asarray(distance),
        heights=jnp.asarray(heights),
        attitude=jnp.asarray(attitude),
        tilt=jnp.asarray(tilt),
        saturated=jnp.asarray(saturated),
    )


def near_limit(limit: float, n: int) -> st.SearchStrategy:
    """Strategy of values that are mostly admissible: below, at and above a limit."""
    near = [limit, limit * (1 + 1e-12), limit * (1 - 1e-12), 0.0, limit / 2, limit * 2]
    return st.lists(st.sampled_from(near), min_size=n, max_size=n)


@given(
    finite=st.sampled_from([True, True, True, False]),
    delassus=near_limit(0.2, AGENTS),
    distance=near_limit(3.0, 1),
    heights=near_limit(0.5, 1 + AGENTS),
    attitude=near_limit(1.5, 1),
    tilt=near_limit(1.2, AGENTS),
    saturated=near_limit(2.0, AGENTS),
)
def test_first_exceeded_limit_ends_a_flight(finite, delassus, distance, heights, attitude, tilt, saturated):
    causes = [
        not finite,
        any(g <= least for g, least in zip(delassus, (0.1, 0.2, 0.3), strict=True)),
        distance[0] > 3.0,
        any(h < 0.5 for h in heights),
        attitude[0] > 1.5,
        any(x > 1.2 for x in tilt),
        any(x > 2.0 for x in saturated),
    ]
    expected = next((TerminationCause(1 + k) for k, met in enumerate(causes) if met), TerminationCause.NONE)
    assert (
        TerminationCause(
            int(exceeded(LIMITS, monitored(finite, delassus, distance[0], heights, attitude[0], tilt, saturated)))
        )
        == expected
    )


FINE = (True, [1.0] * 3, 0.1, [2.0] * 4, 0.1, [0.1] * 3, [0.0] * 3)


def test_flight_within_limits_or_without_limits_continues():
    """A flight within its limits continues, and so does any flight without limits."""
    assert int(exceeded(LIMITS, monitored(*FINE))) == TerminationCause.NONE
    none = TerminationLimits(
        min_delassus=jnp.full(3, -1.0),
        max_distance=jnp.array(np.inf),
        min_height=jnp.array(-np.inf),
        max_attitude_error=jnp.array(np.inf),
        max_tilt=jnp.array(np.inf),
        max_saturation_time=jnp.array(np.inf),
    )
    exceeding = monitored(True, [0.0] * 3, 1e300, [-1e300] * 4, np.pi, [np.pi] * 3, [1e300] * 3)
    assert int(exceeded(none, exceeding)) == TerminationCause.NONE


@pytest.mark.parametrize(
    ("part", "value", "message"),
    [
        (2, 4.0, "the payload is 4 m from its reference at t = 1.500 s, beyond termination.max_position_error_m = 3"),
        (
            3,
            [0.4, 2, 2, 2],
            "the payload is at a height of 0.4 m at t = 1.500 s, beyond termination.min_height_m = 0.5",
        ),
        (
            3,
            [0.4, 2, 0.2, 2],
            "agent north is at a height of 0.2 m at t = 1.500 s, beyond termination.min_height_m = 0.5",
        ),
        (
            4,
            np.pi,
            "the attitude error of the payload is 180 deg at t = 1.500 s, "
            "beyond termination.max_attitude_error_deg = 85.9437",
        ),
        (
            5,
            [0, 1.3, np.pi / 2],
            "the thrust of agent west is 90 deg from the vertical at t = 1.500 s, "
            "beyond termination.max_tilt_deg = 68.7549",
        ),
        (
            6,
            [2.1, 0, 2.05],
            "the thrust of agent east is at its limit for 2.1 s at t = 1.500 s, "
            "beyond termination.max_saturation_time_s = 2",
        ),
    ],
)
def test_message_names_body_value_and_setting(part, value, message):
    """The message names the worst body, its value and the setting."""
    now = monitored(*(value if k == part else x for k, x in enumerate(FINE)))
    cause = TerminationCause(int(exceeded(LIMITS, now)))
    assert termination.format_cause(cause, LIMITS, jax.tree.map(np.asarray, now), 1.5, NAMES) == message


@pytest.mark.parametrize("seed", range(4))
def test_hover_thrusts_satisfy_statics(seed):
    """Forces and moments: each thrust carries its agent and the allocated contact forces."""
    rng = np.random.default_rng(seed)
    team = teams.reference_team(3)
    c = np.array(
        [point for group in team.agent_groups for agent in group.contact_position for point in np.asarray(agent)]
    )
    experiment = allocation.least_squares_allocation(c)
    R = teams.rotation(rng)
    eta, F, tau, f_x = rng.normal(size=12), rng.normal(size=3), 0.1 * rng.normal(size=3), rng.normal(size=(3, 3))
    f = ResidualForces(
        agents=(GeneralizedForce(f_x=jnp.asarray(f_x), f_w=jnp.zeros((3, 3)), f_r=jnp.zeros((3, 3))),),
        payload=Wrench(F=jnp.asarray(F), tau=jnp.asarray(tau)),
    )
    W = Wrench(F=-team.payload.mass * team.gravity - f.payload.F, tau=-f.payload.tau)
    forces = allocation.allocate(experiment, jnp.asarray(R), W, jnp.asarray(eta))
    u = np.asarray(termination.hover_thrust(team, forces, f))
    pull = np.array([0, 0, -9.81])
    G = np.concatenate([np.concatenate([np.eye(3), np.cross(np.eye(3), point)]) for point in c], axis=1)
    expected = -np.concatenate([R.T @ (1.5 * pull + F), tau])
    lam = np.linalg.lstsq(G, expected)[0] + np.asarray(experiment.nullspace) @ eta
    lam = (lam.reshape(3, 2, 3) @ R.T).sum(1)
    np.testing.assert_allclose(lam.sum(0), -(1.5 * pull + F), atol=1e-12)
    np.testing.assert_allclose(u, np.linalg.norm(lam - 1.84 * pull - f_x, axis=1), rtol=1e-12)
