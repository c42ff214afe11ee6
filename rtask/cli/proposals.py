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
    json_option,
    listing_option,
    print_json,
    print_listing,
    shown_parts,
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
    print_listing(matching, limit, as_json, _line, to_data=lambda proposal: proposal.to_dict())


@proposals.command()
@click.argument("number", type=int)
@data_option
@listing_option
@json_option
def show(number: int, data: Path, limit: int | None, as_json: bool) -> None:
    """Show a proposal with its statements."""
    with open_to_read(data) as kb:
        proposal = kb.proposals.get(number)
    shown = shown_parts(proposal.to_dict(), limit, as_json)
    if as_json:
        print_json(shown)
        return
    click.echo(_line(proposal))
    click.echo(f"rests on commit {proposal.rests_on}; {proposal.reason or 'no reason given'}")
    for sign, statements in (("+", shown["added"]), ("-", shown["removed"])):
        for statement in statements:
            click.echo(f"{sign} {statement}")
    if proposal.decided is not None and proposal.decided_by:
        click.echo(f"{proposal.state} by {proposal.decided_by} {proposal.remark}".rstrip())


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


def _line(proposal: Proposal) -> str:
    size = f"+{len(proposal.added.splitlines())} -{len(proposal.removed.splitlines())}"
    made = f"{proposal.made:%Y-%m-%d %H:%M}"
    return f"{proposal.number:5d} {proposal.state:9s} {made} {proposal.author:16s} {size}"
