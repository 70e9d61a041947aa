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
python docs/fill_reproduction.py --check [REPORT]   only say which tables differ from the page's

Ten runs of a chapter on the page that are equal, of the same seed, say that its figures hold for
this version too.
"""

from __future__ import annotations

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


def fill_page(page: Path, report: Path) -> list[Path]:
    """Put the chapters of a report in the place of a page's chapters with the same headings.

    Returns
    -------
    list of Path
        The page, and its pictures.

    Raises
    ------
    ValueError
        If the page has no chapter of a source.
    """
    text, pictures = page.read_text(encoding="utf-8"), []
    for chapter in re.split("^(?=## )", report.read_text(encoding="utf-8"), flags=re.M)[1:]:
        heading = chapter.partition("\n")[0]
        place = re.compile(f"^{re.escape(heading)}\n.*?(?=^## |\\Z)", re.M | re.S)
        if not place.search(text):
            raise ValueError(f"{page} has no chapter {heading[3:]!r}")
        names = re.findall(r"\]\((\w+\.png)\)", chapter)
        pictures += [PICTURES / name for name in names]
        linked = re.sub(r"\]\((?=\w+\.png\))", "](../pictures/", chapter)
        wrapped = "\n".join(map(_wrapped, linked.rstrip().splitlines()))
        before, after = place.split(text, maxsplit=1)
        text = f"{before}{wrapped}\n\n{after}"
    write_whole_text(page, text.rstrip() + "\n")
    for picture in pictures:
        with written_whole(picture) as temporary:
            shutil.copyfile(report.parent / picture.name, temporary)
    return [page, *pictures]


def different_tables(page: Path, report: Path) -> list[str]:
    """Rows of the tables of a report that the page does not have."""
    known = set(page.read_text(encoding="utf-8").splitlines())
    rows = [line for line in report.read_text(encoding="utf-8").splitlines() if line[:1] == "|"]
    return [row for row in rows if row not in known and set(row) - set("|- ")]


def _wrapped(line: str) -> str:
    """A line of text in several; tables, headings and pictures as they are."""
    return line if line.startswith(("|", "#", "!")) else textwrap.fill(line, PAGE_WIDTH)


if __name__ == "__main__":
    check = "--check" in sys.argv
    names = [name for name in sys.argv[1:] if name != "--check"]
    given = Path(names[0]) if names else Path("build/reproduction/report.md")
    if check:
        rows = different_tables(PAGE, given)
        print("\n".join(rows) or f"every row of {given} is on the page")
        raise SystemExit(bool(rows))
    print("written: " + ", ".join(map(str, fill_page(PAGE, given))))
