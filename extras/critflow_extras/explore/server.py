"""The server of the page: loopback only, data with the token alone, one `Page` for each tab."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import secrets
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler, stream_request_body
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from critflow.result import CritflowError, EnvironmentFailure, InputError
from critflow_extras.explore.connections import PROTOCOL, Connections, limited_server
from critflow_extras.explore.datasets import Dataset
from critflow_extras.explore.exports import network_file, picture_file
from critflow_extras.explore.page import Page, Reply
from critflow_extras.explore.source import Source
from critflow_extras.explore.uploads import LARGEST_FILE, MOST_AT_A_TIME, Upload, file_name
from critflow_extras.explore.view import packed

LOOPBACK = "127.0.0.1"
# Longest delays of the first numbers, and of those with errors, while the user keeps dragging, in seconds.
LONGEST_DELAYS = (0.15, 0.5)
# Pages of closed tabs that are kept for a reload.
_KEPT = 12
_MOST_MESSAGES = 100  # of a tab that wait for their answer; the page sends one after the answer to the last
_STATIC = {"": "page.html", **{name: name for name in ("raster.js", "picture.js", "plots.js", "page.js", "page.css")}}
_KINDS = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
_UNREADABLE = "the message is no list of values by name that the server can read: reload the page"
_POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'"


class Explorer:
    """All tabs of one server: pages by their name, and the source of a new page."""

    def __init__(self, source: Source | Dataset):
        self.source = source
        self.connections = Connections()
        self.uploads: list[Upload] = []
        self.pages: dict[str, Page] = {}
        self.open_tabs: dict[str, _Socket] = {}
        self.threads = ThreadPoolExecutor(4, thread_name_prefix="explore")
        self.folder = tempfile.TemporaryDirectory(prefix="critflow-explore-")

    def page(self, name: str) -> Page:
        """The page of a tab that was reloaded, or a new one; a copied tab has another page."""
        if name not in self.pages or name in self.open_tabs:
            page = Page(self.source)
            page.name = name = secrets.token_urlsafe(9)
            self.pages[name] = page
        closed = [key for key in self.pages if key not in self.open_tabs and key != name]
        for key in closed[:-_KEPT]:
            del self.pages[key]
        return self.pages[name]

    def redirect_file(self, address: str) -> Path:
        """A file that leads a browser to the address of the page, for this user only.

        The address contains the token, and the arguments of a process are visible to all users of the machine.
        """
        path = Path(self.folder.name) / "open.html"
        with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
            file.write(f'<!doctype html><meta http-equiv="refresh" content="0; url={address}">\n')
        return path

    def close(self) -> None:
        """Stop the computations and delete the files of all tabs."""
        for page in self.pages.values():
            page.stopping = True
        self.threads.shutdown(wait=False, cancel_futures=True)
        self.folder.cleanup()


class _Open(RequestHandler):
    """A handler of files of the package, the same for everybody."""

    def initialize(self, explorer: Explorer) -> None:
        self.explorer = explorer

    def set_default_headers(self) -> None:
        self.set_header("Content-Security-Policy", _POLICY)
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-store")

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        sentence = "this page needs the link that critflow explore printed" if status_code == 403 else self._reason
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}: {sentence}\n")


class _Guarded(_Open):
    """A handler that refuses requests without the token."""

    def prepare(self) -> None:
        self.explorer.connections.admit(self.request)

    def _page(self) -> Page:
        page = self.explorer.pages.get(self.get_query_argument("tab", ""))
        if page is None:
            raise HTTPError(404, reason="this tab is closed, reload it")
        return page


class _Files(_Open):
    """The files of the page, which hold no data: the browser asks for them before it has read the token."""

    def get(self, name: str) -> None:
        if name not in _STATIC:
            raise HTTPError(404)
        file = files("critflow_extras.explore") / _STATIC[name]
        self.set_header("Content-Type", f"{_KINDS[Path(_STATIC[name]).suffix]}; charset=utf-8")
        self.finish(file.read_text(encoding="utf-8"))


class _Token(_Guarded):
    """Whether the token of a page is that of this server."""

    def get(self) -> None:
        self.set_status(204)


class _Export(_Guarded):
    """Files made of the state of a tab: script.py, a picture, or the network in any format."""

    async def get(self, name: str) -> None:
        page, suffix = self._page(), Path(name).suffix
        loop = asyncio.get_running_loop()
        try:
            if name == "script.py":
                name, content = name, page.script().encode()
            else:
                make = partial(picture_file, colour=page.shown_colour) if name.startswith("picture") else network_file
                name, content = await loop.run_in_executor(self.explorer.threads, make, page.session, suffix)
        except CritflowError as error:
            self.set_status(409)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.finish(str(error))
            return
        self.set_header("Content-Type", "text/plain; charset=utf-8" if suffix == ".py" else "application/octet-stream")
        self.set_header("Content-Disposition", f'attachment; filename="{name}"')
        self.finish(content)


@stream_request_body
class _Upload(_Guarded):
    """A file that a tab may open; `prepare` runs before its first byte is read."""

    upload: Upload | None = None

    def prepare(self) -> None:
        super().prepare()
        if self.request.method != "POST":
            return
        page = self._page()
        try:
            name = file_name(self.request.query_arguments.get("name", [b""])[-1])
        except InputError as error:
            raise HTTPError(400, reason=str(error)) from None
        if len(self.explorer.uploads) >= MOST_AT_A_TIME:
            raise HTTPError(503, reason="other files are still on their way, wait for them")
        size = self.request.headers.get("Content-Length", "")
        if size.isdecimal() and int(size) > LARGEST_FILE:
            raise HTTPError(413, reason=f"the file is larger than {LARGEST_FILE // 10**6} MB, start critflow with it")
        self.request.connection.set_max_body_size(LARGEST_FILE)  # type: ignore[union-attr]
        self.upload = Upload(page, name, Path(self.explorer.folder.name))
        self.explorer.uploads.append(self.upload)

    def data_received(self, part: bytes) -> None:
        if self.upload is not None:
            self.upload.write(part)

    def post(self) -> None:
        if self.upload is not None:
            self.upload.keep()
            self._done()

    def on_connection_close(self) -> None:
        super().on_connection_close()
        self._done()

    def _done(self) -> None:
        """Nothing of the file is on its way any more."""
        if self.upload in self.explorer.uploads:
            self.explorer.uploads.remove(self.upload)
            self.upload.drop()


class _Socket(WebSocketHandler):
    """Messages of one tab, in turn; errors and counts follow when the user pauses."""

    def initialize(self, explorer: Explorer) -> None:
        self.explorer, self.name = explorer, ""

    def prepare(self) -> None:
        self.explorer.connections.admit(self.request)

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        return PROTOCOL

    def open(self, *args: str, **kwargs: str) -> None:
        self.set_nodelay(True)
        try:
            self.page = self.explorer.page(self.get_query_argument("tab", ""))
        except CritflowError as error:
            self.close(1011, str(error)[:100])
            return
        self.name = self.page.name
        self.explorer.open_tabs[self.name] = self
        self.messages: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.loop = asyncio.get_running_loop()
        self.page.progress = self._progress(self.loop)
        self.messages.put_nowait({"do": "look"})
        self.work = asyncio.create_task(self._work())

    async def on_message(self, text: str | bytes) -> None:
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            message = None
        if not isinstance(message, dict):
            await self._send(Reply({"fault": _UNREADABLE}))
        elif message.get("do") == "stop":
            self.page.stopping = True
        elif self.messages.qsize() >= _MOST_MESSAGES:
            self.close(1008, "too many messages wait: load the page again")
        else:
            self.messages.put_nowait(message)

    def on_close(self) -> None:
        if self.name:
            self.explorer.open_tabs.pop(self.name, None)
            self.page.stopping = True
            self.work.cancel()

    def _progress(self, loop: asyncio.AbstractEventLoop) -> Callable[[str], None]:
        """Sends a sentence from another thread, a few times a second."""
        last = 0.0

        def send(sentence: str) -> None:
            nonlocal last
            if time.monotonic() - last > 0.3:
                last = time.monotonic()
                loop.call_soon_threadsafe(lambda: asyncio.ensure_future(self._send(Reply({"busy": sentence}))))

        return send

    async def _work(self) -> None:
        """Answer messages in turn, and compute the stages that are due while none comes."""
        shown = [self.loop.time()] * len(LONGEST_DELAYS)
        while True:
            complete = self.page.wait is None
            try:
                # Waiting for no time at all would also leave a message that has arrived.
                wait = self.page.wait if self.messages.empty() else None
                message = await asyncio.wait_for(self.messages.get(), wait)
            except TimeoutError:
                await self._reply(self.page.refine)
                continue
            if complete:
                shown = [self.loop.time()] * len(LONGEST_DELAYS)
            await self._reply(self.page.handle, message)
            late = [self.loop.time() - then > delay for then, delay in zip(shown, LONGEST_DELAYS, strict=True)]
            # Numbers with errors come after the first ones.
            for stage in range(2 if late[1] else int(late[0])):
                await self._reply(self.page.refine)
                shown[stage] = self.loop.time()

    async def _reply(self, compute: Callable[..., Reply | None], *arguments: Any) -> None:
        """Compute and send a reply; a fault of the program is a sentence too, and the tab stays usable."""
        try:
            reply = await self.loop.run_in_executor(self.explorer.threads, compute, *arguments)
            if reply is not None:
                await self._send(reply)
        except Exception as error:
            logging.exception("a reply failed")
            await self._send(Reply({"fault": f"unexpected {type(error).__name__}, {error}: undo the last change"}))

    async def _send(self, reply: Reply) -> None:
        try:
            await self.write_message(packed(reply), binary=True)
        except WebSocketClosedError:
            pass


def application(explorer: Explorer) -> Application:
    """The routes of the page; all but its own files need the token."""
    shared = {"explorer": explorer}
    return Application(
        [
            (r"/socket", _Socket, shared),
            (r"/export/([\w.]+)", _Export, shared),
            (r"/upload", _Upload, shared),
            (r"/token", _Token, shared),
            (r"/(.*)", _Files, shared),
        ],
        websocket_max_message_size=1_000_000,
        websocket_ping_interval=20,
    )


def listening(explorer: Explorer, port: int = 0) -> tuple[HTTPServer, str]:
    """A server on loopback, and the address of its page; browsers keep the token behind the # to themselves."""
    try:
        listener = socket.create_server((LOOPBACK, port))
    except OSError as error:
        raise EnvironmentFailure(
            f"port {port} cannot be used, {error.strerror}: choose another, or leave it out"
        ) from None
    server = limited_server(application(explorer), explorer.connections)
    listener.setblocking(False)
    server.add_sockets([listener])
    return server, f"http://{LOOPBACK}:{listener.getsockname()[1]}/#{explorer.connections.token}"


def serve(explorer: Explorer, port: int, announce: Callable[[str], None]) -> None:
    """Serve until interrupted; `announce` is called with the address."""

    async def run() -> None:
        server, address = listening(explorer, port)
        announce(address)
        try:
            await asyncio.Event().wait()
        finally:
            server.stop()

    try:
        asyncio.run(run())
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
    finally:
        explorer.close()
