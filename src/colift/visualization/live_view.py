"""A flight that is seen while it flies: the playback's page, on this computer alone, fed by server-sent events."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Generator, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.metadata import version
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from colift.closed_loop import log, signals
from colift.closed_loop.flight import Experiment, FlightResult, run_experiment, ticks_per_chunk
from colift.math import so3
from colift.models.parameters import Team
from colift.onboard.learning import prediction_uncertainty
from colift.runtime import run_directory
from colift.scenario import Scenario, team, trajectories
from colift.visualization import playback, scene

HOST = "127.0.0.1"
POLICY = f"{playback.POLICY}; connect-src 'self'"
EVENTS = "/events"


@contextlib.contextmanager
def serve_live_flight(
    settings: Scenario, experiment: Experiment, case: str, told: str, ready: Callable[[str], None]
) -> Generator[FlightResult]:
    """Fly a plan of a scenario and show it; its page stays until the block ends. `told`: what the case is.

    `ready` is handed the page's address once the first half second is flown. Raises OSError where there is no port.
    """
    flown, live = [], EventStream()
    drawn = _Drawn(settings, experiment, case)

    def seen(rows: signals.StepRecord) -> None:
        flown.append(rows)
        ds = drawn.dataset(jax.tree.map(lambda *parts: np.concatenate(parts), *flown), _no_sigma(experiment))
        live.publish(drawn.event(ds))
        if len(flown) == 1:
            ready(held.enter_context(_served(drawn.page(ds, told).encode(), live)))

    with contextlib.ExitStack() as held:
        flight = run_experiment(experiment, seen=seen)
        ds = drawn.dataset(flight.records, flight.uncertainty, flight.termination_reason)
        live.publish(drawn.event(ds) | drawn.sigma(ds))
        live.close()
        yield flight


class _Drawn:
    """What is drawn of a flight, frame by frame, while it gets longer."""

    def __init__(self, settings: Scenario, experiment: Experiment, case: str) -> None:
        self.settings, self.plan, self.case, self.sent = settings, experiment, case, 0
        self.team: Team = team.team(settings)[0]
        ticks, step = round(experiment.duration / experiment.dt), scene.stride(experiment.dt)
        self.ticks = np.unique([*range(0, ticks, step), ticks - 1])
        self.room = ticks_per_chunk(experiment) // step + 2  # frames that are computed at once: one shape, one program

    def dataset(
        self, rows: signals.StepRecord, sigma: prediction_uncertainty.PredictionUncertainty, stopped: str = ""
    ) -> xr.Dataset:
        """The log of what is flown, as a study has it."""
        told, renewals = self.settings, self.plan.online_updates
        learns = sorted({*self.plan.update_times, *(renewals.times if renewals else ())})
        attrs = {
            "scenario_json": told.model_dump_json(exclude_none=True),
            "version": version("colift"),
            "run": run_directory.run_id(version("colift"), told.digest),
            "case": self.case,
            "stopped": stopped,
            "update_times_s": [t for t in learns if t <= rows.t[-1] + self.plan.dt],
            "T_end_s": told.learning.end_s,
        }
        names = (team.agent_names(told), team.joint_names(told), team.contact_names(told))
        labels = dict(zip(("agents", "joints", "contacts"), names, strict=True))
        return log.dataset(rows, sigma=sigma, attrs=attrs, **labels)

    def event(self, ds: xr.Dataset) -> dict[str, Any]:
        """The frames that are new since the event before, and what is told of the flight until now."""
        until = int(np.searchsorted(self.ticks, scene.frame_rows(ds)[-1], side="right"))
        fresh = self.ticks[self.sent : until]
        tracks, first = {}, self.sent
        for start in range(0, len(fresh), self.room):
            pick = fresh[start : start + self.room]
            at = ds.isel(time=np.pad(pick, (0, self.room - len(pick)), mode="edge"))
            for name, x in (scene.poses(at, self.team) | scene.error_signals(at)).items():
                tracks.setdefault(name, []).append(x[: len(pick)])
        self.sent = until
        return {
            "from": first,
            "known": until,
            "tracks": {name: playback.encode_array(np.concatenate(parts)) for name, parts in tracks.items()},
            "marks": scene.event_markers(ds),
            "stopped": str(ds.attrs["stopped"]),
        }

    def sigma(self, ds: xr.Dataset) -> dict[str, Any]:
        """The deviations, which are computed when the flight has ended."""
        at = ds.time_sigma.values[scene.subsample(ds.time_sigma.values)]
        return {"t_sigma": scene.to_json_times(at), "sigma": playback.encode_array(scene.plot_signals(ds)["sigma"])}

    def page(self, ds: xr.Dataset, told: str) -> str:
        """The page with the first frame, the whole reference, and room for the rest."""
        written = playback.page_data({self.case: ds}, {self.case: told})
        t = self.ticks * self.plan.dt
        wanted = jax.jit(jax.vmap(trajectories.make_reference(self.settings).evaluate))(jnp.asarray(t))
        whole = {"p_d": np.asarray(wanted.p), "q_d": np.asarray(jax.jit(so3.quaternion)(wanted.R))}
        (shown,) = written["cases"]
        at = ds.isel(time=[0])
        for name, x in (scene.poses(at, self.team) | scene.error_signals(at)).items():
            room = np.full((len(t), *x.shape[1:]), np.nan)
            room[0] = x[0]
            shown["tracks"][name] = playback.encode_array(whole.get(name, room))
        shown |= {"t": scene.to_json_times(t), "known": 1}
        return playback.page_html(written | {"live": EVENTS}, POLICY)


def _no_sigma(experiment: Experiment) -> prediction_uncertainty.PredictionUncertainty:
    """The deviations before there are any."""
    groups: Team = experiment.world.team
    sizes = zip(groups.sizes, groups.agent_groups, strict=True)
    empty = tuple(np.zeros((0, size, 6 + group.tree.joints)) for size, group in sizes)
    none = np.zeros((0, 6))
    return prediction_uncertainty.PredictionUncertainty(
        t=np.zeros(0),
        payload_std=none,
        agent_std=empty,
        payload_label_bias=none,
        agent_label_bias=empty,
        payload_radius=none,
        agent_radius=empty,
    )


# Server ---------------------------------------------------------------------------------------------------------------


class EventStream:
    """Events of a flight: told by one thread, followed from the first one on by any number."""

    def __init__(self) -> None:
        self._events: list[bytes] = []
        self._over = False
        self._changed = threading.Condition()

    def publish(self, event: dict[str, Any]) -> None:
        """Adds an event."""
        with self._changed:
            self._events.append(f"data: {json.dumps(event, allow_nan=False, separators=(',', ':'))}\n\n".encode())
            self._changed.notify_all()

    def close(self) -> None:
        """No event follows."""
        with self._changed:
            self._over = True
            self._changed.notify_all()

    def subscribe(self) -> Iterator[bytes]:
        """Every event as it is sent, then the end."""
        k = 0
        while True:
            with self._changed:
                self._changed.wait_for(lambda k=k: self._over or len(self._events) > k)
                fresh, over = self._events[k:], self._over
            yield from fresh
            k += len(fresh)
            if over:
                yield b"event: end\ndata: {}\n\n"
                return


@contextlib.contextmanager
def _served(page: bytes, live: EventStream) -> Generator[str]:
    """The page and its events on a free port of this computer, until the block ends; the address."""

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            ours = f"{HOST}:{server.server_port}"
            if self.headers.get("Host") not in (ours, f"localhost:{server.server_port}"):
                self.send_error(403)  # a page of another host whose name was made to mean this computer
            elif self.path == "/":
                self._begin("text/html; charset=utf-8")
                self.wfile.write(page)
            elif self.path == EVENTS:
                self._begin("text/event-stream")
                with contextlib.suppress(ConnectionError):  # the reader has gone
                    for event in live.subscribe():
                        self.wfile.write(event)
            else:
                self.send_error(404)

        def _begin(self, kind: str) -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Cache-Control", "no-store")
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
            pass  # the terminal is the flight's

    server = ThreadingHTTPServer((HOST, 0), Answer)
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
