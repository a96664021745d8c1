"""Tests of the linearized sampled loop against the nonlinear loop, and of the report of its slowest mode."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.analysis import stability
from colift.closed_loop import flight, signals, simulator
from colift.models.state import State
from colift.scenario import experiment, initial_states
from colift.simulation import sensors
from colift.trajectories.pose_spline import PiecewisePolynomial, PoseSpline, RotationLegs
from colift.workflows import python_api
from tests.support import paper_flights as paper
from tests.support import small_team as light


@functools.cache
def equilibrium() -> tuple[stability.LoopStateTree, np.ndarray]:
    """Equilibrium of the study and the derivative there."""
    return stability.equilibrium_and_jacobian(study_experiment(), z())


def study_experiment(hertz: float = 500.0) -> flight.Experiment:
    return dataclasses.replace(paper.paper_experiment("C1"), dt=1 / hertz)


@functools.cache
def z() -> State:
    return initial_states.equilibrium_state(paper.SETTINGS, paper.paper_experiment("C1").world.team)


@functools.cache
def at_500_hertz() -> stability.Modes:
    return stability.modes_at_equilibrium(study_experiment(), z())


def simulated(of: flight.Experiment, x: stability.LoopStateTree, d: np.ndarray, ticks: int) -> np.ndarray:
    """Return coordinates relative to x after some steps of the nonlinear loop from x + d, without noise and
    disturbances.
    """
    of = dataclasses.replace(of, world=stability._without_disturbances(of.world))
    noise = of.world.sample_noise(jax.random.key(0), flight.ticks_per_chunk(of))
    loop = simulator.reset(of.loop_config, z())
    loop, _ = simulator.rollout(of.loop_config, loop, noise, jnp.asarray(1))
    at = jax.tree.map(lambda leaf: leaf[0], stability._displace(x, jnp.asarray(d[None])))
    # the clock continues, but the reference moves by less than 1e-6 m in the first quarter of a second
    still = paper.with_controller(of, reference=dataclasses.replace(of.controller.reference, amplitude=jnp.zeros(3)))
    loop = dataclasses.replace(stability._insert_states(loop, at), tick=jnp.zeros((), int))
    loop, _ = simulator.rollout(still.loop_config, loop, noise, jnp.asarray(ticks))
    assert int(loop.tick) == ticks
    y = jax.tree.map(lambda leaf: leaf[None], stability._select_states(loop))
    return np.asarray(stability._coordinates(x, y))[0]


@pytest.mark.parametrize("seed", range(3))
def test_linearization_predicts_small_disturbances(seed):
    """Every coordinate of plant and controller is disturbed; the difference is of second order."""
    x, M = equilibrium()
    ticks, d = 200, np.random.default_rng(seed).normal(size=len(M))
    d = np.linalg.matrix_power(M, 5) @ d  # on the grasp, after states that decay within one step
    d /= np.abs(d).max()
    linear = np.linalg.matrix_power(M, ticks) @ d
    still = simulated(study_experiment(), x, 0 * d, ticks)  # remaining motion at equilibrium
    off = [np.abs((simulated(study_experiment(), x, h * d, ticks) - still) / h - linear).max() for h in (1e-3, 5e-4)]
    assert off[0] < 0.02 * np.abs(linear).max()
    assert off[1] == pytest.approx(off[0] / 2, rel=0.1)


@functools.cache
def settled() -> signals.StepRecord:
    """Flight with parameter errors only, with a constant reference and without noise."""
    of = dataclasses.replace(study_experiment(), world=stability._without_disturbances(study_experiment().world))
    still = dataclasses.replace(of.controller.reference, amplitude=jnp.zeros(3))
    alone = paper.with_internal(of, eta=jnp.zeros_like(of.controller.allocator.internal.eta))
    return paper.simulate(paper.with_controller(alone, reference=still), 14.0).records


@pytest.mark.long
def test_equilibrium_is_where_the_simulation_settles():
    """The simulation settles at the equilibrium, which is off the reference by the effect of the unknown weight."""
    x, M = equilibrium()
    assert np.abs(simulated(study_experiment(), x, np.zeros(len(M)), 1)).max() < 1e-8
    rows = settled()
    np.testing.assert_allclose(x[".world.state.payload.p"], rows.p[-1], atol=1e-5)
    np.testing.assert_allclose(x[".world.state.payload.R"], rows.R_L[-1], atol=1e-5)
    np.testing.assert_allclose(x[".world.state.agents[0].r"].ravel(), rows.r[-1], atol=1e-5)
    np.testing.assert_allclose(x[".world.applied_inputs[0].u"], rows.u[-1], atol=1e-3)
    of = paper.paper_experiment("C1")
    (group,), load = of.controller.team.agent_groups, of.controller.team.payload
    more = float(of.world.team.payload.mass - load.mass) * 9.81
    # for an upward acceleration the agents also push with their own mass
    sag = more / float((load.mass + group.mass.sum()) * of.controller.payload_controller.gains.K_p[2, 2])
    np.testing.assert_allclose(x[".world.state.payload.p"] - of.controller.reference.center, [0, 0, -sag], atol=1e-8)


def test_shipped_team_is_stable():
    found = at_500_hertz()
    assert found.stable
    assert (np.diff(found.eigenvalues.real) <= 1e-12).all()
    assert -3 < found.eigenvalues[0].real < -0.3
    assert found.payload.shape == (len(found.eigenvalues), 6)


@pytest.mark.long
def test_stateful_payload_controller_adds_modes():
    def slow(found: stability.Modes) -> int:
        return int((found.eigenvalues.real > -50).sum())  # rad/s; some decay within one or two steps

    with_integral = stability.modes_at_equilibrium(
        paper.with_controller(
            study_experiment(), payload_controller=paper.paper_experiment("integral").controller.payload_controller
        ),
        z(),
    )
    assert slow(with_integral) == slow(at_500_hertz()) + 6
    assert with_integral.stable


@pytest.mark.long
def test_friction_cones_at_equilibrium_leave_true_modes():
    """The multipliers of the cone program persist if they are not unique; they are no mode of the loop."""
    sides = {"left": [0, -1, 0], "right": [0, 1, 0]}
    normal = {f"{agent}/{arm}": axis for agent in ("front", "rear") for arm, axis in sides.items()}
    limits = {"kind": "constrained", "contact": {"friction": 0.6, "normal": normal}}
    setup = python_api.make_experiment(python_api.load_scenario("paper", {"allocation": limits}), "C1")
    x, M = stability.equilibrium_and_jacobian(setup, z())
    modes = stability.compute_modes(x, M, setup.dt)
    assert not any("allocator" in path for path in x)
    assert -2.5 < modes.slowest_eigenvalue[0] < -1.5  # 1/s; -1.75 without limits


@pytest.mark.long
def test_slow_control_rate_is_unstable(monkeypatch):
    """At 20 Hz the same team and gains are unstable, in the linearization and in simulation.

    The loop as it flies follows the mode that grows, for as long as it is small.
    """
    monkeypatch.setattr(
        flight, "CHUNK_DURATION", 12.5
    )  # as many steps as half a second at 500 Hz: the same compiled program
    slow = study_experiment(20.0)
    x, M = stability.equilibrium_and_jacobian(slow, z())
    found = stability.modes_at_equilibrium(slow, z())
    assert not found.stable
    values, vectors = np.linalg.eig(M)
    worst = int(np.argmax(np.abs(values)))
    assert abs(values[worst]) > 1
    d = np.real(vectors[:, worst])
    d *= 1e-6 / np.abs(d).max()
    grown = np.linalg.matrix_power(M, 4) @ d
    off = simulated(slow, x, d, 4) - simulated(slow, x, 0 * d, 4)  # minus the remaining motion at equilibrium
    np.testing.assert_allclose(off, grown, atol=1e-3 * np.abs(grown).max())


def test_a_reference_that_starts_in_motion_has_an_equilibrium():
    """The loop rests at the first pose, as with a reference that starts there at rest."""
    one = experiment.make_experiment(light.settings(), "C1")
    state = initial_states.equilibrium_state(light.settings(), one.world.team)
    start = one.controller.reference.evaluate(jnp.zeros(()))
    x = {}
    for speed in (0.0, 0.5):
        knots, c = jnp.array([0.0, 2.0]), jnp.zeros((1, 8, 3))
        moving = PoseSpline(
            position=PiecewisePolynomial(knots=knots, coefficients=c.at[0, 0].set(start.p).at[0, 1:3].set(speed)),
            attitude=RotationLegs(
                phi=PiecewisePolynomial(knots=knots, coefficients=c.at[0, 1].set(speed)), R=start.R[None]
            ),
        )
        of = dataclasses.replace(one, controller=dataclasses.replace(one.controller, reference=moving))
        x[speed], _ = stability.equilibrium_and_jacobian(of, state)
    still = jax.tree.map(lambda leaf: leaf[None], x[0.0])
    np.testing.assert_allclose(stability._coordinates(x[0.5], still), 0, atol=1e-9)


def test_missing_equilibrium_is_reported():
    nowhere = dataclasses.replace(paper.paper_experiment("C1").controller.reference, center=jnp.full(3, np.nan))
    with pytest.raises(ValueError, match="no equilibrium near the start of its reference"):
        stability.modes_at_equilibrium(paper.with_controller(study_experiment(), reference=nowhere), z())


def modes_of(y: np.ndarray, dt: float) -> np.ndarray:
    """Return continuous-time modes of a damped oscillation that follows `y_{k+2} = a y_{k+1} + b y_k`."""
    (a, b), *_ = np.linalg.lstsq(np.stack([y[1:-1], y[:-2]], axis=1), y[2:], rcond=None)
    return np.log(np.roots([1, -a, -b]).astype(complex)) / dt


def test_slowest_mode_is_the_decay_of_the_simulation():
    """From 2 s to 5 s of a simulation, y and yaw are the slowest mode and the slowest mode of yaw."""
    found = at_500_hertz()
    assert found.describe_slowest().endswith("largest in p_y")
    first_of_yaw = np.argmax(np.abs(found.payload).argmax(1) == 2)
    for first, coordinate in ((0, settled().e_p[:, 1]), (first_of_yaw, settled().e_R[:, 2])):
        for value in modes_of(coordinate[1000:2500:50], 0.1):
            assert np.abs(found.eigenvalues[first : first + 2] - value).min() < 0.01 * abs(value)


def test_modes_name_their_coordinates():
    shape = np.zeros((2, 6))
    shape[0, 4] = 1.0
    none = {"attitude": np.zeros((2, 0, 3)), "joints": np.zeros((2, 0))}
    found = stability.Modes(eigenvalues=np.array([0.3 + 2j, -1 + 0j]), payload=shape, **none)
    assert not found.stable
    assert found.describe_slowest() == "+0.30 +2.00i rad/s, largest in p_y"
    unseen = stability.Modes(eigenvalues=np.array([-0.3 + 2j]), payload=np.full((1, 6), 0.01), **none)
    assert unseen.stable
    assert "the agents' attitudes" in unseen.describe_slowest()
    assert not stability.Modes(eigenvalues=np.array([-1e-9 + 0j]), payload=shape, **none).stable


# Delay ----------------------------------------------------------------------------------------------------------------


@functools.cache
def three_bodies(delay_s: float = 0.0) -> tuple[stability.LoopStateTree, np.ndarray]:
    """Equilibrium and derivative of the smallest team, with a delay of the commands."""
    motors = {"kind": "motors", "bandwidth_Hz": 1e6, "delay_s": delay_s}
    settings = light.settings(actuators=motors)
    one_experiment = experiment.make_experiment(settings, "C1")
    return stability.equilibrium_and_jacobian(
        one_experiment, initial_states.equilibrium_state(settings, one_experiment.world.team)
    )


@pytest.mark.long
def test_equilibrium_does_not_depend_on_the_start():
    one_experiment = experiment.make_experiment(light.settings(), "C1")
    setup, loop, noise = stability._undisturbed_loop(
        one_experiment, initial_states.equilibrium_state(light.settings(), one_experiment.world.team)
    )
    settled = stability._simulate_settling(setup, loop, noise)
    assert int(settled.tick) == int(loop.tick), "the clock is constant"
    apart = stability._coordinates(
        stability._select_states(loop), jax.tree.map(lambda leaf: leaf[None], stability._select_states(settled))
    )
    assert np.abs(apart).max() > 1e-3, "the equilibrium is off the reference by the payload's parameter error"
    rests = [stability._newton_equilibrium(setup, of, noise) for of in (loop, settled)]
    (x, _), (y, _) = (found for found in rests if found)
    between = stability._coordinates(x, jax.tree.map(lambda leaf: leaf[None], y))
    np.testing.assert_allclose(between, 0, atol=1e-6)


@pytest.mark.long
def test_delay_margin_is_the_stability_limit():
    """The limit of actuator delays; the team has no joints."""
    x, M = three_bodies()
    ticks = stability.delay_margin(x, M, 25)
    assert 1 <= ticks < 25
    command, world = stability._rows_of(x, r"\.controller\.last_command.*"), stability._rows_of(x, r"\.world.*")
    controller_rows = np.setdiff1d(np.arange(len(M)), world)
    B = np.zeros((len(M), len(command)))
    B[world] = M[np.ix_(world, controller_rows)] @ np.linalg.pinv(M[np.ix_(command, controller_rows)])
    appended = [np.linalg.eigvals(stability._append_delay(M, B, M[command], k)) for k in (ticks, ticks + 1)]
    within = np.linalg.eigvals(three_bodies((ticks + 1) / 500)[1])
    slow = [values[np.abs(values) > 0.5] for values in (appended[1], within)]
    assert len(slow[0]) == len(slow[1]) > 20
    apart = np.abs(slow[0][:, None] - slow[1])
    assert max(apart.min(0).max(), apart.min(1).max()) < 1e-4
    assert np.abs(appended[0]).max() < 1 < np.abs(within).max()
    assert stability.delay_margin(x, M, ticks - 1) == ticks - 1
    assert stability.delay_margin(x, 1.1 * M, 25) == -1


def test_delay_keeps_unobservable_eigenvalues():
    """States that do not influence the commands have the same eigenvalues with every delay."""
    rng, kept, others, commands = np.random.default_rng(0), 6, 3, 2
    A = rng.normal(size=(kept + others, kept + others))
    A[:kept, kept:] = 0.0  # the other states are driven by the kept ones only
    K = np.hstack([rng.normal(size=(commands, kept)), np.zeros((commands, others))])
    B = rng.normal(size=(kept + others, commands))
    order = rng.permutation(kept + others)
    A, K, B = A[np.ix_(order, order)], K[:, order], B[order]
    rows = stability._observable(A, K)
    assert sorted(order[rows]) == list(range(kept))
    rest = np.setdiff1d(np.arange(kept + others), rows)
    M = A + B @ K
    for ticks in (1, 4):
        whole = np.linalg.eigvals(stability._append_delay(M, B, K, ticks))
        reduced = np.linalg.eigvals(stability._append_delay(M[np.ix_(rows, rows)], B[rows], K[:, rows], ticks))
        union = np.concatenate([reduced, np.linalg.eigvals(A[np.ix_(rest, rest)])])
        np.testing.assert_allclose(np.poly(whole), np.poly(union), atol=1e-7 * np.abs(np.poly(whole)).max())


@pytest.mark.long
def test_gain_margin_is_the_stability_limit():
    """Outside the gain margin the loop with larger or smaller commands is unstable."""
    x, M = three_bodies()
    least, greatest = stability.gain_margin(x, M)
    assert least < 1 < greatest
    B, K = stability._input_matrices(x, M)
    radius = lambda g: np.abs(np.linalg.eigvals(M + (g - 1) * B @ K)).max()  # noqa: E731
    for end, beyond in ((least, 0.98), (greatest, 1.02)):
        assert radius(end) < 1
        assert radius(end * beyond) >= 1 or max(end, 1 / end) > 0.999 * stability.MAX_GAIN
    assert greatest < stability.MAX_GAIN, "some gain is too much"
    assert np.isnan(stability.gain_margin(x, 1.1 * M)).all()
    found = stability.stability_margins(x, M, 0.002)
    assert found.delay_margin == pytest.approx(0.002 * stability.delay_margin(x, M, 25))
    assert f" to {greatest:.3g}" in found.describe()


@pytest.mark.long
def test_state_without_effect_has_no_delay_margin():
    x, M = three_bodies()
    M = M.copy()
    M[np.ix_(stability._rows_of(x, r"\.controller\.last_command.*"), stability._rows_of(x, r"\.controller.*"))] = 0
    with pytest.raises(ValueError, match="does not determine every command"):
        stability.delay_margin(x, M, 5)


@pytest.mark.long
def test_delay_margin_of_nearly_unexcited_commands():
    """Values of a tuned team: a command has singular value 0.9e-7 for the controller state and 1.4e-7 for all
    states.
    """
    x, M = three_bodies()
    commands, world = (
        stability._rows_of(x, where) for where in (r"\.controller\.last_command\[\d+\]\..*", r"\.world\..*")
    )
    controller_rows = np.setdiff1d(np.arange(len(M)), world)
    U, s, V = np.linalg.svd(M[np.ix_(commands, controller_rows)], full_matrices=False)
    s[-1] = 0.9e-7 * s[0]
    M = M.copy()
    M[np.ix_(commands, controller_rows)] = (U * s) @ V
    M[np.ix_(commands, world)] -= np.outer(U[:, -1], U[:, -1] @ M[np.ix_(commands, world)])
    M[np.ix_(commands, world[:1])] += 1.1e-7 * s[0] * U[:, -1:]
    ranks = [np.linalg.matrix_rank(K, rtol=1e-7) for K in (M[np.ix_(commands, controller_rows)], M[commands])]
    assert ranks[0] < ranks[1]
    assert np.isfinite(stability.with_input_delay(x, M, 2)).all()


@pytest.mark.long
def test_slowest_mode_has_first_order_sensitivity():
    """The slowest mode of a slightly different loop follows from first-order perturbation."""
    x, M = three_bodies()
    now = stability.compute_modes(x, M, 1 / 500).slowest_eigenvalue[0]
    for factor in (1.0, 1.1):
        settings = light.settings(
            actuators={"kind": "motors", "bandwidth_Hz": 1e6, "delay_s": 0.0},
            control=light.SAMPLE.control.model_copy(update={"k_omega": 14.0 * factor, "agent_k_omega": 28.0 * factor}),
        )
        one_experiment = experiment.make_experiment(settings, "C1")
        z = initial_states.equilibrium_state(settings, one_experiment.world.team)
        true = stability.modes_at_equilibrium(one_experiment, z).slowest_eigenvalue[0]
        assert abs(stability.predict_growth_rate(one_experiment, z, x, M) - true) < 0.3 * abs(true - now) + 1e-3 * abs(
            now
        )
    assert abs(true - now) > 0.02 * abs(now)


@pytest.mark.long  # compiles three loops
def test_intermittent_sensors_are_sampled_every_step():
    """The clock of the loop is constant there, so that intermittent sensors would never sample and a drift would
    restart.
    """
    of, number = experiment.make_experiment(light.settings(), "C1"), functools.partial(jnp.array, dtype=float)
    rare = sensors.Intermittent(
        channels=("payload.p", "agents.x"),
        sample_period=number(0.05),
        dropout_probability=number(0.5),
        failure_time=number(1.0),
    )
    drift = sensors.BiasRandomWalk(
        channels=("payload.R", "agents.lam"), random_walk_density=number(0.1), initial_bias_std=number(0.1)
    )

    def rates(*extra: sensors.SensorModel) -> np.ndarray:
        one_experiment = dataclasses.replace(of, world=dataclasses.replace(of.world, sensor_models=extra))
        return stability.modes_at_equilibrium(one_experiment, of.initial_state).eigenvalues[:12].real  # of the slowest

    expected = rates()
    np.testing.assert_allclose(rates(drift, rare), expected, atol=1e-4)
    late = rates(dataclasses.replace(rare, delay=2))
    np.testing.assert_allclose(late, expected, rtol=0.1)
    assert abs(late - expected).max() > 0.01


CORRECTOR_STATES = {
    "label_feedback": {"prediction", "sensor_lowpass", "stage1", "error", "previous"},
    "adaptive": {"prediction", "delayed", "d", "v", "noise[0]"},
}


@pytest.mark.parametrize("case", CORRECTOR_STATES)
def test_second_moments_are_excluded_from_the_state(case):
    """At equilibrium they vanish to first order; as coordinates they became negative in the Newton iteration."""
    states = stability._select_states(simulator.reset(paper.paper_experiment(case).loop_config, z()))
    found = {key.split(".corrector.")[1] for key in states if ".corrector." in key}
    assert found == CORRECTOR_STATES[case]
    labels = {key.split(".estimator.")[1].split(".")[0] for key in states if ".estimator." in key}
    assert "modelled_wrench" in labels, "labels before their filter depend on it"
    assert "label" not in labels, "of training samples"
    assert not [key for key in states if "last_f_hat" in key], "used without tip readings only"


@pytest.mark.long
@pytest.mark.parametrize("case", ["label_feedback", "adaptive"])
def test_label_feedback_changes_the_slowest_mode_little(case):
    """The loop with label feedback has an equilibrium and decays like the loop without."""
    with_labels = stability.modes_at_equilibrium(paper.paper_experiment(case), z())
    assert with_labels.stable
    assert with_labels.eigenvalues[0].real == pytest.approx(at_500_hertz().eigenvalues[0].real, rel=0.2)
