"""One random goal for whole arms in physics, and one event that comes between."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from simulate.grasping.record import phase_of
from simulate.study.tasks.trial import stored_picks
from simulate.tasks.arms.bench import Bench
from simulate.tasks.arms.working import Settings, WholeCrew, crew_at_tables
from simulate.tasks.executor import Turn
from simulate.world.seeds import mix_seed, stream

__all__ = ["EVENTS", "run_trial"]

EVENTS = ("", "moved", "dropped", "declined")
"""What may come between: nothing; a person moves the thing before it is picked up, or takes it out
of the hand and drops it onto the table; a person says no."""
_STREAM = 72
_MARGIN_M = 0.03
_MOST_DRAWS = 200


class _Event:
    """The event of a trial, which happens once; a person sees which thing a step is about."""

    def __init__(self, kind: str, bench: Bench, body: int, rng: np.random.Generator) -> None:
        self.kind, self.bench, self.body, self.rng = kind, bench, body, rng
        self.is_over = False

    def before(self, text: str) -> bool:
        """Let it happen before a step if it is time; return whether the step may be taken."""
        verbs = {"moved": " picks ", "dropped": " puts ", "declined": " "}
        if self.is_over or not self.kind or verbs[self.kind] not in text:
            return True
        self.is_over = True
        if self.kind == "declined":
            return False
        self._put_elsewhere()
        return True

    def _put_elsewhere(self) -> None:
        """Put the thing where nothing stands, on another part of the table that hands get to."""
        now = self.bench.area_of(self.body)
        areas = [a for a in self.bench.layout.areas if not a.is_box and a.name != now]
        others = [self.bench.world.object_pose(other).position[:2]
                  for other in self.bench.world.objects if other != self.body]  # fmt: skip
        best, spot, room = -1.0, (0.0, 0.0), 0.0
        for _ in range(_MOST_DRAWS):
            area = areas[int(self.rng.integers(len(areas)))]
            x = float(self.rng.uniform(area.x[0] + _MARGIN_M / 2, area.x[1] - _MARGIN_M / 2))
            y = float(self.rng.uniform(area.y[0] + _MARGIN_M, area.y[1] - _MARGIN_M))
            room = min((float(np.hypot(*(other - (x, y)))) for other in others), default=1.0)
            if room > best:
                best, spot = room, (x, y)
        self.bench.put(self.body, *spot)


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
        event = _Event(kind, bench, _body_of(working, item), rng)
        turns: list[Turn] = []
        goal = f"<{item}> rt:locatedOn <{target}>"
        working.planner.call("store_plan", goal=goal)
        ended = working.work(lambda robot, turn: turns.append(turn), event.before)[0]
        truly = bench.area_of(event.body)
        target_name = working.introduced[0].places[target]
        truths = working.truths()
        is_possible = ended.result == "reached" or _has_way(working, item, goal, truly)
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
            "possible": is_possible,
            "lost": sum(not truth.remembered and bool(truth.place) for truth in truths),
            "wrong": sum(truth.remembered not in ("", truth.place) for truth in truths),
            "twice": max(stored_picks(kb) - held, 0),
            "repair_s": max(working.repair_s, default=0.0), "says": ended.result,
        }  # fmt: skip


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


def _has_way(working: WholeCrew, item: str, goal: str, truly: str) -> bool:
    """Tell whether the hands could still bring a thing to its goal from where it truly lies."""
    place = next((iri for iri, name in working.introduced[0].places.items() if name == truly), "")
    if not place:
        return False
    working.planner.call("state_place", thing=item, place=place)
    return bool(working.planner.call("plan_goal", goal=goal)["complete"])


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
