"""Test of initial states of shipped scenarios: on the manifold, off the reference as stated."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift import scenario
from colift.math import so3
from colift.models import grasp
from colift.scenario import initial_states, team, trajectories

LONG = {"beam", "seven", "leader_block"}  # longer to build than a test should take


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in scenario.shipped_names()]
)
def test_initial_states_are_on_the_manifold(name):
    """Shipped scenarios start on the manifold with the stated offset from the reference."""
    s = scenario.load_scenario(name)
    truth, _ = team.team(s)
    z = initial_states.initial_state(s, truth)
    assert np.abs(grasp.constraint_residual(truth, z)).max() <= 1e-10
    assert np.abs(grasp.constraint_rate(truth, z)).max() <= 1e-10
    d = trajectories.make_reference(s).evaluate(jnp.zeros(()))
    np.testing.assert_allclose(z.payload.p - d.p, s.initial_state.position_error_m, atol=1e-3)
    np.testing.assert_allclose(so3.log(d.R.T @ z.payload.R), np.deg2rad(s.initial_state.attitude_error_deg), atol=1e-3)


def starting(name: str, pose: str, *more: str) -> scenario.Scenario:
    """A shipped team whose reference begins at a pose and moves from there."""
    poses = f"[{{time_s: 0, {pose}}}, {{time_s: 5, position_m: [1, 0, 2], rpy_deg: [0, 0, 20]}}]"
    return scenario.load_scenario(name, [f"reference={{kind: waypoints, poses: {poses}}}", "initial_state={}", *more])


@pytest.mark.parametrize("name", ["hover", "trio", "heavy"])  # two, three and four agents
def test_a_team_starts_at_any_attitude_of_its_reference(name):
    """The configuration about the payload is the same at every heading, and a tilted payload is reached."""
    still = starting(name, "position_m: [1, -2, 2]")
    truth, _ = team.team(still)
    about_payload = initial_states.initial_state(still, truth)
    for rpy in ([0, 0, 180], [0, 0, 90], [0, 0, -135], [15, -10, 180], [0, 20, 90]):
        settings = starting(name, f"position_m: [1, -2, 2], rpy_deg: {rpy}")
        z = initial_states.initial_state(settings, truth)
        assert np.abs(grasp.constraint_residual(truth, z)).max() <= 1e-10
        turned = Rotation.from_euler("ZYX", rpy[::-1], degrees=True).as_matrix()
        np.testing.assert_allclose(z.payload.R, turned, atol=1e-3)
        if rpy[:2] == [0, 0]:
            for there, here in zip(about_payload.agents, z.agents, strict=True):
                offset = np.asarray(here.x - z.payload.p[None]) @ turned
                np.testing.assert_allclose(offset, there.x - about_payload.payload.p[None], atol=1e-6)
                np.testing.assert_allclose(here.r, there.r, atol=1e-6)
        for yaw, group in zip(trajectories.headings(settings), z.agents, strict=True):
            heading = np.arctan2(group.R[:, 1, 0], group.R[:, 0, 0])
            np.testing.assert_allclose(np.sin(heading - np.asarray(yaw)), 0, atol=1e-2)


def test_a_reference_in_motion_gives_its_velocity_to_the_team(tmp_path):
    t = 0.05 * np.arange(60)
    rows = np.column_stack([t, np.sin(t), 0 * t, 2 + 0 * t, 20 * t])
    lines = "".join(",".join(f"{x:.9f}" for x in row) + "\n" for row in rows)
    (tmp_path / "log.csv").write_text("time_s,x_m,y_m,z_m,yaw_deg\n" + lines)
    reference = f"{{kind: sampled, file: {tmp_path / 'log.csv'}}}"
    s = scenario.load_scenario("hover", [f"reference={reference}", "initial_state={velocity_mps: [0, 0.1, 0]}"])
    truth, _ = team.team(s)
    z, rest = initial_states.initial_state(s, truth), initial_states.equilibrium_state(s, truth)
    np.testing.assert_allclose(z.payload.v, [1, 0.1, 0], atol=1e-3)
    np.testing.assert_allclose(z.payload.omega, [0, 0, np.deg2rad(20)], atol=1e-3)
    assert np.abs(grasp.constraint_rate(truth, z)).max() <= 1e-10
    for group in z.agents:
        arm = np.cross([0, 0, np.deg2rad(20)], np.asarray(group.x - z.payload.p[None]))
        np.testing.assert_allclose(group.v, np.array([1, 0.1, 0]) + arm * [1, 1, 0], atol=0.02)
    for still in (rest.payload.v, rest.payload.omega, *(group.v for group in rest.agents)):
        np.testing.assert_array_equal(still, 0)
