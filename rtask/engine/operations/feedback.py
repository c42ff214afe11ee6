"""People judge what came of a grasp: confirm, correct or refuse what the robot reported.

Physics and people may both speak about an outcome, and all of it is kept: who said what when. What
most people say, each by the latest word, is what learners count; it outweighs what the robot
decided. Where as many say the one as the other the outcome is disputed, and counts nowhere until
somebody else speaks. The counts of the grasp and the belief in it change in the same commit.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from rtask.engine.memory.confidence import Confidence, believe, stored_confidences
from rtask.engine.memory.statistics import GraspStatistics, Pending, count, judged_counts, totalled
from rtask.engine.memory.verdicts import Judged, Verdict, find_attempt, label_of
from rtask.engine.names import tail
from rtask.engine.operations.operation import operation
from rtask.engine.records.attempts import state_verdict
from rtask.engine.triples import Triples
from rtask.errors import ForbiddenError, UnknownTermError, UsageError, nearest
from rtask.kb.commit.access import Access
from rtask.rdf.terms import GraphName
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Iri, Text

if TYPE_CHECKING:
    from rtask.engine.context import Context

__all__ = ["Feedback", "GiveFeedback", "GivenVerdict", "give_feedback"]


class GiveFeedback(Message):
    """What a person thinks of what a robot reported."""

    verdict: Literal["confirm", "refuse", "correct"]
    """what the person thinks of the report"""
    task_id: Text | None = None
    """of the attempt that is judged; default: found by grasp or object"""
    object: Iri | None = None
    """IRI of the object whose last attempt is meant; default: found by task_id or grasp"""
    grasp: Iri | None = None
    """IRI of the grasp whose last attempt is meant; default: found by task_id or object"""
    held: Flag | None = None
    """whether it held; to correct; default: as the verdict says"""
    reason: Text | None = None
    """code of why it ended so, in the person's opinion; default: none"""
    operator: Text | None = None
    """who says so; with a token, the token's person; default: the caller"""
    comment: Text | None = None
    """in the person's words; default: none"""


class GivenVerdict(Answer):
    """What one person said about an attempt."""

    by: str
    held: bool
    reason: str
    comment: str
    time: str


class Feedback(Answer):
    """Everything that was said about an attempt, and what counts."""

    stored: int
    commit: str
    attempt: str
    grasp: str
    decided: bool
    reason: str
    held: bool | None
    disputed: bool
    held_votes: int
    lost_votes: int
    verdicts: list[GivenVerdict]
    text: str
    statistics: GraspStatistics
    confidence: float | None


@dataclass(frozen=True)
class _Recounting(Access):
    """A person's rights, and that to correct the counts that the verdict changes."""

    counts: GraphName | None = None

    def may_write(self, graph: GraphName) -> bool:
        return super().may_write(graph) or graph == self.counts


@operation("teach", "confirm, correct or refuse what a robot reported")
def give_feedback(context: Context, request: GiveFeedback, access: Access) -> Feedback:
    """Store a person's verdict; answer with everything that is said and what follows from it."""
    operator = _operator(request.operator, access)
    with context.writing:
        before = find_attempt(
            context, task_id=request.task_id, grasp=request.grasp, thing=request.object
        )
        said = _verdict(context, request, before, operator)
        old = next((v for v in reversed(before.verdicts) if v.by == operator), None)
        if old is not None and _same(old, said):
            return _answer(context, before, stored=0, commit="")
        after = replace(before, verdicts=(*before.verdicts, said))
        commit = _write(context, before, after, context.author(access, operator, "teacher"))
    return _answer(context, after, stored=1, commit=commit)


def _operator(named: str | None, access: Access) -> str:
    """Return who speaks; nobody speaks for another person.

    Raises
    ------
    ForbiddenError
        The token is another person's.
    """
    if access.role == "teacher" and access.agent and named and named != access.agent:
        raise ForbiddenError(
            f"the token belongs to {access.agent!r}: it cannot say what {named!r} thinks"
        )
    return named or access.agent or "operator"


def _verdict(context: Context, request: GiveFeedback, judged: Judged, operator: str) -> Verdict:
    """Return the verdict that a request means for an attempt."""
    kind, held, code = request.verdict, request.held, request.reason or ""
    if kind == "correct" and held is None and not code:
        raise UsageError("held is missing: to correct, say what is right", field="held")
    if kind != "correct" and held is not None:
        raise UsageError(f"held: to {kind} says it already; correct takes it", field="held")
    if kind == "confirm":
        held = judged.decided
    elif kind == "refuse":
        held = not judged.decided
    elif held is None:
        held = code == "ok"
    if code and code not in context.reasons:
        hint = nearest(code, sorted(context.reasons))
        raise UnknownTermError(f"unknown reason {code!r}{hint}")
    if code and held != (code == "ok"):
        word = "held" if held else "did not hold"
        raise UsageError(f"reason: {code} does not fit a grasp that {word}", field="reason")
    now = dt.datetime.now(dt.UTC)
    return Verdict(operator, held, now, code, request.comment or "")


def _same(a: Verdict, b: Verdict) -> bool:
    return (a.held, a.reason, a.comment) == (b.held, b.reason, b.comment)


def _write(context: Context, before: Judged, after: Judged, author: Access) -> str:
    """Store the last verdict of an attempt with the counts and the belief that follow."""
    triples, counts = Triples(), Triples()
    state_verdict(context, triples, after.outcome, after.verdicts[-1], after.votes)
    home, kept = context.home_graph(author), context.kb.graphs.agent(tail(after.robot))
    was, now = label_of(before), label_of(after)
    withdrawn, recounted = [], []
    if was != now:
        recounted = count(
            context, counts, after.grasp, after.gripper_type, after.robot, kept,
            attempts=(now is not None) - (was is not None), successes=bool(now) - bool(was),
            pending=Pending(),
        )  # fmt: skip
        totals = judged_counts(context, after.grasp)
        # Without a reasoner the graph counts what robots decided.
        seen = was if context.kb.reasons else label_of(replace(before, verdicts=()))
        for label, more in ((seen, -1), (now, 1)):
            if label is not None:
                key = label, after.is_fast
                totals[key] = max(totals.get(key, 0) + more, 0)
        who = context.agent_iri(author)
        withdrawn = believe(context, triples, after.grasp, totals, who, home)
    rights = _Recounting(author.agent, author.role, counts=kept)
    with context.kb.transaction(access=rights, note="a person's verdict") as tx:
        for subject, predicate, value in recounted:
            tx.remove(subject, predicate, value, kept)
        for subject, predicate, value in withdrawn:
            tx.remove(subject, predicate, value, home)
        for subject, predicate, value in counts:
            tx.add(subject, predicate, value, kept)
        for subject, predicate, value in triples:
            tx.add(subject, predicate, value, home)
    return context.commit_id(tx.commit)


def _answer(context: Context, judged: Judged, stored: int, commit: str) -> Feedback:
    label, (held, lost) = label_of(judged), judged.votes
    known = stored_confidences(context, [judged.grasp.value]).get(judged.grasp.value, Confidence())
    return Feedback(
        stored=stored,
        commit=commit,
        attempt=judged.attempt.value,
        grasp=judged.grasp.value,
        decided=judged.decided,
        reason=judged.reason,
        held=label,
        disputed=held == lost and bool(judged.verdicts),
        held_votes=held,
        lost_votes=lost,
        verdicts=[
            GivenVerdict(
                by=v.by, held=v.held, reason=v.reason, comment=v.comment, time=v.time.isoformat()
            )
            for v in judged.verdicts
        ],
        text=_sentence(judged),
        statistics=totalled(judged_counts(context, judged.grasp)),
        confidence=known.belief.mean if known.belief else None,
    )


def _sentence(judged: Judged) -> str:
    """Return what is said about an attempt and what counts, in words."""
    held, lost = judged.votes
    report = f"the robot says that it {'held' if judged.decided else 'did not hold'}"
    if not judged.verdicts:
        return f"{report}, and nobody else has spoken"
    people = f"{held} say that it held, {lost} that it did not"
    if held == lost:
        return f"{report}; {people}: disputed, so it counts nowhere until somebody else speaks"
    label = label_of(judged)
    counts = {None: "nothing", True: "a success", False: "a failure"}[label]
    return f"{report}; {people}: it counts as {counts}"
