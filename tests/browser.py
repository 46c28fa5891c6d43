"""A headless browser, driven over the pipe of its DevTools protocol, without another library."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
#: The browser reads commands from descriptor 3 and writes answers to 4.
_AS_3_AND_4 = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(n), fcntl.F_DUPFD, 10) for n in sys.argv[1:3]]
for number, end in zip((3, 4), ends):
    os.dup2(end, number)
os.execv(sys.argv[3], sys.argv[3:])
"""
#: A command that takes longer than this has got lost [s].
_PATIENCE = 60.0


def browser_path() -> str | None:
    """The browser of this machine, None without one."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class BrowserError(RuntimeError):
    """The browser has refused a command, or has gone."""


class Browser:
    """A browser with one page, started with further flags if there are any.

    Attributes:
        errors: what the page has thrown or written as errors since it was opened.
    """

    def __init__(self, path: str, *flags: str) -> None:
        self.errors: list[str] = []
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        commands, self._out = os.pipe()
        self._in, answers = os.pipe()
        shim = [sys.executable, "-c", _AS_3_AND_4, str(commands), str(answers), path]
        self._process = subprocess.Popen(
            [*shim, *_FLAGS, *flags, f"--user-data-dir={self._profile.name}", "about:blank"],
            pass_fds=(commands, answers),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(commands)
        os.close(answers)
        self._rest, self._number, self._session = b"", 0, ""
        self._loaded = False
        found = self.command("Target.getTargets")["targetInfos"]
        page = next(target["targetId"] for target in found if target["type"] == "page")
        attached = self.command("Target.attachToTarget", targetId=page, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.command(f"{domain}.enable")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the browser and takes its profile away."""
        self._process.terminate()
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._in)
        os.close(self._out)
        self._profile.cleanup()

    def open(self, page: Path) -> None:
        """Opens a file and waits until it has loaded; forgets errors of the page before."""
        self.visit(page.resolve().as_uri())

    def visit(self, url: str) -> None:
        """The same with an address."""
        self.errors.clear()
        self._loaded = False
        self.command("Page.navigate", url=url)
        end = time.monotonic() + _PATIENCE
        while not self._loaded:
            self._take(end)
        # What a page does in its load event and in the frame after it is part of loading.
        self.run("new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")

    def size(self, width: int, height: int, *, phone: bool = False, sharp: float = 1.0) -> None:
        """Gives the viewport a size [CSS px], with a touch screen for a phone."""
        self.command(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=sharp,
            mobile=phone,
        )
        self.command("Emulation.setTouchEmulationEnabled", enabled=phone)

    def media(self, kind: str = "", *, dark: bool = False) -> None:
        """Shows pages as on a screen or as printed, on light or dark ground."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.command("Emulation.setEmulatedMedia", media=kind, features=[scheme])

    def run(self, script: str) -> Any:
        """The value of an expression in the page; a promise is waited for."""
        told = self.command(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in told:
            raise BrowserError(_told(told["exceptionDetails"]))
        return told["result"].get("value")

    def mouse(self, kind: str, x: float, y: float, *, down: bool = False, clicks: int = 0) -> None:
        """Moves, presses or releases the mouse at a place of the viewport [CSS px]."""
        held = {"button": "left" if down or clicks else "none", "buttons": int(down)}
        names = {"type": f"mouse{kind}", "x": x, "y": y, "clickCount": clicks}
        self.command("Input.dispatchMouseEvent", **names, **held)

    def swipe(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Draws a finger over the screen, in ten steps."""
        for i in range(11):
            x, y = (a + (b - a) * i / 10 for a, b in zip(start, end, strict=True))
            kind = "touchMove" if i else "touchStart"
            self.command("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y}])
        self.command("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def key(self, name: str) -> None:
        """Presses and releases a key by its name, such as `Tab` or `ArrowRight`."""
        for kind in ("rawKeyDown", "keyUp"):
            code = {"Tab": 9, "Enter": 13, "Escape": 27, "Home": 36}.get(name, 0)
            self.command(
                "Input.dispatchKeyEvent",
                **{"type": kind, "key": name, "code": name, "windowsVirtualKeyCode": code},
            )

    def png(self, *, whole: bool = False) -> bytes:
        """A picture of the viewport, or of the whole page."""
        told = self.command("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        return base64.b64decode(told["data"])

    def pdf(self) -> bytes:
        """The page as it prints."""
        told = self.command("Page.printToPDF", printBackground=False, preferCSSPageSize=True)
        return base64.b64decode(told["data"])

    def command(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Sends a command of the protocol and waits for its answer.

        Raises:
            BrowserError: the browser refuses it, has gone or says nothing.
        """
        self._number += 1
        number = self._number
        content = {"id": number, "method": method, "params": parameters}
        if self._session:
            content["sessionId"] = self._session
        os.write(self._out, json.dumps(content).encode() + b"\0")
        end = time.monotonic() + _PATIENCE
        while True:
            told = self._take(end)
            if told.get("id") == number:
                if "error" in told:
                    raise BrowserError(f"{method}: {told['error'].get('message')}")
                result: dict[str, Any] = told["result"]
                return result

    def _take(self, end: float) -> dict[str, Any]:
        """The next message; notes what it says of the page."""
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._in], [], [], max(end - time.monotonic(), 0.0))
            more = os.read(self._in, 1 << 20) if ready else b""
            if not more:
                raise BrowserError("the browser says nothing" if not ready else "it has gone")
            self._rest += more
        text, _, self._rest = self._rest.partition(b"\0")
        told: dict[str, Any] = json.loads(text)
        match told.get("method"), told.get("params", {}):
            case "Page.loadEventFired", _:
                self._loaded = True
            case "Runtime.exceptionThrown", parameters:
                self.errors.append(_told(parameters["exceptionDetails"]))
            case "Runtime.consoleAPICalled", {"type": "error" | "assert" as kind, "args": args}:
                self.errors.append(f"{kind}: {[arg.get('value') for arg in args]}")
            case "Log.entryAdded", {"entry": {"level": "error", "text": text_}}:
                self.errors.append(text_)
        return told


def _told(details: dict[str, Any]) -> str:
    thrown = details.get("exception", {})
    return str(thrown.get("description") or thrown.get("value") or details.get("text"))
