"""Pages about robots: all of them, and what one is, has, does now, tried and saw last."""

from __future__ import annotations

import datetime as dt
from collections import Counter
from dataclasses import asdict

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.http.messages import RefusedError
from endpoint.pages.choosing import read_resource
from endpoint.pages.drawn import belief_over
from endpoint.pages.feedback import list_attempts
from endpoint.pages.render import (
    Model,
    blueprint,
    context,
    knowledge_base,
    page,
    robot_url,
    select,
    select_first,
)
from endpoint.pages.signin import require_form
from rtask.rdf.namespaces import CORA, RDF
from rtask.rdf.terms import NamedNode, iri

__all__ = ["list_robots"]

_MAX_ROBOTS = 500
_SHOWN_ATTEMPTS = 12
_SHOWN_REASONS = 5
_SHOWN_PARTS = 40
_SHOWN_OUTCOMES = 500


def list_robots() -> tuple[list[Model], str]:
    """Return each robot with its last outcome and what it does now, and a query if there are more.

    The query is for all of them; empty where none is left out.
    """
    rows: dict[str, Model] = {}
    shown, query = select_first("robots", _MAX_ROBOTS, chosen="")
    for row in shown:
        rows.setdefault(str(row["robot"]), {**_counted(row), **_presence(row)})
    return list(rows.values()), query


def _presence(row: Model) -> Model:
    """Return whether a robot is connected, what it waits for, and how long its calls take."""
    name, activity = str(row["name"] or ""), context().activity
    lane, links, calls = activity.lane(name), activity.links.of(name), activity.calls.of(name)
    seen_s = activity.seen_s(name)
    heard = "" if seen_s is None else _iso(seen_s)
    return {
        "connections": [
            {"since": _iso(link.since_s), "provides": link.provides()} for link in links
        ],
        "last_seen": max(heard, str(row.get("time") or "")),
        "doing": lane.doing if lane else "",
        "frame": lane.frame if lane else 0,
        "calls": asdict(calls),
    }


def _iso(seconds: float) -> str:
    return dt.datetime.fromtimestamp(seconds, dt.UTC).isoformat(timespec="milliseconds")


def _counted(row: Model) -> Model:
    attempts, successes = int(row.get("attempts") or 0), int(row.get("successes") or 0)
    mean = successes / attempts if attempts else None
    return {**row, "attempts": attempts, "successes": successes, "mean": mean}


@page("/robots", "robots.html")
def robots() -> Model:
    """Return all robots; one query."""
    listed, all_robots = list_robots()
    return {"robots": listed, "all_robots": all_robots}


@page("/robot", "robot.html")
def robot() -> Model:
    """Return what a robot is, its hands and cameras, its tasks and their success; four queries."""
    asked = flask.request.args.get("iri", "")
    if not asked:
        raise RefusedError(400, "usage", f"which robot? {flask.request.path}?iri=<IRI>")
    term = read_resource(asked)
    facts = _facts_of(term)
    parts, more_parts = select_first("robot", _SHOWN_PARTS, robot=term)
    outcomes, more_outcomes = select_first("robot_outcomes", _SHOWN_OUTCOMES, robot=term)
    reasons = Counter(row["reason"] for row in outcomes if row["reason"] and not row["success"])
    attempts = list_attempts(f"?attempt rt:performedBy {term}")
    return {
        **facts,
        **_presence(facts),
        "hands": [part for part in parts if part["is_hand"]],
        "cameras": [part for part in parts if not part["is_hand"]],
        "belief": belief_over([bool(row["success"]) for row in reversed(outcomes)]),
        "reasons": reasons.most_common(_SHOWN_REASONS),
        "more_reasons": max(0, len(reasons) - _SHOWN_REASONS),
        "tasks": attempts[:_SHOWN_ATTEMPTS],
        "more_tasks": len(attempts) > _SHOWN_ATTEMPTS,
        "all": {"parts": more_parts, "outcomes": more_outcomes},
    }


@blueprint.route("/robot/disconnect", methods=["POST"])
def robot_disconnected() -> WerkzeugResponse:
    """Close the connections of a robot, for an operator; it may connect again."""
    caller = require_form("admin")
    robot = flask.request.form.get("robot", "")
    facts = _facts_of(iri(robot))
    name = str(facts["name"] or "")
    closed = context().activity.links.close(name, f"closed by {caller.name}")
    context().audit.event("robot-disconnected", robot=name, connections=closed, by=caller.name)
    return flask.redirect(robot_url(robot), 303)


def _facts_of(term: NamedNode) -> Model:
    """Return a robot as in the list of all.

    Raises
    ------
    RefusedError
        404 if it is no robot.
    """
    if not knowledge_base().match(term, RDF.type, CORA.Robot):
        raise RefusedError(404, "not-found", f"no robot {term.value}; see /robots")
    return _counted(select("robots", chosen=f"VALUES ?robot {{ {term} }}")[0])
