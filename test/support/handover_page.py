"""The Python of docs/use_the_tracks.md, run as a reader would run it."""

import re
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[2] / "docs" / "use_the_tracks.md"


def run_page(*, stone_soup: bool = False) -> dict[str, Any]:
    """Run the page's blocks, those of Stone Soup only if asked for; returns what they define."""
    defined: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL):
        if stone_soup or "stonesoup" not in block:
            exec(compile(block, str(PAGE), "exec"), defined)
    return defined
