"""``rtask branch``: make, list, compare, merge and drop branches of a folder."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.connection import open_to_change
from rtask.cli.options import (
    agent_option,
    announce_undo,
    confirm_final,
    data_option,
    exit_if_empty,
    json_option,
    listing_option,
    print_json,
    print_listing,
    shown_parts,
    yes_option,
)

if TYPE_CHECKING:
    from rtask.kb.branches.record import BranchRecord


@click.group()
def branch() -> None:
    """Make, list, compare, merge and drop branches."""


@branch.command("list")
@data_option
@listing_option
@json_option
def list_command(data: Path, limit: int | None, as_json: bool) -> None:
    """List branches, the oldest first.

    Exit code 1 if there is none.
    """
    with open_to_change(data) as kb:
        records = kb.branches()
    print_listing(records, limit, as_json, _line, to_data=lambda record: record.to_dict())


@branch.command()
@click.argument("name")
@data_option
@agent_option("Whose branch it is: this robot or person may drop it.")
@click.option("--at", metavar="COMMIT", help="Begin after this commit, or time.")
@click.option(
    "--hours", type=click.FloatRange(0, 24, min_open=True), default=24.0, show_default=True,
    help="Drop it after this time.",
)  # fmt: skip
@click.option("--note", default="", metavar="TEXT", help="What it is for.")
@json_option
def make(
    name: str, data: Path, agent: str | None, at: str | None, hours: float, note: str, as_json: bool
) -> None:
    """Make a branch NAME, to be used by `rtask query --branch` and `rtask update --branch`."""
    start = int(at) if at is not None and at.isdecimal() else at
    lifetime = dt.timedelta(hours=hours)
    with open_to_change(data) as kb:
        record = kb.branch(name, at=start, agent=agent, lifetime=lifetime, note=note).record
    if as_json:
        print_json(record.to_dict())
        return
    click.echo(_line(record))
    announce_undo("branch", "drop", name)


@branch.command()
@click.argument("name")
@data_option
@listing_option
@json_option
def compare(name: str, data: Path, limit: int | None, as_json: bool) -> None:
    """Show what merging branch NAME would do, and what stands against it.

    Exit code 1 if something does.
    """
    with open_to_change(data) as kb:
        shown = shown_parts(kb.open_branch(name).compare().to_dict(), limit, as_json)
    if as_json:
        print_json(shown)
    else:
        for sign, statements in (("+", shown["added"]), ("-", shown["removed"])):
            for statement in statements:
                click.echo(f"{sign} {statement}")
        for conflict in shown["conflicts"]:
            click.echo(f"{conflict['kind']}: {conflict['message']}")
    exit_if_empty(not shown["conflicts"])


@branch.command()
@click.argument("name")
@data_option
@click.option("--note", metavar="TEXT", help="Remark to keep with the provenance.")
@json_option
def merge(name: str, data: Path, note: str | None, as_json: bool) -> None:
    """Merge branch NAME as one commit, and drop it."""
    with open_to_change(data) as kb:
        commit = kb.open_branch(name).merge(note=note)
    if as_json:
        names = ("seq", "added", "removed", "derived")
        print_json({field: getattr(commit, field) for field in names})
        return
    click.echo(f"commit {commit.seq}: +{commit.added} -{commit.removed}, {commit.derived} derived")
    announce_undo("undo", str(commit.seq))


@branch.command()
@click.argument("name")
@data_option
@yes_option
@json_option
def drop(name: str, data: Path, yes: bool, as_json: bool) -> None:
    """Delete branch NAME with all that was written in it."""
    with open_to_change(data) as kb:
        kb.open_branch(name)
        confirm_final("what was written in it is gone; the graph itself stays as it is", yes)
        record = kb.drop_branch(name)
    if as_json:
        print_json(record.to_dict())
        return
    click.echo(f"dropped branch {name}")


def _line(record: BranchRecord) -> str:
    made, expires = (f"{time:%Y-%m-%d %H:%M}" for time in (record.made, record.expires))
    words = f"{record.name:20s} after {record.base}, {made} to {expires}  {record.author}"
    return f"{words} {record.note}".rstrip()
