"""Claims as commits: a robot takes a step, renews or ends its claim; a person cancels a plan."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from rtask.errors import ConflictError, UnknownTermError, UsageError
from rtask.rdf.namespaces import CORA, PROV, RDF, RT, mint
from rtask.rdf.terms import NamedNode, Value, iri
from rtask.tasks.actions import ActionClass, read_actions
from rtask.tasks.names import names_of
from rtask.tasks.patterns import Pattern
from rtask.tasks.queue.choosing import Choice, choose
from rtask.tasks.queue.reading import MAX_LEASE_S, Claim, QueuedPlan, QueuedStep, read_queue
from rtask.tasks.steps import Wording, statement_of

if TYPE_CHECKING:
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = ["LEASE_S", "MAX_LEASE_S", "RESULTS", "cancel_plan", "claim_step", "end_claim", "failing",
           "live_claim"]  # fmt: skip

Statement = tuple[NamedNode, NamedNode, Value]
Statements = Iterable[Statement]
Move = Callable[[str], tuple[Statements, Statements]]
LEASE_S = 300.0
"""How long a claim lasts unless it is renewed."""
RESULTS = ("done", "failed", "declined", "released")
"""How a claim may end."""


def claim_step(
    kb: GraphCore, robot: str, access: Access, *, lease_s: float = LEASE_S,
    now: dt.datetime | None = None,
) -> Choice:  # fmt: skip
    """Claim the next step of a robot, or renew the claim that it has.

    What is decided on and what is stored are one transaction: nobody else writes meanwhile.

    Parameters
    ----------
    robot
        IRI.
    access
        Rights of the author.
    now
        Current time; None = that of the clock.

    Raises
    ------
    UnknownTermError
        The graph has no such robot.
    UsageError
        The lease is not above 0, or is longer than :data:`MAX_LEASE_S`.
    """
    if not 0 < lease_s <= MAX_LEASE_S:
        raise UsageError(f"a claim lasts more than 0 and at most {MAX_LEASE_S:g} s, not {lease_s}")
    if not kb.match(iri(robot), RDF.type, CORA.Robot):
        raise UnknownTermError(f"the graph has no robot {robot}")
    time = now or dt.datetime.now(dt.UTC)
    # Before the transaction: actions hardly ever change, and other writers need not wait for them.
    actions = read_actions(kb.select, kb.catalogue.is_ontology)
    with kb.transaction(access=access, note="claim a task") as tx:
        plans = read_queue(kb)
        names = names_of(kb.select, {r for p in plans for s in p.steps for r in s.robots})
        choice = choose(plans, robot, time, lambda step: failing(kb, actions, step), names)
        if choice.step is None:
            return choice
        until = time + dt.timedelta(seconds=lease_s)
        if choice.claim is not None:
            # A renewal by a shorter lease takes nothing back of what was granted.
            if until > choice.claim.until:
                tx.add(choice.claim.iri, RT.claimedUntil, until)
            return choice
        claim = NamedNode(mint(kb.base, "TaskClaim"))
        tx.add(claim, RDF.type, RT.TaskClaim)
        tx.add(claim, RT.claims, NamedNode(choice.step.task))
        tx.add(claim, PROV.wasAssociatedWith, NamedNode(robot))
        tx.add(claim, PROV.startedAtTime, time)
        tx.add(claim, RT.claimedUntil, until)
        tx.add(claim, RT.claimReason, choice.reason)
        if choice.step.thing:
            tx.add(claim, RT.claimsExemplar, NamedNode(choice.step.thing))
    mine = Claim(claim.value, robot, time, until, why=choice.reason)
    return Choice(choice.plan, choice.step, mine, choice.reason, choice.waits)


def failing(kb: GraphCore, actions: Sequence[ActionClass], step: QueuedStep) -> str:
    """Return the first precondition of a step that does not hold now, in words; else "".

    A precondition that an action of the plan was to make true is asked of the graph like all
    others: the graph is what robots saw and reported.
    """
    action = next((item for item in actions if item.iri == step.action), None)
    if action is None:
        return f"there is an action {step.action}"
    for pattern in action.preconditions:
        values = [step.arguments.get(name, "") for name in pattern.arguments]
        if not all(values):
            return f"the step has all of {', '.join(pattern.arguments)}"
        text = pattern.sparql
        bound = {f"p{n}": iri(value) for n, value in enumerate(values, 1)}
        # Joined to the pattern, not written into its text: an IRI is data, whatever it consists of.
        rows = " ".join(str(value) for value in bound.values())
        variables = " ".join(f"?{name}" for name in bound)
        asked = f"ASK {{ VALUES ({variables}) {{ ({rows}) }} {text} }}"
        if not kb.query(asked):
            atom = (pattern.predicate, *values)
            iris = {*values, *(statement_of(atom) or ())}
            names = names_of(kb.select, iris)
            return Wording(names, names).atom(atom)
    return ""


def end_claim(
    kb: GraphCore, robot: str, task: str, result: str, access: Access, *, comment: str = "",
    attempt: str = "", now: dt.datetime | None = None, move: Move | None = None,
) -> Commit | None:  # fmt: skip
    """End the claim of a robot on a step; None if it has ended in that way before.

    What a step that is done makes true is stated with it, but for places, which are derived from
    placements.

    Parameters
    ----------
    result
        One of :data:`RESULTS`.
    attempt
        IRI of the attempt that carried the step out; the two are linked.
    move
        Returns, for the IRI of the thing, what to state and to withdraw in the same commit about
        where it is now.

    Raises
    ------
    UsageError
        No such result.
    ConflictError
        The robot has no claim on the step: it has run out and another robot has it, it never had
        one, or it has ended in another way.
    """
    if result not in RESULTS:
        raise UsageError(f"a claim ends as one of {', '.join(RESULTS)}, not {result!r}")
    time = now or dt.datetime.now(dt.UTC)
    actions = read_actions(kb.select, kb.catalogue.is_ontology) if result == "done" else ()
    with kb.transaction(access=access, note=f"end a claim: {result}") as tx:
        plans = read_queue(kb)
        last = _last_claim(_step(plans, task)[1], robot)
        # Said again because the answer was lost: it is to count once.
        if last is not None and last.result == result:
            return None
        _, step, claim = live_claim(plans, robot, task, time)
        # A clock that was set back meanwhile must not end the claim before it began.
        tx.add(claim.iri, PROV.endedAtTime, max(time, claim.begun))
        tx.add(claim.iri, RT.claimResult, result)
        if comment:
            tx.add(claim.iri, RT.claimComment, comment)
        if attempt:
            tx.add(step.task, RT.carriedOutBy, iri(attempt))
        for action in actions:
            if action.iri == step.action:
                for statement in _effects(action.removals, step):
                    tx.remove(*statement)
                for statement in _effects(action.additions, step):
                    tx.add(*statement)
        if move is not None and step.thing:
            added, withdrawn = move(step.thing)
            for statement in withdrawn:
                tx.remove(*statement)
            for statement in added:
                tx.add(*statement)
    return tx.commit


def _effects(patterns: Sequence[Pattern], step: QueuedStep) -> Iterator[Statement]:
    """Yield the effects of a step that are single statements and not derived from placements."""
    for pattern in patterns:
        values = tuple(step.arguments.get(name, "") for name in pattern.arguments)
        triple = pattern.triple(values) if all(values) else None
        # Where things are is a placement with a time, which the caller moves; a bare triple would
        # outlive it.
        if triple is not None and triple[1] != RT.locatedOn.value:
            subject, prop, value = map(NamedNode, triple)
            yield subject, prop, value


def live_claim(
    plans: Sequence[QueuedPlan], robot: str, task: str, now: dt.datetime
) -> tuple[QueuedPlan, QueuedStep, Claim]:
    """Return the claim that a robot has on a step, with the step and its plan.

    Raises
    ------
    UnknownTermError
        There is no such step.
    ConflictError
        The robot has no claim on it: it never had one, it has ended, or another robot has it since
        it ran out.
    """
    plan, step = _step(plans, task)
    claim, other = _last_claim(step, robot), step.claim(now)
    if other is not None and other.robot == robot:
        claim = other  # not the last to begin where the clock was set back since
    if claim is None:
        raise ConflictError(f"{robot} has not claimed {task}")
    if claim.result:
        raise ConflictError(f"the claim of {task} ended before: {claim.result}")
    if other is not None and other.robot != robot:
        # A robot that was slow must not report what another one is doing by now.
        raise ConflictError(f"the claim of {task} ran out, and {other.robot} has it now")
    return plan, step, claim


def _last_claim(step: QueuedStep, robot: str) -> Claim | None:
    return next((claim for claim in reversed(step.claims) if claim.robot == robot), None)


def _step(plans: Sequence[QueuedPlan], task: str) -> tuple[QueuedPlan, QueuedStep]:
    for plan in plans:
        for step in plan.steps:
            if step.task == task:
                return plan, step
    raise UnknownTermError(f"no stored plan has the step {task}")


def cancel_plan(
    kb: GraphCore, task: str, reason: str, access: Access, *, now: dt.datetime | None = None
) -> Commit | None:
    """Cancel a plan: no further step of it is begun; None if it was cancelled before.

    A step that a robot has begun is ended by that robot.

    Raises
    ------
    UnknownTermError
        There is no such plan.
    ConflictError
        It is done.
    """
    time = now or dt.datetime.now(dt.UTC)
    with kb.transaction(access=access, note="cancel a plan") as tx:
        plan = next((item for item in read_queue(kb) if item.task == task), None)
        if plan is None:
            raise UnknownTermError(f"there is no stored plan {task}")
        if plan.cancelled is not None:
            return None
        if plan.state(time) == "done":
            raise ConflictError(f"{task} is done")
        tx.add(task, PROV.invalidatedAtTime, time)
        tx.add(task, RT.cancelReason, reason)
    return tx.commit
