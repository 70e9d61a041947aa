"""The page: its files, the self-contained file, and what a served page shows now.

What a page shows is kept by its server: bounded, and sent to each browser as what changed.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import math
import threading
from collections import deque
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from tsepm_ros.tools.viewer.page_frames import Frame, encode
from tsepm_ros.whole_files import write_text

SCRIPTS = ("scene.js", "operator.js", "plan.js", "panels.js", "watch.js")
"""Scripts in the order in which the page loads them."""
STYLE, SHELL = "watch.css", "watch.html"

LIVE, RECORDING, EMBEDDED = "live", "recording", "embedded"
"""Where a page gets its frames: from updates, from the server's recording, or from itself."""

_TYPES = {
    **{".js": "text/javascript", ".css": "text/css"},
    **{"": "text/html", "recording": "application/json"},
}


def page_file(name: str) -> str:
    """Text of a file of the page."""
    return (resources.files("tsepm_ros.tools.viewer") / "page" / name).read_text(encoding="utf-8")


def content_type(name: str) -> str:
    """Content type of a file of the page, of the page itself, or of a recording."""
    return f"{_TYPES[Path(name).suffix or name]}; charset=utf-8"


def served_page(source: str, title: str) -> str:
    """HTML of the page for a server, which loads style and scripts from it.

    Parameters
    ----------
    source : {"live", "recording"}
    title : str
    """
    head = f'<link rel="stylesheet" href="{STYLE}">'
    scripts = "\n".join(f'<script src="{name}"></script>' for name in SCRIPTS)
    return _filled(source, title, head, scripts)


def self_contained_page(title: str, recording: str) -> str:
    """HTML of a page with everything in it, for a browser without a server.

    The page allows itself nothing else: neither other scripts nor any connection.

    Parameters
    ----------
    title : str
    recording : str
        The recording, JSON; the file holds it compressed.
    """
    style = page_file(STYLE)
    scripts = [page_file(name) for name in SCRIPTS]
    policy = (
        f"default-src 'none'; style-src '{_digest(style)}'; "
        f"script-src {' '.join(repr(_digest(script)) for script in scripts)}; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    head = f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n<style>{style}</style>'
    # mtime 0: the same recording gives the same file.
    data = base64.b64encode(gzip.compress(recording.encode(), 9, mtime=0)).decode()
    parts = [f'<script type="text/plain" id="recording">{data}</script>']
    parts += [f"<script>{script}</script>" for script in scripts]
    return _filled(EMBEDDED, title, head, "\n".join(parts))


def write_page(path: Path, title: str, recording: str) -> None:
    """Write a self-contained page, see `self_contained_page`; its folder is made."""
    page = self_contained_page(title, recording)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, page)


def _filled(source: str, title: str, head: str, scripts: str) -> str:
    page = page_file(SHELL)
    for mark, text in (
        ("<!--title-->", html.escape(title)),
        ("<!--head-->", head),
        ('data-source=""', f'data-source="{source}"'),
        ("<!--scripts-->", scripts),
    ):
        page = page.replace(mark, text, 1)
    return page


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


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
    image : str
        The newest sonar image, JSON, see `image_frame`; browsers ask for it.
    image_asked : float
        When a browser last asked for it, s of the monotonic clock.
    """

    def __init__(
        self, info: Mapping[str, Any], max_frames: int, max_bytes: int = MAX_BYTES
    ) -> None:
        self.changed: Callable[[], None] = lambda: None
        self.image, self.image_asked = "null", -math.inf
        self._lock = threading.Lock()
        self._max_bytes = max_bytes
        self._version = 1
        self._info = dict(info), 1
        self._frames: deque[KeptFrame] = deque()
        self._max_frames = max_frames
        self._bytes = 0
        self._facts: dict[str, tuple[str, int]] = {}
        self._health: tuple[str, int] = "null", 0

    @property
    def version(self) -> int:
        """Version of the state."""
        return self._version

    def put(self, frame: Frame, facts: Mapping[str, Frame] | None = None) -> None:
        """Take a frame, with the facts of the tracks that are new in it.

        A frame with the number of the newest one replaces it.
        """
        ids = frozenset(str(row[0]) for row in frame["tracks"])
        text = encode(frame)
        encoded_facts = {track_id: encode(fact) for track_id, fact in (facts or {}).items()}
        with self._lock:
            self._version += 1
            if self._frames and self._frames[-1].number == frame["number"]:
                self._bytes -= len(self._frames.pop().text)
            self._frames.append(KeptFrame(frame["number"], self._version, ids, text))
            self._bytes += len(text)
            for track_id, fact in encoded_facts.items():
                self._facts[track_id] = fact, self._version
            while len(self._frames) > self._max_frames or (
                self._bytes > self._max_bytes and len(self._frames) > 1
            ):
                self._bytes -= len(self._frames.popleft().text)
            if self._version % self._max_frames == 0:
                self._forget_facts()
        self.changed()

    def put_health(self, health: Mapping[str, Any]) -> None:
        """Take the health, see `tsepm_ros.tools.viewer.page_frames`."""
        with self._lock:
            self._version += 1
            self._health = encode(health), self._version
        self.changed()

    def put_info(self, **info: Any) -> None:
        """Change the description of the source."""
        with self._lock:
            self._version += 1
            self._info = {**self._info[0], **info}, self._version
        self.changed()

    def since(self, version: int = 0) -> tuple[str, int]:
        """What changed after a version.

        Returns
        -------
        text : str
            JSON: an object with those of the keys ``info``, ``frames``, ``facts`` (by track id) and
            ``health`` that changed; ``all`` is true if `version` is 0, and the lists are complete.
        version : int
            The version that a browser has with it.
        """
        with self._lock:
            parts = ['"all":true'] if version == 0 else []
            info, info_version = self._info
            if info_version > version:
                parts.append(f'"info":{encode(info)}')
            facts = [
                f'"{track_id}":{text}'
                for track_id, (text, changed) in self._facts.items()
                if changed > version
            ]
            if facts:
                parts.append(f'"facts":{{{",".join(facts)}}}')
            health, health_version = self._health
            if health_version > version:
                parts.append(f'"health":{health}')
            frames = list(self._frames)[0 if version == 0 else -1 :]
            texts = [frame.text for frame in frames if frame.version > version]
            if texts:
                parts.append(f'"frames":[{",".join(texts)}]')
            return "{" + ",".join(parts) + "}", self._version

    def _forget_facts(self) -> None:
        """Forget the facts of tracks that are in no kept frame."""
        shown = frozenset[str]().union(*(frame.ids for frame in self._frames))
        self._facts = {key: fact for key, fact in self._facts.items() if key in shown}
