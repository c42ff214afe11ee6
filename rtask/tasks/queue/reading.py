"""Stored plans with their steps and claims, as the graph holds them now."""

from __future__ import annotations

import datetime as dt
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from rtask.errors import UsageError
from rtask.rdf.namespaces import CORA, PREFIXES, RDF, local_name
from rtask.rdf.terms import NamedNode
from rtask.tasks.actions import Select
from rtask.tasks.questions.price import Prices
from rtask.tasks.questions.question import Question
from rtask.tasks.questions.reading import read_questions

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore
    from rtask.sparql.results import Row

__all__ = ["MAX_LEASE_S", "Claim", "QueuedPlan", "QueuedStep", "claimed_things", "read_queue"]

MAX_LEASE_S = 3600.0
"""The longest that a claim may last before it is renewed."""

_PLANS = f"""{PREFIXES}
SELECT ?plan ?graph ?goal ?made ?priority ?deadline ?cancelled ?reason ?replaced ?asking ?failing
  ?part ?settled ?takeover
WHERE {{
  GRAPH ?graph {{ ?plan a rt:TaskPlan ; rt:goalText ?goal }}
  OPTIONAL {{ ?plan prov:generatedAtTime ?made }}
  OPTIONAL {{ ?plan rt:taskPriority ?priority }}
  OPTIONAL {{ ?plan rt:taskDeadline ?deadline }}
  OPTIONAL {{ ?plan prov:invalidatedAtTime ?cancelled }}
  OPTIONAL {{ ?plan rt:cancelReason ?reason }}
  OPTIONAL {{ ?replaced rt:replacesPlan ?plan }}
  OPTIONAL {{ ?plan rt:askingPrice ?asking ; rt:failingPrice ?failing }}
  OPTIONAL {{ ?plan rt:allowsPart ?part }}
  OPTIONAL {{ ?plan rt:settledGoal ?settled }}
  OPTIONAL {{ GRAPH ?graph {{ ?plan rt:allowsTakeover ?takeover }} }}
}}"""
_OPEN = f"""{PREFIXES}
SELECT DISTINCT ?plan ?open WHERE {{ ?plan a rt:TaskPlan ; rt:openGoal ?open }} ORDER BY ?open"""
_STEPS = f"""{PREFIXES}
SELECT ?plan ?step ?number ?action ?values ?text ?robot ?thing ?before ?duration ?chance WHERE {{
  ?plan a rt:TaskPlan ; rt:hasSubTask ?step .
  ?step rt:stepNumber ?number ; rt:parameterValues ?values ; rt:assignedTo ?robot .
  GRAPH ?graph {{ ?plan rt:hasSubTask ?step . ?step a ?action }}
  OPTIONAL {{ ?step rdfs:label ?text }}
  OPTIONAL {{ ?step rt:handlesExemplar ?thing }}
  OPTIONAL {{ ?step rt:waitsFor ?before }}
  OPTIONAL {{ ?step rt:plannedDuration ?duration }}
  OPTIONAL {{ ?step rt:plannedChance ?chance }}
}}"""
# Apart from the steps: one that waits for many would else have a row for each two of these. By the
# graph, as it is the plan that says so, and nobody else about the plan of another.
_ASSIGNED = f"""{PREFIXES}
SELECT ?graph ?step ?property ?value WHERE {{
  VALUES ?property {{ rt:waitsForHand rt:takenFrom rt:assignmentReason }}
  GRAPH ?graph {{ ?plan rt:hasSubTask ?step . ?step ?property ?value }}
}}"""
_CLAIMS = f"""{PREFIXES}
SELECT ?claim ?step ?robot ?begun (MAX(?until) AS ?last) ?ended ?result ?comment ?why WHERE {{
  ?claim a rt:TaskClaim ; rt:claims ?step ; prov:wasAssociatedWith ?robot ;
    prov:startedAtTime ?begun ; rt:claimedUntil ?until .
  OPTIONAL {{ ?claim prov:endedAtTime ?ended ; rt:claimResult ?result }}
  OPTIONAL {{ ?claim rt:claimComment ?comment }}
  OPTIONAL {{ ?claim rt:claimReason ?why }}
}} GROUP BY ?claim ?step ?robot ?begun ?ended ?result ?comment ?why ORDER BY ?begun"""

_CLAIMED = """
SELECT ?claim ?thing ?robot ?begun (MAX(?until) AS ?last) WHERE {{
  VALUES ?thing {{ {things} }}
  ?claim rt:claimsExemplar ?thing ; prov:wasAssociatedWith ?robot ; prov:startedAtTime ?begun ;
    rt:claimedUntil ?until .
  FILTER NOT EXISTS {{ ?claim rt:claimResult ?result }}
}} GROUP BY ?claim ?thing ?robot ?begun ORDER BY ?begun"""


@dataclass(frozen=True)
class Claim:
    """A robot has a step for itself, or had.

    Parameters
    ----------
    iri
        IRI of the claim.
    robot
        IRI of the robot.
    begun, until
        From when, and when it runs out.
    result
        done, failed, declined or released; empty while it lasts.
    comment
        What happened.
    why
        Why this robot got it.
    ended
        When its robot ended it.
    """

    iri: str
    robot: str
    begun: dt.datetime
    until: dt.datetime
    result: str = ""
    comment: str = ""
    why: str = ""
    ended: dt.datetime | None = None

    def is_live(self, now: dt.datetime) -> bool:
        """Whether it lasts."""
        # One that lasts longer than any may was made while the clock was ahead. Nobody can say when
        # it would have ended, and a step must not wait for years for a robot that is switched off.
        longest = now + dt.timedelta(seconds=MAX_LEASE_S)
        return not self.result and now < self.until <= longest


@dataclass(frozen=True)
class QueuedStep:
    """A step of a stored plan.

    Parameters
    ----------
    task
        IRI of the planned task.
    number
        Its place in the plan, from 1.
    action
        IRI of its class.
    arguments
        IRIs by parameter.
    text
        A sentence.
    robots
        IRIs of those who do it.
    thing
        IRI of the thing that it handles; empty if there is none.
    after
        IRIs of the tasks that must be done before.
    duration_s, chance
        As expected.
    claims
        In the order in which they began.
    questions
        What robots asked people about it, in the order of asking.
    for_hand
        Those of ``after`` that it waits for only because one hand does both.
    taken_from
        IRIs of the robots that it was assigned to before others took it over.
    assignment
        Why it is its robot's, in words; empty where that is as planned.
    """

    task: str
    number: int
    action: str
    arguments: Mapping[str, str]
    text: str
    robots: tuple[str, ...]
    thing: str
    after: tuple[str, ...]
    duration_s: float
    chance: float
    claims: tuple[Claim, ...]
    questions: tuple[Question, ...] = ()
    for_hand: tuple[str, ...] = ()
    taken_from: tuple[str, ...] = ()
    assignment: str = ""

    @property
    def is_done(self) -> bool:
        """Whether a robot has done it."""
        return any(claim.result == "done" for claim in self.claims)

    @property
    def ended_badly(self) -> Claim | None:
        """The claim by which it failed or was declined, unless it was done later."""
        # A claim that was given back says nothing of the step.
        last = next((c for c in reversed(self.claims) if c.result not in ("", "released")), None)
        return None if last is None or last.result == "done" else last

    @property
    def is_untouched(self) -> bool:
        """Whether no robot has begun it or asked about it; one that it gave back untouched."""
        # A claim that ran out is no proof that nothing was done: the thing may be in a hand.
        return all(c.result == "released" for c in self.claims) and not self.questions

    def claim(self, now: dt.datetime) -> Claim | None:
        """Return the claim that lasts."""
        return next((claim for claim in self.claims if claim.is_live(now)), None)

    def open_question(self, now: dt.datetime) -> Question | None:
        """Return the question that it waits for."""
        return next((asked for asked in self.questions if asked.is_open(now)), None)

    def state(self, now: dt.datetime) -> str:
        """Return done, claimed, asked, failed, declined or waiting."""
        if self.is_done:
            return "done"
        if self.claim(now):
            return "claimed"
        if self.open_question(now):
            return "asked"
        return self.ended_badly.result if self.ended_badly else "waiting"


@dataclass(frozen=True)
class QueuedPlan:
    """A stored plan.

    Parameters
    ----------
    task
        IRI of its task.
    graph
        IRI of the graph that it stands in, which says whose it is.
    goal
        In the words of whoever stated it.
    made
        When it was stored; None for one without a time.
    priority, deadline
        Greater ones come first; nothing of it is begun later.
    cancelled
        Why somebody cancelled it; None unless somebody did.
    is_replaced
        Whether another plan has taken its place.
    steps
        In order.
    prices
        Of asking and of failing; None where nobody is to be asked.
    open_goals
        What of the goal was out of reach when the plan was made, and why, in words.
    allows_part
        Whether the rest of the goal is to be done even so.
    allows_takeover
        Whether a robot may take over what another one has not begun.
    """

    task: str
    graph: str
    goal: str
    made: dt.datetime | None
    priority: int
    deadline: dt.datetime | None
    cancelled: str | None
    is_replaced: bool
    steps: tuple[QueuedStep, ...]
    prices: Prices | None = None
    open_goals: tuple[str, ...] = ()
    allows_part: bool = False
    settled: str = ""
    allows_takeover: bool = False

    def state(self, now: dt.datetime) -> str:
        """Return cancelled, replaced, done, blocked, declined, failed, late, running or waiting.

        Blocked: all steps are done, and a part of the goal was out of reach.
        """
        if self.cancelled is not None:
            return "cancelled"
        if self.is_replaced:
            return "replaced"
        # The gravest first: a plan with a failed step is not merely waiting.
        states = {step.state(now) for step in self.steps}
        if states <= {"done"} and not self.open_goals:
            return "done"
        for bad in ("declined", "failed"):
            if bad in states:
                return bad
        if "claimed" not in states and self.deadline is not None and now >= self.deadline:
            return "late"
        if states <= {"done"}:
            return "blocked"
        return "running" if states & {"claimed", "asked", "done"} else "waiting"

    @property
    def ordered_steps(self) -> tuple[QueuedStep, ...]:
        """The steps in an order in which one after the other can be done.

        That of their numbers, unless a step was taken over: then its robot's other work may come
        after it.
        """
        left = {step.task: step for step in self.steps}
        ordered: list[QueuedStep] = []
        while left:
            # The first one where nothing is free: what robots store may wait in a ring.
            ready = (step for step in left.values() if not left.keys() & set(step.after))
            step = next(ready, next(iter(left.values())))
            ordered.append(left.pop(step.task))
        return tuple(ordered)

    def to_dict(self, now: dt.datetime) -> dict[str, Any]:
        """Return JSON-able values."""
        return {
            "task": self.task, "goal": self.goal, "state": self.state(now),
            "priority": self.priority,
            "deadline": None if self.deadline is None else self.deadline.timestamp(),
            "cancelled": self.cancelled or "",
            "asking_price": None if self.prices is None else self.prices.asking,
            "failing_price": None if self.prices is None else self.prices.failing,
            "steps": [_step_dict(step, now) for step in self.steps],
            "open_goals": list(self.open_goals), "allows_part": self.allows_part,
            "settled": self.settled,
        }  # fmt: skip


def _step_dict(step: QueuedStep, now: dt.datetime) -> dict[str, Any]:
    last = step.claim(now) or (step.claims[-1] if step.claims else None)
    asked = step.open_question(now)
    return {
        "task": step.task, "step": step.number, "text": step.text, "state": step.state(now),
        "robots": list(step.robots), "claimed_by": last.robot if last else "",
        "why": last.why if last else "", "comment": last.comment if last else "",
        "question": asked.iri if asked else "", "assignment": step.assignment,
        "taken_from": list(step.taken_from),
    }  # fmt: skip


def read_queue(kb: GraphCore) -> list[QueuedPlan]:
    """Return the stored plans that may be carried out, in the order in which they were stored.

    A robot plans for itself alone: a plan in the graph of a robot with steps for others is data of
    that robot, and no order to them.
    """
    steps = _steps(kb, _claims(kb), read_questions(kb))
    left_open: dict[str, list[str]] = defaultdict(list)
    for row in kb.select(_OPEN):
        left_open[str(row.value("plan"))].append(str(row.value("open")))
    assigned = _assigned(kb)
    plans: dict[str, QueuedPlan] = {}
    for row in kb.select(_PLANS):
        task = str(row.value("plan"))
        # A plan in two graphs is one; without steps or open goals it orders nothing.
        if task in plans or (task not in steps and task not in left_open):
            continue
        plan = _plan(row, tuple(steps.get(task, ())), tuple(left_open.get(task, ())))
        if _may_order(kb, plan):
            plans[task] = _as_assigned(plan, assigned)
    # Plans from before plans had a time come first.
    epoch = dt.datetime.min.replace(tzinfo=dt.UTC)
    return sorted(plans.values(), key=lambda plan: (plan.made or epoch, plan.task))


def claimed_things(select: Select, things: Iterable[str], now: dt.datetime) -> dict[str, Claim]:
    """Return which robots have some things for themselves now.

    Parameters
    ----------
    things
        IRIs.
    """
    nodes = " ".join(str(NamedNode(thing)) for thing in sorted(set(things)))
    claims: dict[str, Claim] = {}
    for row in select(PREFIXES + _CLAIMED.format(things=nodes)) if nodes else ():
        begun, until = _time(row.value("begun")), _time(row.value("last"))
        if begun is not None and until is not None:
            claim = Claim(str(row.value("claim")), str(row.value("robot")), begun, until)
            if claim.is_live(now):
                claims[str(row.value("thing"))] = claim
    return claims


_Assigned = Mapping[tuple[str, str], Mapping[str, list[str]]]


def _assigned(kb: GraphCore) -> _Assigned:
    """Return what each graph says of the assignment of each step, by the name of the property."""
    assigned: dict[tuple[str, str], dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for row in kb.select(_ASSIGNED):
        of_step = assigned[str(row.value("graph")), str(row.value("step"))]
        of_step[local_name(str(row.value("property")))].append(str(row.value("value")))
    return assigned


def _as_assigned(plan: QueuedPlan, assigned: _Assigned) -> QueuedPlan:
    steps = []
    for step in plan.steps:
        stated = assigned.get((plan.graph, step.task), {})
        steps.append(
            replace(
                step, for_hand=tuple(sorted(stated.get("waitsForHand", ()))),
                taken_from=tuple(sorted(stated.get("takenFrom", ()))),
                assignment="; ".join(sorted(stated.get("assignmentReason", ()))),
            )
        )  # fmt: skip
    return replace(plan, steps=tuple(steps))


def _plan(row: Row, steps: tuple[QueuedStep, ...], open_goals: tuple[str, ...]) -> QueuedPlan:
    cancelled = str(row.value("reason") or "") if row.value("cancelled") else None
    priority = row.value("priority")
    return QueuedPlan(
        str(row.value("plan")), str(row.value("graph")), str(row.value("goal")),
        _time(row.value("made")), int(str(priority)) if priority is not None else 0,
        _time(row.value("deadline")), cancelled, row.value("replaced") is not None, steps,
        _prices(row.value("asking"), row.value("failing")), open_goals,
        _is_true(row.value("part")), str(row.value("settled") or ""),
        _is_true(row.value("takeover")),
    )  # fmt: skip


def _is_true(value: object) -> bool:
    return str(value).lower() in ("true", "1")


def _prices(asking: object, failing: object) -> Prices | None:
    try:
        return None if asking is None else Prices(float(str(asking)), float(str(failing)))
    except (UsageError, ValueError):
        return None


def _may_order(kb: GraphCore, plan: QueuedPlan) -> bool:
    owner = kb.graphs.owner(NamedNode(plan.graph))
    if owner is None:
        return True
    # A robot may plan for itself; what it states must not order others about.
    robot = kb.graphs.agent_iri(owner, "robot")
    if not kb.match(robot, RDF.type, CORA.Robot):
        return True
    return all(step.robots == (robot.value,) for step in plan.steps)


def _claims(kb: GraphCore) -> dict[str, list[Claim]]:
    claims: dict[str, list[Claim]] = defaultdict(list)
    for row in kb.select(_CLAIMS):
        begun, until = _time(row.value("begun")), _time(row.value("last"))
        if begun is not None and until is not None:
            claims[str(row.value("step"))].append(
                Claim(
                    str(row.value("claim")), str(row.value("robot")), begun, until,
                    str(row.value("result") or ""), str(row.value("comment") or ""),
                    str(row.value("why") or ""), _time(row.value("ended")),
                )
            )  # fmt: skip
    return claims


def _steps(
    kb: GraphCore, claims: Mapping[str, list[Claim]], questions: Mapping[str, list[Question]]
) -> dict[str, list[QueuedStep]]:
    rows: dict[str, list[Row]] = defaultdict(list)
    for row in kb.select(_STEPS):
        rows[str(row.value("step"))].append(row)
    steps: dict[str, list[QueuedStep]] = defaultdict(list)
    for task, of_task in rows.items():
        step = _step(task, of_task, tuple(claims.get(task, ())), tuple(questions.get(task, ())))
        if step is not None:
            steps[str(of_task[0].value("plan"))].append(step)
    return {plan: sorted(parts, key=lambda step: step.number) for plan, parts in steps.items()}


def _step(
    task: str, rows: Sequence[Row], claims: tuple[Claim, ...], questions: tuple[Question, ...]
) -> QueuedStep | None:
    first = rows[0]
    try:
        arguments = json.loads(str(first.value("values")))
    except ValueError:
        return None
    if not isinstance(arguments, dict):
        return None
    robots = tuple(sorted({str(row.value("robot")) for row in rows}))
    return QueuedStep(
        task, int(str(first.value("number"))), str(first.value("action")),
        {str(name): str(value) for name, value in arguments.items()},
        str(first.value("text") or ""), robots,
        str(first.value("thing") or ""),
        tuple(sorted({str(row.value("before")) for row in rows if row.value("before")})),
        float(str(first.value("duration") or 0.0)), float(str(first.value("chance") or 0.0)),
        # A claim by a robot that the plan does not name is no claim.
        tuple(claim for claim in claims if claim.robot in robots),
        tuple(asked for asked in questions if asked.robot in robots),
    )  # fmt: skip


def _time(value: object) -> dt.datetime | None:
    if value is None:
        return None
    time = value if isinstance(value, dt.datetime) else dt.datetime.fromisoformat(str(value))
    return time if time.tzinfo else time.replace(tzinfo=dt.UTC)
