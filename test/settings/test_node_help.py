"""The text of ``--help`` of every node."""

from __future__ import annotations

import pytest

from tsepm_ros.parameters import table
from tsepm_ros.settings.settings import NODES, help_text


@pytest.mark.parametrize("node", NODES)
def test_every_node_has_a_help_text_with_its_parameters(node):
    text = help_text(node, "A node.\n\nMore.")
    assert text.startswith("usage: ")
    words = " ".join(text.split())
    for prefix, group in NODES[node]:
        for row in table(group):
            assert row.name in words or f"{prefix}{row.name}" in words
