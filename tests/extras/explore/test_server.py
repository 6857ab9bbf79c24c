"""The server of the page: loopback only, nothing without the token, exports equal to the state."""

import asyncio
import json
import os
import socket
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPClientError
from tornado.websocket import websocket_connect

from critflow import network_from
from critflow.command.main import main
from critflow.extras.explore.server import Explorer, listening
from critflow.extras.explore.source import Random
from critflow.result import EnvironmentFailure


class Served:
    """A server and its connections."""

    def __init__(self):
        self.explorer = Explorer(Random(36, 3))
        self.server, self.address = listening(self.explorer)
        self.connections = []
        self.host = f"http://{urlsplit(self.address).netloc}"

    async def get(self, path, token=None, **given):
        token = self.explorer.token if token is None else token
        url = f"{self.host}/{path}{'&' if '?' in path else '?'}token={token}"
        try:
            return await AsyncHTTPClient().fetch(url, **given)
        except HTTPClientError as error:
            return error.response

    async def tab(self, name=""):
        url = f"ws{self.host[4:]}/socket?token={self.explorer.token}&tab={name}"
        self.connections.append(await websocket_connect(url))
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


async def test_nothing_is_served_without_the_token(server):
    for path in ("", "page.js", "nothing", "export/script.py?tab=x", "export/picture.png?tab=x", "socket"):
        for token in ("", "wrong", server.explorer.token[:-1], "%C3%A9"):
            assert (await server.get(path, token)).code == 403, (path, token)
    assert (await server.get("upload?name=a", "wrong", method="POST", body="x")).code == 403
    with pytest.raises(HTTPClientError, match="403"):
        await websocket_connect(f"ws{server.host[4:]}/socket?token=wrong")
    page = await server.get("")
    assert page.code == 200 and server.explorer.token in page.body.decode()
    assert "default-src 'none'" in page.headers["Content-Security-Policy"]
    assert (await server.get("nothing")).code == 404
    assert (await server.get("export/script.py?tab=x")).code == 404


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
        announce(f"http://127.0.0.1:1/?token={explorer.token}")
        file = Path(unquote(urlsplit(opened[0]).path))
        assert explorer.token not in opened[0] and explorer.token in file.read_text()
        assert file.stat().st_mode & 0o777 == 0o600 and file.parent.stat().st_mode & 0o077 == 0
        explorer.close()

    monkeypatch.setattr("critflow.extras.explore.server.serve", look)
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


async def test_a_page_that_cannot_be_read_leaves_the_server_running(server):
    connection = await server.tab()
    await server.reply(connection)
    for text in ("{", "[]", "7", '{"do": 7}', json.dumps({"do": "pick", "panel": "network", "x": "x", "y": 0})):
        await connection.write_message(text)
    found = {}
    while "incomplete" not in found.get("sentence", ""):
        found = await server.reply(connection)
