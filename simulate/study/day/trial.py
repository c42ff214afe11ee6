"""One simulated day from its seed to its figures."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from simulate.study.day.happenings import Day, Sample, live_day
from simulate.study.day.lab import Item, distance
from simulate.study.day.questions import KINDS, Asked, ask_all
from simulate.study.day.robots import BASE, Robot, ask
from simulate.study.intervals import wilson
from simulate.world.seeds import stream

__all__ = ["run_trial"]

_STREAM, _NEWCOMER = 74, 75
_VERDICTS = ("right", "not known", "wrong")
_LOOK_M = 0.1
_SHOWN = 20


def run_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Return what came of one day.

    Parameters
    ----------
    settings
        ``seed``, ``hours``, ``things``, ``questions`` and ``samples``, how often the graph is asked
        during the day how sure it is.
    """
    given = {**settings, "seed": settings["seed"] + number}
    begun_s = time.process_time()
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        day = live_day(engine, given)
        lived_s = time.process_time() - begun_s
        asked = ask_all(day, given["questions"], stream(given["seed"], _STREAM))
        return {
            "verdicts": _verdicts(asked),
            "wrong": [[each.question, each.answer, each.truth] for each in asked
                      if each.verdict == "wrong"][:_SHOWN],
            "two_places": _at_two_places(day),
            "calibration": _calibration(day.samples),
            "newcomer": _newcomer(day, given["seed"]),
            "things": len(day.lab.items),
            "things_in_graph": len(day.identified),
            "taken_for_another": len(day.robots[0].errors),
            "deeds": dict(sorted(day.deeds.items())),
            "commits": kb.seq,
            "lived_s": lived_s,
            "asked_s": time.process_time() - begun_s - lived_s,
        }  # fmt: skip


def _verdicts(asked: Sequence[Asked]) -> dict[str, dict[str, int]]:
    """Return how many answers of each kind were right, not known and wrong."""
    counts = Counter[tuple[str, str]]((each.kind, each.verdict) for each in asked)
    return {
        kind: {verdict: counts[kind, verdict] for verdict in _VERDICTS} for kind in KINDS
    }  # fmt: skip


def _at_two_places(day: Day) -> int:
    """Return how often a thing has two places at one instant, by its trace and by the graph."""
    count = 0
    for iri in day.identified:
        places = ask(day.engine, "trace_thing", name=iri, max_places=10_000).places
        for before, after in itertools.pairwise(places):
            count += before.until is None or before.until > after.since
    rows = day.engine.context.kb.select(f"""{PREFIXES}
SELECT ?thing WHERE {{ ?thing rt:currentPlacement ?place }}
GROUP BY ?thing HAVING (COUNT(DISTINCT ?place) > 1)""")
    return count + len(list(rows))


def _calibration(samples: Sequence[Sample]) -> dict[str, dict[str, Any]]:
    """Return for each kind of place how many things were within the radius said with 90 %."""
    by_kind = {"all": list(samples)}
    for sample in samples:
        by_kind.setdefault(sample.kind, []).append(sample)
    return {kind: _within(chosen) for kind, chosen in by_kind.items() if chosen}


def _within(samples: Sequence[Sample]) -> dict[str, Any]:
    within = sum(sample.away_m <= sample.radius90_m for sample in samples)
    radii = [sample.radius90_m for sample in samples]
    return {
        "samples": len(samples), "within": within,
        "within_95": list(wilson(within, len(samples))),
        "median_radius_m": float(np.median(radii)),
    }  # fmt: skip


def _newcomer(day: Day, seed: int) -> dict[str, int]:
    """Let a robot arrive that has seen nothing, and look for 20 named things."""
    rng = stream(seed, _NEWCOMER)
    robot = Robot("panda-2", day.engine, day.lab, rng, "table-b", day.identified)
    robot.register(day.end_s)
    there = [item for item in day.lab.single if item.now.kind != "away"]
    chosen = [there[int(k)] for k in rng.permutation(len(there))[:20]]
    first_look = sum(_finds(robot, item, day.end_s + 60.0) for item in chosen)
    return {"looked_for": len(chosen), "found_at_first_look": first_look}


def _finds(robot: Robot, item: Item, time_s: float) -> bool:
    """Whether a thing is where the graph sends a robot that asks for it by name."""
    answer = robot.call("where_is", name=item.name, frame="map", stamp=time_s)
    if not answer["known"]:
        return False
    place = answer["things"][0]
    if place.pose is None or item.now.kind != "on":
        return bool(place.place_label == item.now.where)
    at = place.pose["position"]
    return distance((at["x"], at["y"]), item.now.spot) <= _LOOK_M
