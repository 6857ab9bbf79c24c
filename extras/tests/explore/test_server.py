"""The server of the page: loopback only, nothing without the token, exports equal to the state."""

import asyncio
import contextlib
import json
import os
import socket
import time
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPClientError
from tornado.websocket import websocket_connect

from critflow.command.main import main
from critflow.result import EnvironmentFailure
from critflow_extras import network_from
from critflow_extras.explore import connections
from critflow_extras.explore.server import Explorer, listening
from critflow_extras.explore.source import Random
from critflow_extras.explore.uploads import LARGEST_FILE, MOST_AT_A_TIME


class Served:
    """A server and its connections."""

    def __init__(self):
        self.explorer = Explorer(Random(36, 3))
        self.server, self.address = listening(self.explorer)
        self.connections = []
        self.host = f"http://{urlsplit(self.address).netloc}"

    async def get(self, path, token=None, **given):
        token = self.explorer.connections.token if token is None else token
        headers = {"Authorization": f"Bearer {token}"}
        try:
            return await AsyncHTTPClient().fetch(f"{self.host}/{path}", headers=headers, **given)
        except HTTPClientError as error:
            return error.response

    async def tab(self, name=""):
        protocols = ["critflow", self.explorer.connections.token]
        url = f"ws{self.host[4:]}/socket?tab={name}"
        self.connections.append(await websocket_connect(url, subprotocols=protocols))
        return self.connections[-1]

    @staticmethod
    async def reply(connection):
        content = await connection.read_message()
        size = int.from_bytes(content[:4], "little")
        return json.loads(content[4 : 4 + size])

    async def close(self):
        for connection in self.connections:
            connection.close()
        while self.explorer.open_tabs:
            await asyncio.sleep(0.01)
        self.server.stop()
        self.explorer.close()


@pytest.fixture
def server(loop):
    async def served():
        return Served()

    server = loop.run(served())
    yield server
    loop.run(server.close())


async def test_no_data_is_served_without_the_token(server):
    right = server.explorer.connections.token
    for path in ("export/script.py?tab=x", "export/picture.png?tab=x", f"token?token={right}", "socket"):
        for token in ("", "wrong", right[:-1], "é"):
            assert (await server.get(path, token)).code == 403, (path, token)
    assert (await server.get("upload?name=a", "wrong", method="POST", body="x")).code == 403
    for protocols in (None, ["critflow"], ["critflow", "wrong"], ["other", right]):
        with pytest.raises(HTTPClientError, match="403"):
            await websocket_connect(f"ws{server.host[4:]}/socket?token={right}", subprotocols=protocols)
    assert (await server.get("token")).code == 204
    assert (await server.get("nothing")).code == 404
    assert (await server.get("export/script.py?tab=x")).code == 404


async def test_the_files_of_the_page_are_the_same_for_everybody(server):
    page = await server.get("", "")
    assert page.code == 200 and "default-src 'none'" in page.headers["Content-Security-Policy"]
    for path in ("", "page.js", "page.css"):
        assert server.explorer.connections.token not in (await server.get(path)).body.decode()
    # Browsers send no part of an address from its # on.
    address = urlsplit(server.address)
    assert address.fragment == server.explorer.connections.token and not address.query


async def test_nothing_listens_beyond_loopback(server):
    port = urlsplit(server.address).port
    # A server on all addresses would answer on each of 127/8.
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", port), timeout=2)
    with pytest.raises(EnvironmentFailure, match="port"):
        listening(server.explorer, port)


@pytest.mark.parametrize("name", ["..", ".", "", "%00", "a%00b", "a" * 300, "a/b", "%FF", None])
async def test_an_upload_without_a_usable_name_writes_nothing(server, name):
    tab = (await server.reply(await server.tab()))["welcome"]["tab"]
    query = f"upload?tab={tab}" if name is None else f"upload?tab={tab}&name={name}"
    assert (await server.get(query, method="POST", body="x")).code == 400
    assert (await server.get("upload?tab=closed&name=a.csv", method="POST", body="x")).code == 404
    assert list(Path(server.explorer.folder.name).iterdir()) == []
    assert (await server.get(f"upload?tab={tab}&name=a.csv", method="POST", body="x")).code == 200
    assert (await server.get(f"upload?tab={tab}&name=b.csv", method="POST", body="y")).code == 200
    first, second = server.explorer.pages[tab].uploads.values()
    # Two tables of one network lie in one folder.
    assert (first.read_text(), second.read_text()) == ("x", "y") and first.parent == second.parent


def test_the_token_is_in_a_private_file_and_not_in_the_arguments_of_the_browser(monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)

    def look(explorer, port, announce):
        token = explorer.connections.token
        announce(f"http://127.0.0.1:1/#{token}")
        file = Path(unquote(urlsplit(opened[0]).path))
        assert token not in opened[0] and token in file.read_text()
        assert file.stat().st_mode & 0o777 == 0o600 and file.parent.stat().st_mode & 0o077 == 0
        explorer.close()

    monkeypatch.setattr("critflow_extras.explore.server.serve", look)
    assert main(["explore", "--n-vertices", "36"]) == 0 and len(opened) == 1


def test_a_file_that_cannot_be_shown_is_one_sentence(tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe.json")
    for name in ("pipe.json", "missing.csv", "missing.nc"):
        assert main(["explore", str(tmp_path / name)]) == 2
        assert name.split(".")[0] in capsys.readouterr().err


async def test_exports_are_the_state(server, tmp_path):
    connection = await server.tab()
    name = (await server.reply(connection))["welcome"]["tab"]
    await connection.write_message(json.dumps({"do": "change", "change": ["edge", 3, 0.5], "seq": 1}))
    while (await server.reply(connection)).get("seq") != 1:
        pass
    state = server.explorer.pages[name].session.state
    script = await server.get(f"export/script.py?tab={name}")
    assert "np.exp(0.5 * (np.arange(network.n_edges) == 3))" in script.body.decode()
    picture = await server.get(f"export/picture.png?tab={name}")
    server.explorer.pages[name].colour = "length"
    assert (await server.get(f"export/picture.png?tab={name}")).body != picture.body
    assert picture.body.startswith(b"\x89PNG") and "attachment" in picture.headers["Content-Disposition"]
    file = await server.get(f"export/network.json?tab={name}")
    (tmp_path / "network.json").write_bytes(file.body)
    assert network_from(tmp_path / "network.json").force_densities.tolist() == state.critical.sigma.tolist()
    assert (await server.get(f"export/network.csv?tab={name}")).body.startswith(b"PK")
    refused = await server.get(f"export/network.exe?tab={name}")
    assert refused.code == 409 and "ending" in refused.body.decode()


async def test_tabs_are_apart_and_a_reload_finds_its_state(server):
    first = await server.tab()
    name = (await server.reply(first))["welcome"]["tab"]
    copied = await server.reply(await server.tab(name))
    assert copied["welcome"]["tab"] != name
    await first.write_message(json.dumps({"do": "change", "change": ["edge", 3, 0.5], "seq": 1}))
    while (await server.reply(first)).get("seq") != 1:
        pass
    first.close()
    while name in server.explorer.open_tabs:
        await asyncio.sleep(0.01)
    again = await server.reply(await server.tab(name))
    assert again["welcome"]["tab"] == name and again["undo"]


UNREADABLE = {
    "broken": "{",
    "a list": "[]",
    "a number": "7",
    "deep": "[" * 100_000,
    "deep in a message": '{"do": "change", "change": ' + "[" * 100_000,
    "bytes": b"\xff",
    "deep, and readable": '{"do": "change", "change": ' + "[" * 700 + "]" * 700 + "}",
    "no action": '{"do": 7}',
    "no place": json.dumps({"do": "pick", "panel": "network", "x": "x", "y": 0}),
}


@pytest.mark.parametrize("text", UNREADABLE.values(), ids=UNREADABLE)
async def test_a_message_that_cannot_be_read_is_answered_with_a_sentence(server, text):
    connection = await server.tab()
    await server.reply(connection)
    await connection.write_message(text, binary=isinstance(text, bytes))
    found = {}
    while not (found.get("fault") or found.get("error")):
        found = await server.reply(connection)
    assert "reload" in (found.get("fault") or found["sentence"])
    await connection.write_message(json.dumps({"do": "look", "seq": 5}))
    while (await server.reply(connection)).get("seq") != 5:
        pass


async def test_a_tab_with_too_many_messages_is_closed(server, monkeypatch):
    monkeypatch.setattr("critflow_extras.explore.server._MOST_MESSAGES", 3)
    connection = await server.tab()
    await server.reply(connection)
    (tab,) = server.explorer.open_tabs.values()
    monkeypatch.setattr(tab.page, "handle", lambda message: time.sleep(0.2))
    for _ in range(6):
        await connection.write_message(json.dumps({"do": "look"}))
    async with asyncio.timeout(20):
        while await connection.read_message() is not None:
            pass
    assert connection.close_code == 1008 and "load the page again" in connection.close_reason


async def raw(server, head):
    """A connection that has sent a few bytes."""
    address = urlsplit(server.host)
    reader, writer = await asyncio.open_connection(address.hostname, address.port)
    writer.write(head.encode())
    await writer.drain()
    return reader, writer


async def ended(reader, seconds=3.0):
    """What a connection answers until the server closes it; raises `TimeoutError` if it stays open."""
    async with asyncio.timeout(seconds):
        with contextlib.suppress(ConnectionError):
            return await reader.read()
    return b""


def posted(server, token, size, name="a.csv", tab="x"):
    return (
        f"POST /upload?tab={tab}&name={name} HTTP/1.1\r\nHost: a\r\nContent-Length: {size}\r\n"
        f"Authorization: Bearer {token}\r\n\r\n"
    )


async def test_a_body_without_the_token_is_refused_before_it_arrives(server):
    """The request ends while its body is still awaited; the other paths take no body at all."""
    reader, writer = await raw(server, posted(server, "wrong", 40_000_000))
    assert b" 403 " in await ended(reader)
    writer.close()
    for path in ("page.js", "export/script.py", "socket", "token"):
        words = f"GET /{path} HTTP/1.1\r\nHost: a\r\nContent-Length: 40000000\r\n\r\n"
        reader, writer = await raw(server, words)
        await ended(reader)
        writer.close()


async def test_many_slow_connections_are_few_for_the_server(server):
    slow = [await raw(server, "GET / HTTP/1.1\r\n") for _ in range(3 * connections.MOST_UNKNOWN)]
    for reader, _ in slow[: 2 * connections.MOST_UNKNOWN - 1]:
        await ended(reader)
    assert len([known for known in server.explorer.connections.unknown if not known.closed()]) <= 32
    # The page works meanwhile, and what has shown the token is not closed for others.
    tab = await server.tab()
    await server.reply(tab)
    more = [await raw(server, "GET / HTTP/1.1\r\n") for _ in range(2 * connections.MOST_UNKNOWN)]
    await tab.write_message(json.dumps({"do": "look", "seq": 5}))
    while (await server.reply(tab)).get("seq") != 5:
        pass
    for _, writer in slow + more:
        writer.close()


async def test_a_connection_that_asks_for_nothing_is_closed(loop, monkeypatch):
    monkeypatch.setattr(connections, "UNKNOWN_SECONDS", 0.1)
    server = Served()
    for head in ("", "GET / HTTP/1.1\r\nHost:"):
        reader, writer = await raw(server, head)
        await ended(reader)
        writer.close()
    await server.close()


async def test_unfinished_files_are_few_and_leave_nothing(server):
    tab = (await server.reply(await server.tab()))["welcome"]["tab"]
    token, folder = server.explorer.connections.token, Path(server.explorer.folder.name)
    begun = [
        await raw(server, posted(server, token, 1000, f"{number}.csv", tab) + "x" * 500)
        for number in range(MOST_AT_A_TIME)
    ]
    while len(server.explorer.uploads) < MOST_AT_A_TIME:
        await asyncio.sleep(0.01)
    refused = await server.get(f"upload?tab={tab}&name=b.csv", method="POST", body="y")
    assert refused.code == 503 and "wait" in refused.body.decode()
    begun[0][1].write(b"x" * 500)
    assert b" 200 " in await begun[0][0].readline()
    for _, writer in begun:
        writer.close()
    while server.explorer.uploads:
        await asyncio.sleep(0.01)
    assert list(server.explorer.pages[tab].uploads) == ["0.csv"] and list(folder.glob("arriving-*")) == []
    assert server.explorer.pages[tab].uploads["0.csv"].read_text() == "x" * 1000
    reader, writer = await raw(server, posted(server, token, LARGEST_FILE + 1, "b.csv", tab))
    large = await ended(reader)
    writer.close()
    assert b" 413 " in large and b"50 MB" in large
