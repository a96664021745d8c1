"""Live playback page of a running simulation.

A local web server provides the page and sends new frames as server-sent events. It accepts connections from this
computer only, and only requests whose address contains a random token, so that other users of the computer and pages of
other sites cannot read the flight.
"""

from __future__ import annotations

import contextlib
import json
import secrets
import socket
import sys
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
CONTENT_SECURITY_POLICY = f"{playback.CONTENT_SECURITY_POLICY}; connect-src 'self'"
EVENTS = "events"  # path of the event stream, relative to the page
MAX_CONNECTIONS = 16
"""Number of connections that are served at the same time; further ones are closed."""
REQUEST_TIMEOUT = 5.0
"""Longest time for a request to arrive and for a reader to accept data [s]."""


@contextlib.contextmanager
def serve_live_flight(
    settings: Scenario, experiment: Experiment, case: str, description: str, on_ready: Callable[[str], None]
) -> Generator[FlightResult]:
    """Run an experiment and serve its live playback page until the `with` block ends.

    An `OSError` indicates that no port is available.

    Args:
        settings: Scenario.
        experiment: Experiment of one case of the scenario.
        case: Case id.
        description: Description of the case.
        on_ready: Function that is called with the address of the page after the first half second of the simulation.

    Yields:
        The result of the simulation.
    """
    encoder, stream = _FrameEncoder(settings, experiment, case), EventStream()

    def publish_chunk(rows: signals.StepRecord) -> None:
        is_first, ds = encoder.num_sent == 0, encoder.dataset(rows, _no_uncertainty(experiment))
        stream.publish(encoder.event(ds, round(float(rows.t[0]) / experiment.dt)))
        if is_first:
            on_ready(resources.enter_context(_serve(encoder.page(ds, description).encode(), stream)))

    with contextlib.ExitStack() as resources:
        flight = run_experiment(experiment, on_chunk=publish_chunk)
        ds = encoder.dataset(flight.records, flight.uncertainty, flight.termination_reason)
        stream.publish(encoder.event(ds) | encoder.sigma(ds))
        stream.close()
        yield flight


class _FrameEncoder:
    """Encode the frames of a running simulation as events."""

    def __init__(self, settings: Scenario, experiment: Experiment, case: str) -> None:
        self.settings, self.experiment, self.case, self.num_sent = settings, experiment, case, 0
        self.team: Team = team.team(settings)[0]
        ticks, step = round(experiment.duration / experiment.dt), scene.stride(experiment.dt)
        self.ticks = np.unique([*range(0, ticks, step), ticks - 1])
        self.batch_size = ticks_per_chunk(experiment) // step + 2  # constant, so that JAX compiles one program
        self.markers: dict[str, Any] = {}  # events of the flight until now

    def dataset(
        self, rows: signals.StepRecord, sigma: prediction_uncertainty.PredictionUncertainty, reason: str = ""
    ) -> xr.Dataset:
        """Return the log of the simulation until now, in the form that a study writes."""
        settings, online_updates = self.settings, self.experiment.online_updates
        update_times = sorted({*self.experiment.update_times, *(online_updates.times if online_updates else ())})
        attrs = {
            "scenario_json": settings.model_dump_json(exclude_none=True),
            "version": version("colift"),
            "run": run_directory.run_id(version("colift"), settings.digest),
            "case": self.case,
            "termination_reason": reason,
            "update_times_s": [t for t in update_times if t <= rows.t[-1] + self.experiment.dt],
            "T_end_s": settings.learning.end_s,
        }
        names = (team.agent_names(settings), team.joint_names(settings), team.contact_names(settings))
        labels = dict(zip(("agents", "joints", "contacts"), names, strict=True))
        return log.dataset(rows, team=self.team, sigma=sigma, attrs=attrs, **labels)

    def event(self, ds: xr.Dataset, first_tick: int = 0) -> dict[str, Any]:
        """Return the frames since the previous event, and the events of the flight until now.

        Args:
            ds: Log of all control periods, or of those since the previous event.
            first_tick: Index of its first control period.
        """
        until = int(np.searchsorted(self.ticks, first_tick + scene.frame_rows(ds)[-1], side="right"))
        new_ticks = self.ticks[self.num_sent : until]
        tracks, first = {}, self.num_sent
        for start in range(0, len(new_ticks), self.batch_size):
            batch = new_ticks[start : start + self.batch_size]
            rows = ds.isel(time=np.pad(batch - first_tick, (0, self.batch_size - len(batch)), mode="edge"))
            for name, x in (scene.poses(rows, self.team) | scene.error_signals(rows)).items():
                tracks.setdefault(name, []).append(x[: len(batch)])
        self.num_sent = until
        markers = scene.event_markers(ds, self.settings.faults)
        self.markers = markers if first_tick == 0 else scene.join_markers(self.markers, markers)
        return {
            "from": first,
            "known": until,
            "tracks": {name: playback.encode_array(np.concatenate(parts)) for name, parts in tracks.items()},
            "marks": self.markers,
            "stopped": str(ds.attrs["termination_reason"]),
        }

    def sigma(self, ds: xr.Dataset) -> dict[str, Any]:
        """Return the predictive standard deviations, which are available at the end of the simulation."""
        t = ds.time_sigma.values[scene.subsample(ds.time_sigma.values)]
        return {"t_sigma": scene.to_json_times(t), "sigma": playback.encode_array(scene.plot_signals(ds)["sigma"])}

    def page(self, ds: xr.Dataset, description: str) -> str:
        """Return the page with the first frame, the whole reference, and empty arrays for the other frames."""
        data = playback.page_data({self.case: ds}, {self.case: description})
        t = self.ticks * self.experiment.dt
        setpoints = jax.jit(jax.vmap(trajectories.make_reference(self.settings).evaluate))(jnp.asarray(t))
        reference = {"p_d": np.asarray(setpoints.p), "q_d": np.asarray(jax.jit(so3.quaternion)(setpoints.R))}
        (case_data,) = data["cases"]
        first = ds.isel(time=[0])
        for name, x in (scene.poses(first, self.team) | scene.error_signals(first)).items():
            frames = np.full((len(t), *x.shape[1:]), np.nan)
            frames[0] = x[0]
            case_data["tracks"][name] = playback.encode_array(reference.get(name, frames))
        case_data |= {"t": scene.to_json_times(t), "known": 1}
        return playback.page_html(data | {"live": EVENTS}, CONTENT_SECURITY_POLICY)


def _no_uncertainty(experiment: Experiment) -> prediction_uncertainty.PredictionUncertainty:
    """Return empty uncertainty signals, for the log of a simulation that has not ended."""
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
        force_errors_to_payload=np.zeros((0, 6, sum(groups.sizes), 3)),
    )


# Server ---------------------------------------------------------------------------------------------------------------


class EventStream:
    """Stream of server-sent events: one thread publishes, any number of threads receive all events."""

    def __init__(self) -> None:
        """Create an empty stream."""
        self._events: list[bytes] = []
        self._closed = False
        self._changed = threading.Condition()

    def publish(self, event: dict[str, Any]) -> None:
        """Append an event.

        Args:
            event: Values for JSON.
        """
        with self._changed:
            self._events.append(f"data: {json.dumps(event, allow_nan=False, separators=(',', ':'))}\n\n".encode())
            self._changed.notify_all()

    def close(self) -> None:
        """Close the stream; no event may follow."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def subscribe(self) -> Iterator[bytes]:
        """Return an iterator over all events in the format of server-sent events, until the stream is closed."""
        k = 0
        while True:
            with self._changed:
                self._changed.wait_for(lambda k=k: self._closed or len(self._events) > k)
                new_events, closed = self._events[k:], self._closed
            yield from new_events
            k += len(new_events)
            if closed:
                yield b"event: end\ndata: {}\n\n"
                return


class _Server(ThreadingHTTPServer):
    """HTTP server with a limited number of connections."""

    daemon_threads = True

    def __init__(self, handler: type[BaseHTTPRequestHandler]) -> None:
        super().__init__((HOST, 0), handler)
        self._free = threading.BoundedSemaphore(MAX_CONNECTIONS)

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing if a reader has closed the connection or does not accept data."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


@contextlib.contextmanager
def _serve(page: bytes, stream: EventStream) -> Generator[str]:
    """Serve the page and its events on a free port of this computer until the block ends; yield the address."""
    root = f"/{secrets.token_urlsafe(16)}/"

    class RequestHandler(BaseHTTPRequestHandler):
        timeout = REQUEST_TIMEOUT

        def setup(self) -> None:
            super().setup()  # the attribute `timeout` limits the time between two bytes, the timer that of the request
            self._timer = threading.Timer(REQUEST_TIMEOUT, self._close_connection)
            self._timer.daemon = True
            self._timer.start()

        def _close_connection(self) -> None:
            with contextlib.suppress(OSError):
                self.connection.shutdown(socket.SHUT_RDWR)

        def finish(self) -> None:
            self._timer.cancel()
            super().finish()

        def do_GET(self) -> None:
            self._timer.cancel()
            hosts = {f"{host}:{server.server_port}" for host in (HOST, "localhost")}
            origin = self.headers.get("Origin")
            if self.headers.get("Host") not in hosts or (origin and origin.removeprefix("http://") not in hosts):
                self.send_error(403)  # DNS rebinding, or a page of another site
            elif self.path == root:
                self._send_headers("text/html; charset=utf-8")
                self.wfile.write(page)
            elif self.path == root + EVENTS:
                self._send_headers("text/event-stream")
                for event in stream.subscribe():
                    self.wfile.write(event)
            else:
                self.send_error(404)

        def _send_headers(self, content_type: str) -> None:
            self.send_response(200)
            self.send_header("Content-Type", content_type)
            self.send_header("Cache-Control", "no-store")
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
            pass  # requests must not appear between the log lines of the simulation

    server = _Server(RequestHandler)
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_port}{root}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
