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
"""What a page shows now: kept by its server, bounded, and sent to each browser as what changed."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

from tsepm_ros.tools.viewer.page_content import MILLISECONDS, Frame, encode_page_content
from tsepm_ros.whole_files import read_json

MAX_BYTES = 4_000_000
"""Size of the frames that are kept, bytes; the newest frame is always kept."""


class KeptFrame(NamedTuple):
    """An encoded frame.

    Attributes
    ----------
    number : int
    version : int
        Version of the state that this frame made.
    ids : frozenset of str
        Ids of its tracks.
    text : str
        JSON.
    """

    number: int
    version: int
    ids: frozenset[str]
    text: str


class PageState:
    """The newest frames, the facts of their tracks and the health.

    Every change gives the state a new version. A browser says which version it has, and gets the
    difference: of the frames that it missed the newest only, so that a slow browser costs neither
    memory nor time. A browser without a version gets everything.

    All methods may be called from any thread.

    Parameters
    ----------
    info : mapping
        Title and kind of the source.
    max_frames : int
        Number of frames that are kept for browsers that join.
    max_bytes : int, optional
        Their total size.

    Attributes
    ----------
    changed : callable
        Called after each change, in the thread of the change.
    asked : callable
        Called with what a browser asks for, in the server's thread; a ValueError, TypeError or
        AttributeError says that it is nothing.
    crossings : callable
        Returns the crossings of the gates, CSV.
    image : str
        The newest sonar image, JSON, see `page_image_frame`; browsers ask for it.
    image_asked : float
        When a browser last asked for it, s of the monotonic clock.
    """

    def __init__(
        self, info: Mapping[str, Any], max_frames: int, max_bytes: int = MAX_BYTES
    ) -> None:
        self.changed: Callable[[], None] = lambda: None
        self.asked: Callable[[Any], None] = lambda content: None
        self.crossings: Callable[[], str] = str
        self.image, self.image_asked = "null", -math.inf
        self._lock = threading.Lock()
        self._max_frames, self._max_bytes = max_frames, max_bytes
        self._version, self._puts = 1, 0
        self._info = {**info, "begun": _now()}
        self._parts = {"info": (encode_page_content(self._info), 1)}  # JSON and version, by key
        self._frames: deque[KeptFrame] = deque()
        self._facts: dict[str, tuple[str, int]] = {}
        self._health: dict[str, Frame] = {}

    def put(self, frame: Frame, facts: Mapping[str, Frame] | None = None, age: float = 0.0) -> None:
        """Take a frame that came `age` s ago, with the facts of the tracks that are new in it.

        A frame with the number of the newest one replaces it.
        """
        ids = frozenset(str(row[0]) for row in frame["tracks"])
        text = encode_page_content(frame | {"arrived": _now() - round(MILLISECONDS * age)})
        encoded_facts = {
            track_id: encode_page_content(fact) for track_id, fact in (facts or {}).items()
        }
        with self._lock:
            self._version, self._puts = self._version + 1, self._puts + 1
            frames = self._frames
            if frames and frames[-1].number == frame["number"]:
                frames.pop()
            frames.append(KeptFrame(frame["number"], self._version, ids, text))
            excess = sum(len(kept.text) for kept in frames) - self._max_bytes
            while len(frames) > self._max_frames or (excess > 0 and len(frames) > 1):
                excess -= len(frames.popleft().text)
            for track_id, fact in encoded_facts.items():
                self._facts[track_id] = fact, self._version
            if self._puts % self._max_frames == 0:  # facts of tracks in no frame are forgotten
                shown = frozenset[str]().union(*(kept.ids for kept in frames))
                self._facts = {key: fact for key, fact in self._facts.items() if key in shown}
        self.changed()

    def put_health(self, health: Mapping[str, Frame]) -> None:
        """Take the health of some nodes, see `page_health_of_message`: the page shows that of all.

        Each has the time when it was ``heard`` and the ``period`` since the time before, ms.
        """
        now = _now()
        for node, found in health.items():
            before = self._health.get(node, {}).get("heard", now)
            self._health[node] = found | {"heard": now, "period": now - before}
        self.put_part("health", list(self._health.values()))

    def hear(self, message: str | bytes) -> None:
        """Take what a browser asks for; what is not understood is nothing."""
        with suppress(ValueError, TypeError, AttributeError):
            self.asked(read_json(message))

    def put_info(self, **info: Any) -> None:
        """Change the description of the source."""
        self._info.update(info)
        self.put_part("info", self._info)

    def asked_image(self) -> str:
        """The newest sonar image for a browser; the source gets images only while browsers ask."""
        self.image_asked = time.monotonic()
        return self.image

    def put_part(self, key: str, content: object) -> None:
        """Take a part; nothing happens if it is the same as before."""
        text = encode_page_content(content)
        if self._parts.get(key, ("", 0))[0] == text:
            return
        with self._lock:
            self._version += 1
            self._parts[key] = text, self._version
        self.changed()

    def since(self, version: int = 0) -> tuple[str, int]:
        """What changed after a version.

        Returns
        -------
        text : str
            JSON: an object with those of the keys ``info``, ``frames``, ``facts`` (by track id),
            ``health``, ``land`` and ``alarms`` that changed; ``all`` is true if `version` is 0,
            and the lists are complete; ``now`` is the time then, ms.
        version : int
            The version that a browser has with it.
        """
        with self._lock:
            facts = _changed(self._facts, version)
            frames = list(self._frames)[0 if version == 0 else -1 :]
            texts = [frame.text for frame in frames if frame.version > version]
            parts = [f'"all":true,"now":{_now()}'] if version == 0 else []
            parts += _changed(self._parts, version)
            if facts:
                parts.append(f'"facts":{{{",".join(facts)}}}')
            if texts:
                parts.append(f'"frames":[{",".join(texts)}]')
            return "{" + ",".join(parts) + "}", self._version


def _now() -> int:
    """Time of the clock of frames and health, ms."""
    return round(MILLISECONDS * time.monotonic())


def _changed(texts: Mapping[str, tuple[str, int]], version: int) -> list[str]:
    """Members of a JSON object that changed after a version."""
    return [f'"{key}":{text}' for key, (text, changed) in texts.items() if changed > version]
