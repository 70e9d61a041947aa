"""The page's files, and the self-contained file."""

from __future__ import annotations

import base64
import hashlib
import json
import re

import pytest

from tsepm_ros.tools.viewer.page_state import (
    LIVE,
    SCRIPTS,
    SHELL,
    STYLE,
    page_file,
    self_contained_page,
    served_page,
)

TITLE = '<script>alert("1")</script> & "sea"'
RECORDING = json.dumps({"all": True, "info": {"title": "</script><b>"}, "frames": []})
ELSEWHERE = re.compile(
    r"(?:https?:)?//[\w.-]+\.\w|@import|url\(|\beval\(|innerHTML|document\.write"
)


@pytest.mark.parametrize("name", [SHELL, STYLE, *SCRIPTS])
def test_nothing_is_loaded_from_elsewhere_and_nothing_becomes_markup(name):
    assert not ELSEWHERE.findall(page_file(name))


def test_a_title_is_text():
    for page in (served_page(LIVE, TITLE), self_contained_page(TITLE, RECORDING)):
        assert TITLE not in page
        assert "&lt;script&gt;alert(&quot;1&quot;)&lt;/script&gt; &amp; &quot;sea&quot;" in page


def test_the_policy_of_the_file_names_exactly_its_scripts_and_style():
    page = self_contained_page("title", RECORDING)
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)[1]
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == "'none'"
    for rule, pattern in (
        ("script-src", r"<script>(.*?)</script>"),
        ("style-src", r"<style>(.*?)</style>"),
    ):
        found = re.findall(pattern, page, re.DOTALL)
        digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()) for text in found]
        assert rules[rule].split() == [f"'sha256-{digest.decode()}'" for digest in digests]
    assert page.count("<script>") == len(SCRIPTS)
