"""Tests of actuators: lag and delay in closed form, limits, and a mixer that keeps tilt before thrust before yaw."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from colift.models import actuator_lag
from colift.models.actuator_lag import ActuatorLag
from colift.models.state import AgentInput, ControlClock
from colift.simulation import actuators

DT = 0.002
CLOCK = ControlClock(t=jnp.array(0.0), dt=jnp.array(DT))


def command(u: float, tau: object = (0.0, 0.0, 0.0)) -> actuators.TeamInputs:
    """Commands of two equal agents; a joint follows the thrust."""
    both = jnp.tile(jnp.array(tau, dtype=float), (2, 1))
    return (AgentInput(u=jnp.full(2, u, dtype=float), tau=both, tau_r=jnp.full((2, 1), u, dtype=float)),)


def free() -> actuators.BoxLimits:
    return actuators.BoxLimits(thrust_max=jnp.full(2, 1e3), torque_max=jnp.full(2, jnp.inf))


def outputs(of: actuators.IdealActuators, commands: list[actuators.TeamInputs]) -> list[AgentInput]:
    """Return the outputs step by step, starting in the steady state of the first command."""
    state, out = of.init(commands[0]), []
    for each in commands:
        (acting,), state = of(each, state, CLOCK)
        out.append(acting)
    return out


def test_ideal_actuators_output_the_command():
    for acting, (reported,) in zip(
        outputs(actuators.IdealActuators(), [command(3), command(5)]), [command(3), command(5)], strict=True
    ):
        jax.tree.map(np.testing.assert_array_equal, acting, reported)


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_step_response_is_delayed_first_order_lag(delay):
    """A step is delayed and rises as a first-order lag."""
    hertz, ticks = 8.0, 40
    motors = actuators.LaggedMotors(lag=ActuatorLag(bandwidth=jnp.array(hertz), delay=delay), limits=(free(),))
    step = [command(10), *[command(20, (1.0, -2.0, 0.5))] * ticks]
    for k, acting in enumerate(outputs(motors, step)):
        risen = 1 - np.exp(-2 * np.pi * hertz * DT * max(0, k - delay))
        np.testing.assert_allclose(acting.u, 10 + 10 * risen, rtol=1e-12)
        np.testing.assert_allclose(acting.tau[0], risen * np.array([1.0, -2.0, 0.5]), atol=1e-12)
        np.testing.assert_array_equal(acting.tau_r, step[k][0].tau_r)  # joints have no motor lag


def test_box_limits_thrust_and_torque():
    box = actuators.BoxLimits(thrust_max=jnp.array([5.0, 50.0]), torque_max=jnp.array([1.0, 0.1]))
    u, tau = box(jnp.array([7.0, -1.0]), jnp.array([[2.0, -0.5, -3.0], [0.05, 0.2, -0.2]]))
    np.testing.assert_array_equal(u, [5.0, 0.0])
    np.testing.assert_allclose(tau, [[1.0, -0.5, -1.0], [0.05, 0.1, -0.1]])


def ring(count: int, most: float = 5.0) -> actuator_lag.RotorMixer:
    return actuator_lag.ring_mixer(count, arm=0.3, yaw=0.02, force_max=jnp.array([most]))


wrenches = st.tuples(st.floats(-5, 40), *[st.floats(-3, 3)] * 2, st.floats(-0.6, 0.6)).map(np.array)


@given(count=st.sampled_from([4, 6, 8]), asked=wrenches)
def test_rotor_limits_keep_directions_and_limits(count, asked):
    """Rotors stay within their limits; tilt and yaw keep direction and sign, and neither grows."""
    of = ring(count)
    u, tau = of(jnp.array(asked[:1]), jnp.array(asked[None, 1:]))
    got = np.concatenate([np.asarray(u), np.asarray(tau)[0]])
    B = np.asarray(of.effectiveness)
    f = np.linalg.pinv(B) @ got
    assert f.min() > -1e-9
    assert f.max() < 5 + 1e-9
    np.testing.assert_allclose(B @ f, got, atol=1e-9)
    tilt = np.linalg.norm(asked[1:3])
    k = got[1:3] @ asked[1:3] / tilt**2 if tilt > 1e-9 else 1.0  # for less, all shares agree to 1e-9
    np.testing.assert_allclose(got[1:3], k * asked[1:3], atol=1e-9)
    slack = 1e-9 + 1e-14 / max(tilt, 1e-9)  # a torque is rounded to 1e-14 N m
    assert -slack <= k <= 1 + slack
    s = got[3] / asked[3] if abs(asked[3]) > 1e-6 else 1.0
    assert -1e-6 <= s <= 1 + 1e-6
    if k < 1 - 1e-6 and np.abs(asked[1:3]).max() > 1e-3:  # tilt was reduced: it uses the range of a rotor
        np.testing.assert_allclose(np.ptp(np.linalg.pinv(B)[:, 1:3] @ got[1:3]), 5, rtol=1e-6)


@given(asked=wrenches)
def test_four_rotors_follow_the_priorities(asked):
    """Against linear programs: most tilt at any thrust, yaw within its margin, nearest thrust, then the most yaw."""
    of = ring(4)
    u, tau = of(jnp.array(asked[:1]), jnp.array(asked[None, 1:]))
    f_tilt, f_yaw = (np.asarray(of.mixer) @ part for part in ([0, *asked[1:3], 0], [0, 0, 0, asked[3]]))

    def most(base: np.ndarray, part: np.ndarray, thrust: float | None, limit: float = 1.0) -> float:
        """Largest share of a part, with a given thrust or with any."""
        rows = np.column_stack([part, np.full(4, 0.25)])
        found = linprog(
            [-1.0, 0.0],
            A_ub=np.vstack([rows, -rows]),
            b_ub=np.concatenate([5 - base, base]) + 1e-12,
            bounds=[(0, limit), (thrust, thrust)],
        )
        return found.x[0]

    k = most(np.zeros(4), f_tilt, None)
    margin = min(1.0, actuator_lag.YAW_MARGIN * 5 / max(np.abs(f_yaw).max(), 1e-12))
    first = most(k * f_tilt, f_yaw, None, margin)
    base = k * f_tilt + first * f_yaw
    least, highest = -4 * base.min(), 4 * (5 - base.max())
    thrust = np.clip(asked[0], least, max(highest, least))
    s = first + most(base, f_yaw, thrust, 1 - first)
    np.testing.assert_allclose(np.asarray(u)[0], thrust, atol=1e-6)
    np.testing.assert_allclose(np.asarray(tau)[0, :2], k * asked[1:3], atol=1e-6)
    np.testing.assert_allclose(np.asarray(tau)[0, 2], s * asked[3], atol=1e-6)


@given(count=st.sampled_from([4, 6]), asked=wrenches)
def test_feasible_commands_are_realized(count, asked):
    of = ring(count)
    f, base = np.asarray(of.mixer) @ asked, np.asarray(of.mixer)[:, :3] @ asked[:3]
    u, tau = of(jnp.array(asked[:1]), jnp.array(asked[None, 1:]))
    if min(f.min(), base.min()) >= 0 and max(f.max(), base.max()) <= 5:  # thrust and tilt alone are feasible as well
        np.testing.assert_allclose(np.concatenate([u, np.asarray(tau)[0]]), asked, atol=1e-9)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_uncontrollable_rotor_rings_are_refused(count):
    with pytest.raises(ValueError, match="must be even and at least 4"):
        actuator_lag.ring_mixer(count, 0.3, 0.02, jnp.array([5.0]))
