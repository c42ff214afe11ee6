"""Verdicts of people on reported outcomes: confirm, correct or refuse.

Every verdict is kept with its author and time. The majority of the latest verdicts, one per person,
outweighs the robot's report and is what learners count. With as many verdicts for as against, the
outcome is disputed and not counted until another person decides. The counts of the grasp and the
belief in it change in the same commit.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from rtask.engine.curation.edit import VERDICT
from rtask.engine.memory.calibration import Scored, calibrate, score_of
from rtask.engine.memory.causes import Causes, StatingCauses, state_causes
from rtask.engine.memory.confidence import Confidence, believe, stored_confidences
from rtask.engine.memory.statistics import GraspStatistics, Pending, count, judged_counts, totalled
from rtask.engine.memory.verdicts import Judged, Verdict, find_attempt, label_of
from rtask.engine.names import tail
from rtask.engine.operations.operation import operation
from rtask.engine.records.attempts import state_verdict
from rtask.engine.records.identity import check_agent
from rtask.engine.triples import Triples
from rtask.errors import UnknownTermError, UsageError, nearest
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import GraphName, NamedNode, Value
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Iri, Text

if TYPE_CHECKING:
    from pyoxigraph import Quad

    from rtask.engine.context import Context
    from rtask.kb.store.graphs import Graphs

__all__ = ["Feedback", "GiveFeedback", "GivenVerdict", "give_feedback"]


class GiveFeedback(Message):
    """A person's verdict on a reported outcome."""

    verdict: Literal["confirm", "refuse", "correct"]
    """the person's verdict on the report"""
    task_id: Text | None = None
    """of the attempt to judge; default: found by grasp or object"""
    object: Iri | None = None
    """IRI of the object whose last attempt is meant; default: found by task_id or grasp"""
    grasp: Iri | None = None
    """IRI of the grasp whose last attempt is meant; default: found by task_id or object"""
    held: Flag | None = None
    """whether it held, to correct the report; default: as the verdict says"""
    reason: Text | None = None
    """code of the reason in the person's opinion; default: none"""
    operator: Text | None = None
    """name of the person, or of the token's owner; default: the caller"""
    comment: Text | None = None
    """remark of the person; default: none"""


class GivenVerdict(Answer):
    """One person's verdict on an attempt."""

    by: str
    held: bool
    reason: str
    comment: str
    time: str


class Feedback(Answer):
    """All verdicts on an attempt, and the resulting label."""

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
class _Recounting(StatingCauses):
    """A person's rights, extended to the counts that the verdict changes."""

    counts: GraphName | None = None

    def may_write(self, graph: GraphName) -> bool:
        return super().may_write(graph) or graph == self.counts

    def require_own_identity(self, quad: Quad, graphs: Graphs) -> None:
        """Allow the counts of the robot, which the engine words."""
        if quad.graph_name != self.counts:
            super().require_own_identity(quad, graphs)


@operation("teach", "writes", "confirm, correct or refuse what a robot reported")
def give_feedback(context: Context, request: GiveFeedback, access: Access) -> Feedback:
    """Store a person's verdict; answer with all verdicts and the resulting label."""
    operator = _operator(request.operator, access)
    with context.writing:
        before = find_attempt(
            context, task_id=request.task_id, grasp=request.grasp, object_iri=request.object
        )
        verdict = _verdict(context, request, before, operator)
        old = next((v for v in reversed(before.verdicts) if v.by == operator), None)
        if old is not None and _same(old, verdict):
            return _answer(context, before, stored=0, commit="")
        after = replace(before, verdicts=(*before.verdicts, verdict))
        commit = _write(context, before, after, context.author(access, operator, "teacher"))
    return _answer(context, after, stored=1, commit=commit)


def _operator(named: str | None, access: Access) -> str:
    """Return the author of a verdict, who is the owner of the token if there is one.

    Raises
    ------
    ForbiddenError
        The token belongs to another person.
    """
    check_agent(named, access, "operator")
    return named or access.agent or "operator"


def _verdict(context: Context, request: GiveFeedback, judged: Judged, operator: str) -> Verdict:
    """Return the verdict of a request on an attempt."""
    kind, held, code = request.verdict, request.held, request.reason or ""
    if kind == "correct" and held is None and not code:
        raise UsageError("held is missing: a correction needs the right outcome", field="held")
    if kind != "correct" and held is not None:
        raise UsageError(f"held: only a correction takes it, not {kind}", field="held")
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
    """Store the last verdict on an attempt with the resulting counts and belief."""
    triples, counts = Triples(), Triples()
    state_verdict(context, triples, after.outcome, after.verdicts[-1], after.votes)
    home, graph = context.home_graph(author), context.kb.graphs.agent(tail(after.robot))
    was, now, causes = label_of(before), label_of(after), Causes(context)
    withdrawn, recounted = [], []
    if was != now:
        recounted = count(
            context, counts, after.grasp, after.gripper_type, after.robot, graph,
            attempts=(now is not None) - (was is not None), successes=bool(now) - bool(was),
            pending=Pending(),
        )  # fmt: skip
        totals = judged_counts(context, after.grasp)
        # Without a reasoner the counts follow the reports of robots.
        seen = was if context.kb.reasons else label_of(replace(before, verdicts=()))
        for label, more in ((seen, -1), (now, 1)):
            if label is not None:
                key = label, after.is_fast
                totals[key] = max(totals.get(key, 0) + more, 0)
        who = context.agent_iri(author)
        recounted += _recalibrated(context, counts, after, now, graph)
        withdrawn = believe(context, triples, after.grasp, totals, who, home)
        causes.judge(after.grasp, after.attempt, now)
    rights = _Recounting(author.agent, author.role, of_owner=author.of_owner, counts=graph)
    with context.kb.transaction(access=rights, note=VERDICT) as tx:
        state_causes(causes, tx)
        for subject, predicate, value in recounted:
            tx.remove(subject, predicate, value, graph)
        for subject, predicate, value in withdrawn:
            tx.remove(subject, predicate, value, home)
        for subject, predicate, value in counts:
            tx.add(subject, predicate, value, graph)
        for subject, predicate, value in triples:
            tx.add(subject, predicate, value, home)
    return context.commit_id(tx.commit)


def _recalibrated(
    context: Context, triples: Triples, judged: Judged, held: bool | None, graph: NamedNode
) -> list[tuple[NamedNode, NamedNode, Value]]:
    """Restate the map of the hand whose attempt was judged otherwise; return what goes."""
    scored = score_of(context, judged.attempt)
    hands = {quad.object for quad in context.kb.match(judged.attempt, RT.activates)}
    gripper = next((g for g in context.grippers.all() if g.iri in hands), None)
    if scored is None or gripper is None:
        return []
    kind, score = scored
    attempt = judged.attempt.value
    more = [] if held is None else [Scored(attempt, kind, score, held)]
    return calibrate(context, triples, gripper, kind, more, graph, without=(attempt,))


def _answer(context: Context, judged: Judged, stored: int, commit: str) -> Feedback:
    label, (held, lost) = label_of(judged), judged.votes
    confidence = stored_confidences(context, [judged.grasp.value]).get(
        judged.grasp.value, Confidence()
    )
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
        confidence=confidence.belief.mean if confidence.belief else None,
    )


def _sentence(judged: Judged) -> str:
    """Return all verdicts on an attempt and the resulting label, in words."""
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
