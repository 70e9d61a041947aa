"""The version is the same wherever it stands, and the release's files are what they say."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

import tsepm_ros

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(not (ROOT / "CHANGELOG.md").exists(), reason="source tree only")


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_every_place_has_the_same_version():
    manifest = ElementTree.fromstring(text("package.xml")).findtext("version")
    versions = re.findall(r"^## \[(\d+\.\d+\.\d+)\]", text("CHANGELOG.md"), re.MULTILINE)
    citation = yaml.safe_load(text("CITATION.cff"))
    assert {manifest, versions[0], citation["version"]} == {tsepm_ros.__version__}


def test_the_changelog_begins_with_what_is_not_released():
    headings = re.findall(r"^## \[(.+?)\]", text("CHANGELOG.md"), re.MULTILINE)
    assert headings[0] == "Unreleased"
    assert len(headings) == len(set(headings))


@pytest.mark.parametrize("page", ["QUALITY_DECLARATION.md", "SECURITY.md", "CONTRIBUTING.md"])
def test_what_a_page_names_exists(page):
    path = ROOT / ".github" / page
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
    (local,) = yaml.safe_load(text(".pre-commit-config.yaml"))["repos"]
    recipe = re.search(r"^lint:.*\n((?:\t.*\n)+)", text("Makefile"), re.MULTILINE)[1]
    lint = re.findall(r"python -m ([a-z ]+?(?: --check)?)(?: \.)?$", recipe, re.MULTILINE)
    hooks = [hook["entry"].partition("-m ")[2] for hook in local["hooks"]]
    assert hooks == lint
