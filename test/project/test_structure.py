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
"""The house: packages import downwards only, and every module is a room of its own name."""

import ast
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LAYERS = (
    "tsepm_ros.whole_files",
    "tsepm_ros.ending_signals",
    "tsepm_ros.parameters",
    "tsepm_ros.numerics",
    "tsepm_ros.tracker",
    "tsepm_ros.detector",
    "tsepm_ros.own_ship",
    "tsepm_ros.methods",
    "tsepm_ros.settings",
    "tsepm_ros.session",
    "tsepm_ros.diagnostics",
    "msg_adapters",
    "tsepm_ros.nodes",
    "tsepm_ros.tools",
    "tsepm_ros.studies",
)
"""From the lowest to the highest: a layer imports from those before it only.

Three storeys: the tracker and what runs its node, the tools, and the studies.
"""
ROOMS = {
    "what a scan measures": "scan options sensor polar_grid range_rates measurement motion",
    "paths of hits": "initial_state tracks",
    "amplitude": "clutter.amplitude_law clutter.amplitude",
    "clutter": "clutter.excess clutter.density clutter.fixed_places clutter.sensor_performance "
    "clutter.learned",
    "sensors beside each other": "sensor_alignment",
    "hypotheses": "observation hypotheses evaluation splitting pruning",
    "merging": "merging",
    "confirmation": "confirmation threshold",
    "maintenance": "maintenance.data_association maintenance.target_manoeuvre "
    "maintenance.stationary maintenance.branches maintenance.confirmed_tracks "
    "maintenance.track_maintenance",
    "clusters": "clusters.grouping clusters.extended_targets",
    "tracker": "method sensor_state tracker",
}
"""Rooms of the tracker and their modules, the lowest first: a module imports from those before it
only, in its room too."""
WITH_ROS = (
    "tsepm_ros.nodes",
    "tsepm_ros.tools.demo",
    "tsepm_ros.tools.live_commands",
    "tsepm_ros.tools.players",
    "tsepm_ros.tools.viewer.track_viewer",
    "tsepm_ros.tools.bridge.track_bridge",
)
MODULES = sorted([*ROOT.glob("tsepm_ros/**/*.py"), *ROOT.glob("msg_adapters/**/*.py")])
HEADER = 10
"""Lines of copyright and licence at the head of every source file."""
MAX_LINES = 900 + HEADER
MAX_IN_PACKAGE = 22
MAX_STAGE = 25
"""Statements of a function of the detector."""
MAX_AT_THE_TOP = 23  # ament_copyright wants CONTRIBUTING.md there
OTHER_TESTS = {
    *("benchmarks", "browser", "campaigns", "data", "examples", "golden", "messages", "processes"),
    *("project", "scenarios", "support"),
}
"""Folders of test/ that mirror no package: their tests belong to no module."""
BUDGETS = {
    # modules, statements, and statements aimed at
    "first": (103, 13_392, 10_300),
    "tools": (54, 6_822, 5_200),
    "studies": (17, 1_971, 1_700),
    "core": (49, 5_731, 5_000),
}
"""Of each storey, and of what processes a scan: small is a feature. Lowered with what is deleted;
raising a number is a commit of its own, with the reason."""
CORE = "tsepm_ros.tracker", "tsepm_ros.methods", "tsepm_ros.numerics"
"""What processes a scan, a part of the first storey."""
MAX_METHODS_OF_TRACKER, MAX_ATTRIBUTES_OF_TRACKER = 20, 14
"""Of the class `Tracker`."""
CONSTANTS, CONSTANTS_AIM = 212, 210
"""Lines that define constants in the tracker, and those aimed at."""


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMED = {name_of(path): path for path in MODULES}


@cache
def tree_of(path: Path) -> ast.Module:
    """What a module says, read once."""
    return ast.parse(path.read_text(encoding="utf-8"))


def layer_of(module: str) -> int | None:
    """Place in LAYERS; None for the package itself, which only hands on public names."""
    places = [
        place
        for place, layer in enumerate(LAYERS)
        if module == layer or module.startswith(f"{layer}.")
    ]
    return places[0] if places else None


@cache
def imported(path: Path) -> tuple[str, ...]:
    """Modules that a module imports anywhere in it."""
    names = list[str]()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path}: imports are absolute"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return tuple(names)


def test_imports_run_one_way():
    for module, path in NAMED.items():
        place = layer_of(module)
        assert place is not None or module == "tsepm_ros", f"{module} is in no layer"
        for name in imported(path) if place is not None else ():
            if name.startswith(("tsepm_ros", "msg_adapters")) and layer_of(name) is not None:
                assert layer_of(name) <= place, f"{module} imports {name} from a layer above it"


def upward(modules: list[str], imported_by: Mapping[str, Iterable[str]]) -> list[str]:
    """Imports among modules, in their order from the lowest, that are not from one before."""
    wrong = []
    for place, module in enumerate(modules):
        for name in imported_by[module]:
            parents = {name, name.rpartition(".")[0]}
            if parents & set(modules[place:]):
                wrong.append(f"{module} imports {name}")
    return wrong


def test_the_rooms_of_the_tracker_import_from_lower_rooms_only():
    rooms = [f"tsepm_ros.tracker.{name}" for room in ROOMS.values() for name in room.split()]
    paths = {name_of(path): path for path in MODULES if path.stem != "__init__"}
    found = {name for name in paths if name.startswith("tsepm_ros.tracker.")}
    assert sorted(rooms) == sorted(found), "every module of the tracker is in one room"
    assert upward(rooms, {name: imported(paths[name]) for name in rooms}) == []


def test_an_import_from_a_higher_room_and_a_circle_are_told():
    low, high = "tsepm_ros.tracker.scan", "tsepm_ros.tracker.sensor"
    assert upward([low, high], {low: ["numpy"], high: [f"{low}.Scan"]}) == []
    assert upward([low, high], {low: [f"{high}.View"], high: [f"{low}.Scan"]}) == [
        f"{low} imports {high}.View"
    ]


def test_only_nodes_and_demo_import_rclpy():
    with_rclpy = {
        module
        for module, path in NAMED.items()
        if any(name.split(".")[0] == "rclpy" for name in imported(path))
    }
    assert [module for module in with_rclpy if not module.startswith(WITH_ROS)] == []


def test_no_two_modules_share_a_name():
    names = Counter(path.stem for path in MODULES if path.stem != "__init__")
    assert [name for name, number in names.items() if number > 1] == []


def late_constants(tree: ast.Module) -> list[str]:
    """Constants, names in capitals, that stand behind a function or class and need none of them."""
    late: list[str] = []
    # Functions, classes and what is made with them: a constant that needs these stands behind.
    needed: set[str] = set()
    begun = False
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            begun = True
            needed.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = {
                each.id for to in targets for each in ast.walk(to) if isinstance(each, ast.Name)
            }
            used = {each.id for each in ast.walk(node.value) if isinstance(each, ast.Name)}
            if used & needed or (begun and not all(map(str.isupper, names))):
                needed |= names
            elif begun:
                late += sorted(names)
    return late


def test_constants_stand_in_one_place_before_the_code():
    late = {module: late_constants(tree_of(path)) for module, path in NAMED.items()}
    assert {module: names for module, names in late.items() if names} == {}


def test_a_constant_between_functions_is_told_but_for_one_that_needs_them():
    code = "A = 1\ndef f(): ...\nB = f()\nC = B\nD = A\n"
    assert late_constants(ast.parse(code)) == ["D"]


def test_no_module_is_long():
    lines = {
        module: len(path.read_text(encoding="utf-8").splitlines()) for module, path in NAMED.items()
    }
    assert {module: number for module, number in lines.items() if number > MAX_LINES} == {}


def test_every_source_file_begins_with_the_copyright_and_the_licence():
    """Of Python by the rule of ament_copyright; files of pages name no address."""
    notice = Path(__file__).read_text(encoding="utf-8").splitlines()[:HEADER]
    for pattern, lines in (("*.py", HEADER), ("*.js", 2), ("*.css", 2)):
        listed = subprocess.run(
            ["git", "ls-files", pattern], cwd=ROOT, capture_output=True, text=True
        )
        words = " ".join(line.lstrip("# ") for line in notice[:lines])
        for name in listed.stdout.split():
            first = (ROOT / name).read_text(encoding="utf-8").splitlines()[: lines + 1]
            assert words in " ".join(line.strip("#/* ") for line in first), name


def test_ament_copyright_finds_nothing(capsys):
    main = pytest.importorskip("ament_copyright.main", reason="ament_copyright is not installed")
    assert main.main([str(ROOT)]) == 0, capsys.readouterr().out


def storeys_of(path: Path) -> set[str]:
    part = path.relative_to(ROOT).parts[1]
    core = {"core"} if name_of(path).startswith(CORE) else set()
    return core | {part if part in BUDGETS else "first"}


@pytest.mark.parametrize("storey", BUDGETS)
def test_a_storey_stays_within_its_budgets(storey):
    modules = [path for path in MODULES if storey in storeys_of(path)]
    most_modules, most_statements, _ = BUDGETS[storey]
    assert len(modules) <= most_modules
    assert sum(map(statements, map(tree_of, modules))) <= most_statements
    assert max(Counter(path.parent for path in modules).values()) <= MAX_IN_PACKAGE


def test_the_constants_of_the_tracker_stay_within_their_budget():
    lines = [
        line
        for path in ROOT.glob("tsepm_ros/tracker/**/*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if re.match(r"[A-Z][A-Z0-9_]*(, [A-Z0-9_]+)*(: [^=]+)? = ", line)
    ]
    assert len(lines) <= CONSTANTS


def test_the_verb_of_the_tracker_fits_a_screen_and_stands_on_the_page():
    tree = ast.parse((ROOT / "tsepm_ros/tracker/tracker.py").read_text(encoding="utf-8"))
    (tracker,) = (node for node in tree.body if isinstance(node, ast.ClassDef))
    methods = {node.name: node for node in tracker.body if isinstance(node, ast.FunctionDef)}
    assert len(methods) <= MAX_METHODS_OF_TRACKER
    attributes = {
        node.attr
        for node in ast.walk(tracker)
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Store)
        and isinstance(node.value, ast.Name)
        and node.value.id == "self"
    }
    assert len(attributes) <= MAX_ATTRIBUTES_OF_TRACKER
    assert "learns_from_confirmed" not in ast.unparse(tree), "a claim of the method is no switch"
    process = methods["process"]
    lines = process.body[-1].end_lineno - process.body[1].lineno + 1  # below the docstring
    assert lines <= 40
    page = (ROOT / "docs" / "contributing.md").read_text(encoding="utf-8")
    shown = page[page.index("detections = state.measure") :]
    text = [ast.unparse(statement) for statement in process.body]
    (first,) = (place for place, line in enumerate(text) if line.startswith("detections = "))
    for line in text[first:]:
        assert line in shown


def test_the_types_that_docstrings_name_exist():
    known, stated = set[str](), {}
    for path in MODULES:
        code, *rest = re.split(r'"""(.*?)"""', path.read_text(encoding="utf-8"), flags=re.DOTALL)
        known |= set(re.findall(r"\b[A-Z]\w*", " ".join([code, *rest[1::2]])))
        lines = re.findall(r"^ *[\w, *]+ : (.+)$", "\n".join(rest[::2]), re.MULTILINE)
        stated[path] = set(re.findall(r"(?<![.\w])[A-Z]\w*[a-z]\w*", " ".join(lines)))
    assert {path.name: types - known for path, types in stated.items() if types - known} == {}


def file_of_tests(path: Path) -> str:
    """The file that tests a module, in test/."""
    package, *folders, name = path.relative_to(ROOT).parts
    first = ["adapters"] if package == "msg_adapters" else []
    return "/".join([*first, *folders, f"test_{name}"])


def test_each_module_has_its_test_file_and_each_test_file_its_module():
    modules = [path for path in MODULES if path.stem != "__init__"]
    wanted = {file_of_tests(path): path for path in modules}
    tests = [path.relative_to(ROOT / "test") for path in ROOT.glob("test/**/test_*.py")]
    mirrored = {path.as_posix() for path in tests if path.parts[0] not in OTHER_TESTS}
    assert sorted(wanted.keys() ^ mirrored) == []


def test_the_folder_of_tests_without_a_module_is_known():
    packages = {path.parent.name for path in ROOT.glob("tsepm_ros/*/__init__.py")} | {"adapters"}
    folders = {path.name for path in (ROOT / "test").iterdir() if any(path.glob("**/*.py"))}
    assert folders <= packages | OTHER_TESTS


def test_checks_without_ros_leave_out_the_tests_of_what_needs_it():
    if not (ROOT / ".ci" / "run").exists():
        pytest.skip("only in the source tree")
    text = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    (listed,) = re.findall(r"^with_ros=\((.*?)\)$", text, re.MULTILINE | re.DOTALL)
    paths = listed.split()
    assert all((ROOT / path).exists() for path in paths)
    for path in MODULES:
        if name_of(path).startswith((*WITH_ROS, "msg_adapters")) and path.stem != "__init__":
            tested = f"test/{file_of_tests(path)}"
            assert tested.startswith(tuple(paths)), f"{tested} needs ROS"


def test_the_top_of_the_repository_is_read_at_a_glance():
    if not (ROOT / ".git").exists() or not shutil.which("git"):
        pytest.skip("only in the source tree")
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip(f"git does not list the files: {listed.stderr}")
    entries = {name.partition("/")[0] for name in listed.stdout.splitlines()}
    assert len(entries) <= MAX_AT_THE_TOP, sorted(entries)


def statements(tree: ast.AST) -> int:
    """Statements of a module or of a function, without docstrings and other lone constants."""
    return sum(
        isinstance(node, ast.stmt)
        and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
        for node in ast.walk(tree)
    )


def test_no_stage_of_an_image_is_long():
    for path in ROOT.glob("tsepm_ros/detector/*.py"):
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef):
                assert statements(node) - 1 <= MAX_STAGE, f"{path.name}: {node.name}"


def private_names_of_others(tree: ast.Module) -> list[str]:
    """Private names of other modules that a module imports or reads."""
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    modules = {alias.asname or alias.name for node in imports for alias in node.names}
    read = [
        alias.name
        for node in imports
        if (node.module or "").startswith("tsepm_ros")
        for alias in node.names
    ]
    read += [
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id in modules - {"self", "cls"}
    ]
    return [name for name in read if name.startswith("_") and not name.startswith("__")]


def test_no_module_reads_a_private_name_of_another():
    read = {module: private_names_of_others(tree_of(path)) for module, path in NAMED.items()}
    assert {module: names for module, names in read.items() if names} == {}


def test_a_private_name_of_another_module_is_told():
    code = "from tsepm_ros import a\nfrom tsepm_ros.b import _c\na._d\na.__name__\nself._e\n"
    assert private_names_of_others(ast.parse(code)) == ["_c", "_d"]


def classes() -> dict[str, ast.ClassDef]:
    return {
        node.name: node
        for path in MODULES
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.ClassDef)
    }


def private_names_of(kind: ast.ClassDef) -> set[str]:
    """Private names that a class defines: its methods, fields and what it sets on itself."""
    names = {node.name for node in kind.body if isinstance(node, ast.FunctionDef)}
    for node in ast.walk(kind):
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            names.add(node.attr)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
    return {name for name in names if name.startswith("_") and not name.startswith("__")}


def test_no_class_reads_or_overrides_a_private_name_of_its_base():
    known = classes()
    for kind in known.values():
        for base in kind.bases:
            above = known.get(getattr(base, "id", getattr(base, "attr", "")))
            if above is None:
                continue
            foreign = private_names_of(above)
            read = {node.attr for node in ast.walk(kind) if isinstance(node, ast.Attribute)}
            assert not read & foreign, f"{kind.name} reads {read & foreign} of {above.name}"
            hidden = private_names_of(kind) & foreign
            assert not hidden, f"{kind.name} overrides {hidden}, which {above.name} keeps private"
