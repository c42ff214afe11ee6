"""``rtask feedback`` and ``rtask contributors``: people judge what robots reported."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import connection
from rtask.cli.options import (
    agent_option,
    announce_more,
    announce_undo,
    announce_why,
    data_option,
    exit_if_empty,
    json_option,
    listing,
    listing_option,
    print_json,
    server_option,
    shown_rows,
)
from rtask.cli.things import name_or_iri
from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.terms import moment

if TYPE_CHECKING:
    from rtask.client import Client

__all__ = ["contributors", "feedback"]

_ABOUT = {
    "robot": ("?attempt rt:performedBy {}", "a cora:Robot"),
    "object": ("{} rt:hasGrasp/rt:triedIn ?attempt", "rt:objectId ?id"),
    "grasp": ("{} rt:triedIn ?attempt", "a rt:GraspConfiguration"),
}
"""Options that restrict the list: the pattern of each, and what makes something such a one."""
_NAMED = """
SELECT DISTINCT ?term WHERE {
  ?term %s OPTIONAL { ?term rt:name ?name } FILTER(isIRI(?term) && (STR(?term) = %s || ?name = %s))
}"""
_LATEST = """
SELECT DISTINCT ?time ?task ?robot ?object ?success ?judged ?disputed ?code
WHERE {
  { SELECT ?attempt ?outcome ?time
    WHERE { ?attempt a rt:GraspAttempt ; rt:hasOutcome ?outcome ; prov:endedAtTime ?time %s }
    ORDER BY DESC(?time) DESC(?attempt) %s }
  ?attempt rt:performedBy ?who . ?outcome rt:success ?success
  OPTIONAL { ?attempt rt:requestId ?task } OPTIONAL { ?who rt:name ?robot }
  OPTIONAL { ?outcome rt:hasReason/rt:code ?code }
  OPTIONAL { ?through rt:through ?attempt ; rt:handles/rt:name ?object }
  OPTIONAL { ?outcome rt:judgedSuccess ?judged } OPTIONAL { ?outcome rt:disputed ?disputed }
} ORDER BY DESC(?time)"""
_COUNT = """
SELECT (COUNT(*) AS ?n)
WHERE { ?attempt a rt:GraspAttempt ; rt:hasOutcome ?outcome ; prov:endedAtTime ?time %s }"""
_BY_ROBOT = """
SELECT ?robot (COUNT(DISTINCT ?attempt) AS ?made) (COUNT(DISTINCT ?counted) AS ?attempts)
  (COUNT(DISTINCT ?good) AS ?held)
WHERE {
  ?attempt a rt:GraspAttempt ; rt:performedBy ?who %s
  OPTIONAL { ?who rt:name ?name } BIND(COALESCE(?name, STR(?who)) AS ?robot)
  OPTIONAL {
    ?attempt rt:hasOutcome/rt:judgedSuccess ?success
    BIND(?attempt AS ?counted) BIND(IF(?success, ?attempt, ?none) AS ?good)
  }
} GROUP BY ?robot ORDER BY ?robot"""
_LATEST_SHOWN = 20


@click.command()
@click.argument("task_id", required=False)
@data_option
@server_option
@click.option("--confirm", "verdict", flag_value="confirm", help="The robot's report is right.")
@click.option("--refuse", "verdict", flag_value="refuse", help="The robot's report is wrong.")
@click.option(
    "--correct", metavar="held=BOOL,reason=CODE", help="What is right instead: either or both."
)
@agent_option("Person who judges. A server with tokens knows it by the token.")
@click.option("--comment", help="Remark to keep with the verdict.")
@click.option("--robot", help="List only attempts of this robot; name or IRI.")
@click.option("--object", help="List only attempts at this object; name or IRI.")
@click.option("--with-grasp", "grasp", help="List only attempts with this grasp; its IRI.")
@listing(_LATEST_SHOWN)
@json_option
def feedback(
    task_id: str | None,
    robot: str | None,
    object: str | None,
    grasp: str | None,
    data: Path,
    server: str | None,
    verdict: str | None,
    correct: str | None,
    agent: str | None,
    comment: str | None,
    limit: int | None,
    as_json: bool,
) -> None:
    """Confirm, refuse or correct what a robot reported about an attempt.

    Without TASK_ID, lists the latest attempts; exit code 1 if there are none. With --robot,
    --object or --with-grasp it lists those behind a chance, below how many of each robot held. The
    majority of verdicts counts. While there is a tie, the attempt is left out of all statistics.
    """
    about = {
        role: text
        for role, text in (("robot", robot), ("object", object), ("grasp", grasp))
        if text is not None
    }
    if correct is not None and verdict is not None:
        raise UsageError("--confirm, --refuse and --correct exclude each other: one is enough")
    if task_id is None:
        if verdict or correct:
            raise UsageError("which attempt? `rtask feedback` lists the latest with their task ids")
        about = {role: name_or_iri(text, data, server) for role, text in about.items()}
        with connection(data, server) as client:
            _list(client, about, limit, as_json)
        return
    if about:
        raise UsageError("--robot, --object and --with-grasp are for the list, without TASK_ID")
    if correct is None and verdict is None:
        raise UsageError("give --confirm, --refuse or --correct held=false,reason=slip_lift")
    request = _request(task_id, verdict, correct, agent, comment)
    with connection(data, server) as client:
        answer = client.call("give_feedback", **request)
    if as_json:
        print_json(answer)
        return
    click.echo(answer["text"])
    stats = answer["statistics"]
    held = f"{stats['successes']} of {stats['attempts']}"
    click.echo(f"the grasp {answer['grasp']} held {held} times")
    announce_why("feedback", "--with-grasp", answer["grasp"])
    if answer["stored"]:
        announce_undo("undo", answer["commit"])
    else:
        click.echo("nothing new: this verdict had been given before")


def _request(
    task_id: str, verdict: str | None, correct: str | None, agent: str | None, comment: str | None
) -> dict[str, Any]:
    request: dict[str, Any] = {"task_id": task_id, "verdict": verdict or "correct"}
    for part in (correct or "").split(","):
        name, equals, value = part.strip().partition("=")
        if part.strip() and (not equals or name not in ("held", "reason")):
            raise UsageError(
                f"--correct {part.strip()}: held=true, held=false or reason=CODE is expected"
            )
        if value:
            request[name] = value.strip()
    if agent:
        request["operator"] = agent
    if comment:
        request["comment"] = comment
    return request


def _list(client: Client, about: Mapping[str, str], limit: int | None, as_json: bool) -> None:
    import ontology
    from rtask.engine.words import reason_words
    from rtask.rdf.terms import prologue

    prefixes = prologue(ontology.PREFIXES)
    chosen = "".join(
        f". {_ABOUT[role][0].format(_term(client, prefixes, role, text))} "
        for role, text in about.items()
    )
    bound = limit if limit is not None else sys.maxsize if as_json else _LATEST_SHOWN
    # The query is bounded too: a graph may hold far more attempts than anybody lists.
    most = "" if bound == sys.maxsize else f"LIMIT {bound}"
    rows = client.query(prefixes + _LATEST % (chosen, most))
    if limit not in (None, sys.maxsize) or len(rows) >= bound:
        (total,) = client.query(prefixes + _COUNT % chosen)
        announce_more(max(0, total["n"] - bound), "earlier")
    if about and not as_json:
        click.echo(_share(client.query(prefixes + _BY_ROBOT % chosen)))
    if as_json:
        print_json(rows)
        exit_if_empty(rows, "no attempts yet")
        return
    for row in rows:
        result = "held" if row["success"] else reason_words(row["code"]) or "did not hold"
        counts = {True: "held", False: "failed", None: "nothing"}[row["judged"]]
        counts = "disputed" if row["disputed"] else counts
        time = str(row["time"])[:19]
        click.echo(
            f"{time}  {row['robot'] or '-':12s}  {row['object'] or '-':20s}  {result:33s}  "
            f"counts: {counts:8s}  {row['task'] or '-'}"
        )
    exit_if_empty(rows, "no attempts yet")


def _term(client: Client, prefixes: str, role: str, text: str) -> str:
    """Return, for a query, what has a name or is the IRI; no such thing is an error, not a no."""
    from rtask.rdf.terms import iri, literal

    asked = literal(text)
    rows = client.query(prefixes + _NAMED % (_ABOUT[role][1], asked, asked))
    terms = sorted(str(row["term"]) for row in rows)
    if not terms:
        raise UnknownTermError(f"--{role}: no {role} is called {text!r}")
    if len(terms) > 1:
        raise UsageError(f"{len(terms)} are called {text!r}; give the IRI: {', '.join(terms)}")
    return str(iri(terms[0]))


def _share(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return how many attempts held, in all and of each robot, and how many do not count."""
    made, attempts, held = (sum(row[name] for row in rows) for name in ("made", "attempts", "held"))
    robots = ", ".join(f"{row['robot']} {row['held']} of {row['attempts']}" for row in rows)
    text = f"{held} of {attempts} held: {robots}" if attempts else "no attempt counts yet"
    if made > attempts:
        text += f"; {made - attempts} more do not count, because nothing decided whether they held"
    return text


@click.group()
def contributors() -> None:
    """Compare what robots reported, and withdraw a contributor with all that followed."""


@contributors.command("list")
@click.argument("name", required=False)
@data_option
@server_option
@listing_option
@json_option
def list_(
    name: str | None, data: Path, server: str | None, limit: int | None, as_json: bool
) -> None:
    """List robots by how truthfully they report, the least first; NAME restricts it to one.

    Robots that try the same grasp of the same object with the same kind of hand should find the
    same. Exit code 1 if there are no reports.
    """
    request: dict[str, Any] = (
        {} if name is None else {"contributor": name_or_iri(name, data, server)}
    )
    with connection(data, server) as client:
        compared = client.compare_contributors(**request)["contributors"]
    compared = shown_rows(compared, limit, as_json)
    if as_json:
        print_json(compared)
    else:
        for row in compared:
            click.echo(
                f"{row['finding']:12s} {row['truthful']:5.3f}  {row['attempts']:5d} attempts  "
                f"{row['text']}"
            )
        if compared:
            announce_why("feedback", "--robot", compared[0]["name"])
    exit_if_empty(compared, "no reports of robots yet")


@contributors.command()
@click.argument("name")
@data_option
@server_option
@agent_option("Person who withdraws it, and whose graph the change goes to.")
@click.option("--since", metavar="TIME", help="Only what was stored from then on, ISO 8601.")
@click.option("--until", metavar="TIME", help="Only what was stored before, ISO 8601.")
@json_option
def withdraw(
    name: str,
    data: Path,
    server: str | None,
    agent: str | None,
    since: str | None,
    until: str | None,
    as_json: bool,
) -> None:
    """Withdraw all that the robot or person NAME reported, and all that followed from it.

    Attempts, outcomes, verdicts and places go; counts and beliefs are restated from what the
    others reported. Objects and grasps that others build on stay. With --since and --until only
    what was stored in that time goes, by the server's clock. `rtask objects undo COMMIT` undoes it.
    """
    named: dict[str, Any] = {} if agent is None else {"operator": agent}
    for key, time in (("since", since), ("until", until)):
        if time is not None:
            named[key] = moment(time).timestamp()
    with connection(data, server) as client:
        contributor = name_or_iri(name, data, server)
        done = client.withdraw_contributor(contributor=contributor, **named)
    if as_json:
        print_json(done)
        return
    click.echo(
        f"{done['commit']}: {done['attempts']} attempts, {done['verdicts']} verdicts and "
        f"{done['objects']} objects withdrawn; {done['kept']} objects stay, because others build "
        f"on them; {done['grasps']} grasps have a new belief"
    )
    announce_undo("objects", "undo", done["commit"])
