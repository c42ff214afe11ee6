"""Plans for goals: what robots would do, why it is possible, and storing it for them."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Le, MaxLen, MinLen

from rtask.engine.operations.operation import operation
from rtask.engine.records.identity import check_agent
from rtask.errors import BusyError, ConflictError, ForbiddenError, UnknownTermError, UsageError
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import iri
from rtask.tasks import Tasks, storing
from rtask.tasks.behaviour_tree import behaviour_tree
from rtask.tasks.questions.price import Prices
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Iri, Json, Number, Text, Unit, Whole

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.kb.core import GraphCore
    from rtask.tasks import PlannedStep, TaskPlan

__all__ = [
    "GoalPlan",
    "PlanGoal",
    "StorePlan",
    "StoredPlan",
    "answer_of",
    "plan_goal",
    "store_plan",
]

_MAX_CHARS = 20_000
_LATEST_S = 253_402_300_799
"""End of the year 9999, s since the epoch."""
_MAX_PRICE = 1e12
_PATIENCE_S = 10.0
"""How long a plan waits until the ones before it are made."""
Goal = Annotated[Text, MinLen(1), MaxLen(_MAX_CHARS)]


class PlanGoal(Message):
    """A goal that a plan is sought for."""

    goal: Goal
    """words such as "every cup into the left box", PATTERN WHERE { SPARQL }, or JSON"""
    assume_reach: Flag = False
    """plan as if robots reached places of which that is not known, and say so"""
    pddl: Flag = False
    """also answer domain and problem for other planners"""
    behaviour_tree: Flag = False
    """also answer XML of BehaviorTree.CPP 4"""
    branch: Text | None = None
    """name of the branch of the graph to plan in; default: the graph itself"""


class StorePlan(Message):
    """A goal whose plan is to be stored."""

    goal: Goal
    """the goal, as for plan_goal"""
    assume_reach: Flag = False
    """as for plan_goal"""
    digest: Text | None = None
    """digest of the plan that was agreed to: another one is not stored; default: any"""
    agent: Text | None = None
    """in whose name; default: the caller"""
    priority: Annotated[Whole, Ge(-100), Le(100)] = 0
    """plans with a greater one are begun first"""
    deadline: Annotated[Number, Unit("s"), Ge(0)] | None = None
    """Unix time after which no step is begun; default: what the goal says, or none"""
    replaces: Iri | None = None
    """IRI of an earlier plan for the goal, of which nothing more is begun; default: none"""
    asking_price: Annotated[Number, Ge(0), Le(_MAX_PRICE)] | None = None
    """what a question to a person costs, in any unit; default: nobody is asked"""
    failing_price: Annotated[Number, Ge(0), Le(_MAX_PRICE)] | None = None
    """what a failed step costs, in the unit of asking_price; default: nobody is asked"""
    allow_part: Flag = False
    """store the steps for what can be reached, and the rest as open goals; else all or nothing"""


class PlanReason(Answer):
    """Why a precondition of a step holds when its turn comes."""

    text: str
    """the precondition"""
    step: int | None
    """number of the step that makes it true; null if it holds before the plan"""
    assumed: bool
    """whether nobody has stated it"""
    statement: list[str] | None
    """subject, predicate, object: IRIs to be explained; null for what is no single statement"""


class PlanStep(Answer):
    """One task of a plan."""

    step: int
    """from 1"""
    action: str
    """IRI of its class"""
    arguments: Json
    """IRIs by parameter"""
    robots: list[str]
    """IRIs of those who do it"""
    text: str
    duration_s: float
    """as expected"""
    start_s: float
    """when it can begin if robots work at the same time"""
    chance: float
    """expected chance of success"""
    successes: int
    """of outcomes of this kind of hand with this product"""
    attempts: int
    after: list[int]
    """steps that must have ended before"""
    because: list[PlanReason]
    why: str
    """what the chance rests on, in words"""
    outcomes: str
    """SPARQL query for the outcomes that it rests on, with their robots"""


class PlanRefusal(Answer):
    """Why one goal is out of reach."""

    goal: str
    text: str
    missing: list[list[str]]
    """statements under which it could be reached: the cheapest; may be empty"""
    by_robot: Json
    """what each robot alone would need, by its IRI"""


class GoalPlan(Answer):
    """A plan, or the reasons why there is none."""

    goal: str
    understood: list[str]
    """the goals that were read in it"""
    sparql: list[str]
    """for each, the query for what it is about"""
    complete: bool
    """whether the plan reaches the goal; without steps: it holds already"""
    steps: list[PlanStep]
    refusals: list[PlanRefusal]
    assumptions: list[str]
    names: Json
    """names of the IRIs"""
    duration_s: float
    chance: float
    """that all steps succeed at once"""
    deadline: float | None = None
    """Unix time by which the goal says that it is to be reached; store_plan keeps to it"""
    settled: str = ""
    """the goal as JSON with the things that its words mean now, where they will mean others once a
    part of it is done; empty otherwise. What is planned again later is this"""
    digest: str
    """of the steps, for store_plan"""
    text: str
    """all of it in words"""
    domain: str = ""
    """PDDL"""
    problem: str = ""
    """PDDL"""
    behaviour_tree: str = ""
    """XML"""


class StoredPlan(GoalPlan):
    """A plan, and where it is stored."""

    task: str
    """IRI of the task whose sub-tasks are the steps"""
    commit: str
    """which can be undone"""
    late_s: float = 0.0
    """by how much it is expected to end after its deadline if it begins now; 0 if in time"""


@operation("read", "reads", "plan what robots do for a goal, or say why none can reach it")
def plan_goal(context: Context, request: PlanGoal, access: Access) -> GoalPlan:
    """Return a plan from what the caller may read; nothing is stored.

    Raises
    ------
    UnknownTermError
        There is no branch of this name.
    UnsupportedError
        The graph can have no branches.
    """
    kb = context.kb if request.branch is None else context.kb.open_branch(request.branch).graph
    plan = _plan(context, request.goal, access, request.assume_reach, kb)
    return answer_of(plan, pddl=request.pddl, tree=request.behaviour_tree)


@operation("write", "writes", "store the plan for a goal, so that robots can carry it out")
def store_plan(context: Context, request: StorePlan, access: Access) -> StoredPlan:
    """Plan again and store that, so that nothing is stored that the graph does not support.

    Raises
    ------
    ConflictError
        What robots can do or where things are has changed since the digest was answered.
    ForbiddenError
        A robot plans what another one is to do, or in the name of another.
    """
    check_agent(request.agent, access)
    author = context.author(access, request.agent, "teacher")
    plan = _plan(context, request.goal, access, request.assume_reach)
    if request.digest is not None and request.digest != plan.digest:
        raise ConflictError("the graph has changed since, and the plan with it: plan again")
    if author.role == "robot":
        _require_own(context, plan, author)
    with context.writing:
        order = _order(context, request, author).due_by(plan.deadline)
        task, commit = storing.store_plan(context.kb, plan, access=author, order=order)
    return StoredPlan(
        **_fields(plan, pddl=False, tree=False),
        task=task,
        commit=context.commit_id(commit),
        late_s=round(order.late_s(plan.duration_s, dt.datetime.now(dt.UTC)), 3),
    )


def _order(context: Context, request: StorePlan, author: Access) -> storing.Order:
    """Return how urgent the plan is, what it replaces, and whether people may be asked.

    Raises
    ------
    UnknownTermError
        There is no plan to be replaced.
    UsageError
        One of the two prices is missing.
    ForbiddenError
        A robot replaces the plan of somebody else.
    """
    earlier = "" if request.replaces is None else str(request.replaces)
    if earlier:
        if not context.kb.match(iri(earlier), RDF.type, RT.TaskPlan):
            raise UnknownTermError(f"replaces: there is no plan {earlier}", field="replaces")
        home = context.home_graph(author)
        if author.role == "robot" and not context.kb.match(
            iri(earlier), RDF.type, RT.TaskPlan, home
        ):
            raise ForbiddenError(f"{author.agent} may replace plans of its own alone")
    deadline = None
    if request.deadline is not None:
        latest_s = min(request.deadline, _LATEST_S)
        deadline = dt.datetime.fromtimestamp(latest_s, dt.UTC)
    return storing.Order(request.priority, deadline, earlier, _prices(request), request.allow_part)


def _prices(request: StorePlan) -> Prices | None:
    asking, failing = request.asking_price, request.failing_price
    if asking is None and failing is None:
        return None
    if asking is None or failing is None:
        missing = "asking_price" if asking is None else "failing_price"
        raise UsageError(f"{missing} is missing: a price is weighed against the other",
                         field=missing)  # fmt: skip
    return Prices(asking, failing)


def _plan(
    context: Context,
    goal: str,
    access: Access,
    assume_reach: bool,
    kb: GraphCore | None = None,
) -> TaskPlan:
    """Plan, one at a time: a search takes a processor for itself.

    Raises
    ------
    BusyError
        Others plan.
    """
    if not context.planning.acquire(timeout=_PATIENCE_S):
        raise BusyError("other plans are being made; try again", retry_after_s=_PATIENCE_S)
    try:
        return Tasks(kb or context.kb).plan(goal, assume_reach=assume_reach, access=access)
    finally:
        context.planning.release()


def _require_own(context: Context, plan: TaskPlan, author: Access) -> None:
    own = context.agent_iri(author).value
    others = {robot for step in plan.steps for robot in step.robots} - {own}
    if others:
        names = ", ".join(sorted(plan.names.get(robot, robot) for robot in others))
        raise ForbiddenError(
            f"{author.agent} plans for itself alone, and the plan needs {names}: a person may "
            "store it"
        )


def answer_of(plan: TaskPlan, *, pddl: bool = False, tree: bool = False) -> GoalPlan:
    """Return a plan as the operation answers it."""
    return GoalPlan(**_fields(plan, pddl=pddl, tree=tree))


def _fields(plan: TaskPlan, *, pddl: bool, tree: bool) -> dict[str, Any]:
    fields = {
        **plan.to_dict(),
        "steps": [_step(step) for step in plan.steps],
        "refusals": [PlanRefusal(**item.to_dict()) for item in plan.refusals],
        "digest": plan.digest,
        "text": plan.text,
    }
    if pddl:
        fields |= {"domain": plan.domain, "problem": plan.problem}
    if tree:
        fields["behaviour_tree"] = behaviour_tree("; ".join(plan.understood), plan.steps)
    return fields


def _step(step: PlannedStep) -> PlanStep:
    fields = step.to_dict()
    return PlanStep(**{**fields, "because": [PlanReason(**item) for item in fields["because"]]})
