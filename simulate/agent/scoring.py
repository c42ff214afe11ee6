"""Scoring against the ground truth of the simulation, on which no decision of a robot depends.

Neither the agent nor the execution of grasps reads true poses of objects: robots judge for
themselves (:mod:`simulate.grasping.judgement`). Here their judgements are compared with the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from features.perception import Seen
from simulate.agent.encounter import Attempt, Encounter
from simulate.agent.hand_place import HandPlace, describe_product, place_hand
from simulate.agent.simulated_body import SimulatedBody
from simulate.grasping.rules import PlannedGrasp
from simulate.grasping.table_reach import requests_for
from simulate.robots.description import Floats
from simulate.world.robot_body import RobotBody
from simulate.world.world import PlaceBox, World

__all__ = [
    "AttemptTruth",
    "ObjectState",
    "Scorer",
    "Truth",
    "held_reason",
    "is_placed",
    "watch_attempts",
]

_NEAR_M = 0.06

LIFTED_M = 0.02
"""An object that rose by less is still standing on the table, or leaning."""
MIN_LINKS = 2
_PLACED_BELOW_M = 0.09


@dataclass(frozen=True, eq=False)
class ObjectState:
    """True state of an object at one moment.

    Parameters
    ----------
    position : (3,) float, m
        Of its middle.
    bottom
        Height of its lowest point, m; NaN = not known, and then the middle counts.
    links
        Links of the hand that touch it.
    force_n
        Sum of their normal forces.
    on_table
        It touches the table.
    """

    position: Floats
    links: int = 0
    force_n: float = 0.0
    on_table: bool = False
    bottom: float = float("nan")

    @property
    def is_finite(self) -> bool:
        """Whether the physics has not diverged."""
        return bool(np.isfinite(self.position).all()) and bool(np.abs(self.position).max() < 10)


def held_reason(before: ObjectState, lifted: ObjectState, held: ObjectState) -> str:
    """Return ``ok`` if an object was lifted and stayed in the hand, otherwise what went wrong.

    Held = the hand alone carries it, at the beginning and at the end of the hold: the origin rose
    by more than 2 cm, at least two links of the hand touch it, and the table does not. What keeps
    an end on the table is not held: the table carries a part of it, so that the grasp has not
    shown that it bears the whole, and on its way the thing may be torn out of the hand.

    Parameters
    ----------
    before, lifted, held
        The object before the lift, after it, and after the hold.
    """
    for state, reason in ((lifted, "slip_lift"), (held, "slip_hold")):
        if not state.is_finite:
            return "not_judged"
        risen = state.position[2] - before.position[2]
        if risen <= LIFTED_M or state.links < MIN_LINKS or state.on_table:
            return reason
    return "ok"


def is_placed(state: ObjectState, box: PlaceBox) -> bool:
    """Return whether an object is in a box: within its walls, less than 9 cm above its floor.

    Its middle is within the walls, and its lowest point is not higher: what stands upright on
    something else in the box is in the box, though its middle may be higher than that.
    """
    x, y, z = state.position
    inside = box.x_range[0] < x < box.x_range[1] and box.y_range[0] < y < box.y_range[1]
    bottom = z if np.isnan(state.bottom) else state.bottom
    return bool(inside and box.floor - 0.01 < z and bottom < box.floor + _PLACED_BELOW_M)


@dataclass(frozen=True)
class Truth:
    """True outcome of an attempt.

    Parameters
    ----------
    held, placed
        Lifted and kept for 2 s; at rest in the box.
    reason
        ``ok`` if held, else ``slip_lift`` or ``slip_hold``; empty if the lift did not begin.
    lifted_m
        Rise of the object at the end of the hold, m.
    pushed_m
        How far the hand moved the object before it closed, m.
    """

    held: bool
    placed: bool
    reason: str = ""
    lifted_m: float = 0.0
    pushed_m: float = 0.0


class AttemptTruth:
    """Watches the object of one attempt; called at the end of each phase.

    Parameters
    ----------
    world, robot
        Where the attempt takes place.
    plan
        The plan that is executed; its target is the object nearest to the grasp.
    """

    def __init__(self, world: World, robot: RobotBody, plan: PlannedGrasp) -> None:
        self._world, self._robot, self._plan = world, robot, plan
        self.target = self._find_target()
        self.hand: HandPlace | None = None
        """Where the hand was about to close; None if it did not get there."""
        self._states: dict[str, ObjectState] = {}
        self._states["start"] = self._state()

    def __call__(self, phase: str) -> None:
        """Record the state of the object at the end of a phase."""
        self._states[phase] = self._state()
        if phase == "approach" and self.target in self._world.objects:
            product, pose = self._world.objects[self.target], self._world.object_pose(self.target)
            self.hand = place_hand(self._robot, self._plan.arm, product, pose)

    @property
    def truth(self) -> Truth:
        """True outcome of the attempt so far."""
        states, start = self._states, self._states["start"]
        reason = ""
        if "hold" in states:
            reason = held_reason(states["close"], states["lift"], states["hold"])
        box = self._world.box_for(self._robot.arm(self._plan.arm).side, self._plan.request.y)
        end = states.get("home", start)
        rise = states.get("hold", start).position[2] - start.position[2]
        pushed = states.get("approach", start).position - start.position
        return Truth(
            held=reason == "ok",
            placed=box is not None and is_placed(end, box),
            reason=reason,
            lifted_m=float(rise),
            pushed_m=float(np.linalg.norm(pushed)),
        )

    def _find_target(self) -> int:
        """Return the object nearest to the grasp, or -1 if there is none.

        The distance is that to its surface: the end of a long object is far from its middle.
        """
        request, best, nearest = self._plan.request, -1, _NEAR_M
        base = self._robot.world_from_base
        height = request.table_height + self._plan.tool_height
        tool = base[:3, :3] @ [request.x, request.y, height] + base[:3, 3]
        for body, spec in sorted(self._world.objects.items()):
            there = self._world.object_pose(body)
            inside = there.rotation.T @ (tool - there.position)
            half = np.array(spec.extent) / 2
            distance = float(np.linalg.norm(np.maximum(np.abs(inside) - half, 0.0)))
            if distance < nearest:
                best, nearest = body, distance
        return best

    def _state(self) -> ObjectState:
        if self.target not in self._world.objects:  # never there, or taken away
            last = self._states.get("start", ObjectState(np.zeros(3)))
            return replace(last, links=0, force_n=0.0)
        touch = self._robot.touch(self._plan.arm, self.target)
        there = self._world.object_pose(self.target)
        half = np.array(self._world.objects[self.target].extent) / 2
        return ObjectState(
            there.position, touch.links, touch.force_n, self._world.on_table(self.target),
            bottom=float(there.z - np.abs(there.rotation[2]) @ half),
        )  # fmt: skip


def watch_attempts(body: SimulatedBody) -> list[AttemptTruth]:
    """Watch every attempt that a body makes from now on; return the growing list of truths."""
    watched: list[AttemptTruth] = []

    def watch(plan: PlannedGrasp) -> Callable[[str], None]:
        watched.append(AttemptTruth(body.world, body.robot, plan))
        return watched[-1]

    body.watch = watch
    return watched


class Scorer:
    """Scores a robot: the true product of each object, and the true outcome of each attempt."""

    def __init__(self, body: SimulatedBody) -> None:
        self._body = body
        self._watched = watch_attempts(body)
        self._specs = {laid.body: laid.placement.spec for laid in body.laid}
        self._products = {laid: spec.name for laid, spec in self._specs.items()}

    def body_under(self, seen: Seen) -> int:
        """Return the body that most pixels of a segment show, or -1 if it is not a product."""
        ids, counts = np.unique(self._body.eyes.labels[seen.mask], return_counts=True)
        best = int(ids[np.argmax(counts)])
        return best if best in self._products else -1

    def name_of(self, body: int) -> str:
        """Return the name of a product; empty for anything else."""
        return self._products.get(body, "")

    def in_reach(self) -> dict[int, bool]:
        """Return for each body whether a grasp of its true shape fits and can be planned."""
        return {laid.body: self._reachable(laid.body) for laid in self._body.laid}

    def _reachable(self, body: int) -> bool:
        world, executor = self._body.world, self._body.executor
        spec = self._specs[body]
        pose = world.object_pose(body)
        mouth = min(arm.mouth for arm in self._body.robot.arms.values())
        at = (pose.x, pose.y, pose.yaw)
        return any(
            not isinstance(executor.plan(request, obstacles=[], seed=0), str)
            for request in requests_for(spec, at, world.table_height, mouth)
        )

    def truth_of(self, attempt: Attempt) -> Truth | None:
        """Return the true outcome of an attempt; None if nothing was moved."""
        return self._watched[attempt.run - 1].truth if attempt.run else None

    def hand_at(self, attempt: Attempt) -> HandPlace | None:
        """Return where the hand closed in an attempt; None if it did not get there."""
        return self._watched[attempt.run - 1].hand if attempt.run else None

    def score(
        self,
        encounters: Sequence[Encounter],
        first_sight: Mapping[int, int],
        in_reach: Mapping[int, bool],
    ) -> list[dict[str, Any]]:
        """Return the encounters as JSON data, each with its product.

        Each physical attempt gets ``truth`` beside the robot's own judgement, and ``hand``, where
        the hand closed; ``hidden`` is what the product hides.

        ``right`` is filled in by :mod:`simulate.demo`, which alone knows which product an object
        IRI of the graph stands for.
        """
        scored = []
        for encounter in encounters:
            body = first_sight.get(encounter.number, -1)
            summary = encounter.summary()
            for attempt, data in zip(encounter.attempts, summary["attempts"], strict=True):
                truth = self.truth_of(attempt)
                data["truth"] = None if truth is None else asdict(truth)
                hand = self.hand_at(attempt)
                data["hand"] = None if hand is None else asdict(hand)
            scored.append(
                {
                    **summary,
                    "product": self.name_of(body),
                    "hidden": describe_product(self._specs[body]) if body in self._specs else None,
                    "in_reach": bool(in_reach.get(body, False)),
                    "right": None,
                }
            )
        return scored
