"""A robot with nothing to do takes over what another one has not begun, where that is sooner."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rtask.rdf.namespaces import CORA, RDF, RDFS, RT
from rtask.rdf.terms import GraphName, NamedNode, Quad, Value, object_term
from rtask.tasks.actions import ActionClass
from rtask.tasks.names import names_of
from rtask.tasks.outcomes import Experience, read_experience
from rtask.tasks.planning.problem import expected_cost_s
from rtask.tasks.queue.pairs import Pair, open_pairs
from rtask.tasks.queue.preconditions import effects_of, failing
from rtask.tasks.queue.reading import QueuedPlan, QueuedStep
from rtask.tasks.steps import Wording

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["MARGIN", "Takeover", "find_takeover", "still_holds"]

MARGIN = 0.25
"""How much sooner a thing has to arrive, as a share of the time of carrying it."""


@dataclass(frozen=True)
class Takeover:
    """Two steps as they are once another robot has them.

    Parameters
    ----------
    pair
        As they are.
    pick, put
        With the robot, its hand, what is expected of it, and the reason.
    hand
        IRI of that hand.
    sooner_s
        By how much sooner the thing is expected to arrive, s.
    """

    pair: Pair
    pick: QueuedStep
    put: QueuedStep
    hand: str
    sooner_s: float

    def changes(self, kb: GraphCore) -> tuple[list[Quad], list[Quad]]:
        """Return the statements about the plan to withdraw and to make, in the plan's graph."""
        return _changes(kb, self)


def find_takeover(
    kb: GraphCore, plans: Sequence[QueuedPlan], robot: str, now: dt.datetime,
    actions: Sequence[ActionClass],
) -> Takeover | None:  # fmt: skip
    """Return what is best for a robot with nothing to do to take over; None where nothing is.

    Of the plans with the greatest priority, the thing that arrives sooner by the most. All
    preconditions of both steps are asked of the graph for this robot and each of its hands, as for
    a plan.
    """
    by_iri = {action.iri: action for action in actions}
    pairs = [pair for pair in open_pairs(plans, robot, now, by_iri) if _may_gain(pair)]
    hands = _free_hands(kb, robot) if pairs else []
    if not hands:
        return None
    experience = read_experience(kb.select, actions)
    offers = [
        offer for pair in pairs if _is_of_a_person(kb, pair.plan) for hand in hands
        if (offer := _offer(kb, pair, robot, hand, by_iri, experience)) is not None
    ]  # fmt: skip
    offers.sort(key=lambda offer: (-offer.pair.plan.priority, -offer.sooner_s))
    return next((o for o in offers if _is_possible(kb, o, actions)), None)


def still_holds(
    kb: GraphCore, plans: Sequence[QueuedPlan], offer: Takeover, robot: str, now: dt.datetime,
    actions: Sequence[ActionClass],
) -> bool:  # fmt: skip
    """Return whether steps can be taken over although others may have written meanwhile."""
    by_iri = {action.iri: action for action in actions}
    same = (
        pair for pair in open_pairs(plans, robot, now, by_iri)
        if (pair.pick.task, pair.put.task) == (offer.pick.task, offer.put.task)
        and (pair.pick, pair.put) == (offer.pair.pick, offer.pair.put)
    )  # fmt: skip
    return next(same, None) is not None and offer.hand in _free_hands(kb, robot) and (
        _is_possible(kb, offer, actions)
    )  # fmt: skip


def _may_gain(pair: Pair) -> bool:
    """Return whether the thing would arrive sooner if nothing could fail, before all queries."""
    took_s = pair.pick.duration_s + pair.put.duration_s
    return pair.cost_s - took_s > MARGIN * took_s


def _free_hands(kb: GraphCore, robot: str) -> list[str]:
    """Return the hands of a robot; none of them if it holds anything: then it is not idle."""
    hands = sorted(
        quad.object.value for quad in kb.match(NamedNode(robot), RT.hasEndEffector)
        if isinstance(quad.object, NamedNode)
    )  # fmt: skip
    is_free = not any(kb.match(None, RT.locatedOn, NamedNode(hand)) for hand in hands)
    return list(dict.fromkeys(hands)) if is_free else []


def _is_of_a_person(kb: GraphCore, plan: QueuedPlan) -> bool:
    """Return whether a plan is no robot's own: what that plans for itself is nobody else's."""
    owner = kb.graphs.owner(NamedNode(plan.graph))
    return owner is None or not kb.match(kb.graphs.agent_iri(owner, "robot"), RDF.type, CORA.Robot)


def _offer(
    kb: GraphCore, pair: Pair, robot: str, hand: str, actions: Mapping[str, ActionClass],
    experience: Experience,
) -> Takeover | None:  # fmt: skip
    """Return a pair as it would be for a robot, if the thing arrives sooner by the margin."""
    steps = [
        _for_robot(step, actions[step.action], robot, hand, experience)
        for step in (pair.pick, pair.put)
    ]
    took_s = sum(step.duration_s for step in steps)
    sooner_s = pair.cost_s - sum(expected_cost_s(s.duration_s, s.chance) for s in steps)
    if sooner_s <= MARGIN * took_s:
        return None
    values = {v for step in pair.plan.steps for v in (*step.arguments.values(), *step.robots)}
    wording = Wording(names_of(kb.select, values | {robot, hand}), {})
    reason = (
        f"taken over from {wording.name(pair.owner)}, which had not begun it: "
        f"{wording.name(robot)}, with nothing else to do, was expected to have done it "
        f"{sooner_s:.0f} s sooner"
    )
    pick, put = (
        replace(
            step, text=wording.step(actions[step.action], step.arguments), assignment=reason,
            taken_from=tuple(sorted({*step.taken_from, pair.owner} - {robot})),
        )
        for step in steps
    )  # fmt: skip
    return Takeover(pair, pick, put, hand, sooner_s)


def _for_robot(
    step: QueuedStep, action: ActionClass, robot: str, hand: str, experience: Experience
) -> QueuedStep:
    own = {action.parameter("assignedTo"): robot, action.parameter("engages"): hand}
    arguments = {name: own.get(name, value) for name, value in step.arguments.items()}
    duration_s, chance = experience.estimate(action)(arguments)
    return replace(
        step, arguments=arguments, robots=(robot,), duration_s=duration_s, chance=chance,
        after=tuple(task for task in step.after if task not in step.for_hand), for_hand=(),
        claims=(),
    )  # fmt: skip


def _is_possible(kb: GraphCore, offer: Takeover, actions: Sequence[ActionClass]) -> bool:
    """Return whether both steps can be done now, the second one once the first is."""
    # Who says so elsewhere would still say so afterwards, and the step would have two robots.
    own = NamedNode(offer.pair.plan.graph)
    stated = {quad.graph_name for step in (offer.pick, offer.put)
              for quad in kb.match(NamedNode(step.task), RT.assignedTo)}  # fmt: skip
    if any(kb.graphs.is_input(graph) for graph in stated - {own}):
        return False
    if failing(kb, actions, offer.pick):
        return False
    action = next(item for item in actions if item.iri == offer.pick.action)
    made, undone = effects_of(action, offer.pick)
    return not failing(kb, actions, offer.put, made=made, undone=undone)


def _changes(kb: GraphCore, offer: Takeover) -> tuple[list[Quad], list[Quad]]:
    graph = NamedNode(offer.pair.plan.graph)
    removed: list[Quad] = []
    added: list[Quad] = []
    for old, new in ((offer.pair.pick, offer.pick), (offer.pair.put, offer.put)):
        task = NamedNode(old.task)
        for prop, value in _described(kb, old, new, graph):
            removed += kb.match(task, prop, None, graph)
            added.append(Quad(task, prop, object_term(value), graph))
    dropped, extra = _order(offer)
    removed += [quad for step, prop, other in dropped for quad in
                kb.match(NamedNode(step), prop, NamedNode(other), graph)]  # fmt: skip
    added += [Quad(NamedNode(step), prop, NamedNode(other), graph) for step, prop, other in extra]
    more, less = _of_the_plan(offer, graph)
    restated = set(added)
    return [quad for quad in (*removed, *less) if quad not in restated], [*added, *more]


def _described(
    kb: GraphCore, old: QueuedStep, new: QueuedStep, graph: GraphName
) -> Iterator[tuple[NamedNode, Value]]:
    """Yield what replaces the present values of a step's properties."""
    changed = {v: new.arguments[name] for name, v in old.arguments.items()
               if new.arguments[name] != v}  # fmt: skip
    for quad in kb.match(NamedNode(old.task), None, None, graph):
        # Whatever its action states of it with one of the changed values: who, with which hand.
        if isinstance(quad.object, NamedNode) and quad.object.value in changed and (
            quad.predicate != RT.takenFrom
        ):  # fmt: skip
            yield quad.predicate, NamedNode(changed[quad.object.value])
    yield RT.parameterValues, json.dumps(dict(new.arguments), sort_keys=True)
    yield RDFS.label, new.text
    yield RT.plannedDuration, float(new.duration_s)
    yield RT.plannedChance, float(new.chance)
    yield RT.assignmentReason, new.assignment
    for robot in new.taken_from:
        yield RT.takenFrom, NamedNode(robot)


_Order = list[tuple[str, NamedNode, str]]


def _order(offer: Takeover) -> tuple[_Order, _Order]:
    """Return which steps no longer wait for which, and which do now."""
    pair = (offer.pair.pick, offer.pair.put)
    tasks = {step.task for step in pair}
    hand_of_pair = {task for step in pair for task in step.for_hand} - tasks
    dropped: _Order = []
    extra: _Order = []
    waits = (RT.waitsFor, RT.waitsForHand)
    for step in offer.pair.plan.steps:
        lost = set(step.for_hand) & tasks
        if step.task in tasks:
            lost = set(step.for_hand)
        elif lost:
            # What came before the pair in the hand of its robot still does before this step.
            new = hand_of_pair - set(step.after) - {step.task}
            extra += [(step.task, prop, task) for task in sorted(new) for prop in waits]
        elif offer.hand in step.arguments.values():
            # What the robot has done with this hand came before, and the rest comes after.
            first, then = (step, offer.pick) if step.is_done else (offer.put, step)
            # What the goal's order asks for already must not become a wait for the hand alone.
            if first.task not in then.after:
                extra += [(then.task, prop, first.task) for prop in waits]
        dropped += [(step.task, prop, task) for task in sorted(lost) for prop in waits]
    return dropped, extra


def _of_the_plan(offer: Takeover, graph: GraphName) -> tuple[list[Quad], list[Quad]]:
    """Return what to make and to withdraw of the plan: who takes part in it."""
    plan, robot = NamedNode(offer.pair.plan.task), offer.pick.robots[0]
    tasks = {offer.pick.task, offer.put.task}
    rest = {r for step in offer.pair.plan.steps if step.task not in tasks for r in step.robots}
    less = [] if offer.pair.owner in rest else [
        Quad(plan, RT.assignedTo, NamedNode(offer.pair.owner), graph)
    ]  # fmt: skip
    return [Quad(plan, RT.assignedTo, NamedNode(robot), graph)], less
