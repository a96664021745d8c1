"""Tests of the exported MuJoCo model: bodies, names, coordinates, mass matrices, contacts and command."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import jax
import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from colift import scenario
from colift.cli.app import app
from colift.models import aerial_manipulator, mjcf
from colift.scenario import initial_states, team
from tests.support import random_teams as teams
from tests.support.pinocchio_team import PinocchioTeam, take

SEEDS = range(2)
STRUCTURES = (teams.POOL[1], teams.POOL[3], teams.POOL[4])


def loaded(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the loaded model and its data at the keyframe after `mj_forward`."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    return model, data


@pytest.fixture(params=[(s, seed) for s in STRUCTURES for seed in SEEDS], ids=str, scope="module")
def case(request: pytest.FixtureRequest) -> SimpleNamespace:
    structure, seed = request.param
    rng = np.random.default_rng(seed)
    team, z = PinocchioTeam(teams.team(rng, structure)).on_grasp(teams.free_state(rng, structure))
    model, data = loaded(mjcf.to_mjcf(team, z))
    groups = zip(team.agent_groups, z.agents, team.sizes, strict=True)
    agents = [(take(group, j), take(q, j)) for group, q, size in groups for j in range(size)]
    return SimpleNamespace(team=team, z=z, model=model, data=data, agents=agents)


def test_keyframe_equals_the_state(case: SimpleNamespace) -> None:
    d, load = case.data, case.z.payload
    for j, (agent, q) in enumerate(case.agents):
        base = d.body(f"agent {j + 1}")
        np.testing.assert_allclose(base.xmat.reshape(3, 3), q.R, atol=1e-14)
        np.testing.assert_allclose(base.subtree_com, q.x, atol=1e-13)
        np.testing.assert_allclose(base.subtree_linvel, q.v, atol=1e-13)
        np.testing.assert_array_equal(d.joint(f"agent {j + 1}").qvel[3:], q.omega)
        for k in range(agent.tree.joints):
            joint = d.joint(f"agent {j + 1}/joint {k + 1}")
            np.testing.assert_array_equal([*joint.qpos, *joint.qvel], [q.r[k], q.r_dot[k]])
    body, free = d.body("payload"), d.joint("payload")
    np.testing.assert_allclose(body.xmat.reshape(3, 3), load.R, atol=1e-14)
    np.testing.assert_array_equal(free.qpos[:3], load.p)
    np.testing.assert_array_equal(free.qvel, np.concatenate([load.v, load.omega]))


def test_masses_and_inertias_equal_those_of_colift(case: SimpleNamespace) -> None:
    m = case.model
    for j, (agent, _) in enumerate(case.agents):
        names = [f"agent {j + 1}", *(f"agent {j + 1}/joint {k + 1}" for k in range(agent.tree.joints))]
        for i, name in enumerate(names):
            body = m.body(name)
            np.testing.assert_allclose(body.mass[0], agent.mass[i], rtol=1e-15)
            np.testing.assert_allclose(inertia(body), agent.inertia[i], atol=1e-10 * np.abs(agent.inertia[i]).max())
    load = m.body("payload")
    np.testing.assert_allclose(inertia(load), case.team.payload.inertia, atol=1e-10 * load.inertia.max())
    assert m.body_mass.sum() == pytest.approx(
        float(case.team.payload.mass) + sum(agent.mass.sum() for agent, _ in case.agents), rel=1e-14
    )


def inertia(body: object) -> np.ndarray:
    """Return the inertia about the center of mass in the body frame, from MuJoCo's principal axes."""
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, body.iquat)
    return R.reshape(3, 3) @ np.diag(body.inertia) @ R.reshape(3, 3).T


def test_mass_matrix_equals_that_of_colift(case: SimpleNamespace) -> None:
    """`T^T diag(m, M_bar) T` with `v = v_o - R B xi` of the center of mass; blocks between bodies are zero."""
    m, d = case.model, case.data
    M = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(m, d, M)
    ours = np.zeros_like(M)
    load = m.joint("payload").dofadr[0] + np.arange(6)
    ours[np.ix_(load[:3], load[:3])] = float(case.team.payload.mass) * np.eye(3)
    ours[np.ix_(load[3:], load[3:])] = case.team.payload.inertia
    j = 0
    for group, state, size in zip(case.team.agent_groups, case.z.agents, case.team.sizes, strict=True):
        mass, M_bar, base = (np.asarray(x) for x in reduced(group, state))
        for own in range(size):
            j += 1
            names = [f"agent {j}/joint {k + 1}" for k in range(group.tree.joints)]
            at = np.array([*(m.joint(f"agent {j}").dofadr[0] + np.arange(6)), *(m.joint(n).dofadr[0] for n in names)])
            T = np.eye(len(at))
            T[:3, 3:] = -np.asarray(state.R)[own] @ base[own]
            block = np.zeros((len(at), len(at)))
            block[:3, :3], block[3:, 3:] = mass[own] * np.eye(3), M_bar[own]
            ours[np.ix_(at, at)] = T.T @ block @ T
    np.testing.assert_allclose(M, ours, atol=1e-10 * np.abs(ours).max())


@jax.jit
def reduced(group: object, state: object) -> tuple[jax.Array, jax.Array, jax.Array]:
    q = jax.vmap(
        lambda agent, r: aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r))
    )(group, state.r)
    return q.mass, q.M_bar, q.J_base


def test_contacts_are_closed_on_the_grasp(case: SimpleNamespace) -> None:
    """On the grasp the contacts are closed and at rest, and there are no other contacts."""
    m, d, contacts = case.model, case.data, case.team.contacts
    assert m.neq == contacts
    assert (d.nefc, d.ncon) == (3 * contacts, 0)
    assert np.abs(d.efc_pos).max() < 1e-12
    assert np.abs(d.efc_vel).max() < 1e-12
    assert not m.geom_contype.any()
    assert not m.geom_conaffinity.any()


def test_contact_parameters_are_at_mujocos_bounds() -> None:
    assert mjcf.RIGID_CONTACT.impedance == mujoco.mjMAXIMP
    team, z = teams.reference_team(), teams.reference_guess()
    R, pull = [], []
    for part in (0.5, 1.0, 2.0):
        softness = mjcf.ContactSoftness(time_constant=part * 2 * mjcf.TIMESTEP)
        d = loaded(mjcf.to_mjcf(team, z, softness=softness))[1]
        R.append(d.efc_R.copy())
        pull.append(d.efc_KBIP[0, 0])
    np.testing.assert_array_equal(R[0], R[2])
    assert pull[0] == pull[1] == pytest.approx(4 * pull[2])


def test_payload_box_has_the_payload_inertia() -> None:
    """`J_a = m (b^2 + c^2) / 3` of a box with half edges a, b, c."""
    team, z = teams.reference_team(), teams.reference_guess()
    m, _ = loaded(mjcf.to_mjcf(team, z))
    (box,) = [i for i in range(m.ngeom) if m.geom_bodyid[i] == m.body("payload").id]
    a, b, c = m.geom_size[box] ** 2
    np.testing.assert_allclose(np.diag([b + c, a + c, a + b]) / 2, np.asarray(team.payload.inertia), rtol=1e-12)


# The command ----------------------------------------------------------------------------------------------------------


def test_command_writes_names_start_and_limits(tmp_path: Path) -> None:
    out = tmp_path / "paper.xml"
    done = CliRunner().invoke(app, ["export", "mjcf", "paper", "--out", str(out)], catch_exceptions=False)
    assert (done.exit_code, done.stdout) == (0, f"paper is in {out}\n")
    m, d = loaded(out.read_text())
    for name in ("front", "front/waist", "rear/left"):
        assert m.body(name).id
        assert m.joint(name).id
    for name in ("front/left", "rear/right"):
        connect = m.equality(name)
        assert {m.site(name).id, m.site(f"payload/{name}").id} == {connect.obj1id[0], connect.obj2id[0]}
    np.testing.assert_array_equal(m.actuator("front thrust").ctrlrange, [0, 50])
    settings = scenario.load_scenario("paper")
    truth, _ = team.team(settings)
    z = initial_states.initial_state(settings, truth)
    np.testing.assert_array_equal(d.joint("payload").qpos[:3], z.payload.p)
    np.testing.assert_allclose(d.body("rear").subtree_com, z.agents[0].x[1], atol=1e-14)
    np.testing.assert_array_equal(m.opt.gravity, settings.gravity_mps2)


def test_command_prints_model_and_reports_errors(tmp_path: Path) -> None:
    """The command prints the model by default and reports an error in one line."""
    done = CliRunner().invoke(app, ["export", "mjcf", "paper"], catch_exceptions=False)
    assert done.exit_code == 0
    assert mujoco.MjModel.from_xml_string(done.stdout).nv == 24
    for arguments in (["papr"], ["paper", "--out", str(tmp_path / "none" / "x.xml")]):
        done = CliRunner().invoke(app, ["export", "mjcf", *arguments], catch_exceptions=False)
        assert (done.exit_code, done.stderr.count("\n")) == (2, 1)


def test_actuators_have_the_virtual_work_of_the_inputs() -> None:
    """Virtual work of the actuators: `u e3 . R^T v_o + tau . omega + tau_r . r_dot`."""
    rng = np.random.default_rng(0)
    structure = teams.POOL[3]
    team, z = PinocchioTeam(teams.team(rng, structure)).on_grasp(teams.free_state(rng, structure))
    m, d = loaded(mjcf.to_mjcf(team, z))
    d.ctrl[:] = rng.uniform(0, 20, m.nu)
    mujoco.mj_forward(m, d)
    work, j = 0.0, 0
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        for _ in range(size):
            j += 1
            free, R = d.joint(f"agent {j}"), d.body(f"agent {j}").xmat.reshape(3, 3)
            work += d.actuator(f"agent {j} thrust").ctrl[0] * R[:, 2] @ free.qvel[:3]
            work += sum(
                d.actuator(f"agent {j} torque {a}").ctrl[0] * w for a, w in zip("xyz", free.qvel[3:], strict=True)
            )
            for k in range(group.tree.joints):
                name = f"agent {j}/joint {k + 1}"
                work += d.actuator(name).ctrl[0] * d.joint(name).qvel[0]
    assert d.qfrc_actuator @ d.qvel == pytest.approx(work, rel=1e-12)


def test_contacts_that_bear_moments_are_refused() -> None:
    settings = scenario.load_scenario("rigid_beam")
    truth, _ = team.team(settings)
    with pytest.raises(ValueError, match="contacts of type soft_finger or rigid are not supported"):
        mjcf.to_mjcf(truth, initial_states.equilibrium_state(settings, truth))


def test_number_of_names_is_checked() -> None:
    team, z = teams.reference_team(), teams.reference_guess()
    with pytest.raises(ValueError, match="names: 1 given for 2 agents"):
        mjcf.to_mjcf(team, z, ("one",))
    with pytest.raises(ValueError, match="joints: 1 given for 6"):
        mjcf.to_mjcf(team, z, joints=("one",))
    with pytest.raises(ValueError, match="contacts: 5 given for 4"):
        mjcf.to_mjcf(team, z, contacts=tuple("abcde"))


def test_model_is_written_without_mujoco() -> None:
    code = "import sys, colift.models.mjcf; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=300, check=False).returncode == 0
