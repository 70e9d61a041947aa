"""Put the chapters of a report of `tsepm reproduce` on the page of reproduced papers.

python docs/fill_reproduction.py [build/reproduction/report.md]
"""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from pathlib import Path

from tsepm_ros.whole_files import write_whole_text, written_whole

PAGE = Path(__file__).parent / "reproduction.md"
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
        pictures += [page.parent / "pictures" / name for name in names]
        linked = re.sub(r"\]\((?=\w+\.png\))", "](pictures/", chapter)
        wrapped = "\n".join(map(_wrapped, linked.rstrip().splitlines()))
        before, after = place.split(text, maxsplit=1)
        text = f"{before}{wrapped}\n\n{after}"
    write_whole_text(page, text.rstrip() + "\n")
    for picture in pictures:
        with written_whole(picture) as temporary:
            shutil.copyfile(report.parent / picture.name, temporary)
    return [page, *pictures]


def _wrapped(line: str) -> str:
    """A line of text in several; tables, headings and pictures as they are."""
    return line if line.startswith(("|", "#", "!")) else textwrap.fill(line, PAGE_WIDTH)


if __name__ == "__main__":
    given = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("build/reproduction/report.md")
    print("written: " + ", ".join(map(str, fill_page(PAGE, given))))
