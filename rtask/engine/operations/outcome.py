"""Reports of grasp outcomes: one commit in the robot's own graph, once for each task."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from annotated_types import Ge

from rtask.engine.memory.causes import StatingCauses, state_causes
from rtask.engine.memory.statistics import GraspStatistics, Pending, over_all_robots, totalled
from rtask.engine.operations.operation import operation
from rtask.engine.records.clock import clocked
from rtask.engine.records.identity import check_operator, check_task, confirmed
from rtask.engine.records.objects import no_object
from rtask.engine.records.outcomes import Outcome, OutcomeReport
from rtask.engine.records.received import received
from rtask.engine.records.record import Entry, earlier, record
from rtask.engine.triples import Triples
from rtask.errors import UsageError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode, iri
from rtask.wire.message import Answer, Message, read
from rtask.wire.request_id import StoredOnce
from rtask.wire.types import Flag, Grasp, GraspPose, Iri, Number, Stamp, Text, Unit

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["ReportOutcome", "ReportedOutcome", "report_outcome"]

_FLAT = ("success", "reason", "lifted_m", "slip", "duration_s", "confirmed_by", "operator")


class ReportOutcome(Message):
    """Outcome of a grasp on a known object."""

    task_id: Annotated[Text | None, StoredOnce()] = None
    """of the decision; stored once for each id; default: a new task"""
    object: Iri | None = None
    """IRI of the object; default: that of the decision"""
    thing: Iri | None = None
    """IRI of the single thing; default: that of the decision, else the last one it handled"""
    grasp: Grasp | None = None
    """its id, or the whole grasp as received; default: given by grasp_pose"""
    grasp_pose: GraspPose | None = None
    """geometry_msgs/PoseStamped of a grasp that was never offered; default: given by grasp"""
    gripper_id: Text | None = None
    """name or IRI of the end effector; default: the robot's only one"""
    task: Text = "pick"
    """purpose of the grasp: pick, place, push"""
    outcome: OutcomeReport | None = None
    """the outcome; default: given by success and the fields after it"""
    success: Flag | None = None
    """whether it held, without an outcome; default: given by outcome"""
    reason: Text | None = None
    """code of the reason, without an outcome; default: ok if it held, else not judged"""
    lifted_m: Annotated[Number, Unit("m")] | None = None
    """height reached, without an outcome; default: not known"""
    slip: Annotated[Number, Unit("m")] | None = None
    """slip in the hand, without an outcome; default: not known"""
    duration_s: Annotated[Number, Unit("s"), Ge(0)] | None = None
    """of the attempt, without an outcome; default: not known"""
    confirmed_by: Literal["physics", "human"] | None = None
    """who confirmed it; default: nobody"""
    operator: Text | None = None
    """name of the person who confirmed it; default: nobody"""
    stamp: Stamp | None = None
    """when the attempt ended, unless its outcome tells; default: now"""


class ReportedOutcome(Answer):
    """The attempt as it was stored, and the statistics of its grasp over all robots."""

    stored: int
    """0 if the outcome of the task is already stored"""
    commit: str
    statistics: GraspStatistics
    grasp: str
    thing: str = ""
    """IRI of the single thing; empty if nobody knows which one it was"""
    message: str = ""
    """what was wrong with the robot's clock; absent if nothing was"""


@operation("write", "writes", "store the outcome of a grasp on a known object", deferrable=True)
def report_outcome(context: Context, request: ReportOutcome, access: Access) -> ReportedOutcome:
    """Store an attempt and its outcome; answer with the grasp's statistics over all robots."""
    gripper = context.grippers.find(request.gripper_id, access, is_acting=True)
    ahead_s = context.policy.clock_ahead_s
    check_operator(request.operator, access)
    report = confirmed(_report(request), access, "" if request.outcome is None else "outcome.")
    outcome = Outcome.of(report, context.reasons, "outcome").by_our_clock(ahead_s)
    ended, wrong = clocked(request.stamp, ahead_s)
    if wrong and not outcome.clock and outcome.report.ended is None:
        outcome = replace(outcome, comments=(*outcome.comments, wrong), clock=wrong)
    task_id = request.task_id
    check_task(context, task_id, access)
    decision = context.decisions.get(task_id)
    grasp = received(_grasp(request), "grasp").completed(decision)
    object_iri = _object(context, request.object or (decision.object if decision else ""))
    with context.writing:
        author = context.author(access, gripper.robot_name)
        before = None
        if task_id:
            before = earlier(context, task_id, [context.agent_iri(author), gripper.robot])
        if before is not None and before.has_attempt:
            before.refuse_contradiction(task_id or "", outcome.held)
            statistics = over_all_robots(context, iri(before.grasp))
            return ReportedOutcome(stored=0, commit="", statistics=statistics, grasp=before.grasp)
        triples, pending = Triples(), Pending()
        recorded = record(
            context,
            triples,
            Entry(
                object_iri=object_iri,
                gripper=gripper,
                received=grasp,
                outcome=outcome,
                task=request.task,
                task_id=task_id or context.names.task(author.agent).value,
                now=ended,
                graph=context.home_graph(author),
                decision=decision,
                exemplar=request.thing or "",
            ),
            pending,
        )
        rights = StatingCauses.of(author)
        with context.kb.transaction(access=rights, note="report outcome") as tx:
            for subject, predicate, value in recorded.withdrawn:
                tx.remove(subject, predicate, value)
            triples.write(tx)
            state_causes(pending.causes, tx)
    node, counts = recorded.grasp, recorded.counts
    return ReportedOutcome(
        stored=1,
        commit=context.commit_id(tx.commit),
        statistics=over_all_robots(context, node) if counts is None else totalled(counts),
        grasp=node.value,
        thing=recorded.exemplar,
        **({"message": outcome.clock} if outcome.clock else {}),
    )


def _report(request: ReportOutcome) -> OutcomeReport:
    """Return the outcome, or one made of the single fields of the request."""
    if request.outcome is not None:
        return request.outcome
    return read(OutcomeReport, {name: getattr(request, name) for name in _FLAT})


def _grasp(request: ReportOutcome) -> Any:
    if request.grasp is not None:
        return request.grasp
    if request.grasp_pose is None:
        raise UsageError("grasp is missing: its id, or the grasp as received", field="grasp")
    return {"grasp_pose": request.grasp_pose}


def _object(context: Context, name: str) -> NamedNode:
    if not name:
        raise UsageError(
            "object is missing; a new object is stored with "
            "insert_object", field="object",
        )  # fmt: skip
    object_iri = iri(name)
    if not context.kb.match(object_iri, RT.objectId):
        raise no_object(context, name)
    return object_iri
