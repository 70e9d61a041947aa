"""Version of the code that results depend on: a digest of the algorithms."""

from __future__ import annotations

import ast
import functools
import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import tsepm_ros

NO_TRACKS = (
    "analysis",
    "commands",
    "demo",
    "design",
    "diagnostics",
    "ending_signals.py",
    "nodes",
    "pictures",
    "plain_yaml.py",
    "progress.py",
    "replay",
    "reproduction",
    "session",
    "settings",
    "viewer",
    "whole_files.py",
)
"""Packages and modules without influence on the tracks of a scan. All others count."""
_NO_CODE = ("ctx", "kind", "type_comment", "type_params", "type_ignores")
"""Fields of a syntax tree that the code does not depend on, or that not every Python has."""


@functools.cache
def package_version() -> str:
    """Version of the package, and a digest of the modules that determine its tracks.

    The digest takes about a second; it is computed once per process.
    """
    return f"{tsepm_ros.__version__} {digest(track_modules())}"


def track_modules() -> list[Path]:
    """Modules that determine the tracks of a scan."""
    folder = Path(tsepm_ros.__file__).parent
    return [
        path for path in folder.rglob("*.py") if path.relative_to(folder).parts[0] not in NO_TRACKS
    ]


def digest(files: Iterable[Path]) -> str:
    """Short digest of the code of some modules.

    Comments, docstrings, descriptions of parameters, error messages and other sentences do not
    count, nor does formatting: they change no figure.
    """
    content = hashlib.sha256()
    for path in sorted(files):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        content.update(f"{path.name}\n{_code(tree)}\n".encode())
    return content.hexdigest()[:8]


def _code(node: Any) -> str:
    """A syntax tree as text, without words."""
    if isinstance(node, list):
        return f"[{','.join(_code(one) for one in node if not _is_text(one))}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    if isinstance(node, ast.Raise):
        return "raise"
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
        return "words"
    return f"{type(node).__name__}({','.join(_fields(node))})"


def _fields(node: ast.AST) -> Iterator[str]:
    described = isinstance(node, ast.Call) and getattr(node.func, "id", "") == "parameter"
    for name, value in ast.iter_fields(node):
        if name in _NO_CODE:
            continue
        value = value[:1] if described and name == "args" else value  # the default only
        yield f"{name}={_code(value)}"


def _is_text(node: Any) -> bool:
    """Whether a statement is a docstring."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
