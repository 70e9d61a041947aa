"""Figures on the pages come from result files, those of a release from its own; pages are short."""

import importlib.util
import json
import re
from pathlib import Path

import pytest
import yaml

from tsepm_ros import __version__
from tsepm_ros.tools.evaluation.result_files import read_result

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MAX_WORDS = 17_000
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


def test_every_page_shows_its_result_files(figures):
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
    """A result file of other golden outputs, in place of the others."""
    path = tmp_path / "docs" / "box.json"
    path.parent.mkdir()
    content = json.loads((figures.RESULTS / "box.json").read_text("utf-8"))
    path.write_text(json.dumps(content | {"version": "0.0.1", "goldens": "00000000"}))
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(figures, "RESULTS", path.parent)
    monkeypatch.setattr(figures, "PAGES", [])
    return path


def test_a_release_with_figures_of_other_outputs_fails_with_the_command(
    figures, one_result, tmp_path, capsys
):
    (tmp_path / "CHANGELOG.md").write_text("## [Unreleased]\n\n## [0.0.2]\n- Changed.\n")
    assert figures.main(["check"]) == 0, "they are of an earlier release, and the pages say so"
    content = json.loads(one_result.read_text("utf-8"))
    one_result.write_text(json.dumps(content | {"version": __version__}))
    assert figures.main(["check"]) == 1
    said = capsys.readouterr().err
    assert "docs/box.json was not measured with the outputs of this release" in said
    assert "python docs/figures.py renew box" in said


def test_between_releases_a_table_keeps_the_release_that_it_was_measured_with(
    figures, one_result, tmp_path
):
    (tmp_path / "CHANGELOG.md").write_text("## [Unreleased]\n- Changed.\n\n## [0.0.2]\n")
    assert figures.main(["check"]) == 0
    page = "<!-- figures box.curve -->\n<!-- end of figures -->"
    assert "Version 0.0.1." in figures.filled(page)


def test_a_page_without_its_figures_is_found(figures, monkeypatch, tmp_path):
    page = tmp_path / "page.md"
    page.write_text("<!-- figures box.curve -->\n| old |\n<!-- end of figures -->\n")
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(figures, "PAGES", [page])
    monkeypatch.setattr(figures, "is_release", lambda: False)
    assert any("page.md is out of date" in problem for problem in figures.problems())
    figures.fill()
    assert "| old |" not in page.read_text()
    assert read_result(figures.RESULTS / "box.json").command in page.read_text()
    assert not any("page.md" in problem for problem in figures.problems())


def sections() -> dict[str, list[str]]:
    """Pages by the top-level heading of the navigation."""
    text = re.sub(r"^(plugins|hooks|markdown_extensions):.*?(?=^\w)", "", CONFIG, flags=re.M | re.S)
    pages = {}
    for entry in yaml.safe_load(text)["nav"]:
        [(name, value)] = entry.items()
        pages[name] = [value] if isinstance(value, str) else [next(iter(p.values())) for p in value]
    return pages


CONFIG = (ROOT / ".ci" / "mkdocs.yml").read_text(encoding="utf-8") if DOCS.exists() else ""


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
