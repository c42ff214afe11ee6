"""A made-up lab for goals in words: twelve things at six places, and where a plan leaves them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.plan import TaskPlan

__all__ = ["differences", "open_lab"]

_BASE = "https://example.org/kb/"
_ROBOTS = {"nao-1": (-0.5, 0.0), "panda-1": (1.5, 0.0)}
_PLACES = {
    "T": ("table", 0.5, 0.0), "L": ("left box", -0.2, 0.4), "R": ("right box", 1.2, 0.4),
    "S": ("shelf", 0.5, 1.0), "Y": ("tray", 0.0, -0.5), "Z": ("tray", 1.0, -0.5),
}  # fmt: skip
"""Letter for lists of goals, name and position in m."""
_OUT_OF_REACH = {("nao-1", "Z"), ("panda-1", "Y")}


class _Thing(NamedTuple):
    """One thing of the lab; mass in kg, sizes and position in m, when it was seen in minutes."""

    kind: str
    colour: str
    place: str
    mass: float
    material: str
    is_fragile: bool
    width: float
    height: float
    position: tuple[float, float]
    seen: int
    before: str = ""


_THINGS = {
    "cup-1": _Thing("Cup", "red", "T", .1, "glass", True, .06, .08, (.40, .05), 10, "S"),
    "cup-2": _Thing("Cup", "blue", "T", .15, "plastic", False, .07, .10, (.60, .00), 42),
    "cup-3": _Thing("Cup", "green", "R", .12, "glass", False, .065, .09, (1.15, .40), 25),
    "cup-4": _Thing("Cup", "red", "S", .2, "metal", False, .075, .12, (.45, 1.00), 5),
    "can-1": _Thing("Can", "blue", "T", .35, "metal", False, .05, .11, (.70, .10), 12, "L"),
    "can-2": _Thing("Can", "red", "R", .4, "metal", False, .052, .12, (1.25, .42), 30),
    "bottle-1": _Thing("Bottle", "green", "T", .6, "glass", True, .07, .25, (.50, -.10), 8),
    "bottle-2": _Thing("Bottle", "white", "R", .3, "plastic", False, .06, .22, (1.20, .45), 50),
    "jug": _Thing("Bottle", "", "L", 1.0, "ceramic", False, .085, .30, (-.20, .42), 3),
    "pen-1": _Thing("Pen", "black", "T", .02, "plastic", False, .01, .01, (.35, -.05), 20),
    "pen-2": _Thing("Pen", "red", "L", .03, "metal", False, .012, .012, (-.25, .38), 33),
    "ball-1": _Thing("Ball", "yellow", "S", .05, "rubber", False, .06, .06, (.55, 1.00), 17),
}  # fmt: skip
_BOWLS = {
    "bowl-1": _Thing("Bowl", "white", "Y", .25, "ceramic", True, .09, .06, (.05, -.50), 15),
    "bowl-2": _Thing("Bowl", "brown", "Z", .22, "wood", False, .09, .05, (1.05, -.50), 22),
}  # fmt: skip
"""Only in the wide lab: each is within reach of one robot alone."""
_OWNERS = {"cup-3": "Anna", "pen-1": "Ben", "bottle-2": "Ben"}
_OWNER = "https://schema.org/owner"
_ALL = {**_THINGS, **_BOWLS}
_NUMBERS = {name: number for number, name in enumerate(_ALL, 1)}
_LETTERS = {f"{_BASE}place/{letter}": letter for letter in _PLACES}
_NAMES = {f"{_BASE}thing/{number}": name for name, number in _NUMBERS.items()}


def open_lab(*, is_wide: bool = False) -> KnowledgeBase:
    """Return a graph in memory with the lab.

    Parameters
    ----------
    is_wide
        With two bowls more, and with owners.
    """
    graph = rtask.open(":memory:", base=_BASE)
    assert isinstance(graph, KnowledgeBase)
    things = _ALL if is_wide else _THINGS
    rows = [*_robots(), *_places(), *(row for name in things for row in _statements(name))]
    rows += _wide() if is_wide else ()
    graph.update(f"{PREFIXES} INSERT DATA {{ GRAPH <{_BASE}graph/shared> {{ {' '.join(rows)} }} }}")
    return graph


def _robots() -> Iterator[str]:
    for name, (x, y) in _ROBOTS.items():
        robot = f"{_BASE}robot/{name}"
        yield (
            f'<{robot}> a cora:Robot ; rt:name "{name}" ; rt:hasEndEffector <{robot}/hand> ; '
            f"rt:bodyFrame <{_BASE}frame/{name}> . "
            f'<{robot}/hand> a rt:Hand ; rt:name "{name} hand" ; '
            f'rt:gripperType "{name}_hand" ; rt:minOpening 0.0e0 ; rt:maxOpening 0.1e0 ; '
            f"rt:maxPayload 3.0e0 . {_frame(name, x, y)}"
        )


def _places() -> Iterator[str]:
    yield f'<{_BASE}frame/map> a rt:Frame ; rt:frameId "map" .'
    for letter, (name, x, y) in _PLACES.items():
        place = f"{_BASE}place/{letter}"
        yield f'<{place}> a rt:SupportSurface ; rt:name "{name}" ; rt:bodyFrame '
        yield f"<{_BASE}frame/{letter}> . {_frame(letter, x, y)}"
        for robot in _ROBOTS:
            if (robot, letter) not in _OUT_OF_REACH:
                yield f"<{_BASE}robot/{robot}> rt:reaches <{place}> ."


def _wide() -> Iterator[str]:
    yield f'<{_BASE}Bowl> a owl:Class ; rdfs:subClassOf rt:Container ; rdfs:label "bowl"@en .'
    for name, owner in _OWNERS.items():
        person = f"<{_BASE}person/{owner}>"
        yield f'{person} rt:name "{owner}" . <{_BASE}thing/{_NUMBERS[name]}> <{_OWNER}> {person} .'


def _frame(name: str, x: float, y: float) -> str:
    frame = f"{_BASE}frame/{name}"
    return (
        f'<{frame}> a rt:Frame ; rt:frameId "{name}" ; rt:parentFrame <{_BASE}frame/map> ; '
        f"rt:poseInParent <{frame}/pose> . {_pose(f'{frame}/pose', x, y)}"
    )


def _pose(iri: str, x: float, y: float) -> str:
    return (
        f"<{iri}> a rt:Pose ; rt:inFrame <{_BASE}frame/map> ; rt:x {x}e0 ; rt:y {y}e0 ; "
        "rt:z 0.0e0 ; rt:qx 0.0e0 ; rt:qy 0.0e0 ; rt:qz 0.0e0 ; rt:qw 1.0e0 ."
    )


def _statements(name: str) -> Iterator[str]:
    thing, number = _ALL[name], _NUMBERS[name]
    product = f"<{_BASE}object/{number}>"
    kind = f"<{_BASE}Bowl>" if thing.kind == "Bowl" else f"rt:{thing.kind}"
    yield (
        f'{product} a {kind} ; rt:objectId "lab/{number}" ; rt:name "{name}" ; '
        f"rt:graspWidth {thing.width}e0 ; rt:extentX {thing.width}e0 ; rt:extentY "
        f"{thing.width}e0 ; rt:extentZ {thing.height}e0 ; rt:mass {thing.mass}e0 ; "
        f'rt:surfaceMaterial "{thing.material}" .'
    )
    if thing.colour:
        yield f"{product} rt:hasColour rt:colour_{thing.colour} ."
    if thing.is_fragile:
        yield f"{product} rt:hasTrait rt:zone_fragile ."
    yield f"<{_BASE}thing/{number}> a rt:Exemplar ; rt:exemplarOf {product} ."
    if thing.before:
        yield _placement(number, thing.before, "2025-01-01T10:00:00Z", "2026-01-01T10:00:00Z")
    now = _placement(number, thing.place, f"2026-01-01T10:{thing.seen:02}:00Z")
    at = f"{_BASE}placement/{number}-{thing.place}"
    yield f"{now} <{at}> rt:placementPose <{at}/pose> . {_pose(f'{at}/pose', *thing.position)}"


def _placement(number: int, place: str, begin: str, end: str = "") -> str:
    at = f"{_BASE}placement/{number}-{place}"
    stamp = "^^xsd:dateTimeStamp"
    text = (
        f"<{at}> a rt:Placement ; rt:placementOf <{_BASE}thing/{number}> ; rt:placedOn "
        f"<{_BASE}place/{place}> ; time:hasBeginning <{at}/b> . <{at}/b> "
        f'time:inXSDDateTimeStamp "{begin}"{stamp} .'
    )
    if end:
        text += f'<{at}> time:hasEnd <{at}/e> . <{at}/e> time:inXSDDateTimeStamp "{end}"{stamp} .'
    return text


def differences(expected: str, plan: TaskPlan) -> list[str]:
    """Return in what a plan does other than what its writer wanted; empty if in nothing.

    Parameters
    ----------
    expected
        ``THINGS > PLACES``, with letters of places, ``!T`` for anywhere but there, ``H`` for a hand
        and ``2 of THINGS`` for so many; with ``;`` between goals and ``then`` between what comes in
        order. What is not named is to stay. ``by nao-1``: it does all steps; ``not jug pen-1``: no
        step is about these.
    """
    at, first, last = _moved(plan)
    may_move: set[str] = set()
    wrong: list[str] = []
    before = 0
    for stage in expected.split(" then "):
        touched: set[str] = set()
        for part in filter(None, (part.strip() for part in stage.split(";"))):
            if part == "-":
                continue
            if part.startswith(("by ", "not ")):
                wrong += _breaches(part, plan)
                continue
            match = re.fullmatch(r"(?:(\d+) of )?(.*) > (.*)", part)
            assert match is not None, part
            names, where = match[2].split(), match[3].split()
            may_move.update(names)
            touched.update(names)
            good = [name for name in names if _is_there(at[name], where)]
            number = int(match[1]) if match[1] else len(names)
            there = [name for name in names if _is_there(_ALL[name].place, where)]
            if len(good) != number and not len(good) == len(there) >= number:
                wrong.append(f"{len(good)} of {names} at {where}, not {number}")
        starts = [first[name] for name in touched if name in first]
        if starts and min(starts) < before:
            wrong.append("order")
        before = max([before, *(last[name] for name in touched if name in last)])
    moved = {name for name in _ALL if at[name] != _ALL[name].place}
    return wrong + [f"moved also {name}" for name in sorted(moved - may_move)]


def _breaches(part: str, plan: TaskPlan) -> Iterator[str]:
    """Yield the steps that are done by somebody else, or are about what is not to be touched."""
    rule, *names = part.split()
    for step in plan.steps:
        if rule == "by" and {f"{_BASE}robot/{name}" for name in names} != set(step.robots):
            yield f"{part}: {step.text}"
        about = {_NAMES[value] for value in step.arguments.values() if value in _NAMES}
        if rule == "not" and about.intersection(names):
            yield f"{part}: {step.text}"


def _is_there(place: str, where: list[str]) -> bool:
    return any(place != name[1:] if name[0] == "!" else place == name for name in where)


def _moved(plan: TaskPlan) -> tuple[dict[str, str], dict[str, int], dict[str, int]]:
    """Return where each thing is after a plan, and its first and last step."""
    at = {name: thing.place for name, thing in _ALL.items()}
    first: dict[str, int] = {}
    last: dict[str, int] = {}
    for step in plan.steps:
        values = list(step.arguments.values())
        name = next(_NAMES[value] for value in values if value in _NAMES)
        places = [_LETTERS[value] for value in values if value in _LETTERS]
        is_put = step.action.rsplit("#")[-1].lower().startswith(("plac", "put"))
        at[name] = places[0] if is_put else "H"
        first.setdefault(name, step.number)
        last[name] = step.number
    return at, first, last
