"""Every command reads, or has an opposite that it prints, or says that nothing undoes it."""

from __future__ import annotations

import inspect

import click
import pytest

from tests.rtask.cli.each.tree import walk_commands

_FINAL = {
    "branch drop",
    "dataset create", "dataset snapshot", "objects forget", "promote", "proposals refuse",
    "quarantine", "token revoke", "update", "load", "dataset put", "dataset remove",
    "dataset restore", "dataset prune",
}  # fmt: skip
"""Commands that say of some changes that nothing undoes them."""
_UNDONE = {
    "branch make", "branch merge",
    "contributors withdraw", "dataset merge", "dataset prune", "dataset put", "dataset remove",
    "dataset restore", "episodes import", "feedback", "grasp push", "grasp space", "load",
    "migrate", "objects forget", "objects merge", "objects mesh", "objects name", "objects split",
    "objects twins", "objects undo", "ontology unload", "ontology upgrade", "plan",
    "proposals adopt", "questions answer", "robot add", "robot remove", "robot restore",
    "rules add", "rules remove", "tasks cancel", "teach", "token create", "token expire", "undo",
    "update",
}  # fmt: skip
_OTHERS = {
    "rebuild": "states derived data again", "verify": "as rebuild",
    "reason": "as rebuild",
    "backup": "makes a folder of its own", "restore": "as backup", "demo": "as backup",
    "simulate fetch": "reports as a robot does; contributors withdraw, forget and undo mend it",
    "simulate tasks": "as simulate fetch; tasks cancel ends its plans",
    "simulate crew": "as simulate tasks",
    "service save": "a server keeps each version of a pipeline",
    "service call": "what the service does", "service run": "what the script does",
    "ros2 dds call": "what the operation does", "mcp": "what the agent calls",
}  # fmt: skip
"""Commands that change something which needs no undoing, with the reason."""
_READING = {
    "ask", "branch compare", "branch list", "contributors list", "dataset diff",
    "dataset get", "dataset list", "dataset show",
    "episodes ask", "objects list", "objects show", "query", "questions list", "recognise",
    "search", "tasks list", "tasks tree", "token list", "where", "why",
}  # fmt: skip
"""Commands that open what changing commands open, too."""
_CHANGING = (
    "open_to_change(", "rtask.open(", "connection(", "_connected(", "_curate(", "_carry_out(",
    "_tokens(", "set_aside(", "client.update(",
)  # fmt: skip
"""Calls in the source of a command that changes something."""


@pytest.fixture(scope="module")
def commands() -> dict[str, click.Command]:
    return dict(walk_commands())


def test_a_command_that_may_change_something_says_how_that_is_undone(
    commands: dict[str, click.Command],
) -> None:
    may_change = {
        name
        for name, command in commands.items()
        if command.callback is not None
        and not name.startswith("study ")
        and any(call in inspect.getsource(inspect.unwrap(command.callback)) for call in _CHANGING)
    }
    listed = _READING | _UNDONE | _FINAL | _OTHERS.keys()
    assert may_change - listed == set()
    assert listed - commands.keys() == set()
    assert set() == _READING & (_UNDONE | _FINAL)


def _module(command: click.Command) -> str:
    assert command.callback is not None
    module = inspect.getmodule(inspect.unwrap(command.callback))
    assert module is not None
    return inspect.getsource(module)


def test_commands_with_an_opposite_print_it(commands: dict[str, click.Command]) -> None:
    printing = ("announce_undo(", "announce_stored(", "print_change(")
    for name in _UNDONE - {"grasp space"}:  # printed by its report
        assert any(call in _module(commands[name]) for call in printing), name


def test_commands_that_nothing_undoes_ask_before_at_a_terminal(
    commands: dict[str, click.Command],
) -> None:
    asking = {
        name
        for name, command in commands.items()
        if any("--yes" in parameter.opts for parameter in command.params)
    }
    # What is not asked adds something, or goes on where nothing was lost.
    silent = {"dataset create", "dataset snapshot", "proposals refuse", "update", "load"}
    assert asking == _FINAL - silent
