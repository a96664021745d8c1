"""Tests of the live view: local connections only, and each frame once as logged."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from colift.scenario import experiment, team
from colift.visualization import live_view, scene
from tests.support import browser
from tests.support import playback_logs as played
from tests.support import small_team as light

CASE = "C3"


@pytest.fixture(scope="module")
def live_flight() -> Iterator[dict[str, Any]]:
    """A finished flight whose stream was read during the simulation, with its page still served."""
    settings = played.short_flight()
    received: dict[str, Any] = {}

    def read() -> None:
        with urllib.request.urlopen(received["address"] + "events", timeout=300) as stream:
            received["kind"], received["stream"] = stream.headers["Content-Type"], stream.read().decode()

    reader = threading.Thread(target=read)

    def ready(address: str) -> None:
        received["address"] = address
        reader.start()

    with live_view.serve_live_flight(
        settings, experiment.make_experiment(settings, CASE), CASE, "as in the tests", ready
    ) as flight:
        reader.join(60)
        yield received | {"flight": flight}


def events(stream: str) -> list[dict[str, Any]]:
    *messages, last, after = stream.split("\n\n")
    assert (last, after) == ("event: end\ndata: {}", "")
    assert all(each.startswith("data: ") for each in messages)
    return [json.loads(each.removeprefix("data: ")) for each in messages]


def numbers(packed: dict[str, Any]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["float32"]), dtype="<f4").reshape(packed["shape"])


@pytest.mark.long
def test_stream_has_every_frame_once(live_flight):
    settings, messages = played.short_flight(), events(live_flight["stream"])
    assert live_flight["kind"] == "text/event-stream"
    assert len(messages) >= 4  # one per chunk, split by the update, and the end
    assert [each["from"] for each in messages] == [0, *(each["known"] for each in messages[:-1])]
    flight = live_flight["flight"]
    ds = played.labelled(flight.records, flight.uncertainty, settings, update_times_s=[0.8], case=CASE)
    expected = scene.frames(ds, team.team(settings)[0]) | scene.plot_signals(ds)
    for name in messages[0]["tracks"]:
        track = np.concatenate([numbers(each["tracks"][name]) for each in messages if each["tracks"]])
        np.testing.assert_array_equal(track, expected[name].astype("<f4"), err_msg=name)
    assert messages[-1]["marks"] == scene.event_markers(ds)
    np.testing.assert_array_equal(numbers(messages[-1]["sigma"]), expected["sigma"].astype("<f4"))
    assert [each["marks"]["updates"] for each in messages[:2]] == [[], [0.8]]


def test_server_accepts_local_connections_only(live_flight):
    port = urllib.parse.urlsplit(live_flight["address"]).port
    assert re.fullmatch(rf"http://127\.0\.0\.1:{port}/[\w-]{{20,}}/", live_flight["address"])
    listening = []
    for table, here in (("tcp", "0100007F"), ("tcp6", None)):
        with contextlib.suppress(FileNotFoundError), open(f"/proc/net/{table}") as lines:  # noqa: PTH123
            listening += [line.split()[1] for line in lines if f":{port:04X} " in line and line.split()[3] == "0A"]
            assert here is None or listening == [f"{here}:{port:04X}"]
    with pytest.raises(OSError, match=r"refused|unreachable|assign"):
        socket.create_connection((_other_address(), port), timeout=5).close()


def _other_address() -> str:
    """Another local address: every address of 127/8 is local on Linux."""
    return "127.0.0.2" if sys.platform == "linux" else "::1"


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("", {"Host": "evil.example"}, 403),
        ("", {"Origin": "http://evil.example"}, 403),
        ("events", {"Origin": "null"}, 403),
        ("secrets", {}, 404),
        ("../", {}, 404),
        ("../events", {}, 404),
    ],
)
def test_other_paths_hosts_and_origins_are_refused(live_flight, path, headers, status):
    """Without the token in the address, neither the page nor the events are available."""
    request = urllib.request.Request(urllib.parse.urljoin(live_flight["address"], path), headers=headers)
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(request, timeout=10)
    assert refused.value.code == status
    refused.value.close()


def connect(live_flight) -> socket.socket:
    parts = urllib.parse.urlsplit(live_flight["address"])
    return socket.create_connection((parts.hostname, parts.port), timeout=10)


@pytest.fixture
def short_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fifth of a second in place of five."""
    monkeypatch.setattr(live_view, "REQUEST_TIMEOUT", 0.2)


@pytest.mark.parametrize("pause", [0.02, 10.0])
def test_an_incomplete_request_is_closed(live_flight, short_timeout, pause):
    """Neither a connection without data nor one that sends single bytes stays open."""
    with connect(live_flight) as connection:
        connection.settimeout(pause)
        began = time.monotonic()
        while time.monotonic() - began < 5:
            try:
                connection.sendall(b"G")
                if not connection.recv(1):
                    break
            except TimeoutError:
                continue
            except ConnectionError:
                break
        assert time.monotonic() - began < 4


def test_the_number_of_connections_is_limited(live_flight):
    with contextlib.ExitStack() as stack:
        for _ in range(live_view.MAX_CONNECTIONS):
            stack.enter_context(connect(live_flight))
        time.sleep(0.3)
        with pytest.raises((urllib.error.URLError, ConnectionError)):
            urllib.request.urlopen(live_flight["address"], timeout=10)
    deadline = time.monotonic() + 10
    while True:  # the page is available again when connections have ended
        try:
            urllib.request.urlopen(live_flight["address"], timeout=10).close()
            break
        except (urllib.error.URLError, ConnectionError):
            assert time.monotonic() < deadline
            time.sleep(0.1)


def test_a_reader_that_leaves_is_no_error(live_flight, capfd):
    parts = urllib.parse.urlsplit(live_flight["address"])
    for path in (parts.path, f"{parts.path}events"):
        with connect(live_flight) as connection:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # reset at the end
            connection.sendall(f"GET {path} HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode())
            connection.recv(10)
    time.sleep(0.3)
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.skipif(browser.FOUND is None, reason="there is no Chromium")
def test_page_shows_the_stream_and_makes_no_other_request(live_flight, tmp_path):
    with browser.page(tmp_path) as page:
        page.visit(live_flight["address"])
        page.wait("!state().running")
        state = page.evaluate("state()")
        rows = live_flight["flight"].records
        assert (state["case"], state["end"]) == (CASE, pytest.approx(rows.t[-1], abs=1e-6))
        # one expression: the page still plays, so the next animation frame changes the time again
        position = page.evaluate("(seek(1.0), state().p)")
        np.testing.assert_allclose(position, rows.p[np.searchsorted(rows.t, 1.0 - 1e-9)], atol=1e-3)
        assert page.errors == []
        assert set(page.requests) == {live_flight["address"], live_flight["address"] + "events"}


@pytest.mark.long
def test_ctrl_c_ends_command_and_server(tmp_path):
    file = light.write(tmp_path / "short.yaml", learning=played.short_flight().learning, duration_s=1.5)
    command = [sys.executable, "-m", "colift", "live", str(file), "--case", "C1"]
    handler = "signal.signal(signal.SIGINT, signal.default_int_handler)"  # ignored in a shell's background
    reset = f"import os, signal, sys; {handler}; os.execv(sys.argv[1], sys.argv[1:])"
    command = [sys.executable, "-c", reset, *command]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ
    ) as process:
        assert process.stdout
        address = process.stdout.readline().split()[3]
        assert process.stdout.readline() == "the flight has ended\n"
        with urllib.request.urlopen(address, timeout=30) as page:
            assert "default-src 'none'" in page.read().decode()
        process.send_signal(signal.SIGINT)
        _, messages = process.communicate(timeout=60)
    assert (process.returncode, messages) == (130, "interrupted\n")
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(address, timeout=5)
