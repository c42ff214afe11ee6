"""Commands that errors and pages recommend exist, with the options that they are given."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from rtask.cli import cli

_ROOT = Path(__file__).resolve().parents[2]
_ROOMS = ("rtask", "endpoint", "simulate", "features", "grasp", "reasoner")
_QUOTED = re.compile(r"`rtask ([a-z][^`]*)`|(?::|run) rtask ([a-z][^`\n;,]*)")
_MARKUP = re.compile(r"<(?:code|pre)>\s*rtask ([a-z][^<]*)<")
_MENTIONED = re.compile(r"[`: ]rtask (?!import\b)[a-z]")
_WORD = re.compile(r"[a-z][a-z-]*")
_OPTION = re.compile(r"(?<![\w-])--?[a-z][a-z-]*")


def _texts(source: str) -> Iterator[str]:
    """Yield the texts of a module that its users may read; what is filled in is ``X``."""
    tree = ast.parse(source)
    silent: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            silent.add(id(node.value))  # a docstring
        elif isinstance(node, ast.JoinedStr):
            silent.update(map(id, node.values))
            parts = (v.value if isinstance(v, ast.Constant) else "X" for v in node.values)
            yield "".join(map(str, parts))
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in silent
        ):
            yield node.value


def _recommended() -> Iterator[tuple[str, str]]:
    for room in _ROOMS:
        for path in sorted((_ROOT / room).rglob("*.py")):
            source = path.read_text("utf-8")
            if not _MENTIONED.search(source):
                continue
            for text in _texts(source):
                for quoted in _QUOTED.finditer(text):
                    yield str(path.relative_to(_ROOT)), quoted[1] or quoted[2]
    for path in sorted((_ROOT / "endpoint/pages").rglob("*.html")):
        if "node_modules" not in path.parts:
            for quoted in _MARKUP.finditer(path.read_text("utf-8")):
                yield str(path.relative_to(_ROOT)), quoted[1]


def _fault(command: str) -> str:
    """Return what is wrong with the words after ``rtask``; nothing if all of them are known."""
    group: click.Command = cli
    context = click.Context(cli, info_name="rtask")
    for word in command.split():
        if not isinstance(group, click.Group) or not _WORD.fullmatch(word.rstrip(".,:)")):
            break
        found = group.get_command(context, word.rstrip(".,:)"))
        if found is None:
            return f"there is no command {word}"
        context = click.Context(found, parent=context, info_name=word)
        group = found
    options = {name for part in group.params for name in (*part.opts, *part.secondary_opts)}
    missing = set(_OPTION.findall(command)) - options - {"-h", "--help"}
    return f"no option {', '.join(sorted(missing))}" if missing else ""


def test_every_recommended_command_exists_with_its_options() -> None:
    recommended = list(_recommended())
    assert len(recommended) >= 50
    faults = [f"{path}: rtask {words}: {_fault(words)}" for path, words in recommended
              if _fault(words)]  # fmt: skip
    assert faults == [], "\n".join(faults)


@pytest.mark.parametrize(
    ("command", "fault"),
    [("objects lists", "no command"), ("load --dat X", "no option --dat"), ("load -d X", "")],
)
def test_a_command_that_does_not_exist_is_a_fault(command: str, fault: str) -> None:
    assert (fault in _fault(command)) if fault else _fault(command) == ""
