"""Figures on the pages come from result files, and stale ones are found; the pages stay short."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import pytest
import yaml

from tsepm_ros.analysis.code_version import NO_TRACKS, digest, package_version, track_modules
from tsepm_ros.analysis.result_files import read_result

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MAX_WORDS = 20_000
"""Outside of the sections Research and Reference, and with the README."""
MAX_README_LINES = 80
LONG = ("Research", "Reference")
MEASURED = re.compile(r"(?:[Mm]easured|[Cc]omputed)\s+with\s+version\s+\d")
BLOCK = re.compile(r"<!-- figures .*?<!-- end of figures -->", re.DOTALL)
CODE = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
FIGURE_CELL = re.compile(r"^\|.*\|\s*[+-]?\d+\.\d+[^|]*\|", re.MULTILINE)
"""A row with a cell that begins with a decimal number."""
REFERENCE = ("parameters.md", "topics.md", "messages.md", "diagnostics.md", "time_and_frames.md")

pytestmark = pytest.mark.skipif(not DOCS.exists(), reason="only in the source tree")


@pytest.fixture(scope="module")
def figures():
    spec = importlib.util.spec_from_file_location("figures", DOCS / "figures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_no_result_file_is_stale_and_every_page_is_filled(figures):
    assert figures.problems() == [], "each names the command that renews it"


def test_every_result_file_stands_on_a_page(figures):
    used = {
        block["name"]
        for page in figures.PAGES
        for block in figures.BLOCK.finditer(page.read_text("utf-8"))
    }
    assert used == {path.stem for path in figures.RESULTS.glob("*.json")}


@pytest.fixture
def one_result(figures, tmp_path, monkeypatch):
    """A result file of other algorithms, in place of the others."""
    path = tmp_path / "docs" / "box.json"
    path.parent.mkdir()
    content = json.loads((figures.RESULTS / "box.json").read_text("utf-8"))
    path.write_text(json.dumps(content | {"version": "0.0.1 00000000"}))
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(figures, "RESULTS", path.parent)
    monkeypatch.setattr(figures, "PAGES", [])
    return path


def test_a_stale_figure_fails_with_the_command_that_renews_it(figures, one_result, capsys):
    assert figures.main(["check"]) == 1
    said = capsys.readouterr().err
    assert "docs/box.json was measured with version 0.0.1 00000000" in said
    assert "python docs/figures.py renew box" in said


def test_a_figure_that_takes_hours_is_marked_instead(figures, one_result, monkeypatch):
    monkeypatch.setattr(figures, "DEAR", frozenset({"box"}))
    assert figures.main(["check"]) == 0
    page = "<!-- figures box.curve -->\n<!-- end of figures -->"
    assert "Version 0.0.1 00000000." in figures.filled(page)


def test_a_page_without_its_figures_is_found(figures, monkeypatch, tmp_path):
    page = tmp_path / "page.md"
    page.write_text("<!-- figures box.curve -->\n| old |\n<!-- end of figures -->\n")
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(figures, "PAGES", [page])
    monkeypatch.setattr(figures, "stale", list)
    assert any("page.md is out of date" in problem for problem in figures.problems())
    figures.fill()
    assert "| old |" not in page.read_text()
    assert read_result(figures.RESULTS / "box.json").command in page.read_text()
    assert not any("page.md" in problem for problem in figures.problems())


CODE_BEFORE = '''
def gate(x: float) -> float:
    """The gate."""
    if x < 0:
        raise ValueError(f"x is {x}")
    return 2.0 * x  # of two
OPTION = parameter(3, "Hits", minimum=2)
SENTENCE = "there are " + str(OPTION)
NAME = "weighted"
'''


@pytest.mark.parametrize(
    ("before", "after", "same"),
    [
        ("The gate.", "The region.", True),
        ("# of two", "# twice", True),
        ("x is {x}", "x must not be {x}", True),
        ('"Hits"', '"Detections"', True),
        ('"there are "', '"hits: there are "', True),
        ('"weighted"', '"polar"', False),
        ("2.0 * x", "2.5 * x", False),
        ("parameter(3", "parameter(4", False),
        ("minimum=2", "minimum=1", False),
        ("x < 0", "x <= 0", False),
    ],
)
def test_the_digest_is_of_the_code_and_not_of_its_words(tmp_path, before, after, same):
    path = tmp_path / "module.py"
    path.write_text(CODE_BEFORE)
    first = digest([path])
    path.write_text(CODE_BEFORE.replace(before, after))
    assert (digest([path]) == first) is same


def test_the_version_covers_the_algorithms():
    modules = {path.name for path in track_modules()}
    assert {"tree.py", "merging.py", "clutter_map.py", "kalman.py", "plots.py"} <= modules
    assert not {"cli.py", "plan_position.py", "session.py", "page_server.py"} & modules
    folder = ROOT / "tsepm_ros"
    assert all((folder / name).exists() for name in NO_TRACKS)
    assert re.fullmatch(r"\d+\.\d+\.\d+ [0-9a-f]{8}", package_version())


def sections() -> dict[str, list[str]]:
    """Pages by the top-level heading of the navigation."""
    text = re.sub(r"^(plugins|hooks|markdown_extensions):.*?(?=^\w)", "", CONFIG, flags=re.M | re.S)
    pages = {}
    for entry in yaml.safe_load(text)["nav"]:
        [(name, value)] = entry.items()
        pages[name] = [value] if isinstance(value, str) else [next(iter(p.values())) for p in value]
    return pages


CONFIG = (ROOT / "mkdocs.yml").read_text(encoding="utf-8") if DOCS.exists() else ""


def test_the_pages_are_short():
    short = [name for head, names in sections().items() if head not in LONG for name in names]
    words = {name: len((DOCS / name).read_text("utf-8").split()) for name in short}
    words["README.md"] = len((ROOT / "README.md").read_text("utf-8").split())
    assert sum(words.values()) <= MAX_WORDS, words


def test_the_readme_is_read_in_a_minute():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= MAX_README_LINES


@pytest.mark.parametrize("name", [name for names in sections().values() for name in names])
def test_a_table_of_figures_has_a_result_file_or_a_version(name):
    if name in REFERENCE:
        return
    text = BLOCK.sub("", CODE.sub("", (DOCS / name).read_text(encoding="utf-8")))
    beginning, *parts = re.split(r"^## ", text, flags=re.MULTILINE)
    if MEASURED.search(beginning):
        return
    for part in parts:
        if FIGURE_CELL.search(part):
            assert MEASURED.search(part), part.splitlines()[0]
