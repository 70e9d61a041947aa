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
"""Files of the page: nothing from elsewhere, a policy, titles that are text, and colours."""

import base64
import hashlib
import json
import re

import numpy as np
import pytest

from tsepm_ros.tools.viewer.page_files import (
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


def contrast(one: str, other: str) -> float:
    """Contrast of two colours of the form #rrggbb, as WCAG 2 has it."""
    bright, dark = sorted(map(luminance, (one, other)), reverse=True)
    return (bright + 0.05) / (dark + 0.05)


def luminance(colour: str) -> float:
    parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


@pytest.mark.parametrize("colours", re.findall(r":root[^{]*\{([^}]*)\}", page_file("watch.css")))
def test_text_and_signs_stand_out_from_their_ground_in_every_set_of_colours(colours):
    named = dict(re.findall(r"--([\w-]+): (#\w{6});", colours))
    for name in ("text", "muted", "accent", "ok", "warn", "error", "stale", "track", "strong"):
        assert min(contrast(named[name], named[on]) for on in ("plot", "panel")) >= 4.5, name
    for name in ("ring", "detection", "weak", "fixed", "truth", "ship", "new"):
        assert contrast(named[name], named["plot"]) >= 3.0, name
