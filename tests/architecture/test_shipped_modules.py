"""Nothing ships that only tests use.

A module is used when a command, an entry point or ``import rtask`` comes to it by imports, or when
a page of the documentation tells users to import it.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator

import pytest

from tests.architecture.imports import PACKAGES, ROOT, import_graph, source_files

_DOTTED = re.compile(rf"\b(?:{'|'.join(PACKAGES)})(?:\.[a-z_]\w*)+")
_QUOTED = re.compile(rf"""["']({_DOTTED.pattern})(?::\w+)?["']""")


def _modules_named(text: str) -> Iterator[str]:
    """Yield each module of the packages that a text names, by itself or by one of its names."""
    known = source_files()
    for name in _DOTTED.findall(text):
        while name and name not in known:
            name = name.rpartition(".")[0]
        if name:
            yield name


def _named_in_strings(module: str) -> set[str]:
    """Return the modules that a module loads by name, as tables of commands do."""
    text = source_files()[module].read_text(encoding="utf-8")
    return {named for name in _QUOTED.findall(text) for named in _modules_named(name)}


def _starting_points() -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    entries = [*project["scripts"].values()]
    for group in project["entry-points"].values():
        entries += group.values()
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("**/*.md")]
    return {
        *PACKAGES,
        "rtask.__main__",
        *(entry.partition(":")[0] for entry in entries),
        *(name for page in pages for name in _modules_named(page.read_text(encoding="utf-8"))),
    }


def _used_modules() -> set[str]:
    graph = import_graph()
    used: set[str] = set()
    waiting = sorted(_starting_points() & graph.keys())
    while waiting:
        module = waiting.pop()
        if module not in used:
            used.add(module)
            parent = module.rpartition(".")[0]
            waiting += [*graph[module], *_named_in_strings(module), *([parent] if parent else [])]
    return used


@pytest.mark.slow
def test_every_module_is_used_by_a_command_or_shown_in_the_documentation() -> None:
    unused = source_files().keys() - _used_modules()
    assert not sorted(unused)
