"""``rtask ask``: a question in words, or an object to be held by a hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlsplit

import click

from rtask.cli.connection import connection, open_graph
from rtask.cli.options import (
    agent_option,
    announce_why,
    announce_why_stated,
    data_option,
    exit_if_empty,
    json_option,
    listing,
    print_json,
    server_option,
    shown_rows,
)
from rtask.cli.things import name_or_iri, resolve_object
from rtask.errors import UsageError

if TYPE_CHECKING:
    from rtask.asking.questions import Answer
    from rtask.client.calls import ResolvedRequest
    from rtask.sparql.results import Row

__all__ = ["ask"]

_MAX_WIDTH = 40
_ROWS = 20
_OPTIONS = {"robot": "--robot", "object": "--object", "grasp": "--with-grasp"}
"""Options of ``rtask feedback`` for the fields of the page of outcomes."""


@click.command()
@click.argument("words", nargs=-1, required=True)
@data_option
@server_option
@agent_option("Robot whose hand is to hold the object now. A server knows it by the token.")
@click.option("--gripper", help="Name or IRI of the hand that is to hold the object now.")
@click.option(
    "--object",
    "objects",
    multiple=True,
    metavar="IRI",
    help="An object in view now; may be repeated.",
)
@click.option(
    "--seen-within",
    default=600.0,
    show_default=True,
    metavar="S",
    help="With a hand, without --object: consider objects seen this recently, s.",
)
@listing(_ROWS)
@json_option
def ask(
    words: tuple[str, ...],
    data: Path,
    server: str | None,
    agent: str | None,
    gripper: str | None,
    objects: tuple[str, ...],
    seen_within: float,
    limit: int | None,
    as_json: bool,
) -> None:
    """Ask a question in words, such as "which robot fails at cartons, and why?".

    The nearest of the ontology's questions is answered: in a sentence, as a table, and with its
    query. If none is near, the three nearest are printed, and the exit code is 1, as it is if the
    graph states nothing that answers the question.

    With --agent or --gripper, the words name a kind or use of object, such as "something to drink
    from": which of the objects in view will do, why, and how to grasp it.
    """
    if not (agent or gripper or objects):
        if server is not None and _asks_for_changes(" ".join(words)):
            with connection(data, server) as client:
                _show_changes(client.answer(" ".join(words)), limit, as_json)
            return
        with open_graph(data, server) as kb:
            from rtask.asking.questions import answer

            _show_answer(answer(kb, " ".join(words)), limit, as_json)
        return
    request: dict[str, Any] = {"wanted": " ".join(words), "seen_within_s": seen_within}
    if gripper:
        request["gripper_id"] = name_or_iri(gripper, data, server)
    with connection(data, server, agent) as client:
        if objects:
            request["objects"] = [resolve_object(client.query, name) for name in objects]
        if not (gripper or agent or server):
            raise UsageError("whose hand is to hold it? --agent ROBOT, or --gripper NAME")
        resolved = client.resolve_request(**request)
    if as_json:
        print_json(resolved)
    else:
        _show_resolved(resolved)
    if resolved["task_response"] == "unmet":
        raise SystemExit(1)


def _asks_for_changes(text: str) -> bool:
    import datetime as dt

    from rtask.asking.questions.beliefs import asks_for_changes
    from rtask.asking.questions.periods import find_period

    return asks_for_changes(text, find_period(text, dt.datetime.now(dt.UTC)))


def _show_changes(told: Mapping[str, Any], limit: int | None, as_json: bool) -> None:
    """Print what a server says has changed, since it alone keeps its earlier states."""
    rows = shown_rows(told["rows"], limit, as_json, default=_ROWS)
    if as_json:
        print_json({**told, "rows": rows, "why": told["why"][: len(rows)]})
    else:
        click.echo(f"understood: {told['understood']}", err=True)
        click.echo(told["sentence"])
        for row in rows:
            click.echo(f"  {row['belief']}: {row['before'] or '-'} -> {row['now'] or '-'}")
    exit_if_empty(rows)


def _show_answer(result: Answer, limit: int | None, as_json: bool) -> None:
    shown = shown_rows(result.rows, limit, as_json, default=_ROWS)
    if as_json:
        rows = [row.to_dict() for row in shown]
        print_json({**result.to_dict(), "rows": rows, "why": list(result.why[: len(rows)])})
        exit_if_empty(len(result.rows))
        return
    if not result.is_understood:
        click.echo(result.sentence, err=True)
        raise click.exceptions.Exit(1)
    click.echo(f"understood: {result.understood}", err=True)
    click.echo(result.sentence)
    if len(result.rows):
        click.echo()
        _print_rows(result, shown)
        _announce_why(result)
    click.echo(f"\n{result.sparql.rstrip()}")
    exit_if_empty(len(result.rows))


def _print_rows(result: Answer, rows: Sequence[Row]) -> None:
    from rtask.asking.questions.sentences import spoken

    names = {term: result.names[str(getattr(term, "value", term))]
             for row in result.rows for term in row
             if term is not None and str(getattr(term, "value", term)) in result.names}  # fmt: skip
    cells = [[spoken(term, names)[:_MAX_WIDTH] for term in row] for row in rows]
    table = [list(result.rows.variables), *cells]
    widths = [max(len(line[at]) for line in table) for at in range(len(table[0]))]
    for line in table:
        padded = (cell.ljust(width) for cell, width in zip(line, widths, strict=True))
        click.echo("  ".join(padded).rstrip())


def _announce_why(result: Answer) -> None:
    """Print how to see what the numbers of the first row with any rest on.

    Those that rest on the query alone need no line, as it is printed anyway.
    """
    for address in result.why:
        parts = urlsplit(address)
        fields = dict(parse_qsl(parts.query))
        if parts.path == "/feedback":
            options = ((_OPTIONS[name], iri) for name, iri in fields.items())
            announce_why("feedback", *(word for option in options for word in option))
            return
        if parts.path == "/resource":
            announce_why_stated(fields["iri"])
            return


def _show_resolved(answer: ResolvedRequest) -> None:
    if answer["object"]:
        click.echo(f"{answer['label']}  {answer['object']}")
        click.echo(answer["explanation"]["text"])
        for grasp in answer["grasps"]:
            stats, sure = grasp["statistics"], grasp["confidence"]["mean"]
            click.echo(
                f"  {grasp['id']}  confidence {sure:.2f}, "
                f"held {stats['successes']} of {stats['attempts']}"
            )
        if answer["grasps_left_out"]:
            all_of_it = f"rtask objects show {answer['object']}"
            click.echo(f"{answer['grasps_left_out']} more grasps; {all_of_it} lists them", err=True)
        for line in answer["explanation"]["proof"]:
            click.echo(f"  {line}")
        if answer["grasps"]:
            _announce_why_grasp(answer["grasps"][0])
    for reason in answer["reasons"]:
        click.echo(f"{reason['code']}: {reason['text']}", err=not answer["object"])


def _announce_why_grasp(grasp: Mapping[str, Any]) -> None:
    """Print how to see what the numbers of a grasp rest on: its outcomes, or who stated it."""
    if grasp["statistics"]["attempts"]:
        announce_why("feedback", "--with-grasp", grasp["id"])
    else:
        announce_why_stated(grasp["id"])
