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
"""The server of the page: one page, its files, a websocket with what changes, and who may see it.

The library is tornado, which ROS has as ``python3-tornado`` (rosbridge uses it): HTTP, websockets
with flow control, and nothing else to install.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hmac
import ipaddress
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, unquote, urlencode, urlsplit

from tsepm_ros.settings.node_options import ViewerNodeOptions
from tsepm_ros.tools.viewer.page_files import (
    LIVE,
    RECORDING,
    SCRIPTS,
    STYLE,
    page_content_type,
    page_file,
    served_page,
)
from tsepm_ros.tools.viewer.page_state import PageState

try:
    import tornado.web
    from tornado.httpserver import HTTPServer
    from tornado.httputil import HTTPConnection
    from tornado.netutil import bind_sockets
    from tornado.websocket import WebSocketClosedError, WebSocketHandler
except ImportError:
    raise ValueError(
        "the page needs the library tornado: pip install tornado, the extra viewer, or the "
        "package python3-tornado"
    ) from None

MAX_BROWSERS = 32
"""Maximum number of connected browsers; further ones are refused."""
PING_INTERVAL, PING_TIMEOUT = 30.0, 30.0
"""Times after which a silent browser is asked for a sign of life, and given up, s."""
SIGN_OF_LIFE = 1.0
"""Time after which a browser that follows is told that nothing has changed, s."""
REQUEST_TIMEOUT = 20.0
"""Time for a connection to send a whole request, s."""
MAX_CONNECTIONS = 50
"""Maximum number of connections without a websocket; the one that was quiet longest is closed."""
ACCEPT_PAUSE = 0.1
"""Pause in accepting connections while the process has no free file, s."""
CLOSE_TIMEOUT = 2.0
"""Time for connections to close at the end, s."""
MAX_REQUEST = 4096
"""Largest message and body that a browser may send, bytes."""
ANY_ADDRESS = ("0.0.0.0", "::")
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}


def page_server_token(addresses: Iterable[str], given: str) -> str:
    """Token that a server on some addresses demands; empty if it needs none.

    Parameters
    ----------
    addresses : iterable of str
        The IP addresses to which it is bound.
    given : str
        The token of the options; empty: a random token, unless all addresses are loopback ones.
    """
    if given or all(ipaddress.ip_address(address).is_loopback for address in addresses):
        return given
    return secrets.token_urlsafe(24)


@dataclass(frozen=True)
class PageServerAccess:
    """The checks of a request.

    Attributes
    ----------
    token : str
        Empty: none is demanded.
    names : frozenset of str
        Host names, in lower case, under which the page may be asked for, besides IP addresses.
        Another name may have been pointed here by its owner, whose page a browser would then take
        for the same site (DNS rebinding).
    """

    token: str
    names: frozenset[str]

    @classmethod
    def to(cls, host: str, token: str) -> PageServerAccess:
        """Access to a server that was told to listen on `host`."""
        name = socket.gethostname().lower()
        own = {name, f"{name}.local", socket.getfqdn().lower()} if token else set()
        return cls(token, frozenset({"localhost", host.lower(), *own}))

    def allows_host(self, header: str) -> bool:
        """Whether a Host header names this server."""
        try:
            name = urlsplit(f"//{header}").hostname or ""
        except ValueError:
            return False
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return name in self.names
        # Without a token, only those on this machine can be meant.
        return bool(self.token) or address.is_loopback

    def allows_origin(self, origin: str | None, host: str) -> bool:
        """Whether a page from an Origin header's site may ask; programs send none."""
        own = {f"{scheme}://{host.lower()}" for scheme in ("http", "https")}
        return origin is None or origin.lower() in own

    def allows_token(self, given: str) -> bool:
        """Whether a token is the one demanded, in a time that does not depend on where it differs.

        True if none is demanded.
        """
        return not self.token or hmac.compare_digest(given.encode(), self.token.encode())


class PageServer:
    """Serves the page in a thread of its own.

    Parameters
    ----------
    options : ViewerNodeOptions
    title : str
    state : PageState, optional
        Followed by the page while it changes; without it the page replays a recording.

    Attributes
    ----------
    url : str
        Where the page is, with the token if one is demanded.
    browsers : set of WebSocketHandler
        The connected browsers.
    loop : asyncio.AbstractEventLoop
        Of its thread; see `call_later`.

    Raises
    ------
    ValueError
        If the server cannot be bound to the host and port of the options.
    """

    def __init__(
        self, options: ViewerNodeOptions, title: str, state: PageState | None = None
    ) -> None:
        self._sockets = _bound(options.host, options.port)
        addresses = [bound.getsockname()[0] for bound in self._sockets]
        port = self._sockets[0].getsockname()[1]
        token = page_server_token(addresses, options.token)
        self.url = _url(options.host, port, token)
        self._title = title
        self._state = state
        self.browsers: set[_UpdatesOfPageServer] = set()
        self._settings: dict[str, Any] = {
            "access": PageServerAccess.to(options.host, token),
            "cookie": f"tsepm_token_{port}",
            "websocket_ping_interval": PING_INTERVAL,
            "websocket_ping_timeout": PING_TIMEOUT,
            "websocket_max_message_size": MAX_REQUEST,
            "compress_response": True,
            "default_handler_class": _NothingOfPageServer,
            "log_function": lambda handler: None,
        }
        self.loop = asyncio.new_event_loop()
        self._started = False
        self._stopped = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="page server", daemon=True)

    def start(self, recording: str = "") -> None:
        """Serve from now on; `recording`, JSON, is what a page without a state replays."""
        texts: dict[str, Callable[[], str | bytes]] = {
            name: page_file(name).encode for name in (STYLE, *SCRIPTS)
        }
        page = served_page(RECORDING if self._state is None else LIVE, self._title)
        texts[""] = page.encode
        if self._state is None:
            texts["recording"] = recording.encode
        else:
            texts |= {"image": self._state.asked_image, "crossings.csv": self._state.crossings}
            self._state.changed = lambda: self._call(self._wake)
        routes: list[Any] = [
            (f"/{name}", _TextOfPageServer, {"text": text, "content_type": page_content_type(name)})
            for name, text in texts.items()
        ]
        if self._state is not None:
            source = {"state": self._state, "browsers": self.browsers}
            routes.append(("/updates", _UpdatesOfPageServer, source))
        self._application = tornado.web.Application(routes, **self._settings)
        self._started = True
        self._thread.start()

    def stop(self) -> None:
        """Close all connections and end the thread, if it was started; free the port."""
        if self._started:
            self._call(self._stopped.set)
            # An interrupt may have ended `start` before the thread runs, which then ends at once
            # and closes the loop.
            if self._thread.is_alive():
                self._thread.join()
        else:
            self.loop.close()
        for bound in self._sockets:
            bound.close()

    def call_later(self, seconds: float, function: Callable[[], None]) -> None:
        """Call a function in the server's thread after some time, unless it is stopped before."""
        self._call(self.loop.call_later, seconds, function)

    def _call(self, function: Callable[..., object], *arguments: object) -> None:
        """Call a function in the loop, from any thread; nothing after the end."""
        if not self.loop.is_closed():
            with contextlib.suppress(RuntimeError):  # closed since
                self.loop.call_soon_threadsafe(function, *arguments)

    def _wake(self) -> None:
        for browser in self.browsers:
            browser.changed.set()

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self.loop) as runner:  # closes the loop
            runner.run(self._serve())

    async def _serve(self) -> None:
        if self._stopped.is_set():
            return  # the sockets may be closed
        self._server = _PageHttpServer(
            self._application,
            max_body_size=MAX_REQUEST,
            idle_connection_timeout=REQUEST_TIMEOUT,
            body_timeout=REQUEST_TIMEOUT,
        )
        for listening in self._sockets:
            listening.make_room = self._server.make_room
        self._server.add_sockets(self._sockets)
        await self._stopped.wait()  # an event also counts when it is set before
        await self._close()

    async def _close(self) -> None:
        self._server.stop()
        for browser in list(self.browsers):
            browser.close(1001)
        with contextlib.suppress(asyncio.TimeoutError):  # a connection that just begins
            await asyncio.wait_for(self._server.close_all_connections(), CLOSE_TIMEOUT)


class _PageHttpServer(HTTPServer):
    """A server with few connections at a time; websockets are counted apart."""

    def initialize(self, *given: Any, **options: Any) -> None:
        super().initialize(*given, **options)
        self._quiet: dict[Any, None] = {}  # connections, the one that was quiet longest first

    def start_request(self, server_conn: object, request_conn: HTTPConnection) -> Any:
        """Note that a connection waits for a request, and close another if there are too many."""
        self._quiet.pop(server_conn, None)
        self._quiet[server_conn] = None
        if len(self._quiet) > MAX_CONNECTIONS:
            self.make_room()
        return super().start_request(server_conn, request_conn)

    def make_room(self) -> bool:
        """Close the connection that was quiet longest; whether there was one."""
        longest = next(iter(self._quiet), None)
        if longest is None:
            return False
        del self._quiet[longest]
        longest.stream.close()
        return True

    def on_close(self, server_conn: object) -> None:
        """Forget a connection that is closed, or has become a websocket."""
        self._quiet.pop(server_conn, None)
        super().on_close(server_conn)


class _GuardedPageServer(tornado.web.RequestHandler):
    """A handler behind the checks of `PageServerAccess`."""

    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)
        self.clear_header("Server")

    def prepare(self) -> None:
        access: PageServerAccess = self.settings["access"]
        host = self.request.headers.get("Host", "")
        if not access.allows_host(host):
            self.answer(
                403,
                f"The page is not served under the name {host!r}. Use the address that the viewer "
                "printed, or start the viewer with that name as host.",
            )
        elif not access.allows_origin(self.request.headers.get("Origin"), host):
            self.answer(403, "A page of another site may not ask.")
        elif not access.allows_token(self.given_token()):
            self.answer(
                403, "The token is missing or wrong. Use the address that the viewer printed."
            )

    def write_error(self, status_code: int, **_: Any) -> None:
        self.answer(status_code, f"{status_code}")

    def given_token(self) -> str:
        """Token of the request: in its address, or as the cookie that the page has set."""
        cookie = unquote(self.get_cookie(self.settings["cookie"]) or "")
        return self.get_query_argument("token", cookie, strip=False)

    def answer(self, status: int, sentence: str) -> None:
        """Answer a status and a sentence."""
        self.set_status(status)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{sentence}\n")


class _NothingOfPageServer(_GuardedPageServer):
    """Every other path."""

    def get(self) -> None:
        raise tornado.web.HTTPError(404)


class _TextOfPageServer(_GuardedPageServer):
    """The page, one of its files, the recording, or the newest sonar image."""

    def initialize(self, text: Callable[[], str | bytes], content_type: str) -> None:
        self._text = text
        self._content_type = content_type

    def get(self) -> None:
        if self.get_query_argument("token", "", strip=False):
            # The cookie takes the token out of the address bar and the history. Lax: a link from
            # elsewhere may open the page, and no other site can read it. Quoted: not every
            # character may stand in a cookie.
            cookie = quote(self.given_token(), safe="")
            self.set_cookie(self.settings["cookie"], cookie, httponly=True, samesite="Lax")
            self.redirect(self.request.path, status=303)
            return
        self.set_header("Content-Type", self._content_type)
        self.write(self._text())


class _UpdatesOfPageServer(_GuardedPageServer, WebSocketHandler):
    """The websocket of a browser: what changed, as fast as the browser takes it."""

    def initialize(self, state: PageState, browsers: set[_UpdatesOfPageServer]) -> None:
        self._state = state
        self._browsers = browsers
        self._sender: asyncio.Task[None] | None = None
        self.changed = asyncio.Event()

    def check_origin(self, origin: str) -> bool:
        return True  # `prepare` has checked it

    def open(self, *_: str, **__: str) -> None:
        if len(self._browsers) >= MAX_BROWSERS:
            self.close(1013, "too many browsers")
            return
        self._browsers.add(self)
        self.changed.set()
        self._sender = asyncio.create_task(self._send())

    def on_message(self, message: str | bytes) -> None:
        self._state.hear(message)

    def on_close(self) -> None:
        self._browsers.discard(self)
        if self._sender is not None:
            self._sender.cancel()

    async def _send(self) -> None:
        """Send what changed since the last message, after that has left this machine.

        A browser that reads slowly so gets fewer messages, and no message waits here but one. An
        empty one is a sign of life: no browser notices that a machine or its network is gone.
        """
        version = 0
        with contextlib.suppress(WebSocketClosedError):
            while True:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self.changed.wait(), SIGN_OF_LIFE)
                self.changed.clear()
                text, version = self._state.since(version)
                await self.write_message(text)


class _ListeningPageServer(socket.socket):
    """A bound socket that makes room for a connection for which no file is free, or waits.

    tornado logs the error and tries again at once, as fast as it can.
    """

    make_room: Callable[[], bool]

    def accept(self) -> tuple[socket.socket, Any]:
        try:
            return super().accept()
        except OSError as error:
            if error.errno not in (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM):
                raise
            if not self.make_room():
                time.sleep(ACCEPT_PAUSE)
            raise BlockingIOError from None


def _bound(host: str, port: int) -> list[_ListeningPageServer]:
    try:
        bound = bind_sockets(port, host)
    except (OSError, UnicodeError) as error:
        in_use = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
        remedy = "; choose another port, or 0 for any free one" if in_use else ""
        raise ValueError(
            f"the page cannot be served on {host}, port {port}: {error}{remedy}"
        ) from None
    return [_ListeningPageServer(fileno=bound_socket.detach()) for bound_socket in bound]


def _url(host: str, port: int, token: str) -> str:
    name = socket.gethostname() if host in ANY_ADDRESS else f"[{host}]" if ":" in host else host
    return f"http://{name}:{port}/" + (f"?{urlencode({'token': token})}" if token else "")
