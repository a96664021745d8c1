"""References of scenario files: turning by stated angles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.scenario import trajectories

along = jax.jit(jax.vmap(lambda path, t: path.evaluate(t), (None, 0)))


def yaw_rates(yaws: list[float], roll: float = 0.0) -> np.ndarray:
    """Body rates of a reference through poses of 2 s each, sampled along it."""
    poses = ", ".join(
        f"{{time_s: {2 * k}, position_m: [0, 0, 2], rpy_deg: [{roll}, 0, {yaw}]}}" for k, yaw in enumerate(yaws)
    )
    s = scenario.load_scenario("hover", [f"reference={{kind: waypoints, poses: [{poses}]}}"])
    t = jnp.linspace(0, 2 * (len(yaws) - 1), 200 * (len(yaws) - 1) + 1)
    return np.asarray(along(trajectories.make_reference(s), t).omega)


def turned(rates: np.ndarray) -> float:
    """Sum of the rotations about the third axis [deg]."""
    return float(np.rad2deg(np.trapezoid(rates[:, 2], dx=0.01)))


def test_angles_beyond_a_turn_go_on():
    rates = yaw_rates([90.0 * k for k in range(9)])
    assert turned(rates) == pytest.approx(720, abs=0.1)
    assert rates[:, 2].min() >= -1e-9


@pytest.mark.parametrize("sign", [1, -1])
def test_half_turns_have_the_direction_of_the_stated_angles(sign):
    for roll in (0.0, 20.0):
        assert turned(yaw_rates([0, sign * 180, sign * 360], roll)) == pytest.approx(
            sign * 360 * np.cos(np.deg2rad(roll)), abs=0.5
        )


def test_angles_that_wrap_turn_by_the_shorter_way():
    assert turned(yaw_rates([170, -170, -150])) == pytest.approx(40, abs=0.1)
