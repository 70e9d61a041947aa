"""YAML of untrusted files: plain values only.

Tags that make objects are refused, as by `yaml.safe_load`, and so are aliases: a few lines of these
stand for more values than any memory holds. ROS refuses them in parameter files, too.
"""

from __future__ import annotations

from typing import Any

import yaml


class _PlainLoader(yaml.SafeLoader):
    """A loader without aliases."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(
                None, None, f"aliases such as *{event.anchor} are not supported", event.start_mark
            )
        node: yaml.Node | None = super().compose_node(parent, index)
        return node


def load(text: str) -> Any:
    """The content of a YAML text.

    Raises
    ------
    yaml.YAMLError, ValueError, RecursionError
        If it is none.
    """
    return yaml.load(text, _PlainLoader)
