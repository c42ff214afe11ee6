"""One random goal for whole arms in physics, and one event that comes between."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from simulate.grasping.record import phase_of
from simulate.study.tasks.trial import stored_picks
from simulate.tasks.actions import TaskAction, available_actions
from simulate.tasks.arms.bench import Area, Bench, Layout
from simulate.tasks.arms.body import ArmBody
from simulate.tasks.arms.working import Settings, WholeCrew, crew_at_tables
from simulate.tasks.body import Deed, TaskBody
from simulate.tasks.crew import Ended
from simulate.tasks.executor import Turn
from simulate.world.seeds import mix_seed, stream

__all__ = ["EVENTS", "run_trial"]

EVENTS = ("moved", "dropped", "killed", "declined")
"""What may come between: a person moves the thing before it is picked up, or takes it out of the
hand and drops it onto the table; the program of a robot ends after it has acted and before it says
so; a person says no."""
_STREAM = 72
_MARGIN_M = 0.03
_MOVED_M = 0.06
"""By which a thing that is moved within one part of the table is elsewhere than before."""
_MOST_DRAWS = 200


class KilledError(RuntimeError):
    """The program of a robot ends."""

    def __init__(self, body: ArmBody) -> None:
        super().__init__("the program of a robot ended")
        self.body = body


class _Event:
    """The event of a trial, which happens once; a person sees which thing a step is about."""

    def __init__(
        self, kind: str, bench: Bench, body: int, target: str, rng: np.random.Generator
    ) -> None:
        self.kind, self.bench, self.body, self.rng = kind, bench, body, rng
        self.target = target
        self.is_over = False

    def before(self, text: str) -> bool:
        """Let it happen before a step if it is time; return whether the step may be taken."""
        verbs = {"moved": " picks ", "dropped": " puts ", "declined": " "}
        if self.is_over or verbs.get(self.kind, "\0") not in text:
            return True
        self.is_over = True
        if self.kind == "declined":
            return False
        self._put_elsewhere()
        return True

    def kill(self, body: ArmBody, deed: Deed) -> None:
        """End the program of a robot that has just picked something up."""
        if self.kind == "killed" and not self.is_over and deed.success:
            self.is_over = True
            raise KilledError(body)

    def _put_elsewhere(self) -> None:
        """Put the thing where nothing stands, on a part of the table that hands get to."""
        was = self.bench.world.object_pose(self.body).position[:2]
        areas = self._areas()
        others = [self.bench.world.object_pose(other).position[:2]
                  for other in self.bench.world.objects if other != self.body]  # fmt: skip
        best, spot, room = -1.0, (0.0, 0.0), 0.0
        for _ in range(_MOST_DRAWS):
            area = areas[int(self.rng.integers(len(areas)))]
            x = float(self.rng.uniform(area.x[0] + _MARGIN_M / 2, area.x[1] - _MARGIN_M / 2))
            y = float(self.rng.uniform(area.y[0] + _MARGIN_M, area.y[1] - _MARGIN_M))
            room = min((float(np.hypot(*(other - (x, y)))) for other in others), default=1.0)
            if room > best and float(np.hypot(*(was - (x, y)))) > _MOVED_M:
                best, spot = room, (x, y)
        self.bench.put(self.body, *spot)

    def _areas(self) -> list[Area]:
        """Return parts of the table to which a person puts it: none of them is the goal.

        What is moved comes to another part, if there is one from which hands get it to the goal;
        what is dropped may lie where it was picked up.
        """
        now, layout = self.bench.area_of(self.body), self.bench.layout
        within = _reachable(layout, self.target)
        areas = [a for a in layout.areas if not a.is_box and a.name != self.target]
        areas = [a for a in areas if a.name in within] or areas
        other = [a for a in areas if a.name != now]
        return other if other and self.kind == "moved" else areas


def _reachable(layout: Layout, target: str) -> set[str]:
    """Return the names of the areas from which hands get a thing to an area, one after another."""
    within = {target}
    while True:
        more = {name for post in layout.posts for names in post.reach.values()
                if within & set(names) for name in names} | within  # fmt: skip
        if more == within:
            return within
        within = more


@dataclass
class _Watched:
    """An action of robots after which something may happen."""

    action: TaskAction
    after: Callable[[ArmBody, Deed], None]
    is_grasp: bool = True

    def target(self, arguments: Mapping[str, str]) -> str:
        """Return the hand."""
        return self.action.target(arguments)

    def missing(self, body: TaskBody, arguments: Mapping[str, str]) -> str:
        """Look before acting."""
        return self.action.missing(body, arguments)

    def carry_out(self, body: TaskBody, arguments: Mapping[str, str]) -> Deed:
        """Do it, and let happen what comes afterwards."""
        deed = self.action.carry_out(body, arguments)
        assert isinstance(body, ArmBody)
        self.after(body, deed)
        return deed


def run_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Return what came of one goal."""
    tables = settings["tables"]
    table = tables[number % len(tables)]
    events = settings["events"]
    kind = str(events[(number // len(tables)) % len(events)]) if events else ""
    seed = mix_seed(settings["seed"], _STREAM, number)
    rng = stream(settings["seed"], _STREAM, number)
    setting = Settings((table,), settings["things"], seed, settings["preset"])
    with (
        rtask.open(":memory:") as kb,
        Engine(kb) as engine,
        crew_at_tables(rtask.connect(engine), setting) as working,
    ):
        drawn = _draw_goal(working, rng)
        if drawn is None:
            return _nothing(table)
        item, target, plan = drawn
        bench = working.benches[0]
        target_name = working.introduced[0].places[target]
        event = _Event(kind, bench, _body_of(working, item), target_name, rng)
        turns: list[Turn] = []
        goal = f"<{item}> rt:locatedOn <{target}>"
        working.planner.call("store_plan", goal=goal)
        ended = _carry_out(working, event, turns)
        truly = bench.area_of(event.body)
        truths = working.truths()
        picks = [turn for turn in turns if " picks " in turn.text and _moved_a_hand(turn)]
        held = sum(turn.result == "done" for turn in picks)
        return {
            "table": table, "goal": goal, "event": kind if event.is_over else "",
            "result": ended.result, "comment": ended.comment[:200],
            "robots": len({robot for step in plan["steps"] for robot in step["robots"]}),
            "steps": len(plan["steps"]), "repairs": ended.repairs, "deeds": len(turns),
            "picks": len(picks), "held": held,
            "reasons": [turn.comment for turn in turns if turn.result == "failed"],
            "is_true": ended.result != "reached" or truly == target_name,
            # Events leave each thing where hands get it to its goal: what then falls off the table
            # was dropped or pushed by a robot, and is a goal that was missed.
            "possible": True,
            "lost": sum(not truth.remembered and bool(truth.place) for truth in truths),
            "wrong": sum(truth.remembered not in ("", truth.place) for truth in truths),
            "twice": max(stored_picks(kb) - held, 0),
            "repair_s": max(working.repair_s, default=0.0), "says": ended.result,
        }  # fmt: skip


def _carry_out(working: WholeCrew, event: _Event, turns: list[Turn]) -> Ended:
    """Let the robots work, and start the program of a robot again when it was killed."""
    actions = {name: _Watched(action, event.kill) if action.is_grasp else action
               for name, action in available_actions().items()}  # fmt: skip
    while True:
        try:
            return working.work(
                lambda robot, turn: turns.append(turn), event.before, actions=actions
            )[0]
        except KilledError as killed:
            working.restart(killed.body)


def _moved_a_hand(turn: Turn) -> bool:
    """Tell whether a step was tried: not where a thing was not seen, or no way was found to it."""
    return turn.result == "done" or phase_of(turn.comment) in ("reach", "close", "lift", "hold")


def _draw_goal(
    working: WholeCrew, rng: np.random.Generator
) -> tuple[str, str, Mapping[str, Any]] | None:
    """Draw a thing and a place that a plan of at least one step leads to; None if there is none."""
    places = sorted(working.introduced[0].places)
    pairs = [(item, place) for item in sorted(working.things) for place in places]
    for k in rng.permutation(len(pairs)):
        item, place = pairs[int(k)]
        plan = working.planner.call("plan_goal", goal=f"<{item}> rt:locatedOn <{place}>")
        if plan["complete"] and plan["steps"]:
            return item, place, plan
    return None


def _body_of(working: WholeCrew, item: str) -> int:
    """Return the body of a thing in the physics, by the name of its product; -1 for none."""
    rows = working.planner.query(_NAME % item)
    name = str(rows[0]["name"]) if rows else ""
    return next(
        (body for body, spec in working.benches[0].world.objects.items() if spec.name == name), -1
    )


def _nothing(table: str) -> dict[str, Any]:
    """Return the result of a trial in which no robot saw anything that it could move."""
    return {
        "table": table, "goal": "", "event": "", "result": "given_up", "comment": "nothing seen",
        "robots": 0, "steps": 0, "repairs": 0, "deeds": 0, "picks": 0, "held": 0, "reasons": [],
        "is_true": True, "possible": True, "lost": 0, "wrong": 0, "twice": 0, "repair_s": 0.0,
        "says": "given_up",
    }  # fmt: skip


_NAME = f"""{PREFIXES}
SELECT ?name WHERE {{ <%s> rt:exemplarOf/rt:name ?name }}"""
