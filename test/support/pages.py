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
"""Tracks, frames and servers for the tests of the viewer."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any

import numpy as np

from support.patience import WAIT
from tsepm_ros import ConfirmedTrack
from tsepm_ros.settings.node_options import ViewerNodeOptions
from tsepm_ros.tools.viewer.page_content import make_page_frame, page_track_facts
from tsepm_ros.tools.viewer.page_server import PageServer
from tsepm_ros.tools.viewer.page_state import PageState


def confirmed_track(
    track_id: int, x: float, y: float, vx: float = 3.0, vy: float = 4.0, **more: Any
):
    """A confirmed track at time 100 s."""
    values = {
        "stamp": 100.0,
        "covariance": np.diag([400.0, 1.0, 900.0, 4.0]),
        "hits": ((0, 1), (2, 0), (3, 3)),
        "evaluation": 0.5,
        "score": 10.5,
        "scan_count": 4,
        "age": 36.0,
    }
    return ConfirmedTrack(track_id=track_id, state=np.array([x, vx, y, vy]), **values | more)


def numbered(number: int, *tracks: ConfirmedTrack, **more: Any) -> dict[str, Any]:
    """A frame with a number; its stamp is 12 s times that."""
    return make_page_frame(12.0 * number, "odom", number=number, tracks=tracks, **more)


def live_state(frames: int = 0, kept: int = 300, title: str = "Tracks") -> PageState:
    """A state of a live source with some frames of one track that moves east."""
    state = PageState({"kind": "live", "title": title, "topic": "/tracks/current"}, kept)
    for number in range(1, frames + 1):
        put_moving(state, number)
    return state


def put_moving(state: PageState, number: int) -> None:
    track = confirmed_track(7, 100.0 * number, 500.0, 8.0, 0.0)
    detections = np.array([[-2000.0, -1500.0], [2500.0, 1800.0]])
    frame = numbered(number, track, detections=detections, own_ship=(0.0, 0.0, 0.5))
    state.put(frame, page_track_facts([track], 12.0) if number == 1 else None)


@contextmanager
def served(
    state: PageState | None = None, recording: str = "", **options: Any
) -> Iterator[PageServer]:
    """A running server, by default on a free port of the loopback address."""
    server = PageServer(ViewerNodeOptions(**{"port": 0, **options}), "Tracks", state)
    server.start(recording)
    try:
        yield server
    finally:
        server.stop()


def run(work: Callable[[], Any]) -> Any:
    """Run a coroutine function with a limit against hanging."""

    async def limited() -> Any:
        return await asyncio.wait_for(work(), WAIT)

    return asyncio.run(limited())


async def message(socket: Any) -> dict[str, Any]:
    """The next message of a websocket."""
    text = await socket.read_message()
    assert text is not None, "the server has closed the connection"
    return json.loads(text)


class Watcher:
    """A browser's place at a server: what its websocket receives, in a thread of its own."""

    def __init__(self, url: str) -> None:
        self._url = url.replace("http", "ws", 1).partition("?")[0] + "updates"
        self.updates: list[dict[str, Any]] = []
        self._socket: Any = None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Watcher:
        self._task = self._loop.create_task(self._read())  # here: the end needs it
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join(WAIT)

    def send(self, text: str) -> Future[Any]:
        """Send a message, once the connection exists."""

        async def sent() -> None:
            while self._socket is None:
                await asyncio.sleep(0.01)
            await self._socket.write_message(text)

        return asyncio.run_coroutine_threadsafe(sent(), self._loop)

    @property
    def frames(self) -> list[dict[str, Any]]:
        """The frames so far; a frame that came again counts as it came last."""
        newest = {
            frame["number"]: frame for update in self.updates for frame in update.get("frames", [])
        }
        return list(newest.values())

    @property
    def facts(self) -> dict[str, Any]:
        return {
            key: fact for update in self.updates for key, fact in update.get("facts", {}).items()
        }

    @property
    def health(self) -> dict[str, Any] | None:
        """The newest health of the first node."""
        found = [update["health"] for update in self.updates if update.get("health")]
        return found[-1][0] if found else None

    def _run(self) -> None:
        with contextlib.suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._task)
        self._loop.close()

    async def _read(self) -> None:
        from tornado.websocket import websocket_connect

        socket = self._socket = await websocket_connect(self._url)
        try:
            while True:
                self.updates.append(await message(socket))
        finally:
            socket.close()
