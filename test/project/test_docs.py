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
"""The pages say what is, and are short: parameters, commands, code, files and figures."""

import ast
import contextlib
import functools
import io
import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from support.scripts import loaded

from tsepm_ros import __version__, available_methods
from tsepm_ros.methods.registry import NODE_METHODS, registered_method, registered_option_names
from tsepm_ros.settings.settings import NODES, settings_table, settings_with_method
from tsepm_ros.tools.commands.cli import _parser
from tsepm_ros.tools.evaluation.result_files import read_result

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([ROOT / "README.md", *DOCS.rglob("*.md")])
ALL = [
    row
    for groups in NODES.values()
    for row in settings_table(functools.reduce(settings_with_method, available_methods(), groups))
]
"""Every parameter, also of the methods that are not chosen."""
NAMES = {row.name for row in ALL}
GROUPS = "|".join(sorted({name.partition(".")[0] for name in NAMES if "." in name}))

CODE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"`([^`\n]+)`")
GROUPED = re.compile(rf"((?:{GROUPS})\.(?!md\b|py\b)\w+)(:=\S*)?")
ASSIGNED = re.compile(r"([a-z_.]+):=\S*")
GIVEN = re.compile(r"(?:-p|--parameter) '?([\w.]+):=")
LINK = re.compile(r"\]\(([^)\s#]+)")
ANCHOR = re.compile(r"\]\(([^)\s#]*)#([^)\s]+)\)")
PLACEHOLDER = re.compile(r"\b(?:FIGURES?|TODO|TBD|FIXME|XXX+|TK)\b")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)

EVERY_PAGE = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
pytestmark = pytest.mark.skipif(not DOCS.exists(), reason="only in the source tree")


def blocks(page: Path, language: str = "") -> list[str]:
    return [
        code for kind, code in CODE.findall(page.read_text(encoding="utf-8")) if kind == language
    ]


def commands(page: Path) -> Iterator[str]:
    """Commands of the blocks without a language: the lines after "$ " or, where none is, all."""
    for block in blocks(page):
        lines = re.sub(r"\\\n\s*", "", block).splitlines()
        after = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
        yield from after or lines


def launch_arguments() -> set[str]:
    launch = ElementTree.parse(ROOT / "launch" / "tsepm.launch.xml")
    return {str(argument.get("name")) for argument in launch.iter("arg")}


def test_the_page_of_parameters_is_up_to_date_and_has_every_parameter(figures):
    page = figures.parameters_page()
    assert (DOCS / "parameters.md").read_text(encoding="utf-8") == page
    for section in page.split("\n## ")[1:]:
        assert f"As with {section.splitlines()[0]}:" not in section, "named by itself"
    rows = re.findall(r"^\| `([\w.]+)` \|", page, re.MULTILINE)
    assert set(rows) == NAMES


@EVERY_PAGE
def test_parameters_named_in_text_exist(page):
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    named = {
        found[1]
        for quoted in INLINE.findall(text)
        for pattern in (GROUPED, ASSIGNED)
        if (found := pattern.fullmatch(quoted))
    }
    options = set().union(*map(registered_option_names, available_methods()))
    assert named <= NAMES | options | launch_arguments()


@EVERY_PAGE
def test_parameters_given_in_commands_exist(page):
    for command in commands(page):
        options: frozenset[str] = frozenset()
        if "tsepm evaluate" in command:
            options = frozenset().union(*map(registered_option_names, available_methods()))
        assert set(GIVEN.findall(command)) <= NAMES | options, command
        if "ros2 launch" in command:
            assert set(re.findall(r"(\w+):=", command)) <= launch_arguments(), command


@EVERY_PAGE
def test_commands_of_tsepm_are_as_the_command_takes_them(page):
    for line in commands(page):
        if line.startswith("tsepm "):
            arguments = shlex.split(line.split(">")[0], comments=True)[1:]
            assert _parser().parse_args(arguments).command, line


@EVERY_PAGE
def test_links_lead_to_files(page):
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    for target in LINK.findall(text):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as a code host and MkDocs make them of plain words."""
    headings = HEADING.findall(CODE.sub("", page.read_text(encoding="utf-8")))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@EVERY_PAGE
def test_links_lead_to_headings(page):
    # MkDocs warns of those within docs/ only: for those out of it, its hook names the file.
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    for target, anchor in ANCHOR.findall(text):
        if "://" not in target:
            assert anchor in anchors((page.parent / target) if target else page), (target, anchor)


@EVERY_PAGE
def test_nothing_is_left_to_be_filled_in(page):
    assert not PLACEHOLDER.findall(CODE.sub("", page.read_text(encoding="utf-8")))


@EVERY_PAGE
def test_python_can_be_read(page):
    for code in blocks(page, "python"):
        ast.parse(code)


def test_the_page_on_python_runs_and_prints_what_it_says():
    page = DOCS / "python_and_command_line.md"
    names: dict[str, object] = {}
    printed = []
    for code in blocks(page, "python"):
        with contextlib.redirect_stdout(io.StringIO()) as output:
            exec(compile(code, str(page), "exec"), names)
        printed.append(output.getvalue())
    assert printed[0] in blocks(page)


def test_the_driver_on_the_page_is_the_example():
    source = (ROOT / "examples" / "minimal_driver.py").read_text(encoding="utf-8").rstrip()
    driver = source[source.index('"""') :]  # without its licence
    assert driver in [block.rstrip() for block in blocks(DOCS / "get_started.md", "python")]


@pytest.mark.parametrize("method", available_methods())
def test_every_method_has_a_section_with_its_code_equations_options_and_figures(method, figures):
    text = (DOCS / "methods.md").read_text(encoding="utf-8")
    (section,) = re.findall(rf"^## `{method}`\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    module = registered_method(method).__module__.replace(".", "/")
    assert f"](../{module}.py)" in section
    own = method if method in NODE_METHODS else "other-methods"
    assert f"](parameters.md#{own})" in section
    assert CODE.search(section), "its equations"
    box = read_result(figures.RESULTS / "box.json")
    if method in {row["method"] for row in box.measures}:
        assert f"| **`{method}` {figures.DEFAULTS[method]}** |" in text


@pytest.mark.parametrize("method", available_methods())
def test_the_default_point_of_a_method_is_that_of_its_default_options(method, figures):
    kind = registered_method(method)
    defaults = kind.Options()
    for name, value in kind.operating_points[figures.DEFAULTS[method]].items():
        assert getattr(defaults, name) == value


def test_the_second_command_of_the_readme_shows_the_scene_of_the_demo():
    from tsepm_ros.tools.demo import _parse_arguments

    given = re.search(r"tsepm watch (\w+) --seed (\d+)", (ROOT / "README.md").read_text())
    demo = _parse_arguments([])
    assert given and (given[1], int(given[2])) == (demo.scenario, demo.seed)


TYPED = re.compile(
    r"\btsepm (?:run|watch|init|design|evaluate|reproduce|methods|parameters)\b"
    r"|ros2 run tsepm_ros |\btsepm_demo\b"
)


@EVERY_PAGE
def test_a_page_with_commands_says_at_its_top_how_they_are_typed(page):
    text = page.read_text(encoding="utf-8")
    code = [code for _, code in CODE.findall(text)] + INLINE.findall(CODE.sub("", text))
    if any(map(TYPED.search, code)) and page.name not in ("parameters.md", "diagnostics.md"):
        assert "get_started.md#commands)" in text[:1200] or "\n## Commands\n" in text[:1200], (
            "generated pages alone have no such line"
        )


MAX_WORDS = 31_200
"""Of the README and all pages."""
MAX_USER_WORDS = 12_400
"""Of these, outside of the sections Papers and Reference."""
MAX_README_LINES = 80
LONG = ("Papers", "Reference")
MEASURED = re.compile(r"(?:[Mm]easured|[Cc]omputed)\s+with\s+version\s+\d")
BLOCK = re.compile(r"<!-- figures .*?<!-- end of figures -->", re.DOTALL)
FENCED = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
FIGURE_CELL = re.compile(r"^\|.*\|\s*[+-]?\d+\.\d+[^|]*\|", re.MULTILINE)
"""A row with a cell that begins with a decimal number."""
REFERENCE = ("parameters.md", "topics.md", "diagnostics.md", "time_and_frames.md")


@pytest.fixture(scope="module")
def figures():
    return loaded(DOCS / "figures.py")


def test_every_page_shows_its_result_files_and_every_one_stands_on_a_page(figures):
    assert figures.problems() == [], "each names the command that renews it"
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


def test_a_command_of_real_data_is_renewed_with_their_folder_only(figures, one_result, capsys):
    content = json.loads(one_result.read_text("utf-8"))
    command = "python benchmarks/chain.py run --data FOLDER"
    one_result.write_text(json.dumps(content | {"command": command}))
    figures.renew(["box"])
    assert f"box needs --data FOLDER: {command}" in capsys.readouterr().out


def test_a_number_that_is_changed_by_hand_on_the_page_of_papers_is_found(tmp_path):
    page, report = tmp_path / "page.md", tmp_path / "report.md"
    table = "| M/N | P_D |\n|---|---|\n| 5/8 | 0.9 |\n"
    chapter = f"## A 2018\n\nOf 150 runs 0.92 (0.87-0.96) agree.\n\n{table}"
    page.write_text(f"Words.\n\n{chapter}\n## B 2014\n\nOther.\n")
    report.write_text(f"# Report\n\n{chapter}")
    script = loaded(DOCS / "fill_reproduction.py")
    assert script.different_lines(page, report) == []
    for right, wrong in (("| 5/8 | 0.9 |", "| 5/8 | 0.8 |"), ("0.92 (", "0.93 (")):
        text = page.read_text()
        page.write_text(text.replace(right, wrong))
        [told, expected] = script.different_lines(page, report)
        assert wrong in told and right in expected
        page.write_text(text)
    page.write_text(text.replace("| 5/8 | 0.9 |", "| 5/8 | 0.9 |\n| 9/9 | 0.1 |"))
    assert script.different_lines(page, report) == ["- | 9/9 | 0.1 |"]


def sections() -> dict[str, list[str]]:
    """Pages by the top-level heading of the navigation."""
    text = re.sub(r"^(plugins|hooks|markdown_extensions):.*?(?=^\w)", "", CONFIG, flags=re.M | re.S)
    pages = {}
    for entry in yaml.safe_load(text)["nav"]:
        [(name, value)] = entry.items()
        pages[name] = [value] if isinstance(value, str) else [next(iter(p.values())) for p in value]
    return pages


CONFIG = (ROOT / ".ci" / "mkdocs.yml").read_text(encoding="utf-8") if DOCS.exists() else ""


def words_of(text: str) -> int:
    """What has a letter or a digit; the lines of a table have none."""
    return sum(any(map(str.isalnum, word)) for word in text.split())


def test_the_pages_are_short():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    words = {("", "README.md"): words_of(readme)}
    for head, names in sections().items():
        words |= {(head, name): words_of((DOCS / name).read_text("utf-8")) for name in names}
    short = {page: count for page, count in words.items() if page[0] not in LONG}
    assert sum(words.values()) <= MAX_WORDS, words
    assert sum(short.values()) <= MAX_USER_WORDS, short
    assert len(readme.splitlines()) <= MAX_README_LINES


@pytest.mark.parametrize("name", [name for names in sections().values() for name in names])
def test_a_table_of_figures_has_a_result_file_or_a_version(name):
    if name in REFERENCE:
        return
    text = BLOCK.sub("", FENCED.sub("", (DOCS / name).read_text(encoding="utf-8")))
    beginning, *parts = re.split(r"^## ", text, flags=re.MULTILINE)
    if MEASURED.search(beginning):
        return
    for part in parts:
        if FIGURE_CELL.search(part):
            assert MEASURED.search(part), part.splitlines()[0]
