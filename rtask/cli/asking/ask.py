"""``rtask ask``: a question in words, or an object to be held by a hand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import connection, open_graph
from rtask.cli.options import (
    agent_option,
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
_MAX_PAGES = 5
_ROWS = 20


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
        with open_graph(data, server) as kb:
            from rtask.asking.questions import answer

            _show_answer(answer(kb, " ".join(words)), limit, as_json, server)
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


def _show_answer(result: Answer, limit: int | None, as_json: bool, server: str | None) -> None:
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
        _print_why(result, server)
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


def _print_why(result: Answer, server: str | None) -> None:
    """Print the pages of what the numbers rest on; the query is printed anyway."""
    pages = dict.fromkeys(why for why in result.why if why and not why.startswith("/sparql"))
    for address in list(pages)[:_MAX_PAGES]:
        site = server.rstrip("/") if server else "a page of rtask serve: "
        click.echo(f"Why? {site}{address}")
    if len(pages) > _MAX_PAGES:
        click.echo(f"... {len(pages) - _MAX_PAGES} more pages; --json lists them", err=True)


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
        for line in answer["explanation"]["proof"]:
            click.echo(f"  {line}")
    for reason in answer["reasons"]:
        click.echo(f"{reason['code']}: {reason['text']}", err=not answer["object"])
