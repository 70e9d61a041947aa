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
"""A headless Chromium, driven by the DevTools protocol."""

from __future__ import annotations

import asyncio
import base64
import json
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any
from urllib.parse import urlsplit

import pytest

from support.patience import WAIT

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless=new",
    "--no-sandbox",  # tests may run as root, and open nothing but the page under test
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-extensions",
    "--in-process-gpu",
    "--disable-features=BackForwardCache,SpareRendererForSitePerProcess",
    "--no-first-run",
    "--renderer-process-limit=1",
    "--remote-debugging-port=0",
)


def chromium() -> str:
    """Path of the browser; empty if there is none."""
    return next(filter(None, map(shutil.which, NAMES)), "")


def need_browser() -> None:
    """Skip the module where there is no browser, or no library to drive it."""
    pytest.importorskip("tornado")
    if not chromium():
        pytest.skip("no Chromium: apt-get install chromium", allow_module_level=True)


class Tab:
    """One page of a browser: its complaints, also of its policy, and the addresses it asked for."""

    def __init__(self, browser: Browser, session: str, target: str) -> None:
        self._browser = browser
        self.session = session
        self.target = target
        self.complaints: list[str] = []
        self.requests: list[str] = []

    def call(self, method: str, **parameters: Any) -> Any:
        """Call a method of the protocol in this page."""
        return self._browser.call(method, self.session, **parameters)

    def size(self, width: int, height: int, *, phone: bool = False) -> None:
        size = {"width": width, "height": height, "deviceScaleFactor": 2 if phone else 1}
        self.call("Emulation.setDeviceMetricsOverride", mobile=phone, **size)

    def theme(self, name: str) -> None:
        """Prefer "dark" or "light", as the system's setting does."""
        feature = {"name": "prefers-color-scheme", "value": name}
        self.call("Emulation.setEmulatedMedia", features=[feature])

    def open(self, url: str) -> None:
        self.call("Page.navigate", url=url)
        self.until("document.readyState === 'complete' && typeof scene !== 'undefined'")

    def value(self, expression: str) -> Any:
        """Value of a JavaScript expression."""
        how = {"returnByValue": True, "awaitPromise": True}
        answer = self.call("Runtime.evaluate", expression=expression, **how)
        if "exceptionDetails" in answer:
            raise AssertionError(answer["exceptionDetails"])
        return answer["result"].get("value")

    def until(self, expression: str) -> None:
        """Wait until an expression holds."""
        end = time.monotonic() + WAIT
        while True:
            try:
                if self.value(expression):
                    return
            except AssertionError:
                if time.monotonic() > end:
                    raise
            if time.monotonic() > end:
                pytest.fail(f"waited in vain for {expression}; complaints: {self.complaints}")
            time.sleep(0.02)

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def click(self, x: float, y: float) -> None:
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, x, y, button="left", clickCount=1)

    def key(self, name: str, *, shift: bool = False) -> None:
        """Press and release a key, such as "f" or "ArrowLeft"."""
        sign = {"text": name} if len(name) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            more = sign if kind == "keyDown" else {}
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=name, modifiers=8 if shift else 0, **more
            )

    def reload(self) -> None:
        """Load the page anew."""
        self.value("window.before = true")
        self.call("Page.reload")
        self.until(
            "document.readyState === 'complete' && !window.before && typeof scene === 'object'"
        )

    def press(self, selector: str) -> None:
        """Click an element."""
        self.value(f"document.querySelector({json.dumps(selector)}).click()")

    def picture(self, path: Path) -> None:
        """Write what the page shows as PNG."""
        self.value("new Promise((done) => requestAnimationFrame(() => setTimeout(done, 50)))")
        data = self.call("Page.captureScreenshot", format="png")["data"]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(base64.b64decode(data))


class Browser:
    """A browser with its own profile, ended and removed at the end of its `with` block."""

    def __enter__(self) -> Browser:
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._process = subprocess.Popen(
            [chromium(), *FLAGS, f"--user-data-dir={self._profile.name}", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=(Path(self._profile.name) / "stderr").open("wb"),
        )
        self._loop = asyncio.new_event_loop()
        self._number = 0
        self._tabs: dict[str, Tab] = {}
        self._contexts: list[str] = []
        self._idle = ""
        try:
            from tornado.websocket import websocket_connect

            address = self._address()
            self._socket = self._run(lambda: websocket_connect(address, max_message_size=2**28))
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self, kind: type | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._run(self._closed)
        self._end()

    def tab(self, width: int = 1280, height: int = 800, theme: str = "light") -> Tab:
        """Open an empty page with an empty storage; beside another as in another user's browser."""
        own, target = {}, self._idle
        if self._tabs:  # half a second of processor time more
            own = self.call("Target.createBrowserContext")
            self._contexts.append(own["browserContextId"])
        if self._tabs or not target:
            target = self.call("Target.createTarget", url="about:blank", **own)["targetId"]
        answer = self.call("Target.attachToTarget", targetId=target, flatten=True)
        tab = self._tabs[answer["sessionId"]] = Tab(self, answer["sessionId"], target)
        for domain in ("Page", "Runtime", "Log", "Network"):
            tab.call(f"{domain}.enable")
        tab.size(width, height)
        tab.theme(theme)
        return tab

    def close_tabs(self) -> None:
        """Close every page and empty its storage: an open page goes on drawing and asking."""
        for number, tab in enumerate(self._tabs.values()):
            if number:
                self.call("Target.closeTarget", targetId=tab.target)
                continue
            self._idle = tab.target  # a new page costs half a second of processor time
            for origin in {"://".join(urlsplit(url)[:2]) for url in tab.requests}:
                tab.call("Storage.clearDataForOrigin", origin=origin, storageTypes="all")
            tab.call("Page.navigate", url="about:blank")
            self.call("Target.detachFromTarget", sessionId=tab.session)
        for context in self._contexts:
            self.call("Target.disposeBrowserContext", browserContextId=context)
        self._tabs.clear()
        self._contexts.clear()

    def call(self, method: str, session: str = "", **parameters: Any) -> Any:
        """Call a method of the protocol and return its result."""
        self._number += 1
        request = {"id": self._number, "method": method, "params": parameters}
        if session:
            request["sessionId"] = session
        self._run(lambda: self._socket.write_message(json.dumps(request)))
        while True:
            message = json.loads(self._run(self._socket.read_message))
            if message.get("id") == self._number:
                assert "error" not in message, (method, message["error"])
                return message["result"]
            self._note(message)

    def _note(self, event: dict[str, Any]) -> None:
        tab, content = self._tabs.get(event.get("sessionId", "")), event.get("params", {})
        if tab is None:
            return
        match event["method"]:
            case "Network.requestWillBeSent":
                tab.requests.append(content["request"]["url"])
            case "Network.webSocketCreated":
                tab.requests.append(content["url"])
            case "Runtime.exceptionThrown" | "Log.entryAdded" | "Runtime.consoleAPICalled":
                tab.complaints.append(str(content))

    def _address(self) -> str:
        end = time.monotonic() + WAIT
        while time.monotonic() < end and self._process.poll() is None:
            said = (Path(self._profile.name) / "stderr").read_text(errors="replace")
            if found := re.search(r"DevTools listening on (ws://\S+)", said):
                return found[1]
            time.sleep(0.02)
        return pytest.fail("the browser does not start")

    async def _closed(self) -> None:
        self._socket.close()

    def _run(self, begin: Callable[[], Any]) -> Any:
        async def within() -> Any:
            return await asyncio.wait_for(begin(), WAIT)

        return self._loop.run_until_complete(within())

    def _end(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(WAIT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._loop.close()
        self._profile.cleanup()
