"""The queue of stored plans: robots claim steps and say how they ended; a person cancels."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import Ge, Le, MaxLen, MinLen
from pydantic import Field

from rtask.engine.operations.operation import operation
from rtask.engine.operations.tasks.robot_named import robot_named
from rtask.engine.operations.world.state import check_hand, moved
from rtask.engine.records.identity import check_agent
from rtask.errors import ForbiddenError, UnknownTermError, UsageError
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import NamedNode, iri
from rtask.tasks.behaviour_tree import behaviour_tree
from rtask.tasks.queue import claiming
from rtask.tasks.queue.reading import QueuedStep, read_queue
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Iri, Json, Number, Text, Unit

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["cancel_plan", "claim_step", "end_step", "list_plans"]

_MAX_CHARS = 1000


class ClaimStep(Message):
    """A robot asks what to do next."""

    robot: Text | None = None
    """name or IRI of the robot; default: the caller"""
    lease: Annotated[Number, Unit("s"), Ge(1), Le(claiming.MAX_LEASE_S)] = claiming.LEASE_S
    """how long the step is the robot's unless it asks again"""


class WaitingStep(Answer):
    """A step of the robot that cannot be begun now."""

    plan: str
    task: str
    text: str
    why: str
    """what it waits for"""
    stuck: bool
    """whether waiting does not help, and the goal has to be planned again"""


class TakenStep(Answer):
    """A step that another robot took over."""

    plan: str
    task: str
    text: str
    why: str
    """who has it, and why"""


class StepAnswer(Answer):
    """What came of the last question about a step."""

    question: str
    """IRI"""
    kind: str
    code: str
    """of the choice that was made"""
    place: str
    """IRI of the place that it names; empty for none"""
    by: str
    """who made it; empty where nobody answered in time"""
    remark: str


class ClaimedStep(Answer):
    """The step that is the robot's now, or why there is none."""

    claimed: bool
    plan: str = ""
    """IRI of the plan"""
    goal: str = ""
    task: str = ""
    """IRI of the step"""
    action: str = ""
    """IRI of its class"""
    arguments: Json = Field(default_factory=dict)
    """IRIs by parameter"""
    text: str = ""
    until: float = 0.0
    """when the claim runs out, Unix time, s"""
    resumed: bool = False
    """whether the robot had it before"""
    reason: str = ""
    """why this robot, and why now"""
    chance: float = 0.0
    """of success, as planned"""
    answer: StepAnswer | None = None
    """what came of the last question about it; null if nobody was asked"""
    asks: bool = False
    """whether the plan has prices, so that people may be asked"""
    asked: list[str] = Field(default_factory=list)
    """kinds of questions that were asked about it before"""
    waiting: list[WaitingStep]
    taken: list[TakenStep]
    """its steps that others took over and have not done"""


class EndStep(Message):
    """How a claimed step ended."""

    task: Iri
    """IRI of the step"""
    result: Literal["done", "failed", "declined", "released"]
    """declined: by a person; released: untouched, so that it may be claimed again"""
    robot: Text | None = None
    """name or IRI of the robot; default: the caller"""
    outcome: Text | None = None
    """task_id of the report_outcome about it, whose attempt is linked to it; default: none"""
    place: Text | None = None
    """IRI of the place or end effector where the thing is now; default: as the graph has it"""
    lost: Flag = False
    """whether nobody knows where the thing is now"""
    comment: Annotated[Text, MaxLen(_MAX_CHARS)] | None = None
    """what happened; default: nothing to say"""


class EndedStep(Answer):
    """The commit; empty if it ended in that way before."""

    commit: str


class CancelPlan(Message):
    """A stored plan is not to be carried out any further."""

    plan: Iri
    """IRI of the plan"""
    reason: Annotated[Text, MinLen(1), MaxLen(_MAX_CHARS)]
    """why"""
    operator: Text | None = None
    """name of the person; default: the caller"""


class CancelledPlan(Answer):
    """The commit, which can be undone; empty if it was cancelled before."""

    commit: str


class ListPlans(Message):
    """Which stored plans to list."""

    state: Literal["open", "all"] = "open"
    """open: those that are not done, cancelled or replaced"""
    behaviour_tree: Flag = False
    """also answer XML of BehaviorTree.CPP 4"""


class ListedStep(Answer):
    """A step of a stored plan."""

    task: str
    step: int
    text: str
    state: str
    """waiting, asked, claimed, done, failed or declined"""
    robots: list[str]
    claimed_by: str
    """IRI of the robot that has or had it; empty if none"""
    why: str
    """why it got it"""
    comment: str
    """what happened"""
    question: str
    """IRI of the question to a person that it waits for; empty for none"""
    assignment: str
    """why it is its robot's; empty: as planned"""
    taken_from: list[str]
    """IRIs of robots that had it before"""


class ListedPlan(Answer):
    """A stored plan."""

    task: str
    goal: str
    state: str
    """waiting, running, late, failed, declined, blocked, done, cancelled or replaced; blocked: all
    steps are done, and the open goals wait until they are planned again"""
    priority: int
    deadline: float | None
    """Unix time, s"""
    cancelled: str
    """why; empty if it is not"""
    asking_price: float | None
    """of a question to a person, in the unit of failing_price; null where nobody is asked"""
    failing_price: float | None
    """of a step that fails"""
    steps: list[ListedStep]
    open_goals: list[str]
    """what of the goal was out of reach when it was planned, and why"""
    allows_part: bool
    """whether the rest is to be done even so"""
    settled: str
    """the goal as JSON with the things that its words meant, from which it is planned again; empty
    where the words still say the same"""
    behaviour_tree: str = ""
    """only if asked for"""


class ListedPlans(Answer):
    """Stored plans in the order in which they were stored."""

    plans: list[ListedPlan]


@operation("write", "writes", "claim the next step that a robot can begin", repeatable=True)
def claim_step(context: Context, request: ClaimStep, access: Access) -> ClaimedStep:
    """Claim a step by a commit; a robot that has one gets that again, and its claim is renewed.

    A robot with nothing to do gets what another one has not begun, where that is sooner done.
    """
    robot, author = robot_named(context, request.robot, access)
    with context.writing:
        choice = claiming.claim_step(context.kb, robot, author, lease_s=request.lease)
    waiting = [
        WaitingStep(
            plan=wait.plan, task=wait.task, text=wait.text, why=wait.why, stuck=wait.is_stuck
        )
        for wait in choice.waits
    ]
    taken = [
        TakenStep(plan=wait.plan, task=wait.task, text=wait.text, why=wait.why)
        for wait in choice.taken
    ]
    if choice.step is None or choice.plan is None or choice.claim is None:
        return ClaimedStep(claimed=False, waiting=waiting, taken=taken)
    until = dt.datetime.now(dt.UTC) + dt.timedelta(seconds=request.lease)
    step, is_new = choice.step, choice.claim not in choice.step.claims
    return ClaimedStep(
        claimed=True,
        plan=choice.plan.task,
        goal=choice.plan.goal,
        task=step.task,
        action=step.action,
        arguments=dict(step.arguments),
        text=step.text,
        until=max(choice.claim.until, until).timestamp(),
        resumed=not is_new,
        reason=choice.reason,
        chance=step.chance,
        answer=_answer(step),
        asks=choice.plan.prices is not None,
        asked=[question.kind for question in step.questions],
        waiting=waiting,
        taken=taken,
    )


@operation("write", "writes", "say how a claimed step ended", repeatable=True)
def end_step(context: Context, request: EndStep, access: Access) -> EndedStep:
    """End a claim; it may be said again."""
    robot, author = robot_named(context, request.robot, access)
    with context.writing:
        commit = claiming.end_claim(
            context.kb, robot, str(request.task), request.result, author,
            comment=request.comment or "", attempt=_attempt(context, request.outcome, robot),
            move=_move(context, request, author),
        )  # fmt: skip
    return EndedStep(commit="" if commit is None else context.commit_id(commit))


@operation("write", "writes", "cancel a stored plan", repeatable=True)
def cancel_plan(context: Context, request: CancelPlan, access: Access) -> CancelledPlan:
    """Cancel a plan; a robot may cancel its own alone.

    Raises
    ------
    ForbiddenError
        A robot cancels the plan of somebody else, or in the name of another.
    """
    check_agent(request.operator, access, "operator")
    author = context.author(access, request.operator, "teacher")
    task = str(request.plan)
    if author.role == "robot":
        graph = context.home_graph(author)
        if not context.kb.match(iri(task), RDF.type, RT.TaskPlan, graph):
            raise ForbiddenError(f"{author.agent} may cancel plans of its own alone")
    with context.writing:
        commit = claiming.cancel_plan(context.kb, task, request.reason, author)
    return CancelledPlan(commit="" if commit is None else context.commit_id(commit))


@operation("read", "reads", "list stored plans with their steps, and who does what and why")
def list_plans(context: Context, request: ListPlans, access: Access) -> ListedPlans:
    """Return the queue."""
    now = dt.datetime.now(dt.UTC)
    shown = []
    for plan in read_queue(context.kb):
        if request.state == "all" or plan.state(now) not in ("done", "cancelled", "replaced"):
            fields = plan.to_dict(now)
            fields["steps"] = [ListedStep(**step) for step in fields["steps"]]
            if request.behaviour_tree:
                fields["behaviour_tree"] = behaviour_tree(plan.goal, plan.ordered_steps)
            shown.append(ListedPlan(**fields))
    return ListedPlans(plans=shown)


def _answer(step: QueuedStep) -> StepAnswer | None:
    """Return what came of the last question; a claimed step waits for none."""
    if not step.questions:
        return None
    last = step.questions[-1]
    given = last.answer
    return StepAnswer(
        question=last.iri, kind=last.kind, code=last.outcome.code, place=last.outcome.place,
        by="" if given is None else given.by, remark="" if given is None else given.remark,
    )  # fmt: skip


def _attempt(context: Context, task_id: str | None, robot: str) -> str:
    """Return the attempt of a robot that was reported under an id; "" for none.

    Raises
    ------
    UnknownTermError
        It reported none.
    """
    if not task_id:
        return ""
    for quad in context.kb.match(None, RT.requestId, task_id):
        attempt = quad.subject
        if isinstance(attempt, NamedNode) and context.kb.match(
            attempt, RT.performedBy, NamedNode(robot)
        ):
            return attempt.value
    raise UnknownTermError(f"outcome: {robot} reported no outcome of {task_id}", field="outcome")


def _move(context: Context, request: EndStep, author: Access) -> claiming.Move | None:
    """Return what states where the thing of a step is now; None if that is not said.

    Raises
    ------
    UsageError
        It is said to be somewhere, and to be lost.
    UnknownTermError
        The graph has no such place.
    ForbiddenError
        It is said to be in the hand of a robot that has no part in the step.
    """
    if request.place is None:
        if not request.lost:
            return None
    elif request.lost:
        raise UsageError("give place, or lost", field="lost")
    elif not context.kb.match(iri(request.place)):
        raise UnknownTermError(f"place: the graph has no {request.place}", field="place")
    task = iri(str(request.task))
    # A thing may be given into the hand of who takes part, and of nobody else.
    partners = {str(quad.object)[1:-1] for quad in context.kb.match(task, RT.assignedTo)}
    check_hand(context, request.place, author, partners)
    return lambda thing: moved(context, thing, request.place, author)
