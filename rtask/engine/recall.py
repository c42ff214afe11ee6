"""Ask the graph once: everything a decision needs, in one SPARQL query (Gatto 2016, 3.2.4).

What recognition found goes in as ``VALUES``; out come the objects, their grasps with every
outcome of every robot, what this robot just tried, and where stored views were taken from.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.frames import matrix_from_pose
from rtask.engine.vocabulary import PREFIXES, RT, local_name, reason, values

if TYPE_CHECKING:
    from rtask.kb.knowledge_base import KnowledgeBase
    from rtask.kb.results import Row, Solutions

__all__ = [
    "UNJUDGED",
    "KnownObject",
    "Memory",
    "Question",
    "Remembered",
    "Tally",
    "Trial",
    "recall",
]

UNJUDGED = (
    "timed_out", "stopped_by_human", "hardware",
    "no_match", "low_recognition", "wrong_object", "pose_unknown", "low_pose",
    "no_grasp", "low_grasp",
    "ik", "tilt", "grasp_collision", "approach_ik", "approach_collision", "pregrasp_collision",
    "lift_ik", "rrt_start", "rrt_goal", "rrt_time", "tracking",
)  # fmt: skip
"""Reasons that say something about the robot, the place or the day, not about the grasp.

Such attempts are stored like all others and count in no statistics: that one arm could not reach
an object where it stood teaches nothing about taking hold of it elsewhere."""

_NOBODY = "urn:rtask:nobody"
_NUMBERS = ("x", "y", "z", "theta", "opening", "quality", "length", "width", "height")


@dataclass(frozen=True)
class Question:
    """What a decision wants to know.

    Parameters
    ----------
    objects
        IRIs that recognition or tracking gave.
    classes
        IRIs of kinds of objects whose members may teach something.
    size
        (length, width, height), m, of the object in question.
    tracked
        The object that the robot is in the middle of handling, if any.
    robot
        Who asks, for its own attempts on ``tracked``.
    views
        Stored views whose viewpoints are needed.
    only
        Classes to one of which an object must belong; empty = any.
    """

    objects: tuple[str, ...] = ()
    classes: tuple[str, ...] = ()
    size: tuple[float, float, float] | None = None
    size_tolerance: float = 1.5
    tracked: str | None = None
    robot: str | None = None
    views: tuple[str, ...] = ()
    only: tuple[str, ...] = ()


@dataclass(frozen=True)
class Tally:
    """Judged attempts of one grasp that ended alike."""

    held: bool
    count: int
    preset: str = ""
    latest: dt.datetime | None = None


@dataclass(frozen=True)
class Remembered:
    """A grasp in the graph.

    Parameters
    ----------
    x, y, z, theta
        In the frame of its object, m and rad.
    of_class
        It comes from another object of the class, not from the object itself.
    size
        (length, width, height) of its object, m.
    """

    grasp: str
    object: str
    of_class: bool
    x: float
    y: float
    z: float
    theta: float
    opening: float
    quality: float
    gripper_type: str
    size: tuple[float, float, float] | None
    tallies: tuple[Tally, ...] = ()

    @property
    def attempts(self) -> int:
        """Judged attempts of all robots."""
        return sum(tally.count for tally in self.tallies)

    @property
    def successes(self) -> int:
        """Those that held."""
        return sum(tally.count for tally in self.tallies if tally.held)


@dataclass(frozen=True)
class Trial:
    """An attempt of this robot on the tracked object."""

    grasp: str
    x: float
    y: float
    z: float
    theta: float
    held: bool
    number: int
    ended: str
    preset: str = ""


@dataclass(frozen=True)
class KnownObject:
    """What the graph says about an object."""

    iri: str
    name: str = ""
    class_iri: str = ""
    label: str = ""
    short_id: str = ""
    size: tuple[float, float, float] | None = None
    is_round: bool = False


@dataclass(frozen=True)
class Memory:
    """The answer to a :class:`Question`."""

    objects: Mapping[str, KnownObject] = field(default_factory=dict)
    grasps: tuple[Remembered, ...] = ()
    trials: tuple[Trial, ...] = ()
    viewpoints: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def of(self, iri: str) -> list[Remembered]:
        """Return the grasps of one object."""
        return [g for g in self.grasps if g.object == iri and not g.of_class]


def recall(kb: KnowledgeBase, question: Question) -> Memory:
    """Ask the graph once."""
    if not (question.objects or question.classes or question.views):
        return Memory()
    return _memory(kb.select(query_text(question)), question)


def query_text(question: Question) -> str:
    """Return the query of a decision.

    Each part leaves the other parts' variables unbound; ``?part`` tells the rows apart.
    """
    objects = values(question.objects)
    unjudged = ", ".join(str(reason(code)) for code in UNJUDGED)
    who = f"{{ VALUES ?object {{ {objects} }} BIND(false AS ?of_class) }}"
    if question.classes and question.size is not None:
        who += " UNION " + _members(question)
    return f"""{PREFIXES}
SELECT * WHERE {{
  {{ VALUES ?object {{ {objects} }} BIND("object" AS ?part)
     ?object a rt:ManipulableObject {_only(question)}
     OPTIONAL {{ ?object rt:name ?name }}
     OPTIONAL {{ ?object rt:extentX ?length ; rt:extentY ?width ; rt:extentZ ?height }}
     OPTIONAL {{ ?object rt:hasSymmetry/rt:symmetryOrder ?order }}
     OPTIONAL {{ ?object a ?class . ?class rdfs:subClassOf rt:ManipulableObject
       FILTER(?class != rt:ManipulableObject && isIRI(?class))
       OPTIONAL {{ ?class rdfs:label ?label }} OPTIONAL {{ ?class rt:shortId ?short }}
       OPTIONAL {{ ?class rdfs:subClassOf ?above . ?above rdfs:subClassOf rt:ManipulableObject
         FILTER(?above != ?class && isIRI(?above)) }} }} }}
  UNION
  {{ SELECT ("grasp" AS ?part) ?object ?of_class ?grasp ?gripper ?x ?y ?z ?theta ?opening ?quality
       ?length ?width ?height ?held ?preset
       (COUNT(DISTINCT ?attempt) AS ?n) (MAX(?ended) AS ?latest)
     WHERE {{
       {who}
       ?object rt:hasGrasp ?grasp . ?grasp rt:gripperType ?gripper ; rt:graspPose ?pose .
       ?pose rt:inFrame ?frame ; rt:x ?x ; rt:y ?y ; rt:z ?z ; rt:theta ?theta .
       ?owner rt:bodyFrame ?frame
       OPTIONAL {{ ?object rt:extentX ?length ; rt:extentY ?width ; rt:extentZ ?height }}
       OPTIONAL {{ ?grasp rt:jawOpening ?opening }} OPTIONAL {{ ?grasp rt:graspQuality ?quality }}
       OPTIONAL {{ {_attempt(unjudged)} }} }}
     GROUP BY ?object ?of_class ?grasp ?gripper ?x ?y ?z ?theta ?opening ?quality
       ?length ?width ?height ?held ?preset }}
  UNION
  {{ BIND("trial" AS ?part) VALUES ?object {{ {values([question.tracked or _NOBODY])} }}
     ?object rt:hasGrasp ?grasp . ?grasp rt:graspPose ?pose .
     ?pose rt:x ?x ; rt:y ?y ; rt:z ?z ; rt:theta ?theta .
     {_attempt(unjudged)}
     ?attempt rt:performedBy {values([question.robot or _NOBODY])} ; rt:attemptNumber ?number }}
  UNION
  {{ VALUES ?view {{ {values(question.views)} }} BIND("view" AS ?part)
     ?view rt:viewpoint ?p . ?p rt:x ?x ; rt:y ?y ; rt:z ?z ;
       rt:qx ?qx ; rt:qy ?qy ; rt:qz ?qz ; rt:qw ?qw }}
}}"""


def _attempt(unjudged: str) -> str:
    """Return the pattern of a judged attempt of ``?grasp``: ?attempt ?held ?preset ?ended."""
    return f"""?attempt rt:executesGrasp ?grasp ; prov:endedAtTime ?ended ; rt:hasOutcome ?outcome .
       ?outcome rt:hasReason ?reason ; rt:success ?decided
       OPTIONAL {{ ?outcome rt:judgedSuccess ?verdict }}
       OPTIONAL {{ ?outcome rt:hasFeedback/rt:preset ?preset }}
       BIND(COALESCE(?verdict, ?decided) AS ?held)
       FILTER(?verdict != ?decided || ?reason NOT IN ({unjudged}))"""


def _only(question: Question) -> str:
    if not question.only:
        return ""
    return f"FILTER EXISTS {{ VALUES ?wanted {{ {values(question.only)} }} ?object a ?wanted }}"


def _members(question: Question) -> str:
    """Return the pattern of other objects of the classes that are about as large."""
    assert question.size is not None
    bounds = " && ".join(
        f"?{name} > {size / question.size_tolerance:.6f} && "
        f"?{name} < {size * question.size_tolerance:.6f}"
        for name, size in zip(("l", "w", "h"), question.size, strict=True)
    )
    known = ", ".join(values([iri]) for iri in sorted(question.objects)) or f"<{_NOBODY}>"
    return f"""{{ SELECT DISTINCT ?object (true AS ?of_class) {{
         VALUES ?kind {{ {values(question.classes)} }} ?object a ?kind ; rt:extentX ?l ;
           rt:extentY ?w ; rt:extentZ ?h FILTER({bounds} && ?object NOT IN ({known})) }} }}"""


def _memory(rows: Solutions, question: Question) -> Memory:
    parts: dict[str, list[Row]] = {"object": [], "grasp": [], "trial": [], "view": []}
    for row in rows:
        parts[str(row.value("part"))].append(row)
    return Memory(
        objects=_objects(parts["object"]),
        grasps=_grasps(parts["grasp"]),
        trials=_episode(parts["trial"]),
        viewpoints={_text(row, "view"): _pose(row) for row in parts["view"]},
    )


def _text(row: Row, name: str) -> str:
    value = row.value(name)
    return "" if value is None else str(value)


def _number(row: Row, name: str, default: float = 0.0) -> float:
    value: Any = row.value(name)
    return default if value is None else float(value)


def _size(row: Row) -> tuple[float, float, float] | None:
    if any(row[name] is None for name in ("length", "width", "height")):
        return None
    return _number(row, "length"), _number(row, "width"), _number(row, "height")


def _pose(row: Row) -> NDArray[np.float64]:
    position = np.array([_number(row, name) for name in "xyz"])
    quaternion = np.array([_number(row, "q" + name) for name in "xyzw"])
    return np.asarray(matrix_from_pose(position, quaternion), dtype=np.float64)


def _objects(rows: Iterable[Row]) -> dict[str, KnownObject]:
    grouped: dict[str, list[Row]] = {}
    for row in rows:
        grouped.setdefault(_text(row, "object"), []).append(row)
    return {iri: _object(iri, grouped[iri]) for iri in sorted(grouped)}


def _object(iri: str, mine: list[Row]) -> KnownObject:
    """Join the rows of one object; of several classes the lowest in the hierarchy wins."""
    classes: dict[str, set[str]] = {}
    for row in mine:
        if row["class"] is not None:
            classes.setdefault(_text(row, "class"), set()).add(_text(row, "above"))
    best = min(classes, key=lambda c: (-len(classes[c] - {""}), c), default="")
    labels = sorted(_text(r, "label") for r in mine if best and _text(r, "class") == best)
    shorts = sorted(_text(r, "short") for r in mine if best and _text(r, "class") == best)
    names = sorted(_text(row, "name") for row in mine)
    sizes = sorted(size for row in mine if (size := _size(row)) is not None)
    orders = {_number(row, "order") for row in mine if row["order"] is not None}
    name = names[0] if names else ""
    return KnownObject(
        iri=iri,
        name=name,
        class_iri=best or RT.ManipulableObject.value,
        label=name or (labels[0] if labels and labels[0] else local_name(best) if best else ""),
        short_id=shorts[0] if shorts else "",
        size=sizes[0] if sizes else None,
        is_round=0.0 in orders,
    )


def _grasps(rows: Iterable[Row]) -> tuple[Remembered, ...]:
    """Join rows by grasp and object; the order follows geometry, not the store."""
    kept: dict[tuple[str, str, bool], tuple[Row, list[Tally]]] = {}
    # Two robots may have measured one object differently: the smaller size wins, for any order.
    for row in sorted(rows, key=lambda row: _size(row) or ()):
        key = (_text(row, "object"), _text(row, "grasp"), bool(row.value("of_class")))
        _, tallies = kept.setdefault(key, (row, []))
        count = int(_number(row, "n"))
        if row["held"] is not None and count:
            latest = row.value("latest")
            when = None if latest is None else dt.datetime.fromisoformat(str(latest))
            tally = Tally(bool(row.value("held")), count, _text(row, "preset"), when)
            if tally not in tallies:
                tallies.append(tally)
    grasps = [_remembered(key, row, tallies) for key, (row, tallies) in kept.items()]
    return tuple(sorted(grasps, key=lambda g: (g.of_class, g.x, g.y, g.z, g.theta, g.grasp)))


def _remembered(key: tuple[str, str, bool], row: Row, tallies: list[Tally]) -> Remembered:
    iri, grasp, of_class = key
    x, y, z, theta, opening, quality = (_number(row, name) for name in _NUMBERS[:6])
    order = sorted(tallies, key=lambda t: (t.held, t.preset, t.count))
    return Remembered(
        grasp, iri, of_class, x, y, z, theta, opening, quality,
        _text(row, "gripper"), _size(row), tuple(order),
    )  # fmt: skip


def _episode(rows: Iterable[Row]) -> tuple[Trial, ...]:
    """Return the attempts of the episode under way: the last run with numbers 1, 2, 3 ...

    An episode that held the object is over, so it is nobody's present one.
    """
    trials = {
        _text(row, "attempt"): Trial(
            _text(row, "grasp"), _number(row, "x"), _number(row, "y"), _number(row, "z"),
            _number(row, "theta"), bool(row.value("held")), int(_number(row, "number")),
            _text(row, "ended"), _text(row, "preset"),
        )
        for row in rows
    }  # fmt: skip
    newest_first = sorted(trials.values(), key=lambda t: (t.ended, t.number), reverse=True)
    run: list[Trial] = []
    for trial in newest_first:
        if trial.held or (run and trial.number >= run[-1].number):
            break
        run.append(trial)
    return tuple(reversed(run))
