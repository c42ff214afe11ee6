"""``rtask feedback``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import connection, server_option
from rtask.cli.options import data_option, json_option, print_json
from rtask.errors import UsageError

if TYPE_CHECKING:
    from rtask.client import Client

__all__ = ["feedback"]

_LATEST = """
SELECT ?time ?task ?robot ?object ?success ?judged ?disputed ?code
WHERE {
  { SELECT ?attempt ?outcome ?time
    WHERE { ?attempt a rt:GraspAttempt ; rt:hasOutcome ?outcome ; prov:endedAtTime ?time }
    ORDER BY DESC(?time) DESC(?attempt) LIMIT %d }
  ?attempt rt:requestId ?task ; rt:performedBy/rt:name ?robot .
  ?outcome rt:success ?success ; rt:hasReason/rt:code ?code
  OPTIONAL { ?through rt:through ?attempt ; rt:handles/rt:name ?object }
  OPTIONAL { ?outcome rt:judgedSuccess ?judged } OPTIONAL { ?outcome rt:disputed ?disputed }
} ORDER BY DESC(?time)"""


@click.command()
@click.argument("task_id", required=False)
@data_option
@server_option
@click.option("--confirm", "verdict", flag_value="confirm", help="The robot's report is right.")
@click.option("--refuse", "verdict", flag_value="refuse", help="The robot's report is wrong.")
@click.option(
    "--correct", metavar="held=BOOL,reason=CODE", help="Say what is right: either or both."
)
@click.option("--by", metavar="NAME", help="Who says so; with a token, the token's person.")
@click.option("--comment", help="In your own words.")
@click.option("--limit", "-n", default=20, show_default=True, help="Attempts to list at most.")
@json_option
def feedback(
    task_id: str | None,
    data: Path,
    server: str | None,
    verdict: str | None,
    correct: str | None,
    by: str | None,
    comment: str | None,
    limit: int,
    as_json: bool,
) -> None:
    """Confirm, refuse or correct what a robot reported about an attempt.

    Without TASK_ID it lists the latest attempts. What most people say counts; where as many say the
    one as the other, the attempt counts nowhere until somebody else speaks.
    """
    if correct is not None and verdict is not None:
        raise UsageError("one of --confirm, --refuse and --correct is enough")
    if task_id is None:
        if verdict or correct:
            raise UsageError("which attempt? rtask feedback lists the latest with their task ids")
        with connection(data, server) as client:
            _list(client, limit, as_json)
        return
    if correct is None and verdict is None:
        raise UsageError("say --confirm, --refuse or --correct held=false,reason=slip_lift")
    request = _request(task_id, verdict, correct, by, comment)
    with connection(data, server) as client:
        answer = client.call("give_feedback", **request)
    if as_json:
        print_json(answer)
        return
    click.echo(answer["text"])
    stats = answer["statistics"]
    held = f"{stats['successes']} of {stats['attempts']}"
    click.echo(f"the grasp {answer['grasp']} held {held} times")
    if not answer["stored"]:
        click.echo("nothing new: the same was said before")


def _request(
    task_id: str, verdict: str | None, correct: str | None, by: str | None, comment: str | None
) -> dict[str, Any]:
    request: dict[str, Any] = {"task_id": task_id, "verdict": verdict or "correct"}
    for part in (correct or "").split(","):
        name, equals, value = part.strip().partition("=")
        if part.strip() and (not equals or name not in ("held", "reason")):
            raise UsageError(f"--correct {part.strip()}: held=true, held=false or reason=CODE")
        if value:
            request[name] = value.strip()
    if by:
        request["operator"] = by
    if comment:
        request["comment"] = comment
    return request


def _list(client: Client, limit: int, as_json: bool) -> None:
    import ontology
    from rtask.rdf.terms import prologue

    rows = client.query(prologue(ontology.PREFIXES) + _LATEST % max(limit, 1))
    if as_json:
        print_json(rows)
        return
    if not rows:
        click.echo("no attempt yet")
    for row in rows:
        said = "held" if row["success"] else str(row["code"])
        counts = {True: "held", False: "failed", None: "nothing"}[row["judged"]]
        counts = "disputed" if row["disputed"] else counts
        time = str(row["time"])[:19]
        click.echo(
            f"{time}  {row['robot']:12s}  {row['object'] or '-':20s}  {said:12s}  "
            f"counts: {counts:8s}  {row['task']}"
        )
