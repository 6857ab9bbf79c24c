"""A headless Chromium driven through its DevTools protocol, with the packages that the page itself needs."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tornado.httpclient import AsyncHTTPClient
from tornado.websocket import WebSocketClientConnection, websocket_connect

FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--remote-debugging-port=0"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars"),
)
# Seconds to wait for the browser to start, and for a condition on a page.
_START, _WAIT = 20.0, 15.0


def executable() -> str | None:
    """The path of Chromium, or None where there is no browser."""
    known = Path("/usr/bin/chromium")
    return str(known) if known.exists() else shutil.which("chromium") or shutil.which("google-chrome")


class Chromium:
    """A browser with an empty profile, as an asynchronous context."""

    async def __aenter__(self) -> Self:
        found = executable()
        if found is None:
            raise FileNotFoundError("there is no Chromium: install the package chromium")
        self.folder = tempfile.mkdtemp(prefix="chromium-")
        self.process = subprocess.Popen(
            [found, *FLAGS, f"--user-data-dir={self.folder}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            async with asyncio.timeout(_START):
                written = Path(self.folder) / "DevToolsActivePort"
                while not (written.exists() and "\n" in written.read_text()):
                    await asyncio.sleep(0.02)
        except TimeoutError:
            await self.__aexit__(None, None, None)
            raise
        self.tabs: list[Tab] = []
        self.port = int(written.read_text().split()[0])
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for tab in getattr(self, "tabs", []):
            tab.socket.close()
        await asyncio.sleep(0)
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)

    async def tab(self, url: str, width: int = 1300, height: int = 1150) -> Tab:
        """A new tab of a size in pixels that shows a page."""
        reply = await AsyncHTTPClient().fetch(
            f"http://127.0.0.1:{self.port}/json/new?about:blank", method="PUT", body=""
        )
        socket = await websocket_connect(json.loads(reply.body)["webSocketDebuggerUrl"], max_message_size=2**28)
        tab = Tab(socket)
        self.tabs.append(tab)
        await tab.send("Page.enable")
        await tab.send("Runtime.enable")
        await tab.size(width, height)
        await tab.send("Page.navigate", url=url)
        return tab


class Tab:
    """One tab; `problems` collects exceptions of its scripts."""

    def __init__(self, socket: WebSocketClientConnection):
        self.socket, self.number, self.problems = socket, 0, list[str]()

    async def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        self.number += 1
        number = self.number
        await self.socket.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            text = await self.socket.read_message()
            if text is None:
                raise ConnectionError("the browser closed the tab")
            message = json.loads(text)
            if message.get("method") == "Runtime.exceptionThrown":
                self.problems.append(str(message["params"]["exceptionDetails"].get("exception", {}).get("description")))
            if message.get("id") == number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']['message']}")
                return dict(message["result"])

    async def run(self, script: str) -> Any:
        """The value of a script, awaited if it is a promise."""
        reply = await self.send("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in reply:
            raise RuntimeError(str(reply["exceptionDetails"].get("exception", {}).get("description")))
        return reply["result"].get("value")

    async def until(self, condition: str, wait: float = _WAIT) -> Any:
        """Wait until a script returns a true value, and return it."""
        try:
            async with asyncio.timeout(wait):
                while True:
                    found = await self.run(condition)
                    if found:
                        return found
                    await asyncio.sleep(0.02)
        except TimeoutError:
            raise TimeoutError(
                f"{condition}; the page says {await self.run('document.body.innerText.slice(0, 300)')!r}"
            ) from None

    async def size(self, width: int, height: int) -> None:
        """Set the size of the window in pixels."""
        await self.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
        )

    async def mouse(self, kind: str, x: float, y: float) -> None:
        """A mouse event: "mousePressed", "mouseMoved" or "mouseReleased"."""
        await self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    async def screenshot(self) -> bytes:
        """The window as PNG."""
        return base64.b64decode((await self.send("Page.captureScreenshot", format="png"))["data"])
