# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""The server, asked as browsers and others do."""

from __future__ import annotations

import asyncio
import json
import math
import os
import resource
import socket
import subprocess
import sys
import threading
import time
from contextlib import closing
from urllib.parse import urlsplit

import pytest
from support.pages import live_state, message, numbered, put_moving, run, served
from support.patience import WAIT

pytest.importorskip("tornado")

from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

from tsepm_ros.settings.node_options import ViewerNodeOptions
from tsepm_ros.tools.viewer import page_server
from tsepm_ros.tools.viewer.page_files import SCRIPTS, STYLE
from tsepm_ros.tools.viewer.page_server import (
    HEADERS,
    PageServer,
    PageServerAccess,
    page_server_token,
)

TOKEN = "a-token-of-some-length"


def get(url: str, **more):
    """An answer, whatever its status; redirects are not followed."""

    async def ask():
        request = HTTPRequest(url, follow_redirects=False, request_timeout=WAIT, **more)
        return await AsyncHTTPClient(force_instance=True).fetch(request, raise_error=False)

    return run(ask)


def updates(server: PageServer) -> str:
    return server.url.replace("http", "ws", 1).replace("/?", "/updates?") + (
        "" if "?" in server.url else "updates"
    )


def numbers(update) -> list[int]:
    return [frame["number"] for frame in update.get("frames", [])]


def test_the_page_and_its_files_come_with_a_strict_policy_and_nothing_else():
    with served(live_state()) as server:
        for path in ("", STYLE, *SCRIPTS):
            answer = get(server.url + path)
            assert answer.code == 200 and answer.body
            for name, value in HEADERS.items():
                assert answer.headers[name] == value
        assert b'data-source="live"' in get(server.url).body
        assert "default-src 'none'" in HEADERS["Content-Security-Policy"]
        for path in ("nothing", "../setup.py", "page/watch.js", "recording"):
            assert get(server.url + path).code == 404


def test_a_recording_is_served_compressed_and_plain():
    recording = json.dumps({"all": True, "frames": [numbered(1)] * 50})
    with served(recording=recording) as server:
        plain = get(server.url + "recording", decompress_response=False)
        assert plain.body.decode() == recording
        packed = get(server.url + "recording", decompress_response=True)
        assert packed.body.decode() == recording
        assert b'data-source="recording"' in get(server.url).body
        assert get(server.url + "updates").code == 404


FOREIGN = "evil.example", "evil.example:80", "localhost.evil.example", "a@b@c", "[bad"
OWN = "localhost", "127.0.0.1:9000", "[::1]:8470", "LOCALHOST:1"


def test_a_name_that_is_not_this_machine_s_is_refused():
    """A page that has pointed its own name here (DNS rebinding) reads nothing."""
    with served(live_state(1)) as server:
        for path in ("", "updates", "nothing"):
            for host in (*FOREIGN, "192.168.1.5", ""):
                assert get(server.url + path, headers={"Host": host}).code in (400, 403)
        assert {get(server.url, headers={"Host": host}).code for host in OWN} == {200}
    with served(live_state(1), host="0.0.0.0", token=TOKEN) as server:
        url = f"http://127.0.0.1:{urlsplit(server.url).port}/?token={TOKEN}"
        assert get(url, headers={"Host": "192.168.1.5:8470"}).code == 303
        for host in FOREIGN:
            assert get(url, headers={"Host": host}).code in (400, 403)


@pytest.mark.parametrize(
    ("address", "is_open"),
    [
        *(("127.1.2.3", True), ("::1", True), ("192.168.1.5", False)),
        *(("::", False), ("fe80::1%eth0", False)),
    ],
)
def test_what_others_can_reach_needs_a_token_of_its_own(address, is_open):
    first, second = (page_server_token(["127.0.0.1", address], "") for _ in range(2))
    assert (first == second == "") if is_open else (len(first) >= 32 and first != second)
    for given in ("", f"{TOKEN}-", TOKEN.upper(), "ä"):
        assert not PageServerAccess.to("0.0.0.0", TOKEN).allows_token(given)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "http://["]
)
def test_a_page_of_another_site_is_refused(origin):
    async def connect():
        request = HTTPRequest(updates(server), headers={"Origin": origin})
        with pytest.raises(Exception, match="403"):
            await websocket_connect(request)

    with served(live_state(1)) as server:
        run(connect)
        assert get(server.url, headers={"Origin": origin}).code == 403


@pytest.mark.parametrize("files", [None, 40], ids=["by number", "by free files"])
def test_many_connections_with_half_a_request_leave_the_page_answered(files, capfd, monkeypatch):
    half = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    with served(live_state(1)) as server:
        before = len(os.listdir("/proc/self/fd"))
        address = ("127.0.0.1", urlsplit(server.url).port)
        script = (
            "import socket, sys\n"
            "held = []\n"
            f"for _ in range(300): held.append(socket.create_connection({address!r}))\n"
            f"for one in held: one.sendall({half!r})\n"
            "print('held', flush=True)\n"
            "sys.stdin.read()\n"
        )
        limits = resource.getrlimit(resource.RLIMIT_NOFILE)
        client = subprocess.Popen([sys.executable, "-c", script], stdin=-1, stdout=-1)
        browser = socket.socket()
        browser.settimeout(WAIT)
        try:
            if files:
                resource.setrlimit(resource.RLIMIT_NOFILE, (before + files, limits[1]))
            assert client.stdout.readline() == b"held\n"
            browser.connect(address)
            browser.sendall(half + b"Connection: close\r\n\r\n")
            assert browser.recv(12) == b"HTTP/1.1 200"
            resource.setrlimit(resource.RLIMIT_NOFILE, limits)
            assert len(os.listdir("/proc/self/fd")) <= before + page_server.MAX_CONNECTIONS + 4
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, limits)
            browser.close()
            client.communicate()
    assert capfd.readouterr().err == ""


def test_half_a_request_is_given_up(monkeypatch):
    monkeypatch.setattr(page_server, "REQUEST_TIMEOUT", 0.2)
    with served(live_state(1)) as server:
        address = ("127.0.0.1", urlsplit(server.url).port)
        for half in (b"GET /", b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 9\r\n\r\nabc"):
            with closing(socket.create_connection(address, timeout=WAIT)) as browser:
                browser.sendall(half)
                assert browser.recv(1) in (b"", b"H"), "closed, or refused first"


def test_on_other_addresses_everything_needs_the_token():
    with served(live_state(1), host="0.0.0.0") as server:
        parts = urlsplit(server.url)
        assert len(parts.query) > len("token=") + 30
        base = f"http://127.0.0.1:{parts.port}/"
        for path in ("", STYLE, SCRIPTS[0], "updates", "nothing"):
            assert get(base + path).code == 403
            assert get(f"{base}{path}?token=wrong").code == 403

        async def connect():
            with pytest.raises(Exception, match="403"):
                await websocket_connect(f"ws://127.0.0.1:{parts.port}/updates")
            open_socket = await websocket_connect(
                f"ws://127.0.0.1:{parts.port}/updates?{parts.query}"
            )
            update = await message(open_socket)
            open_socket.close()
            return update

        assert numbers(run(connect)) == [1]


@pytest.mark.parametrize(
    "token", ["a passphrase of words ", 'a "quoted"; token, 50 % = \\\'', " " * 16]
)
def test_a_token_of_any_characters_opens_the_page_and_its_files(token):
    with served(live_state(1), host="127.0.0.1", token=token) as server:
        answer = get(server.url)
        assert answer.code == 303
        cookie = answer.headers["Set-Cookie"].partition(";")[0]
        assert not set(cookie) & set(' ",\\'), "a browser need not send these as it got them"
        base = server.url.partition("?")[0]
        assert get(base + STYLE, headers={"Cookie": cookie}).code == 200


def test_the_token_of_the_printed_address_becomes_a_cookie():
    with served(live_state(1), host="127.0.0.1", token=TOKEN) as server:
        assert server.url.endswith(f"/?token={TOKEN}")
        base = server.url.partition("?")[0]
        answer = get(server.url)
        assert (answer.code, answer.headers["Location"]) == (303, "/")
        cookie = answer.headers["Set-Cookie"]
        assert "HttpOnly" in cookie and "SameSite=Lax" in cookie
        headers = {"Cookie": cookie.partition(";")[0]}
        assert get(base, headers=headers).code == 200
        assert get(base + STYLE, headers=headers).code == 200
        assert get(base, headers={"Cookie": headers["Cookie"] + "x"}).code == 403

        async def connect():
            request = HTTPRequest(f"ws{base[4:]}updates", headers=headers)
            browser = await websocket_connect(request)
            update = await message(browser)
            browser.close()
            return update

        assert numbers(run(connect)) == [1]


def test_the_newest_sonar_image_is_given_to_browsers_that_ask_for_it():
    state = live_state(1)
    assert state.image_asked == -math.inf
    with served(state) as server:
        state.image = '{"stamp":1}'
        assert json.loads(get(f"{server.url}image").body) == {"stamp": 1}
        assert state.image_asked > 0.0


def test_a_browser_follows_and_one_that_comes_back_gets_the_present_state():
    state = live_state(2)

    async def follow():
        first = await websocket_connect(updates(server))
        assert numbers(await message(first)) == [1, 2]
        put_moving(state, 3)
        assert numbers(await message(first)) == [3]
        first.close()
        put_moving(state, 4)
        again = await websocket_connect(updates(server))
        update = await message(again)
        assert update["all"] and numbers(update) == [1, 2, 3, 4]
        assert update["facts"]["7"]["confirmed"] == 12.0
        again.close()
        while server.browsers:
            await asyncio.sleep(0.01)

    with served(state) as server:
        run(follow)


def test_a_browser_gets_a_sign_of_life_while_nothing_changes():
    async def follow():
        browser = await websocket_connect(updates(server))
        assert (await message(browser))["all"]
        for _ in range(2):
            assert await asyncio.wait_for(message(browser), 5.0 * page_server.SIGN_OF_LIFE) == {}
        put_moving(state, 3)
        while not (update := await message(browser)):
            pass
        assert numbers(update) == [3]
        browser.close()

    state = live_state(2)
    with served(state) as server:
        run(follow)


def test_a_browser_that_does_not_read_costs_nothing_and_then_gets_the_newest():
    state = live_state(0, kept=3)
    many = [float(k) for k in range(20_000)]
    frames = 300

    async def read_all():
        """Connect, let the server write without reading, and count what comes then."""
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=2**26)
        writer.write(
            b"GET /updates HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
            b"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        await reader.readuntil(b"\r\n\r\n")
        await frame_of(reader)  # the state without frames
        writer.transport.pause_reading()
        for number in range(1, frames + 1):
            state.put(numbered(number) | {"detections": many})
            await asyncio.sleep(0.001)
        await asyncio.sleep(0.1)
        writer.transport.resume_reading()
        found: list[int] = []
        while not found or found[-1] < frames:
            found += numbers(json.loads(await frame_of(reader)))
        writer.close()
        return found

    with served(state) as server:
        port = urlsplit(server.url).port
        received = run(read_all)
    assert received[-1] == frames and received == sorted(received)
    # A message is 0.14 MB; what the system's buffers hold, some MB, is all that can be old.
    assert len(received) < frames / 2


async def frame_of(reader: asyncio.StreamReader) -> bytes:
    """The payload of the next text message of a websocket, read by hand."""
    while True:
        first, length = await reader.readexactly(2)
        if length == 126:
            length = int.from_bytes(await reader.readexactly(2), "big")
        elif length == 127:
            length = int.from_bytes(await reader.readexactly(8), "big")
        payload = await reader.readexactly(length)
        if first & 0x0F == 1:
            return payload


def test_there_are_not_more_browsers_than_allowed(monkeypatch):
    monkeypatch.setattr(page_server, "MAX_BROWSERS", 2)

    async def connect():
        sockets = [await websocket_connect(updates(server)) for _ in range(3)]
        assert [await message(one) for one in sockets[:2]]
        assert await sockets[2].read_message() is None
        assert sockets[2].close_code == 1013
        sockets[0].close()
        while len(server.browsers) > 1:
            await asyncio.sleep(0.01)
        again = await websocket_connect(updates(server))
        assert await message(again)
        for one in (sockets[1], again):
            one.close()

    with served(live_state(1)) as server:
        run(connect)


def test_what_a_browser_sends_is_ignored_and_must_be_short():
    async def talk():
        browser = await websocket_connect(updates(server))
        await message(browser)
        browser.write_message("anything")
        put_moving(state, 2)
        assert numbers(await message(browser)) == [2]
        browser.write_message("x" * 100_000)
        assert await browser.read_message() is None

    state = live_state(1)
    with served(state) as server:
        run(talk)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # tornado's socket
def test_a_port_in_use_is_named():
    with served(live_state()) as server:
        port = urlsplit(server.url).port
        with pytest.raises(ValueError, match=rf"port {port}: .*choose another port"):
            PageServer(ViewerNodeOptions(port=port), "Tracks", live_state())


def test_the_end_closes_connections_frees_the_port_and_what_comes_later_is_left():
    async def connect():
        browser = await websocket_connect(updates(server))
        await message(browser)
        server.stop()
        assert await browser.read_message() is None

    with served(live_state(1)) as server:
        run(connect)
        with socket.create_server(("127.0.0.1", urlsplit(server.url).port)):
            pass
        server.stop()  # a second time changes nothing
        put_moving(live_state(1), 2)
    called = threading.Event()
    state = live_state(1)
    with served(state) as server:
        server.call_later(0.0, called.set)
        assert called.wait(WAIT)
    server.call_later(0.0, lambda: pytest.fail("called after the end"))
    put_moving(state, 2)


def test_a_server_that_was_not_started_or_that_is_stopped_while_it_starts_ends():
    server = PageServer(ViewerNodeOptions(port=0), "Tracks", live_state())
    server.stop()
    assert server.loop.is_closed()
    with socket.create_server(("127.0.0.1", urlsplit(server.url).port)):
        pass
    for _ in range(100):
        server = PageServer(ViewerNodeOptions(port=0), "Tracks", live_state())
        server.start()
        while not server.loop.is_running():
            pass
        server.stop()
        assert server.loop.is_closed()


@pytest.mark.parametrize("begun", [False, True], ids=["before_the_thread", "while_it_begins"])
def test_a_server_whose_start_is_interrupted_ends(monkeypatch, begun):
    failures = []
    monkeypatch.setattr(threading, "excepthook", failures.append)
    start_new_thread = threading._start_new_thread

    def interrupted(*arguments):
        if begun:
            start_new_thread(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(threading, "_start_new_thread", interrupted)
    for _ in range(50):
        server = PageServer(ViewerNodeOptions(port=0), "Tracks", live_state())
        with pytest.raises(KeyboardInterrupt):
            server.start()
        server.stop()
        end = time.monotonic() + WAIT
        while begun and not server.loop.is_closed() and time.monotonic() < end:
            time.sleep(0.001)
        assert not begun or server.loop.is_closed()
        with socket.create_server(("127.0.0.1", urlsplit(server.url).port)):
            pass
        server.loop.close()
    assert failures == []
