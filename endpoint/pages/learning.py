"""Page about learning: how often attempts hold, and what earlier attempts have to do with it."""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from endpoint.pages.drawn import belief_over
from endpoint.pages.render import Model, page, query_text, select

__all__ = ["MAX_ATTEMPTS", "benefit", "learned", "recent_attempts"]

MAX_ATTEMPTS = 5000
MAX_GRASPS = 100
MAX_CURVE = 500
_QUERY = "learning"
_PRIORS = {
    (False, False): "nobody had tried the object",
    (True, False): "only the robot itself had",
    (False, True): "only other robots had",
    (True, True): "the robot and others had",
}
_MAX_OWN = 9
_CURVES = {False: "nobody else had tried the object", True: "other robots had tried it before"}
_BINS = 5
_COUNTS = ((0, "none"), (1, "1"), (4, "2 to 4"), (9, "5 to 9"), (10**9, "10 or more"))


@page("/learning", "learning.html")
def learning() -> Model:
    """Return success by what was known before, by robot and by grasp; one query."""
    return {**learned(recent_attempts()), "most": MAX_ATTEMPTS, "query": query_text(_QUERY)}


def learned(attempts: Iterable[Mapping[str, Any]]) -> Model:
    """Return what attempts show about learning.

    Parameters
    ----------
    attempts
        With robot, object, grasp and success, the oldest first.

    Examples
    --------
    >>> tried = {"object": "o", "grasp": "g", "object_name": "cup", "robot_name": None}
    >>> found = learned([{**tried, "robot": "a", "success": False},
    ...                  {**tried, "robot": "b", "success": True}])
    >>> [(one["name"], one["attempts"], one["held"]) for one in found["known"]]
    [('nobody had tried the object', 1, 0), ('only other robots had', 1, 1)]
    """
    tried: dict[str, Counter[str]] = defaultdict(Counter)
    judgements: dict[str, list[bool]] = defaultdict(list)
    counts: dict[str, list[bool]] = defaultdict(list)
    robots: dict[str, list[bool]] = defaultdict(list)
    grasps: dict[tuple[str, str], list[bool]] = defaultdict(list)
    own_tries: dict[bool, dict[int, list[bool]]] = {shared: defaultdict(list) for shared in _CURVES}
    expected: dict[int, list[tuple[float, bool]]] = defaultdict(list)
    names: dict[str, str] = {}
    total = 0
    for row in attempts:
        robot, subject, held = str(row["robot"]), str(row["object"]), bool(row["success"])
        before = tried[subject]
        number, own = before.total(), before[robot]
        judgements[_PRIORS[own > 0, number > own]].append(held)
        counts[next(words for most, words in _COUNTS if number <= most)].append(held)
        own_tries[number > own][min(own, _MAX_OWN)].append(held)
        alpha, beta = row.get("alpha"), row.get("beta")
        if alpha and beta:
            before_it = float(alpha) / (float(alpha) + float(beta))
            expected[min(int(before_it * _BINS), _BINS - 1)].append((before_it, held))
        robots[robot].append(held)
        grasps[subject, str(row["grasp"])].append(held)
        names[robot], names[subject] = row["robot_name"] or "", row["object_name"] or ""
        before[robot] += 1
        total += 1
    curves = [
        {**_share(names[robot], judged), "robot": robot, "belief": belief_over(judged[-MAX_CURVE:])}
        for robot, judged in sorted(robots.items())
    ]
    beliefs = [
        {**_share(names[subject], judged), "object": subject, "grasp": grasp}
        for (subject, grasp), judged in grasps.items()
    ]
    beliefs.sort(key=lambda belief: (-belief["attempts"], -belief["mean"], belief["grasp"]))
    return {
        "attempts": total,
        "known": [
            _share(name, judgements[name]) for name in _PRIORS.values() if name in judgements
        ],
        "counts": [_share(name, counts[name]) for _, name in _COUNTS if name in counts],
        "curves": [_over_tries(name, own_tries[shared]) for shared, name in _CURVES.items()],
        "expected": [_beside_expected(number, expected[number]) for number in sorted(expected)],
        "robots": curves,
        "grasps": beliefs[:MAX_GRASPS],
        "grasp_count": len(beliefs),
    }


def benefit(attempts: Iterable[Mapping[str, Any]]) -> Model | None:
    """Return what sharing is worth: first tries at what other robots had tried, and at the rest.

    None unless there are both.

    Parameters
    ----------
    attempts
        As for :func:`learned`.

    Examples
    --------
    >>> tried = {"object": "o", "success": True}
    >>> found = benefit([{**tried, "robot": "a"}, {**tried, "robot": "b"}])
    >>> found["shared"], found["alone"]
    ({'attempts': 1, 'held': 1}, {'attempts': 1, 'held': 1})
    """
    tried: dict[str, set[str]] = defaultdict(set)
    held: dict[bool, list[bool]] = {True: [], False: []}
    for row in attempts:
        robot, before = str(row["robot"]), tried[str(row["object"])]
        if robot not in before:
            held[bool(before)].append(bool(row["success"]))
        before.add(robot)
    if not all(held.values()):
        return None
    shared, alone = (f"{sum(held[known])} of {len(held[known])}" for known in (True, False))
    return {
        "shared": {"attempts": len(held[True]), "held": sum(held[True])},
        "alone": {"attempts": len(held[False]), "held": sum(held[False])},
        "sentence": f"At the first try, robots held {shared} objects that another robot had tried "
        f"before, and {alone} that none had.",
    }


def recent_attempts() -> list[Model]:
    """Return the last attempts whose outcome is known, the oldest first."""
    return select(_QUERY, limit=MAX_ATTEMPTS)[::-1]


def _share(name: str, judged: list[bool]) -> Model:
    """Return how many attempts held, and the belief in the next with its 90 % interval."""
    (last,) = belief_over(judged)[-1:]
    return {"name": name, "attempts": len(judged), "held": sum(judged), **last}


def _over_tries(name: str, tries: Mapping[int, list[bool]]) -> Model:
    """Return the belief at each number of own earlier attempts, up to the first nobody reached."""
    reached = list(itertools.takewhile(tries.get, range(_MAX_OWN + 1)))
    points = [{"attempts": len(tries[n]), **_share(str(n), tries[n])} for n in reached]
    return {"name": name, "points": points, "most": _MAX_OWN}


def _beside_expected(number: int, judged: list[tuple[float, bool]]) -> Model:
    """Return what was believed before attempts of one range of beliefs, and how many held."""
    name = f"{100 * number // _BINS} to {100 * (number + 1) // _BINS} %"
    mean = sum(before for before, _ in judged) / len(judged)
    return {**_share(name, [held for _, held in judged]), "expected": mean}
