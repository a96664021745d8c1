"""Headless Chromium for tests of pages, controlled by its DevTools protocol over two pipes, without a package."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import os
import selectors
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOUND = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
FLAGS = (
    *("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--remote-debugging-pipe", "--no-first-run", "--disable-extensions", "--disable-background-networking"),
)
CONTRAST = """(() => {
  const light = (color) => {
    const [r, g, b] = color.match(/[\\d.]+/g).map((x) => x / 255)
      .map((x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ground = light(getComputedStyle(document.body).backgroundColor);
  return Math.min(...[...document.querySelectorAll("p, td, th, dt, dd, h1, h2, a, .bad, .quiet")].map((element) => {
    const text = light(getComputedStyle(element).color);
    return (Math.max(text, ground) + 0.05) / (Math.min(text, ground) + 0.05);
  }));
})()"""  # smallest contrast of text and background by WCAG 2.2; 4.5 is required
TIMEOUT = 120.0  # s per response; a shared computer renders slowly


class Page:
    """One page, with the requests, console messages and exceptions since it was opened."""

    def __init__(self, write: int, read: int) -> None:
        self._write, self._read, self._rest = write, read, b""
        self._ready = selectors.DefaultSelector()
        self._ready.register(read, selectors.EVENT_READ)
        self._numbers, self._session = itertools.count(1), ""
        self.requests: list[str] = []
        self.errors: list[str] = []
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self._call(f"{domain}.enable")

    def open(
        self, path: Path, width: int = 1280, height: int = 800, dark: bool = False, ready: str = "window.state"
    ) -> None:
        """Open a file in a window of some size [px] and wait for the expression `ready`."""
        phone = {"mobile": width < 500, "deviceScaleFactor": 1}
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, **phone)
        look = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._call("Emulation.setEmulatedMedia", features=[look])
        self.visit(path.as_uri(), ready)

    def visit(self, address: str, ready: str = "window.state") -> None:
        """Open an address and wait for the expression `ready`."""
        self._call("Page.navigate", url=address)
        self.wait(f"document.readyState === 'complete' && Boolean({ready})")
        self.wait_until_drawn()

    def evaluate(self, script: str) -> Any:
        """Return the value of an expression, or of its promise; raise AssertionError if it throws."""
        done = self._call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in done, done["exceptionDetails"]
        return done["result"].get("value")

    def wait(self, script: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + TIMEOUT
        while not self.evaluate(script):
            assert time.monotonic() < end, f"never: {script}; {self.errors}"
            time.sleep(0.05)

    def wait_until_drawn(self) -> None:
        """Wait for two animation frames, after which changes are drawn."""
        self.evaluate("new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(() => drawn(1))))")

    def press(self, key: str, code: str = "", shift: bool = False) -> None:
        """Press and release a key by its name in the DOM, and by the code of its place on the keyboard."""
        numbers = {" ": 32, "End": 35, "Home": 36, "ArrowLeft": 37, "ArrowRight": 39, "Escape": 27}
        event = {"key": key, "code": code, "modifiers": 8 if shift else 0}
        for kind in ("keyDown", "keyUp"):
            number = numbers.get(key) or ord(key.upper())
            self._call("Input.dispatchKeyEvent", type=kind, windowsVirtualKeyCode=number, **event)

    def click(self, x: float, y: float) -> None:
        """Press and release the left button at a position of the window [px]."""
        for kind, held in (("mousePressed", 1), ("mouseReleased", 0)):
            self._call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=held, clickCount=1)

    def screenshot(self, whole: bool = False) -> bytes:
        """Return the visible part, or the whole page, as PNG."""
        return base64.b64decode(self._call("Page.captureScreenshot", captureBeyondViewport=whole)["data"])

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        number = next(self._numbers)
        session = {"sessionId": self._session} if self._session else {}
        os.write(
            self._write, json.dumps({"id": number, "method": method, "params": parameters} | session).encode() + b"\0"
        )
        while (message := self._read_message()).get("id") != number:
            self._record_event(message.get("method", ""), message.get("params", {}))
        assert "error" not in message, f"{method}: {message['error']}"
        return message["result"]

    def _read_message(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            assert self._ready.select(TIMEOUT), "no response from the browser"
            received = os.read(self._read, 1 << 20)
            assert received, "the browser has ended"
            self._rest += received
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)

    def _record_event(self, event: str, params: dict[str, Any]) -> None:
        if event == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
        elif event == "Runtime.exceptionThrown":
            self.errors.append(str(params["exceptionDetails"]))
        elif event == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            self.errors.append(str(params["args"]))
        elif event == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            self.errors.append(params["entry"]["text"])


@contextlib.contextmanager
def page(profile: Path, *flags: str) -> Iterator[Page]:
    """Page of a separate browser with its profile in a folder; the browser ends with the block."""
    assert FOUND
    to_browser, from_us = os.pipe()
    to_us, from_browser = os.pipe()
    # it reads from descriptor 3 and writes to 4
    start = f'exec "$0" "$@" 3<&{to_browser} 4>&{from_browser}'
    command = ["/bin/bash", "-c", start, FOUND, *FLAGS, *flags, f"--user-data-dir={profile}"]
    browser = subprocess.Popen(
        command, pass_fds=(to_browser, from_browser), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    os.close(to_browser)
    os.close(from_browser)
    try:
        yield Page(from_us, to_us)
    finally:
        os.close(from_us)  # it ends when the pipe is closed
        try:
            browser.wait(20)
        except subprocess.TimeoutExpired:
            browser.kill()
            browser.wait()
        os.close(to_us)
