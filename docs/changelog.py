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
"""Write CHANGELOG.rst, which catkin_pkg and bloom read, from CHANGELOG.md.

    python docs/changelog.py

The format of CHANGELOG.rst is that of REP 132: a section for each version with its date, and
"Forthcoming" for what is not released. REP 132 ignores sections inside a version, so the kinds of
changes ("Added", "Fixed") are bold lines.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

from tsepm_ros.whole_files import write_whole_text

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "CHANGELOG.rst"
VERSION = re.compile(r"^## \[(.+?)\](?: - (\S+))?$")
INLINE = re.compile(r"`([^`]+)`|\[([^\]]+)\]\(([^)]+)\)|([*_|\\])")
"""Code, a link, or a character with a meaning in reStructuredText, in the text of an entry."""


def inline(match: re.Match[str]) -> str:
    """Write code, links and special characters as reStructuredText has them."""
    code, label, target, special = match.groups()
    if code:
        return f"``{code}``"
    if label:
        return f"`{label} <{target}>`__" if "://" in target else label
    return f"\\{special}"


def heading(title: str, line: str) -> str:
    """Underline a title."""
    return f"{title}\n{line * len(title)}"


def as_rst(markdown: str, package: str) -> str:
    """Return the changelog of a package as REP 132 states it.

    Parameters
    ----------
    markdown : str
        Changelog in the format of Keep a Changelog.
    package : str
        Name of the package.

    Raises
    ------
    ValueError
        If a version has no date.
    """
    title = f"Changelog for package {package}"
    lines = ["^" * len(title), heading(title, "^"), ""]
    body = markdown[markdown.index("## [") :]
    for line in INLINE.sub(inline, body).splitlines():  # code may run over the end of a line
        version = VERSION.match(line)
        if version:
            lines.append(heading(section(*version.groups()), "-"))
        elif line.startswith("### "):
            lines.append(f"**{line[4:]}**")
        else:
            lines.append(line)
    return "\n".join(lines).rstrip() + "\n"


def section(version: str, date: str | None) -> str:
    """Return the title of a version."""
    if version == "Unreleased":
        return "Forthcoming"
    if date is None:
        raise ValueError(
            f"CHANGELOG.md: version {version} has no date: ## [{version}] - YEAR-MM-DD"
        )
    return f"{version} ({date})"


def current() -> str:
    """Return what CHANGELOG.rst should be."""
    package = ElementTree.parse(ROOT / "package.xml").findtext("name", "")
    return as_rst((ROOT / "CHANGELOG.md").read_text("utf-8"), package)


if __name__ == "__main__":
    write_whole_text(TARGET, current())
