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
"""The page as files: for a server, which loads style and scripts from it, or all in one file."""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
from importlib import resources
from pathlib import Path

from tsepm_ros.whole_files import write_whole_text

SCRIPTS = (
    *("units.js", "scene.js", "operator.js", "alarm.js"),
    *("plan.js", "panels.js", "controls.js", "watch.js"),
)
"""Scripts in the order in which the page loads them."""
STYLE, SHELL = "watch.css", "watch.html"
LIVE, RECORDING, EMBEDDED = "live", "recording", "embedded"
"""Where a page gets its frames: from updates, from the server's recording, or from itself."""
_TYPES = {
    **{".js": "text/javascript", ".css": "text/css", ".csv": "text/csv"},
    **{"": "text/html", "recording": "application/json", "image": "application/json"},
}


def page_file(name: str) -> str:
    """Text of a file of the page."""
    return (resources.files("tsepm_ros.tools.viewer") / "page" / name).read_text(encoding="utf-8")


def page_content_type(name: str) -> str:
    """Content type of a file of the page, of the page itself, a recording or an image."""
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
    style, *scripts = map(page_file, (STYLE, *SCRIPTS))
    policy = (
        f"default-src 'none'; style-src '{_digest(style)}'; "
        f"script-src {' '.join(repr(_digest(script)) for script in scripts)}; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    head = f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n<style>{style}</style>'
    # mtime 0: the same recording gives the same file.
    data = base64.b64encode(gzip.compress(recording.encode(), 9, mtime=0)).decode()
    parts = [
        f'<script type="text/plain" id="recording">{data}</script>',
        *(f"<script>{script}</script>" for script in scripts),
    ]
    return _filled(EMBEDDED, title, head, "\n".join(parts))


def write_page(path: Path, title: str, recording: str) -> None:
    """Write a self-contained page, see `self_contained_page`."""
    write_whole_text(path, self_contained_page(title, recording))


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
