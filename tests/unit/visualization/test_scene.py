"""Tests of scene data: positions of bodies by the model's kinematics, reference, disturbance and markers."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from colift import scenario
from colift.models import aerial_manipulator, grasp
from colift.models.state import PayloadState
from colift.scenario import disturbances, initial_states, team, trajectories
from colift.simulation.disturbances import init, payload_wrench
from colift.visualization import scene
from tests.support import playback_logs as played
from tests.support import random_logs as flights
from tests.support import small_team
from tests.support.playback_logs import PAPER, random_log


@pytest.fixture(scope="module")
def settings() -> scenario.Scenario:
    return played.short_flight()


@pytest.fixture(scope="module")
def logs() -> dict[str, xr.Dataset]:
    return played.two_case_logs()


def test_positions_equal_the_kinematics():
    truth, _ = team.team(PAPER)
    z = initial_states.initial_state(PAPER, truth)
    (state,) = z.agents
    still = {"R": state.R, "x": state.x, "r": state.r.ravel(), "p": z.payload.p, "R_L": z.payload.R}
    ticks = flights.PAPER.time
    still = {name: np.repeat(np.asarray(x)[None], ticks, axis=0) for name, x in still.items()}
    rows = flights.rows(np.random.default_rng(8), flights.PAPER, **still)
    ds = played.labelled(rows, flights.sigma(np.random.default_rng(8), flights.PAPER), PAPER)
    shown = scene.frames(ds, truth)
    nodes = shown["nodes"][-1].reshape(2, 6, 3)  # base, waist, left, right, two tips
    for j in range(2):
        agent, own = jax.tree.map(lambda leaf, j=j: leaf[j], (truth.agent_groups[0], state))
        np.testing.assert_allclose(nodes[j, 4:], aerial_manipulator.tip_positions(agent, own), atol=1e-12)
        base = np.asarray(own.x - own.R @ aerial_manipulator.center_of_mass(agent, own.r))
        np.testing.assert_allclose(shown["base"][-1, j], base, atol=1e-12)
        np.testing.assert_allclose(nodes[j, :2], [base, base], atol=1e-12)  # the waist turns about the base's origin
        np.testing.assert_allclose(np.linalg.norm(nodes[j, 4:] - nodes[j, 2:4], axis=1), 0.3, rtol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(nodes[j, 2:4] - base, axis=1), 0.08, rtol=1e-12)
    held = np.asarray(z.payload.p) + np.asarray(grasp.contact_points(truth)) @ np.asarray(z.payload.R).T
    np.testing.assert_allclose(nodes[:, 4:].reshape(4, 3), held, atol=1e-9)


def test_tips_stay_on_the_payload(logs, settings):
    truth, _ = team.team(settings)
    for ds in logs.values():
        at, shown = ds.isel(time=scene.frame_rows(ds)), scene.frames(ds, truth)
        contacts = np.asarray(grasp.contact_points(truth))
        held = at.p.values[:, None] + np.einsum("tij,cj->tci", at.R_L.values, contacts)
        np.testing.assert_allclose(shown["nodes"][:, 1::2], held, atol=1e-8)


def test_reference_and_disturbance_equal_the_scenario(logs, settings):
    """The reference is the scenario's, and the disturbance is the force of its models."""
    truth, _ = team.team(settings)
    ds = logs["C1"]
    at, shown = ds.isel(time=scene.frame_rows(ds)), scene.frames(ds, truth)
    path, sources = trajectories.make_reference(settings), disturbances.make_disturbances(settings)
    setpoint = jax.jit(jax.vmap(path.evaluate))(jnp.asarray(at.time.values))
    np.testing.assert_allclose(shown["p_d"], setpoint.p, atol=1e-12)
    w, x, y, z = np.moveaxis(shown["q_d"], -1, 0)
    third = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)
    np.testing.assert_allclose(third, setpoint.R[:, :, 2], atol=1e-9)

    @jax.jit
    @jax.vmap
    def force(p, R, v, omega, t):
        state = init(sources, truth).payload
        return payload_wrench(sources.payload, PayloadState(p=p, R=R, v=v, omega=omega), t, state).F

    moving = [jnp.asarray(at[name].values) for name in ("p", "R_L", "v", "omega_L")]
    np.testing.assert_allclose(shown["disturbance"], force(*moving, jnp.asarray(at.time.values)), atol=1e-6)


def test_thirty_frames_per_second_and_the_last_one():
    ds = random_log(flights.PAPER._replace(time=1001))
    at = ds.time.values[scene.frame_rows(ds)]
    assert at[[0, -1]].tolist() == ds.time.values[[0, -1]].tolist()
    assert np.diff(at)[:-1] == pytest.approx(0.034)
    ds.x[700:] = np.nan  # a flight that failed
    assert scene.frame_rows(ds)[-1] == 699
    one = ds.isel(time=slice(1), time_sigma=slice(1))
    assert scene.frame_rows(one).tolist() == [0]
    assert scene.plot_signals(one)["e_p"].shape == (1, 1)


def test_curves_equal_the_log():
    ds = random_log(flights.PAPER._replace(time=200))
    shown, at = scene.plot_signals(ds), scene.frame_rows(ds)
    np.testing.assert_allclose(shown["e_p"][:, 0], np.linalg.norm(ds.e_p[at], axis=1))
    sine, cosine = np.linalg.norm(ds.e_R[at], axis=1), 1 - ds.Psi.values[at]
    np.testing.assert_allclose(np.tan(np.deg2rad(shown["angle"][:, 0])), sine / cosine)
    assert shown["sigma"].shape[1] == 2
    assert shown["sigma"][0].tolist() == [ds.sigma_L_force[0], ds.sigma_A_force[0]]


def test_event_markers_are_time_intervals():
    ds = random_log(flights.PAPER._replace(time=1000)).assign_attrs(update_times_s=[0.5, 1.0], T_end_s=1.0)
    ds.eta[:] = ds.eta * ((ds.time >= 0.2) & (ds.time <= 0.4))
    ds.thrust_saturated[:] = False
    ds.thrust_saturated[100:103, 1] = ds.thrust_saturated[110:112, 1] = ds.thrust_saturated[900, 1] = True
    found = scene.event_markers(ds)
    assert (found["updates"], found["learning_end"]) == ([0.5, 1.0], 1.0)
    assert scene.event_markers(ds.assign_attrs(T_end_s=0.9))["learning_end"] is None
    assert found["internal"] == [[0.2, 0.4]]
    assert found["at_limit"] == {"rear": [[0.2, 0.222], [1.8, 1.8]]}
    assert found["faults"] == []


@pytest.mark.parametrize("cut", [90, 101, 105, 111, 500])
def test_markers_of_two_parts_are_those_of_the_flight(cut):
    ds = random_log(flights.PAPER._replace(time=1000)).assign_attrs(update_times_s=[0.5, 1.0], T_end_s=1.0)
    ds.eta[:] = ds.eta * ((ds.time >= 0.2) & (ds.time <= 0.4))
    ds.thrust_saturated[:] = False
    ds.thrust_saturated[100:103, 1] = ds.thrust_saturated[110:112, 1] = ds.thrust_saturated[900, 0] = True
    parts = (scene.event_markers(part) for part in (ds.isel(time=slice(cut)), ds.isel(time=slice(cut, None))))
    assert scene.join_markers(*parts) == scene.event_markers(ds)


def test_event_markers_name_the_faults_that_acted():
    ds = random_log(flights.PAPER._replace(time=500))
    given = small_team.faults(
        {"kind": "thrust", "who": "front", "start_s": 0.2, "end_s": 0.5, "to": 0.6},
        {"kind": "contact", "who": "rear/left", "start_s": 0.4},
        {"kind": "contact", "who": "rear/right", "start_s": 10},
    )
    end = float(ds.time[-1])
    assert scene.event_markers(ds, given)["faults"] == [
        {"text": "rotors of front at 0.6 of their effectiveness from 0.2 s to 0.5 s", "span": [0.2, 0.5]},
        {"text": "contact rear/left open from 0.4 s", "span": [0.4, end]},
    ]
