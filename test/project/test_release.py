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
"""The version is the same wherever it stands, and the release's files are what they say."""

import re
import runpy
from datetime import datetime
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from support.scripts import loaded

import tsepm_ros

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(not (ROOT / "CHANGELOG.md").exists(), reason="source tree only")


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_every_place_has_the_same_version_and_the_changelog_begins_with_what_is_not_released():
    manifest = ElementTree.fromstring(text("package.xml")).findtext("version")
    versions = re.findall(r"^## \[(\d+\.\d+\.\d+)\]", text("CHANGELOG.md"), re.MULTILINE)
    citation = yaml.safe_load(text("CITATION.cff"))
    assert {manifest, versions[0], citation["version"]} == {tsepm_ros.__version__}
    headings = re.findall(r"^## \[(.+?)\]", text("CHANGELOG.md"), re.MULTILINE)
    assert headings[0] == "Unreleased"
    assert len(headings) == len(set(headings))


def described_by_setup(manifest: ElementTree.Element, folder: Path, monkeypatch) -> dict:
    """What setup.py tells setuptools beside this package.xml."""
    setuptools = pytest.importorskip("setuptools")
    told = {}
    monkeypatch.setattr(setuptools, "setup", told.update)
    monkeypatch.chdir(folder)
    ElementTree.ElementTree(manifest).write(folder / "package.xml")
    runpy.run_path(str(ROOT / "setup.py"))
    return told


def test_setup_reads_people_and_addresses_from_the_manifest(tmp_path, monkeypatch):
    manifest = ElementTree.fromstring(text("package.xml"))
    for role in ("maintainer", "author"):
        manifest.find(role).text = f"A. {role}"
        manifest.find(role).set("email", f"{role}@example.org")
    for url in manifest.findall("url"):
        url.text = f"https://{url.get('type')}.example.org"
    told = described_by_setup(manifest, tmp_path, monkeypatch)
    assert (told["maintainer"], told["author"]) == ("A. maintainer", "A. author")
    assert told["maintainer_email"] == "maintainer@example.org"
    assert told["author_email"] == "author@example.org"
    assert told["url"] == "https://website.example.org"
    assert told["project_urls"] == {
        "Repository": "https://repository.example.org",
        "Issues": "https://bugtracker.example.org",
    }


def test_every_place_has_the_same_keywords(tmp_path, monkeypatch):
    told = described_by_setup(ElementTree.fromstring(text("package.xml")), tmp_path, monkeypatch)
    citation = yaml.safe_load(text("CITATION.cff"))["keywords"]
    assert citation == ["ROS 2", *told["keywords"]]
    assert "sonar" in citation


def test_catkin_reads_the_manifest_without_a_warning():
    catkin = pytest.importorskip("catkin_pkg.package", reason="catkin_pkg is not installed")
    warnings = []
    package = catkin.parse_package(str(ROOT / "package.xml"), warnings=warnings)
    assert warnings == []
    assert {url.type for url in package.urls} == {"website", "bugtracker", "repository"}


def test_the_container_is_made_by_the_commands_of_the_readme():
    (commands,) = re.findall(r"```\ngit clone .*\n((?:.+\n)+)```", text("README.md"))
    made = text(".ci/Dockerfile")
    install, build = (line.partition(" && ")[0] for line in commands.splitlines())
    assert install.startswith("rosdep install ") and f"{install} -y" in made
    assert build == "colcon build" and made.index(install) < made.index(f"&& {build}\n")


@pytest.fixture
def changelog():
    return loaded(ROOT / "docs/changelog.py")


def test_the_changelog_of_ros_is_made_from_the_other_with_signs_that_mean_the_same(changelog):
    assert text("CHANGELOG.rst") == changelog.current(), "out of date: python docs/changelog.py"
    markdown = "# All\n\n## [1.0.0] - 2026-01-02\n\n### Fixed\n\n- `a_b\n  c` of [x](y.md), a*b, [z](http://z).\n"
    assert changelog.as_rst(markdown, "boat").split("\n", 3)[3] == (
        "\n1.0.0 (2026-01-02)\n------------------\n\n**Fixed**\n\n"
        "- ``a_b\n  c`` of x, a\\*b, `z <http://z>`__.\n"
    )
    with pytest.raises(ValueError, match=r"version 1\.0\.0 has no date"):
        changelog.as_rst("## [1.0.0]\n- Changed.\n", "boat")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of docutils, in catkin_pkg
def test_catkin_reads_every_version_with_its_date_and_entries(changelog):
    catkin = pytest.importorskip("catkin_pkg.changelog", reason="catkin_pkg is not installed")
    read = catkin.get_changelog_from_path(str(ROOT), "tsepm_ros")
    released = text("CHANGELOG.md").partition("\n## [")[2].partition("\n## [")[2]
    dated = re.findall(r"^(?:## \[)?(\d\S+)\] - (\S+)$", released, re.MULTILINE)
    assert [(version, date) for version, date, _ in read.foreach_version(reverse=True)] == [
        (version, datetime.fromisoformat(date)) for version, date in dated
    ]
    entries = [
        bullet
        for _, _, contents in read.foreach_version()
        for block in contents
        for bullet in getattr(block, "bullets", [])
    ]
    assert len(entries) == len(re.findall(r"^- ", released, re.MULTILINE))


@pytest.mark.parametrize(
    "page", [".github/QUALITY_DECLARATION.md", ".github/SECURITY.md", "CONTRIBUTING.md"]
)
def test_what_a_page_names_exists(page):
    path = ROOT / page
    content = path.read_text(encoding="utf-8")
    named = [path.parent / link for link in re.findall(r"\]\((?!http)([^)#]+)", content)]
    quoted = re.findall(
        r"(?:`|python )((?:test|benchmarks|docs|config|\.github|\.ci)/[\w./-]+)`", content
    )
    named += [ROOT / name for name in quoted]
    assert named
    for place in named:
        assert place.exists(), f"{page} names {place}"
    targets = set(re.findall(r"^([a-z]+):", text("Makefile"), re.MULTILINE))
    assert set(re.findall(r"`make ([a-z]+)", content)) <= targets


@pytest.mark.parametrize("path", sorted(ROOT.glob(".github/**/*.y*ml")), ids=lambda p: p.name)
def test_workflows_and_forms_are_yaml_with_what_their_kind_needs(path):
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    if path.parent.name == "workflows":
        assert content["permissions"] == {"contents": "read"}
        assert all(job["runs-on"] and job["steps"] for job in content["jobs"].values())
    elif path.name != "config.yml":
        assert content["name"] and content["description"] and content["body"]


def test_the_hooks_are_the_tools_of_make_lint():
    (local,) = yaml.safe_load(text(".ci/pre-commit.yaml"))["repos"]
    recipe = re.search(r"^lint:.*\n((?:\t.*\n)+)", text("Makefile"), re.MULTILINE)[1]
    lint = re.findall(r"python -m ([a-z ]+?(?: --check)?)(?: \.)?$", recipe, re.MULTILINE)
    hooks = [hook["entry"].partition("-m ")[2] for hook in local["hooks"]]
    assert hooks == lint
