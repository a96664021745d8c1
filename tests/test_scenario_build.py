"""From settings to what a run starts from: units, frames, names and order, against the numbers written elsewhere."""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift import disturbance, gp, grasp, learn, scenario, simulate, so3, study
from colift.model import Residual, State, no_force
from colift.scenario import ScenarioError, Settings, build
from colift.scenario.references import log_numbers, model_outputs
from tests import teams


def changed(name: str, **sections: object) -> Settings:
    """A shipped scenario with some sections replaced, validated again."""
    return Settings.model_validate(scenario.load(name).model_dump() | sections)


def bar(joints: list[dict], tips: list[str]) -> dict:
    """An agent type with a given tree; the numbers do not matter."""
    body = {"mass_kg": 0.1, "inertia_kgm2": [1e-3, 1e-3, 1e-3]}
    return {
        "base": {"mass_kg": 1.0, "inertia_kgm2": [0.02, 0.02, 0.03]},
        "thrust_max_N": 40,
        "joints": [{"axis": [0, 3, 4], "body": body} | joint for joint in joints],
        "arms": [{"name": f"a{i}", "joint": tip, "tip_m": [0, 0, -0.2]} for i, tip in enumerate(tips)],
    }


MIXED = {
    "agent_types": {
        "crane": bar([{"name": "hook", "type": "prismatic", "rest_m": 0.3}], ["hook"]),
        "claw": bar(
            [{"name": "f", "type": "revolute"}, {"name": "g", "type": "revolute", "parent": "f"}], ["g", "base"]
        ),
        "big_crane": bar([{"name": "winch", "type": "prismatic", "rpy_deg": [10, 20, 30]}], ["winch"]),
    },
    "agents": [
        {"name": "a", "type": "crane", "contacts_m": [[1, 0, 0]]},
        {"name": "b", "type": "claw", "yaw_deg": 90, "contacts_m": [[0, 1, 0], [0, 1, 0.1]]},
        {"name": "c", "type": "big_crane", "yaw_deg": -90, "contacts_m": [[-1, 0, 0]]},
    ],
    "nominal": {"agent_types": {"big_crane": {"joints": {"winch": {"mass_kg": 0.2, "inertia_kgm2": [1, 1, 1]}}}}},
    "disturbances": [
        {"name": "push", "kind": "constant", "acts_on": "c", "body": "winch", "force_N": [1, 2, 3]},
        {"name": "bias", "kind": "rotor_bias", "acts_on": "agents", "thrust_N": 0.5},
        {"name": "rub", "kind": "joint_friction", "acts_on": "b", "viscous_Nms": 0.3, "coulomb_Nm": 0.1},
    ],
    "allocation": {"kind": "balanced"},
}


@pytest.fixture(scope="module")
def mixed() -> Settings:
    return changed("paper", **MIXED)


def test_the_study_has_the_reference_team():
    truth, nominal = build.team(scenario.load("paper"))
    expected = teams.reference_team()
    order = jnp.array([1, 0])  # the scenario counts from the front
    group = jax.tree.map(lambda leaf: leaf[order], expected.groups[0])
    jax.tree.map(np.testing.assert_allclose, truth.groups[0], group)
    jax.tree.map(np.testing.assert_allclose, truth.payload, expected.payload)
    np.testing.assert_array_equal(truth.gravity, expected.gravity)
    jax.tree.map(np.testing.assert_array_equal, nominal.groups, truth.groups)
    assert float(nominal.payload.mass) == 1.2
    np.testing.assert_array_equal(nominal.payload.inertia, np.diag([0.03, 0.12, 0.15]))


@pytest.mark.parametrize("name", scenario.names())
def test_shipped_scenarios_start_on_the_manifold_as_far_off_as_they_say(name):
    s = scenario.load(name)
    truth, _ = build.team(s)
    z = build.start(s, truth)
    assert np.abs(grasp.Phi(truth, z)).max() <= 1e-10
    assert np.abs(grasp.Phi_dot(truth, z)).max() <= 1e-10
    d = build.path(s).at(jnp.zeros(()))
    np.testing.assert_allclose(z.payload.p - d.p, s.start.position_error_m, atol=1e-3)
    np.testing.assert_allclose(so3.log(d.R.T @ z.payload.R), np.deg2rad(s.start.attitude_error_deg), atol=1e-3)


@pytest.mark.parametrize("name", [name for name in scenario.names() if scenario.load(name).allocation.internal])
def test_internal_forces_of_shipped_scenarios_are_felt_and_leave_the_wrench_alone(name):
    s = scenario.load(name)
    _, nominal = build.team(s)
    plan, internal = build.allocation(s, nominal)
    lam = np.asarray(plan.kernel @ internal.eta)
    assert np.linalg.norm(lam) >= 1
    assert np.linalg.norm(lam.reshape(-1, 3), axis=1).max() >= 0.5
    G = np.asarray(grasp.matrix(grasp.contacts(nominal), jnp.eye(3)))
    assert np.abs(G @ lam).max() <= 1e-12
    assert (float(internal.start), float(internal.end)) == (8, 14)


def test_asking_for_internal_forces_that_do_not_exist_is_an_error_that_says_so():
    leaders = {"kind": "leader_follower", "leader_contacts": ["front/left", "front/right", "rear/left"]}
    internal = scenario.load("paper").allocation.internal
    assert internal is not None
    s = changed("paper", allocation=leaders)
    _, nominal = build.team(s)
    assert build.allocation(s, nominal)[0].kernel.shape == (12, 0)
    with pytest.raises(ScenarioError, match="no internal force"):
        build.allocation(changed("paper", allocation=leaders | {"internal": internal.model_dump()}), nominal)


def test_a_leader_block_that_cannot_carry_every_wrench_is_refused():
    s = changed("paper", allocation={"kind": "leader_follower", "leader_contacts": ["front/left", "front/right"]})
    with pytest.raises(ScenarioError, match="rank 5"):
        build.allocation(s, build.team(s)[1])


def test_agents_of_one_structure_form_a_group_and_names_follow(mixed):
    truth, nominal = build.team(mixed)
    assert build.agent_names(mixed) == ("a", "c", "b")
    assert build.contact_names(mixed) == ("a/a0", "c/a0", "b/a0", "b/a1")
    assert truth.sizes == (2, 1)
    np.testing.assert_array_equal(grasp.contacts(truth), [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 1, 0.1]])
    assert truth.groups[0].tree.prismatic == (True,)
    assert truth.groups[1].tree.tips == (2, 0)
    np.testing.assert_allclose(truth.groups[1].joint_axis[0], [[0, 0.6, 0.8]] * 2)
    np.testing.assert_allclose(np.concatenate(build.heading(mixed)), [0, -np.pi / 2, np.pi / 2])
    np.testing.assert_array_equal(build.rest(mixed)[0], [[0.3], [0]])
    assert nominal.groups[0].mass[1, 1] == 0.2
    assert truth.groups[0].mass[1, 1] == nominal.groups[0].mass[0, 1] == 0.1


def test_roll_pitch_yaw_are_about_the_fixed_axes_in_this_order(mixed):
    expected = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix()
    np.testing.assert_allclose(build.team(mixed)[0].groups[0].joint_rotation[1, 0], expected, atol=1e-15)


def test_sources_act_on_the_agents_and_bodies_that_they_name(mixed):
    truth, _ = build.team(mixed)
    z = teams.free_state(
        np.random.default_rng(0), tuple((g.tree, n) for g, n in zip(truth.groups, truth.sizes, strict=True))
    )
    felt = disturbance.at_start(build.disturbances(mixed), truth, z)
    up = [np.asarray(q.R[:, :, 2]) for q in z.agents]
    np.testing.assert_allclose(felt.agents[0].f_x, 0.5 * up[0] + np.array([[0, 0, 0], [1, 2, 3]]))
    np.testing.assert_allclose(felt.agents[1].f_x, 0.5 * up[1])
    # on crane a the bias alone: at the base, off the centre of mass by the hook's share of the mass
    np.testing.assert_allclose(felt.agents[0].f_r[0], [-0.5 * 0.8 * 0.1 / 1.1])
    r_dot = z.agents[1].r_dot[0]
    np.testing.assert_allclose(felt.agents[1].f_r[0], -0.3 * r_dot - 0.1 * np.tanh(r_dot / 0.05))
    assert np.abs(felt.payload.F).max() == 0


def test_sensors_and_pilot_are_in_SI():
    s = scenario.load("paper")
    noise = build.sensors(s)
    np.testing.assert_allclose(noise.attitude, 0.2 * np.pi / 180)
    np.testing.assert_allclose(noise.joint, 0.1 * np.pi / 180)
    pilot = build.pilot(s, build.team(s)[1])
    np.testing.assert_allclose(pilot.recorder.every, 1 / s.learning.sample_Hz)
    np.testing.assert_array_equal(pilot.leader.gains.K_p, np.diag(s.control.K_p))
    assert not bool(pilot.recorder.payload)
    assert all(leaf.dtype in (jnp.float64, int, bool) and not leaf.weak_type for leaf in jax.tree.leaves(pilot))


def test_before_any_data_the_models_state_the_scenario_s_deviations():
    s = scenario.load("paper")
    prior = s.learning.agents
    oracle = build.prior(s, build.team(s)[1])
    expected = np.repeat([prior.force_N, prior.moment_Nm, prior.joint_Nm], 3) ** 2
    variance = jax.vmap(gp.variance)(oracle.agents[0], jnp.ones((2, 24)))
    np.testing.assert_allclose(variance, np.tile(expected, (2, 1)))
    assert np.abs(gp.mean(oracle.payload, jnp.ones(20))).max() == 0


# What error bounds rest on --------------------------------------------------------------------------------------------


def test_error_bounds_rest_on_what_the_scenario_states():
    s = scenario.load("paper")
    _, nominal = build.team(s)
    stated = build.stated(s, nominal, no_force(nominal))
    given = s.certificate
    assert (stated.bound, stated.confidence, stated.norm) == ("energy", 0.95, 6)
    assert given.payload is not None
    assert given.agents is not None
    np.testing.assert_array_equal(stated.payload, [given.payload.force_N] * 3 + [given.payload.moment_Nm] * 3)
    row = [given.agents.force_N] * 3 + [given.agents.moment_Nm] * 3 + [given.agents.joint_Nm] * 3
    np.testing.assert_array_equal(stated.agents[0], [row, row])
    assert stated.assumed == ("norm", "energy")  # of a team among winds nobody knows them


def test_label_errors_that_are_not_stated_are_three_deviations_of_the_prior_s_noise():
    s = changed("paper", certificate={})
    _, nominal = build.team(s)
    stated = build.stated(s, nominal, no_force(nominal))
    noise = s.learning.agents
    np.testing.assert_allclose(stated.payload, [0.3] * 3 + [0.06] * 3)
    row = 3 * np.repeat([noise.force_noise_N, noise.moment_noise_Nm, noise.joint_noise_Nm], 3)
    np.testing.assert_allclose(stated.agents[0], [row, row])


def test_in_the_certified_scenario_nothing_is_assumed_unless_it_is_changed():
    def assumed(**sections: object) -> tuple[str, ...]:
        return study.plan(changed("certified", **sections), "C1").stated.assumed

    certified = scenario.load("certified")
    assert certified.drawn is not None
    norm, learning = certified.drawn.norm, certified.learning.model_dump()
    bounds = ("energy", "srinivas", "abbasi_yadkori", "chowdhury_gopalan", "fiedler")
    for bound in bounds:
        assert assumed(certificate={"bound": bound, "norm": norm}) == ()
    assert assumed(certificate={"norm": 0.9 * norm}) == ("norm",)
    assert assumed(disturbances=scenario.load("paper").disturbances) == ("norm",)
    assert assumed(nominal={"payload": scenario.load("paper").payload.model_dump() | {"mass_kg": 1.2}}) == ("norm",)
    assert assumed(drawn=None, learning=learning | {"samples": "estimated"}) == ("norm", "energy")
    fitted = {
        "certificate": {"bound": "abbasi_yadkori", "norm": norm},
        "learning": learning | {"hyperparameters": "fitted"},
    }
    assert assumed(**fitted) == ("norm", "stated")
    small = {"force_N": 1e-6, "moment_Nm": 1e-6}
    assert assumed(certificate={"norm": norm, "payload": small}) == ("energy",)


def test_a_label_error_of_zero_is_refused():
    learning = scenario.load("certified").learning.model_dump() | {"rig_error": 0.0}
    with pytest.raises(ScenarioError, match=r"certificate: label error .* must be positive"):
        study.plan(changed("certified", learning=learning), "C1")


# Unknown forces of known norm -----------------------------------------------------------------------------------------


SEEDED = {"norm": 1.7, "centers": 6, "spread": 0.0}


def drawn(**sections: object) -> tuple[learn.Oracle, Residual, Settings]:
    """What `certified` draws with few kernels on the reference itself."""
    s = changed("certified", drawn=SEEDED, **sections)
    truth, _ = build.team(s)
    found = build.drawn(s, truth, start())
    assert found is not None
    return *found, s


@functools.cache
def start() -> State:
    """The team of `certified` where it starts."""
    s = scenario.load("certified")
    return build.start(s, build.team(s)[0])


def functions(oracle: learn.Oracle) -> list[gp.GP]:
    """The bodies' functions one by one."""
    (group,) = oracle.agents
    return [oracle.payload, *(jax.tree.map(lambda x, j=j: x[j], group) for j in range(len(group.n)))]


def correlations(X: np.ndarray, Z: np.ndarray, ls: np.ndarray) -> np.ndarray:
    """`exp(-|x - z|^2 / 2)` in length-scales, entry by entry."""
    return np.exp(-0.5 * (((X[:, None] - Z[None]) / ls) ** 2).sum(-1))


@pytest.mark.parametrize("spread", [0.0, 0.3])
def test_every_output_of_every_body_has_exactly_the_norm_that_is_stated(spread):
    s = changed("certified", drawn=SEEDED | {"spread": spread})
    truth, _ = build.team(s)
    found = build.drawn(s, truth, start())
    assert found is not None
    for f, outputs in zip(functions(found[0]), (6, 9, 9), strict=True):
        assert int(f.n) == 6
        X, alpha = np.asarray(f.X)[:6], np.asarray(f.alpha)[:, :6]
        for i in range(outputs):
            K = float(f.hyper.signal_variance[i]) * correlations(X, X, np.asarray(f.hyper.lengthscales)[i])
            np.testing.assert_allclose(np.sqrt(alpha[i] @ K @ alpha[i]), 1.7, rtol=1e-9)
            values = K @ alpha[i]
            assert np.abs(values).max() <= 1.7 * float(f.hyper.signal_variance[i]) ** 0.5


def test_what_is_drawn_depends_on_the_seed_alone():
    first, deviation, _ = drawn()
    again, _, _ = drawn(certificate={"norm": 9.0})
    other, _, _ = drawn(seed=1)
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert not np.isclose(first.payload.alpha[:, :6], other.payload.alpha[:, :6]).any()
    assert not np.isclose(first.agents[0].X[:, :6, 9:12], other.agents[0].X[:, :6, 9:12]).any()
    agents = np.asarray(first.agents[0].alpha)[:, :, :6]
    assert not np.isclose(agents[0], agents[1]).any()  # unlike agents
    assert all((np.asarray(x) > 0).all() for x in jax.tree.leaves(deviation))


def test_kernels_stand_where_the_team_would_pass():
    """On the Lissajous figure, after its ramp: `((p - c) / A)^2 + (v T / 2 pi A)^2 = 1` on each axis."""
    oracle, _, s = drawn()
    payload, front, rear = (np.asarray(f.X)[:6] for f in functions(oracle))
    c, A, T = (np.array(x) for x in (s.reference.center_m, s.reference.amplitude_m, s.reference.period_s))
    unit = ((payload[:, :3] - c) / A) ** 2 + (payload[:, 3:6] * T / (2 * np.pi * A)) ** 2
    np.testing.assert_allclose(unit, 1, atol=1e-9)
    np.testing.assert_allclose(payload[:, 18], np.linalg.norm(payload[:, 3:6], axis=1), rtol=1e-9)
    np.testing.assert_allclose(payload[:, 6:15], np.tile(np.eye(3).ravel(), (6, 1)), atol=1e-12)
    shift = payload[:, :3] - np.asarray(start().payload.p)
    for j, x in enumerate((front, rear)):
        np.testing.assert_allclose(x[:, 9:12], np.asarray(start().agents[0].x)[j] + shift, atol=1e-12)
        np.testing.assert_allclose(x[:, 18:21], payload[:, 3:6], atol=1e-12)
        np.testing.assert_allclose(x[:, 12:15], np.tile(start().agents[0].r[j], (6, 1)), atol=1e-12)
    scattered = build.drawn(changed("certified", drawn=SEEDED | {"spread": 0.5}), build.team(s)[0], start())
    assert scattered is not None
    off = (np.asarray(scattered[0].payload.X)[:6] - payload) / np.asarray(oracle.payload.hyper.lengthscales)[0]
    assert 0.3 < off.std() < 0.7  # of 120 numbers of deviation 0.5


def test_deviations_are_those_along_the_reference_and_the_rig_errs_by_its_share_of_them():
    oracle, deviation, s = drawn()
    t = np.linspace(s.reference.ramp_s, s.duration_s, 400)
    A, T, phase = (np.array(x) for x in (s.reference.amplitude_m, s.reference.period_s, s.reference.phase_deg))
    angle = 2 * np.pi * t[:, None] / T + np.deg2rad(phase)
    p, v = s.reference.center_m + A * np.sin(angle), 2 * np.pi * A / T * np.cos(angle)
    x = np.concatenate([p, v, np.tile(np.eye(3).ravel(), (400, 1)), np.zeros((400, 3))], axis=1)
    x = np.concatenate([x, np.linalg.norm(v, axis=1, keepdims=True), np.full((400, 1), 1e-6)], axis=1)
    f = oracle.payload
    X, ls = np.asarray(f.X)[:6], np.asarray(f.hyper.lengthscales)
    stated = np.concatenate([deviation.payload.F, deviation.payload.tau])
    for i in range(6):
        values = float(f.hyper.signal_variance[i]) * correlations(x, X, ls[i]) @ np.asarray(f.alpha)[i, :6]
        np.testing.assert_allclose(stated[i], values.std(), rtol=1e-9)
    plan = study.plan(s, "C3")
    (rig,) = plan.world.extra
    jax.tree.map(lambda e, of: np.testing.assert_allclose(e, 0.1 * of), rig.error, deviation)
    jax.tree.map(np.testing.assert_array_equal, plan.world.sources.functions, (learn.Function(oracle=oracle),))


def test_nothing_is_drawn_where_it_is_not_asked_for_and_no_norm_is_an_error():
    s = scenario.load("paper")
    truth, _ = build.team(s)
    assert build.drawn(s, truth, start()) is None
    assert study.plan(s, "C1").world.sources.functions == ()
    for bad in ({"norm": 0}, {"norm": 1, "centers": 0}, {"norm": 1, "spread": -0.1}):
        with pytest.raises(ScenarioError):
            changed("certified", drawn=bad)


def test_rates_of_rotation_and_of_joints_have_a_lengthscale_of_their_own():
    s = scenario.load("certified")
    assert (s.learning.payload.lengthscale, s.learning.payload.rate_lengthscale) == (3, 15)
    oracle = build.prior(s, build.team(s)[1])
    rates = {"payload": ["omega_x", "omega_y", "omega_z", "|omega|"]}
    rates["agents"] = ["omega_x", "omega_y", "omega_z", "r_dot_1", "r_dot_2", "r_dot_3"]
    for name, features, hyper in (
        ("payload", learn.PAYLOAD_FEATURES, oracle.payload.hyper),
        ("agents", learn.agent_feature_names(3), jax.tree.map(lambda x: x[0], oracle.agents[0].hyper)),
    ):
        expected = [15.0 if feature in rates[name] else 3.0 for feature in features]
        np.testing.assert_array_equal(hyper.lengthscales, np.tile(expected, (len(hyper.signal_variance), 1)))


# What a run takes -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["paper", "mixed"])
def test_the_log_is_no_larger_than_the_settings_are_told(name, mixed):
    s = mixed if name == "mixed" else scenario.load(name)
    agents, contacts = len(s.agents), len(build.contact_names(s))
    joints = len(build.joint_names(s))
    sizes = {"time": 1, "agents": agents, "joints": joints, "contacts": contacts, "eta": 3 * contacts - 6}
    shapes = [re.findall(r"\w+", re.findall("'(.*)'", part)[0]) for part in simulate.Row.__annotations__.values()]
    logged = sum(np.prod([sizes[word] if word in sizes else int(word) for word in shape]) for shape in shapes)
    assert 0.8 * log_numbers(s.model_dump()) < logged <= log_numbers(s.model_dump())


def test_the_models_have_as_many_outputs_as_the_settings_are_told(mixed):
    s = mixed.model_copy(update={"learning": mixed.learning.model_copy(update={"capacity": 3})})
    oracle = build.prior(s, build.team(s)[1])
    W = [oracle.payload.W, *(model.W for model in oracle.agents)]
    assert sum(matrices.size for matrices in W) == 3**2 * model_outputs(s.model_dump())


def test_noise_too_small_for_the_data_is_refused_with_its_section():
    s = scenario.load("paper")
    quiet = s.learning.agents.model_copy(update={"joint_noise_Nm": 1e-9})
    s = s.model_copy(update={"learning": s.learning.model_copy(update={"agents": quiet})})
    with pytest.raises(ScenarioError, match=r"^paper: learning.agents: output 6: "):
        build.prior(s, build.team(s)[1])


def test_fits_start_from_what_the_scenario_states_and_stay_within_its_bounds():
    learning = {"lengthscale_bounds": (0.2, 20.0), "prior_factor": 2.0, "restarts": 4, "max_iterations": 7}
    s = changed("paper", learning=scenario.load("paper").learning.model_dump() | learning)
    _, nominal = build.team(s)
    training, oracle = build.training(s, nominal), build.prior(s, nominal)
    assert (training.restarts, training.max_iterations) == (4, 7)
    stated = (oracle.payload.hyper, *(jax.tree.map(lambda x: x[0], group.hyper) for group in oracle.agents))
    for belief, hyper in zip((training.payload, *training.agents), stated, strict=True):
        assert (belief.least, belief.greatest, belief.factor) == (0.2, 20.0, 2.0)
        jax.tree.map(np.testing.assert_array_equal, belief.median, hyper)
    certified = scenario.load("certified")
    assert build.training(certified, build.team(certified)[1]) is None


def test_a_look_ahead_is_the_realizer_s_and_the_pilot_s():
    settings = scenario.load("paper")
    far = settings.model_copy(update={"control": settings.control.model_copy(update={"look_ahead_s": 0.03})})
    _, nominal = build.team(settings)
    ours, theirs = build.pilot(settings, nominal), build.pilot(far, nominal)
    assert (type(ours.realizer).__name__, ours.look_ahead) == ("Aligned", None)
    assert (type(theirs.realizer).__name__, float(theirs.look_ahead)) == ("Anticipating", 0.03)
