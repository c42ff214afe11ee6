"""Claims as commits: a robot takes a step, renews or ends its claim; a person cancels a plan."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rtask.errors import ConflictError, UnknownTermError, UsageError
from rtask.rdf.namespaces import CORA, PROV, RDF, RT, mint
from rtask.rdf.terms import NamedNode, Value, iri
from rtask.tasks.actions import ActionClass, read_actions
from rtask.tasks.names import names_of
from rtask.tasks.patterns import Pattern
from rtask.tasks.queue.choosing import Choice, choose, reason_of
from rtask.tasks.queue.preconditions import failing
from rtask.tasks.queue.reading import MAX_LEASE_S, Claim, QueuedPlan, QueuedStep, read_queue
from rtask.tasks.queue.takeover import Takeover, find_takeover, still_holds

if TYPE_CHECKING:
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit
    from rtask.kb.commit.transaction import Transaction
    from rtask.kb.core import GraphCore

__all__ = ["LEASE_S", "MAX_LEASE_S", "RESULTS", "cancel_plan", "claim_step", "end_claim",
           "live_claim"]  # fmt: skip

Statement = tuple[NamedNode, NamedNode, Value]
Statements = Iterable[Statement]
Move = Callable[[str], tuple[Statements, Statements]]
LEASE_S = 300.0
"""How long a claim lasts unless it is renewed."""
_TRIES = 4
RESULTS = ("done", "failed", "declined", "released")
"""How a claim may end."""


def claim_step(
    kb: GraphCore, robot: str, access: Access, *, lease_s: float = LEASE_S,
    now: dt.datetime | None = None,
) -> Choice:  # fmt: skip
    """Claim the next step of a robot, or renew the claim that it has.

    What is decided on and what is stored are one transaction: nobody else writes meanwhile. A
    robot for which there is nothing takes over what another one has not begun, if the thing is
    expected to arrive sooner by that; the step is assigned to it in the same commit.

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
    claiming = _Claiming(kb, robot, access, lease_s, time, actions)
    choice = claiming.claim()
    if choice.step is not None:
        return choice
    # Between two transactions, as to weigh what others have may take long, and is mostly in vain.
    # What another robot has got meanwhile is not this one's: then it looks for something else.
    for _ in range(_TRIES):
        offer = find_takeover(kb, choice.plans, robot, time, actions)
        if offer is None:
            break
        choice = claiming.claim(offer)
        if choice.step is not None:
            break
    return choice


@dataclass(frozen=True)
class _Claiming:
    """A robot asks for a step."""

    kb: GraphCore
    robot: str
    access: Access
    lease_s: float
    now: dt.datetime
    actions: Sequence[ActionClass]

    def claim(self, offer: Takeover | None = None) -> Choice:
        """Claim the next step, or what is offered if there is still none and nobody has it."""
        kb, now = self.kb, self.now
        with kb.transaction(access=self.access, note="claim a task") as tx:
            plans = read_queue(kb)
            names = names_of(kb.select, {r for p in plans for s in p.steps
                                         for r in (*s.robots, *s.taken_from)})  # fmt: skip
            choice = choose(plans, self.robot, now, lambda s: failing(kb, self.actions, s), names)
            if choice.step is None and offer is not None:
                if not still_holds(kb, plans, offer, self.robot, now, self.actions):
                    return choice
                tx.replace_permitted(*offer.changes(kb))
                plan, step = offer.pair.plan, offer.pick
                reason = reason_of(plan, step, choice.waits, names)
                choice = replace(choice, plan=plan, step=step, reason=reason)
            if choice.step is None:
                return choice
            until = now + dt.timedelta(seconds=self.lease_s)
            if choice.claim is not None:
                # A renewal by a shorter lease takes nothing back of what was granted.
                if until > choice.claim.until:
                    tx.add(choice.claim.iri, RT.claimedUntil, until)
                return choice
            claim = self._state(tx, choice.step, until, choice.reason)
        return replace(choice, claim=claim)

    def _state(self, tx: Transaction, step: QueuedStep, until: dt.datetime, reason: str) -> Claim:
        claim = NamedNode(mint(self.kb.base, "TaskClaim"))
        tx.add(claim, RDF.type, RT.TaskClaim)
        tx.add(claim, RT.claims, NamedNode(step.task))
        tx.add(claim, PROV.wasAssociatedWith, NamedNode(self.robot))
        tx.add(claim, PROV.startedAtTime, self.now)
        tx.add(claim, RT.claimedUntil, until)
        tx.add(claim, RT.claimReason, reason)
        if step.thing:
            tx.add(claim, RT.claimsExemplar, NamedNode(step.thing))
        return Claim(claim.value, self.robot, self.now, until, why=reason)


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
        if robot in step.taken_from and robot not in step.robots:
            raise ConflictError(f"{task} is {' and '.join(step.robots)}'s now: {step.assignment}")
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
