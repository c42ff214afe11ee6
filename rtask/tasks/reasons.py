"""Why a goal is out of reach, for each robot, and what would mend it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from rtask.rdf.namespaces import PREFIXES, RT, local_name
from rtask.rdf.terms import NamedNode
from rtask.tasks.actions import Select
from rtask.tasks.plan import Refusal
from rtask.tasks.planning.mutexes import CrowdedGoal
from rtask.tasks.planning.problem import Atom, Goal, Problem
from rtask.tasks.planning.unsolvable import Obstacle, explain_unsolvable
from rtask.tasks.room import is_measured, measures_in_words, mended_by
from rtask.tasks.steps import Wording, excluded_by, excluded_link, statement_of

__all__ = ["crowded", "refusal"]

_MAX_ROBOTS = 6
_LIMITS = """
SELECT (MAX(?opening) AS ?widest) (MIN(?low) AS ?narrowest) (MAX(?payload) AS ?strongest)
  (SAMPLE(?w) AS ?width) (MIN(?m) AS ?mass) WHERE {
  %s rt:hasEndEffector ?hand
  OPTIONAL { ?hand rt:maxOpening ?opening } OPTIONAL { ?hand rt:maxPayload ?payload }
  OPTIONAL { ?hand rt:minOpening ?low }
  OPTIONAL { %s rt:effectiveGraspWidth ?w }
  OPTIONAL { { %s rt:effectiveMass ?m } UNION { %s rt:massBound ?m } }
}"""
_LIMIT_NAMES = ("widest", "narrowest", "strongest", "width", "mass")


def refusal(
    select: Select,
    problem: Problem,
    obstacle: Obstacle,
    mendable: Mapping[str, float],
    robots: Sequence[tuple[str, str]],
    wording: Wording,
) -> Refusal:
    """Return why a goal is out of reach: the cheapest remedy, and what each robot alone lacks."""
    # No addition helps: perhaps something has to end, such as that a hand is out of order.
    if not obstacle.missing:
        mendable = {**mendable, **_absences(problem)}
        [obstacle] = explain_unsolvable(replace(problem, goals=(obstacle.goal,)), mendable)
    goal = _goal_text(obstacle.goal, wording)
    alone: dict[str, str] = {}
    for robot, _ in robots[_MAX_ROBOTS:]:
        alone[robot] = f"not looked at: only the first {_MAX_ROBOTS} robots are"
    # Each is a search of its own, with the others out of the problem.
    for robot, kind in robots[:_MAX_ROBOTS]:
        objects = {**problem.objects, kind: (robot,)}
        restricted = replace(problem, objects=objects, goals=(obstacle.goal,))
        for other in explain_unsolvable(restricted, mendable):
            alone[robot] = (
                _reasons(select, other.missing, wording)
                or _without_hand(select, robot)
                or _nothing(problem, obstacle, wording)
            )
    text = (
        _remedy(select, obstacle, wording)
        if obstacle.missing
        else _handless(select, robots, wording) or _nothing(problem, obstacle, wording)
    )
    statements = (statement_of(atom) for atom in obstacle.missing)
    return Refusal(goal, text, tuple(item for item in statements if item is not None), alone)


def crowded(goal: CrowdedGoal, wording: Wording) -> Refusal:
    """Return why a goal finds no room beside the others."""
    names = [wording.name(taker) for taker in goal.takers[:_MAX_ROBOTS]]
    more = len(goal.takers) - len(names)
    listed = " and ".join(names) + (f" and {more} more" if more else "")
    each = " each" if len(goal.takers) > 1 else ""
    return Refusal(
        _goal_text(goal.goal, wording),
        f"for {listed}{each}, one such goal can hold at a time, and others come first; ask for "
        "fewer, or for another place",
        (),
        {},
    )


def _goal_text(goal: Goal, wording: Wording) -> str:
    return " or ".join(wording.atom(atom) for atom in goal[:3])


def _absences(problem: Problem) -> dict[str, float]:
    """Return the conditions that something is not so, each as dear as another, as remedies.

    No statement makes them true: they only say what stands in the way.
    """
    conditions = {atom[0] for action in problem.actions for atom in action.preconditions}
    return {name: 1.0 for name in conditions if name.startswith(_ABSENT)}


_NO_REMEDY = "no capability or reach that could be added would make it possible"
_ABSENT = "FILTER NOT EXISTS"


def _nothing(problem: Problem, obstacle: Obstacle, wording: Wording) -> str:
    """Return that no single statement helps: mostly, that nobody knows where something is."""
    made = {atom[0] for action in problem.actions for atom in action.adds}
    if not any(atom[0] in made for atom in obstacle.goal):
        # A misspelt property, or an ontology that nobody has loaded.
        return "no action that the graph knows of brings this about (rt:addition in an ontology)"
    subject = obstacle.goal[0][1]
    predicate = obstacle.goal[0][0]
    statement = statement_of(obstacle.goal[0])
    is_place = statement is not None and statement[1] == RT.locatedOn.value
    if not is_place:
        return _NO_REMEDY
    at = [atom[-1] for atom in problem.facts if atom[0] == predicate and atom[1] == subject]
    if not at:
        return "it is not known where it is: nobody has stated on or in what; say so by state_place"
    held = sorted(set(at).intersection(problem.objects.get(RT.EndEffector.value, ())))
    if held:  # what another robot has in its hand is taken from there by nobody else
        return f"it is in {wording.name(held[0])}, which would have to put it down first"
    return _NO_REMEDY


def _without_hand(select: Select, robot: str) -> str:
    """Return that nobody has stated a hand of a robot; "" if somebody has."""
    return "" if _has_hand(select, robot) else "no hand of it is stated (rt:hasEndEffector)"


def _handless(select: Select, robots: Sequence[tuple[str, str]], wording: Wording) -> str:
    """Return that no robot has a stated hand, as no other remedy helps then; "" if one has."""
    if any(_has_hand(select, robot) for robot, _ in robots):
        return ""
    names = [wording.name(robot) for robot, _ in robots[:_MAX_ROBOTS]]
    return f"no hand of {' or '.join(names)} is stated (rt:hasEndEffector)" if names else ""


def _has_hand(select: Select, robot: str, hand: str = "") -> bool:
    """Return whether a robot is stated to have a hand; by default any."""
    end = str(NamedNode(hand)) if hand else "?hand"
    return bool(select(
        f"{PREFIXES}SELECT ?robot {{ VALUES ?robot {{ {NamedNode(robot)} }} "
        f"?robot rt:hasEndEffector {end} }} LIMIT 1"
    ))  # fmt: skip


def _remedy(select: Select, obstacle: Obstacle, wording: Wording) -> str:
    reasons = _reasons(select, obstacle.missing, wording)
    data = " . ".join(
        " ".join(str(NamedNode(part)) for part in statement)
        for atom in obstacle.missing
        # That a robot can grasp something follows from sizes and masses; stated, it would only hide
        # what is missing.
        if (statement := statement_of(atom)) is not None and statement[1] != RT.canGrasp.value
    )
    how = f"; if so, state it: rtask update 'INSERT DATA {{ {data} }}'" if data else ""
    lacks = [
        _why_no_grasp(select, statement[0], statement[2], wording).remedy
        for atom in obstacle.missing
        if (statement := statement_of(atom)) is not None
        and statement[1] == RT.canGrasp.value
        # Where the goal names the very hand, another robot is no remedy.
        and not _has_hand(select, statement[0], obstacle.goal[0][-1])
    ]
    how += "".join(f"; {lack}" for lack in dict.fromkeys(lacks) if lack)
    how += "".join(
        f"; {advice}" for atom in obstacle.missing if (advice := mended_by(select, atom, wording))
    )
    over = [
        f"{NamedNode(subject)} a {NamedNode(kind)}"
        for atom in obstacle.missing
        if (excluded := excluded_by(atom)) is not None
        for subject, kind in _stated(select, *excluded)
    ] + [
        " ".join(str(NamedNode(part)) for part in link)
        for atom in obstacle.missing
        if (link := excluded_link(atom)) is not None and not is_measured(select, link)
    ]
    if over:
        # Each for itself: a robot says of its own hand in its own graph, a person of the box.
        updates = "; ".join(f"DELETE WHERE {{ GRAPH ?g {{ {item} }} }}" for item in over)
        how += f"; once that is over, withdraw it: rtask update '{updates}'"
    return f"it would be possible, were it not that {reasons}{how}"


def _stated(select: Select, subject: str, kind: str) -> list[tuple[str, str]]:
    """Return whose state it is: of a robot that is out of order, for what its hands are with it."""
    node, cls = NamedNode(subject), NamedNode(kind)
    rows = select(f"{PREFIXES}SELECT DISTINCT ?x {{ ?x rt:hasEndEffector {node} ; a {cls} }}")
    return [(str(row.value("x")), kind) for row in rows] or [(subject, kind)]


def _reasons(select: Select, missing: Iterable[Atom], wording: Wording) -> str:
    return " and ".join(_reason(select, atom, wording) for atom in missing)


def _reason(select: Select, atom: Atom, wording: Wording) -> str:
    statement = statement_of(atom)
    excluded = excluded_by(atom)
    measured = measures_in_words(select, atom, wording)
    if measured:
        return measured
    if excluded is not None:
        name, label = wording.name(excluded[0]), wording.labels.get(excluded[1])
        return f"{name} is {label or local_name(excluded[1])}"
    link = excluded_link(atom)
    if link is not None:
        label = wording.labels.get(link[1]) or local_name(link[1])
        return f"{wording.name(link[0])} is {label} {wording.name(link[2])}"
    if statement is None:
        words = wording.atom(atom)
        if words.startswith("nothing is "):
            return "something is " + words.removeprefix("nothing is ")
        return f"it does not hold that {words}"
    if statement[1] != RT.canGrasp.value:
        return f"it is not known that {wording.atom(atom)}"
    return _why_no_grasp(select, statement[0], statement[2], wording).reason


class _GraspLack(NamedTuple):
    """Why a robot cannot grasp a thing, and what would mend it; "" where that is not known."""

    reason: str
    remedy: str = ""


def _why_no_grasp(select: Select, robot: str, exemplar: str, wording: Wording) -> _GraspLack:
    """Return which of the conditions of ``rt:canGrasp`` fails for a robot, with its numbers."""
    what, who = str(NamedNode(exemplar)), str(NamedNode(robot))
    row = select(PREFIXES + _LIMITS % (who, what, what, what))[0]
    widest, narrowest, strongest, width, mass = (
        float(value) if isinstance(value, int | float) else None
        for value in (row.value(name) for name in _LIMIT_NAMES)
    )
    name, owner = wording.name(exemplar), wording.name(robot)
    unknown = [of for of, value in (("graspWidth", width), ("mass", mass)) if value is None]
    listed = " and ".join(f"rt:{of}" for of in unknown)
    remedy = f"once measured, state {listed} of its product, in m and kg" if unknown else ""
    # Sizes before masses: a weight is no reason for what no hand goes around.
    if width is None:
        of = "width" if mass is not None else "width and the mass"
        return _GraspLack(f"the {of} of {name} {'are' if mass is None else 'is'} not known", remedy)
    if widest is not None and width >= widest:
        return _GraspLack(
            f"{name} is {1000 * width:.0f} mm wide, and no hand of {owner} opens beyond "
            f"{1000 * widest:.0f} mm",
            f"a robot there with a hand that opens beyond {1000 * width:.0f} mm would",
        )
    if mass is None:
        return _GraspLack(f"nobody has stated what {name} weighs, or lifted it", remedy)
    if strongest is not None and mass > strongest:
        return _GraspLack(
            f"{name} may weigh {mass:.2f} kg, and no hand of {owner} lifts more than "
            f"{strongest:.2f} kg",
            f"a robot there with a hand that lifts {mass:.2f} kg would",
        )
    if width < (narrowest or 0.0):
        return _GraspLack(
            f"{name} is {1000 * width:.1f} mm wide, and no hand of {owner} closes below "
            f"{1000 * (narrowest or 0.0):.1f} mm",
            f"a robot there with a hand that closes to {1000 * width:.1f} mm would",
        )
    # What nobody has stated of a hand is not known to be enough.
    limits = {"minOpening": narrowest, "maxOpening": widest, "maxPayload": strongest}
    lacking = " and ".join(f"rt:{of}" for of, value in limits.items() if value is None)
    if lacking:
        return _GraspLack(
            f"nobody has stated {lacking} of a hand of {owner}",
            f"once known, state {lacking} of that hand, in m and kg",
        )
    return _GraspLack(
        f"no one hand of {owner} is known to grasp what is {1000 * width:.0f} mm wide and weighs "
        f"{mass:.2f} kg"
    )
