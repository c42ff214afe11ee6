"""``rtask proposals``: list, show, adopt and refuse changes that wait for a decision."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.connection import open_to_change, open_to_read
from rtask.cli.options import (
    announce_final,
    announce_undo,
    data_option,
    exit_if_empty,
    json_option,
    listing_option,
    print_json,
    shown_rows,
)

if TYPE_CHECKING:
    from rtask.kb.proposals.proposal import Proposal

_STATES = ("proposed", "adopted", "refused", "expired")


@click.group()
def proposals() -> None:
    """List, show, adopt and refuse proposed changes."""


@proposals.command("list")
@data_option
@click.option("--state", type=click.Choice(_STATES), help="Only those in this state.")
@click.option("--author", metavar="NAME", help="Only those of this robot or person.")
@listing_option
@json_option
def list_command(
    data: Path, state: str | None, author: str | None, limit: int | None, as_json: bool
) -> None:
    """List proposals, the oldest first.

    Exit code 1 if there is none.
    """
    with open_to_read(data) as kb:
        matching = [
            proposal
            for proposal in kb.proposals.find(author=author)
            if state is None or proposal.state == state
        ]
    matching = shown_rows(matching, limit, as_json)
    if as_json:
        print_json([proposal.to_dict() for proposal in matching])
    for proposal in () if as_json else matching:
        click.echo(_line(proposal))
    exit_if_empty(matching)


@proposals.command()
@click.argument("number", type=int)
@data_option
@json_option
def show(number: int, data: Path, as_json: bool) -> None:
    """Show a proposal with its statements."""
    with open_to_read(data) as kb:
        found = kb.proposals.get(number)
    if as_json:
        print_json(found.to_dict())
        return
    click.echo(_line(found))
    click.echo(f"rests on commit {found.rests_on}; {found.reason or 'no reason given'}")
    for sign, text in (("+", found.added), ("-", found.removed)):
        for line in text.splitlines():
            click.echo(f"{sign} {line}")
    if found.decided is not None and found.decided_by:
        click.echo(f"{found.state} by {found.decided_by} {found.remark}".rstrip())


@proposals.command()
@click.argument("number", type=int)
@data_option
@json_option
def adopt(number: int, data: Path, as_json: bool) -> None:
    """Carry a proposal out, as the operator: it is checked against what holds now."""
    with open_to_change(data) as kb:
        commit = kb.adopt(number)
    if as_json:
        print_json({"commit": commit.seq, "added": commit.added, "removed": commit.removed})
        return
    click.echo(f"adopted in commit {commit.seq}: {commit.added} added, {commit.removed} removed")
    announce_undo("undo", str(commit.seq))


@proposals.command()
@click.argument("number", type=int)
@data_option
@click.option("--remark", default="", metavar="TEXT", help="Why, for the author.")
@json_option
def refuse(number: int, data: Path, remark: str, as_json: bool) -> None:
    """Decide against a proposal."""
    with open_to_read(data) as kb:
        kb.proposals.refuse(number, "operator", remark)
        refused = kb.proposals.get(number)
    if as_json:
        print_json(refused.to_dict())
        return
    click.echo(f"refused proposal {number}")
    announce_final("its author may propose the change anew")


def _line(one: Proposal) -> str:
    size = f"+{len(one.added.splitlines())} -{len(one.removed.splitlines())}"
    return f"{one.number:5d} {one.state:9s} {one.made:%Y-%m-%d %H:%M} {one.author:16s} {size}"
