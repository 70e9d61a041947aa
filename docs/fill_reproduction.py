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
"""Put the chapters of a report of `tsepm reproduce` on the page of reproduced papers.

python docs/fill_reproduction.py [build/reproduction/report.md]
python docs/fill_reproduction.py --check [REPORT]   only say which lines are not the report's

All chapters of the page are the command's, to the letter. Runs that are stored are not made again.
"""

from __future__ import annotations

import difflib
import re
import shutil
import sys
import textwrap
from pathlib import Path

from tsepm_ros.whole_files import write_whole_text, written_whole

PAGE = Path(__file__).parent / "papers" / "reproduction.md"
PICTURES = Path(__file__).parent / "pictures"
PAGE_WIDTH = 120
"""Characters of a line of the page."""


def filled(text: str, report: str) -> str:
    """The text of the page with the chapters of a report in the place of those of the same heading.

    Raises
    ------
    ValueError
        If the page has no chapter of a source.
    """
    for chapter in re.split("^(?=## )", report, flags=re.M)[1:]:
        heading = chapter.partition("\n")[0]
        place = re.compile(f"^{re.escape(heading)}\n.*?(?=^## |\\Z)", re.M | re.S)
        if not place.search(text):
            raise ValueError(f"the page has no chapter {heading[3:]!r}")
        linked = re.sub(r"\]\((?=\w+\.png\))", "](../pictures/", chapter)
        wrapped = "\n".join(map(_wrapped, linked.rstrip().splitlines()))
        before, after = place.split(text, maxsplit=1)
        text = f"{before}{wrapped}\n\n{after}"
    return text.rstrip() + "\n"


def fill_page(page: Path, report: Path) -> list[Path]:
    """Put the chapters of a report on a page; returns it and its pictures."""
    chapters = report.read_text(encoding="utf-8")
    write_whole_text(page, filled(page.read_text(encoding="utf-8"), chapters))
    pictures = [PICTURES / name for name in re.findall(r"\]\((\w+\.png)\)", chapters)]
    for picture in pictures:
        with written_whole(picture) as temporary:
            shutil.copyfile(report.parent / picture.name, temporary)
    return [page, *pictures]


def different_lines(page: Path, report: Path) -> list[str]:
    """Lines of the page that are not the report's ("- "), and those of the report ("+ ")."""
    text = page.read_text(encoding="utf-8")
    right = filled(text, report.read_text(encoding="utf-8"))
    lines = difflib.ndiff(text.splitlines(), right.splitlines())
    return [line for line in lines if line[0] in "-+"]


def _wrapped(line: str) -> str:
    """A line of text in several; tables, headings and pictures as they are."""
    return line if line.startswith(("|", "#", "!")) else textwrap.fill(line, PAGE_WIDTH)


if __name__ == "__main__":
    check = "--check" in sys.argv
    names = [name for name in sys.argv[1:] if name != "--check"]
    given = Path(names[0]) if names else Path("build/reproduction/report.md")
    if check:
        lines = different_lines(PAGE, given)
        print("\n".join(lines) or f"the chapters of the page are those of {given}")
        raise SystemExit(bool(lines))
    print("written: " + ", ".join(map(str, fill_page(PAGE, given))))
