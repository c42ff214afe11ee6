"""What a robot finds no way to is put elsewhere by another robot, or given up with a reason.

Where a hand gets to, the graph knows by places. Within a place it depends on how the thing stands
there, which only the robot's planning tells. What it found no way to twice, with nothing taken away
there in between, another robot moves; its next place for the thing is a new one. Where nobody else
can move it, or there is no room to put it down, what stands beside it is taken elsewhere: to a
place that several robots reach, or, where there is none, for as long as it is in the way.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rtask.errors import RtaskError
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.limits import limited
from simulate.grasping.record import phase_of
from simulate.tasks.actions import NOT_SEEN
from simulate.tasks.executor import Graph

__all__ = ["Rearranging"]

_BEFORE_HELP, _BEFORE_END = 2, 4
"""Failures to find a way before another robot is to help, with nothing taken away there in between,
and before the goal ends, with nothing done anywhere in between."""
_MAX_MOVES = 4
"""How often something is moved for a thing."""


_Failure = tuple[str, str, str, bool]
"""Robot, thing, place, and whether there was no room for it there, or else no way to it."""


@dataclass
class Rearranging:
    """What robots found no way to, and the plans that move it.

    Parameters
    ----------
    planner
        A client that may store plans for all robots.
    store
        Stores a plan for a goal; its arguments are those of ``store_plan``.
    """

    planner: Graph
    store: Callable[..., Any]
    helping: dict[str, str] = field(default_factory=dict)
    """IRI of the thing for which each plan is that only moves something, by the IRI of the plan."""
    helped: set[str] = field(default_factory=set)
    """IRIs of those that were carried out."""
    _failures: Counter[_Failure] = field(default_factory=Counter)
    """Since anything was done."""
    _blocked: Counter[_Failure] = field(default_factory=Counter)
    """The same since something was taken away from the place, or the thing itself was handled."""
    _moves: Counter[str] = field(default_factory=Counter)
    """Plans stored for a thing, which bound what is tried, and those of them carried out."""
    _times_helped: Counter[str] = field(default_factory=Counter)
    _borrowed: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Where things belong that stand elsewhere only for a while, and for which goal; by IRI."""
    _unmoved: set[str] = field(default_factory=set)
    """Things that another robot could not move either."""
    _counted: set[str] = field(default_factory=set)

    def note_done(self, task: str) -> None:
        """Note that a step was done, so that what had no way before may have one now.

        Parameters
        ----------
        task
            IRI of the step.
        """
        self._failures.clear()
        if not self._blocked:
            return
        values = self._values(task)
        item, place = values.get("thing", ""), values.get("place", "")
        # In a busy crew something is done between any two failures. What was done elsewhere, or
        # put down beside the thing, opens no way to it: if it counted, nobody would ever help.
        if item and place and self._is_at(item, place):
            place = ""
        for failure in list(self._blocked):
            # What there is no room for is picked up each time before that shows.
            was_handled = item == failure[1] and not failure[3]
            if was_handled or place == failure[2]:
                del self._blocked[failure]

    def move(self, plan: Mapping[str, Any]) -> bool:
        """Store a plan by which another robot moves what a plan has failed at, if that helps."""
        failure, step = self._failure(plan), _failed(plan)
        if failure is None or step["task"] in self._counted:
            return False
        self._counted.add(step["task"])
        robot, item, place, is_full = failure
        self._failures[failure] += 1
        self._blocked[failure] += 1
        if self._blocked[failure] < _BEFORE_HELP or self._moves[item] >= _MAX_MOVES:
            return False
        may_move = not (is_full or item in self._unmoved)
        # By turns: where every spot is beside something, the thing itself could be moved for ever.
        # What a hand would touch is likely beside it, and what it does not get to is too far away.
        is_beside = step["comment"].endswith(_COLLISION)
        is_next = (self._moves[item] % 2 == 0) is not is_beside
        if may_move and is_next and self._store_move(plan, item, item, place, robot):
            return True
        beside = [other for other in self._contents_of(place) if other != item]
        if any(self._store_move(plan, item, other, place) for other in beside):
            return True
        if may_move and not is_next and self._store_move(plan, item, item, place, robot):
            return True
        # A robot that is alone gets back what it puts aside; nobody asked for it to be there.
        for other in beside:
            if self._store_move(plan, item, other, place, is_alone=True):
                self._borrowed[other] = place, plan["settled"] or plan["goal"]
                return True
        return False

    def bring_back(self) -> bool:
        """Store plans by which things that only were in the way come back; tell if there is one.

        What the goal itself is about stays where it is: a can that was put aside into the box may
        belong there.
        """
        is_any = False
        for moved, (place, goal) in list(self._borrowed.items()):
            del self._borrowed[moved]
            try:
                if moved in self.planner.call("plan_goal", goal=goal)["names"]:
                    continue
                back = limited(f"<{moved}> rt:locatedOn <{place}>", goal)
                answer = self.planner.call("plan_goal", goal=back)
                if not answer["complete"] or not answer["steps"]:
                    continue
                stored = self.store(goal=back, digest=answer["digest"])
            except RtaskError as error:
                if not error.answer_status or error.answer_status >= 500:
                    raise
                continue
            self.helping[stored["task"]] = moved
            is_any = True
        return is_any

    def _store_move(
        self,
        plan: Mapping[str, Any],
        item: str,
        moved: str,
        place: str,
        but: str = "",
        is_alone: bool = False,
    ) -> bool:
        """Store a plan that takes something away from a place; return whether there is one.

        Parameters
        ----------
        item, moved
            IRIs of the thing for which it is moved, and of what is moved.
        but
            IRI of a robot that is not to do it.
        is_alone
            Also to a place that only one robot reaches.
        """
        needed = {self._values(step["task"]).get("place", "") for step in plan["steps"]}
        places = self._places(but or _NOBODY, moved, place, is_alone)
        if moved != item:  # there it would soon be in the way again
            places.sort(key=lambda at: at in needed)
        for elsewhere in places:
            # What the goal forbids is forbidden to those who help it, too.
            own = plan["settled"] or plan["goal"]
            goal = limited(f"<{moved}> rt:locatedOn <{elsewhere}>", own)
            try:
                answer = self.planner.call("plan_goal", goal=goal)
                if not answer["complete"] or not answer["steps"] or _is_by(answer, but):
                    continue
                stored = self.store(
                    goal=goal, digest=answer["digest"], priority=min(plan["priority"] + 1, 100)
                )
            except RtaskError as error:
                if not error.answer_status or error.answer_status >= 500:
                    raise
                continue
            self._moves[item] += 1
            self.helping[stored["task"]] = item
            return True
        return False

    def note_helped(self, plan: str) -> None:
        """Note that a plan that only moves something was carried out."""
        self._times_helped[self.helping.pop(plan)] += 1
        self.helped.add(plan)

    def note_unhelped(self, plan: Mapping[str, Any]) -> None:
        """Note that a plan that only moves something failed.

        Where it found no way either, what is beside that is next to go. What it missed or let slip,
        it may hold the next time.
        """
        item, step = self.helping.pop(plan["task"]), _failed(plan)
        if not step or _is_no_way(step["comment"]):
            self._unmoved.add(item)

    def _contents_of(self, place: str) -> list[str]:
        return [str(row["thing"]) for row in self.planner.query(_CONTENTS % place)]

    def hopeless(self, plan: Mapping[str, Any]) -> str:
        """Return why there is no use in planning again; empty if there may be."""
        failure = self._failure(plan)
        count = self._failures[failure] if failure is not None else 0
        if count < _BEFORE_END:
            return ""
        step = _failed(plan)
        moved = self._times_helped[failure[1]] if failure is not None else 0
        helped = f"things were moved {moved} times for that" if moved else "nobody could help"
        return f"{step['text']}: no way was found {count} times ({step['comment']}), and {helped}"

    def _failure(self, plan: Mapping[str, Any]) -> _Failure | None:
        """Return what a step failed at for want of a way or of room; None for other reasons."""
        step = _failed(plan)
        if not step or not _is_no_way(step["comment"]):
            return None
        values = self._values(step["task"])
        if "thing" not in values or "place" not in values:
            return None
        is_full = step["comment"] == _NO_ROOM
        return step["claimed_by"], values["thing"], values["place"], is_full

    def _values(self, task: str) -> dict[str, str]:
        """Return the IRIs that a step is about, by parameter of its action."""
        rows = self.planner.query(_VALUES % task)
        values = json.loads(str(rows[0]["values"])) if rows else {}
        return {str(name): str(value) for name, value in values.items()}

    def _is_at(self, item: str, place: str) -> bool:
        return bool(self.planner.query(_IS_AT % (item, place)))

    def _places(self, robot: str, item: str, place: str, is_alone: bool) -> list[str]:
        """Return places to which another robot could move a thing, the emptiest first.

        Where one robot alone gets to, only if the thing was there before, or comes back: else
        nobody might get it back from there.
        """
        values = {"prefixes": PREFIXES, "robot": robot, "place": place, "item": item}
        values["shared"] = "" if is_alone else _SHARED.format(**values)
        rows = self.planner.query(_ELSEWHERE.format(**values))
        things = Counter(str(row["at"]) for row in rows if row["thing"] is not None)
        return sorted({str(row["at"]) for row in rows}, key=lambda at: (things[at], at))


_NO_ROOM = "place_plan"
_COLLISION = "_collision"
"""How the codes of grasps end at which the hand or the arm would touch something."""
_NOBODY = "urn:nobody"


def _is_no_way(reason: str) -> bool:
    """Tell whether a robot found no grasp, no way to one, or none to put a thing down.

    Nor is there a way to what a robot does not see where another one does, or what is covered: it
    sees that at another spot, or with less beside it.
    """
    is_unseen = reason.startswith(NOT_SEEN)
    return is_unseen or phase_of(reason) == "plan" or reason in ("no_grasp", _NO_ROOM)


def _failed(plan: Mapping[str, Any]) -> Mapping[str, Any]:
    return next((step for step in plan["steps"] if step["state"] == "failed"), {})


def _is_by(plan: Mapping[str, Any], robot: str) -> bool:
    return any(robot in step["robots"] for step in plan["steps"])


_VALUES = f"""{PREFIXES}
SELECT ?values WHERE {{ <%s> rt:parameterValues ?values }} LIMIT 1"""
_CONTENTS = f"""{PREFIXES}
SELECT DISTINCT ?thing WHERE {{ ?thing a rt:Exemplar ; rt:locatedOn <%s> }} ORDER BY ?thing"""
_IS_AT = f"""{PREFIXES}
SELECT ?at WHERE {{ VALUES (?item ?at) {{ (<%s> <%s>) }} ?item rt:locatedOn ?at }} LIMIT 1"""
_ELSEWHERE = """{prefixes}
SELECT DISTINCT ?at ?thing WHERE {{
  ?other rt:reaches <{place}>, ?at FILTER(?other != <{robot}> && ?at != <{place}>)
  {shared}
  OPTIONAL {{ ?thing a rt:Exemplar ; rt:locatedOn ?at }}
}}"""
_SHARED = """FILTER(EXISTS {{ ?third rt:reaches ?at FILTER(?third != ?other) }}
         || EXISTS {{ ?earlier rt:placementOf <{item}> ; rt:placedOn ?at }})"""
