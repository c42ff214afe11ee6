"""``rtask undo``: undo commits, each by its inverse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rtask.cli.connection import connection, open_to_change
from rtask.cli.options import (
    agent_option,
    announce_undo,
    data_option,
    json_option,
    print_json,
    server_option,
)
from rtask.cli.progress import announce_compilation
from rtask.errors import UsageError

__all__ = ["undo"]


@click.command()
@click.argument("commits", nargs=-1, required=True, metavar="COMMIT...")
@data_option
@server_option
@agent_option("Person who undoes it, and whose graph the change goes to. A server knows it.")
@json_option
def undo(
    commits: tuple[str, ...], data: Path, server: str | None, agent: str | None, as_json: bool
) -> None:
    """Undo commits: withdraw what each added, and assert what it removed.

    COMMIT is a number from `rtask history`, or a form like c-00012; several are undone in the order
    given, each by a commit of its own. Refused if later commits changed the same statements, or
    refer to what it introduced.
    """
    with announce_compilation():
        done = [_undone(number, data, server, agent) for number in map(_number, commits)]
    if as_json:
        print_json(done)
        return
    for row in done:
        click.echo(
            f"{row['undone']} is undone by {row['commit']}: "
            f"+{row['added']} -{row['removed']} statements"
        )
    announce_undo("undo", *(row["commit"] for row in reversed(done)))


def _number(commit: str) -> int:
    number = commit.removeprefix("c-")
    if not (number.isdecimal() and len(number) < 16):
        raise UsageError(f"{commit!r} is not a commit; expected a number, or a form like c-00012")
    return int(number)


def _undone(number: int, data: Path, server: str | None, agent: str | None) -> dict[str, Any]:
    if not server:
        with open_to_change(data) as kb:
            if kb.plain:
                commit = kb.revert(number, agent=agent)
                id = f"c-{commit.seq:05d}"
                return _row(number, id, commit.added, commit.removed)
    named: dict[str, Any] = {} if agent is None else {"operator": agent}
    with connection(data, server) as client:
        done = client.call("curate_object", operation="undo", commit=f"c-{number:05d}", **named)
    return _row(number, done["commit"], done["added"], done["removed"])


def _row(number: int, commit: str, added: int, removed: int) -> dict[str, Any]:
    return {"undone": f"c-{number:05d}", "commit": commit, "added": added, "removed": removed}
