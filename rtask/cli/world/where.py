"""``rtask where``: where something is or was, since when, and how sure that is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rtask.cli.connection import connection, open_to_read
from rtask.cli.options import (
    announce_why,
    announce_why_stated,
    data_option,
    json_option,
    listing_option,
    print_json,
    server_option,
    shown_rows,
)
from rtask.cli.things import name_or_iri

__all__ = ["where"]


@click.command()
@click.argument("name")
@click.option("--at", metavar="TIME", help="Time that is asked about, ISO 8601; default: now.")
@click.option(
    "--frame", help="Frame for poses: its name in tf, ROBOT/NAME or its IRI; default: as measured."
)
@click.option("--near", metavar="PLACE", help="Only what is near a place, robot, frame or thing.")
@click.option(
    "--radius", type=click.FloatRange(min=0.001, max=1000.0), default=0.5, show_default=True,
    help="How near that is, m.",
)  # fmt: skip
@click.option(
    "--max-things", type=click.IntRange(1, 10_000), default=200, show_default=True,
    help="How many things of that name are looked at.",
)  # fmt: skip
@data_option
@server_option
@listing_option
@json_option
def where(
    name: str,
    at: str | None,
    frame: str | None,
    near: str | None,
    radius: float,
    max_things: int,
    data: Path,
    server: str | None,
    limit: int | None,
    as_json: bool,
) -> None:
    """Tell where NAME is or was: a thing, a product or a kind, by name or IRI.

    Exit code 1 if its place is not known; the answer then says where it was last. What was not
    looked at, because more things than --max-things have the name, is said and not denied.
    """
    named = {
        role: name_or_iri(text, data, server)
        for role, text in (("name", name), ("frame", frame), ("near", near))
        if text is not None
    }
    question: dict[str, Any] = {**named, "radius": radius, "max_things": max_things}
    if at is not None:
        from rtask.rdf.terms import moment

        question["stamp"] = moment(at).timestamp()
    answer = _ask(question, data, server)
    answer["things"] = shown_rows(answer["things"], limit, as_json)
    if as_json:
        print_json(answer)
    else:
        for line in [thing["text"] for thing in answer["things"]] or [answer["text"]]:
            click.echo(line)
        if answer["things"]:
            _announce_why(answer["things"][0], at)
        untried = answer["things_untried"]
        if untried and answer["things"]:
            click.echo(
                f"{untried} more were not looked at; --max-things {max_things + untried} does so",
                err=True,
            )
    if not answer["known"]:
        raise SystemExit(1)


def _announce_why(thing: dict[str, Any], at: str | None) -> None:
    """Print how to see who saw a thing at its place: only what holds at present has a proof."""
    if at is None and thing["place"] and thing["relation"] in ("in", "on"):
        announce_why("explain", thing["thing"], "rt:locatedOn", thing["place"])
    else:
        announce_why_stated(thing["thing"] or thing["object"])


def _ask(question: dict[str, Any], data: Path, server: str | None) -> dict[str, Any]:
    if server:
        with connection(data, server) as client:
            return dict(client.call("where_is", **question))
    from rtask.engine.operations.world.where import WhereIs, answer_of

    with open_to_read(data) as kb:
        return answer_of(kb.world, WhereIs(**question)).as_json()
