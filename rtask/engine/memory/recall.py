"""One query of the graph about recognised objects.

The answer contains the objects, their grasps with the outcomes of every robot, the attempts of the
asking robot, and the viewpoints and pictures of stored views.
"""

from __future__ import annotations

import datetime as dt
import logging
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.candidate import Contacts
from grasp.spatial.frames import closing_yaw, matrix_from_pose
from rtask.engine.memory.question import Question, query_text
from rtask.engine.remembered import Memory, Remembered, RememberedObject, Tally, Trial
from rtask.rdf.namespaces import RT, local_name

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore
    from rtask.sparql.results import Row, Solutions

__all__ = ["recall"]

log = logging.getLogger(__name__)

_NUMBERS = ("x", "y", "z", "opening", "quality")


def recall(kb: GraphCore, question: Question) -> Memory:
    """Return the graph's answer to a question; one query."""
    if not (question.objects or question.classes or question.views):
        return Memory()
    return _memory(kb.select(query_text(question)), question)


def _memory(rows: Solutions, question: Question) -> Memory:
    parts: dict[str, list[Row]] = {
        name: [] for name in ("object", "grasp", "contact", "tally", "fast", "trial", "view")
    }
    for row in rows:
        parts[str(row.value("part"))].append(row)
    return Memory(
        objects=_objects(parts["object"]),
        grasps=_grasps(
            parts["grasp"],
            _tallies(parts["tally"], parts["fast"], question),
            _contacts(parts["contact"]),
        ),
        trials=_episode(parts["trial"]),
        viewpoints={
            _text(row, "view"): _pose(row) for row in parts["view"] if row["qw"] is not None
        },
        pictures={
            view: digest
            # Backwards, so that of several pictures of a view the first digest is the one that
            # remains.
            for view, digest in sorted(
                ((_text(row, "view"), _text(row, "sha")) for row in parts["view"]), reverse=True
            )
            if digest
        },
    )


def _text(row: Row, name: str) -> str:
    value = row.value(name)
    return "" if value is None else str(value)


def _number(row: Row, name: str, default: float = 0.0) -> float:
    value: Any = row.value(name)
    return default if value is None else float(value)


def _orientation(row: Row) -> tuple[float, tuple[float, float, float, float] | None]:
    """Return the closing direction about z and, of a grasp in space, the quaternion."""
    if row["qw"] is None:
        return _number(row, "theta"), None
    x, y, z, w = (_number(row, "q" + name) for name in "xyzw")
    return closing_yaw(matrix_from_pose(np.zeros(3), np.array([x, y, z, w]))), (x, y, z, w)


def _size(row: Row) -> tuple[float, float, float] | None:
    if any(row[name] is None for name in ("length", "width", "height")):
        return None
    return _number(row, "length"), _number(row, "width"), _number(row, "height")


def _pose(row: Row) -> NDArray[np.float64]:
    position = np.array([_number(row, name) for name in "xyz"])
    quaternion = np.array([_number(row, "q" + name) for name in "xyzw"])
    return np.asarray(matrix_from_pose(position, quaternion), dtype=np.float64)


def _objects(rows: Iterable[Row]) -> dict[str, RememberedObject]:
    grouped: dict[str, list[Row]] = {}
    for row in rows:
        grouped.setdefault(_text(row, "object"), []).append(row)
    return {iri: _object(iri, grouped[iri]) for iri in sorted(grouped)}


def _object(iri: str, mine: list[Row]) -> RememberedObject:
    """Combine the rows of one object, with the most specific of several classes."""
    classes: dict[str, set[str]] = {}
    for row in mine:
        if row["class"] is not None:
            classes.setdefault(_text(row, "class"), set()).add(_text(row, "above"))
    # The class with most classes above it is the most specific; the IRI settles ties, whatever the
    # order of rows.
    best = min(classes, key=lambda c: (-len(classes[c] - {""}), c), default="")
    labels = sorted(_text(r, "label") for r in mine if best and _text(r, "class") == best)
    shorts = sorted(_text(r, "short") for r in mine if best and _text(r, "class") == best)
    names = sorted(_text(row, "name") for row in mine)
    sizes = sorted(size for row in mine if (size := _size(row)) is not None)
    orders = {_number(row, "order") for row in mine if row["order"] is not None}
    name = names[0] if names else ""
    return RememberedObject(
        iri=iri,
        name=name,
        class_iri=best or RT.ManipulableObject.value,
        label=name or (labels[0] if labels and labels[0] else local_name(best) if best else ""),
        short_id=shorts[0] if shorts else "",
        size=sizes[0] if sizes else None,
        is_round=0.0 in orders,
    )


Key = tuple[str, str, bool]


def _key(row: Row) -> Key:
    return _text(row, "object"), _text(row, "grasp"), bool(row.value("of_class"))


def _tallies(
    rows: Iterable[Row], fast_rows: Iterable[Row], question: Question
) -> dict[Key, list[Tally]]:
    """Return the counts of each grasp, apart those in coarse physics and of robots in doubt."""

    def teller(row: Row) -> str:
        return _text(row, "by") if question.weighs_robots else ""

    fast = {
        (_key(row), row.value("held"), bool(row.value("lost")), teller(row)): int(_number(row, "n"))
        for row in fast_rows
    }
    tallies: dict[Key, list[Tally]] = {}
    for row in rows:
        key, held, lost = _key(row), bool(row.value("held")), bool(row.value("lost"))
        latest = row.value("latest")
        when = None if latest is None else dt.datetime.fromisoformat(str(latest))
        by = teller(row)
        in_fast = fast.get((key, held, lost, by), 0)
        # The query counts all attempts, and those in coarse physics again.
        for count, is_fast in ((int(_number(row, "n")) - in_fast, False), (in_fast, True)):
            if count:
                weight = question.doubts.get(by, 1.0)
                tallies.setdefault(key, []).append(
                    Tally(held, count, is_fast, when, by, weight, lost)
                )
    return tallies


def _contacts(rows: Iterable[Row]) -> dict[str, Contacts | None]:
    """Return the contacts of grasps by cups and three fingers, None where they make no sense."""
    grouped: dict[str, dict[int, Row]] = {}
    for row in rows:
        grouped.setdefault(_text(row, "grasp"), {})[int(_number(row, "number"))] = row
    contacts: dict[str, Contacts | None] = {}
    for grasp, by_number in grouped.items():
        mine = [by_number[number] for number in sorted(by_number)]
        is_cup = _text(mine[0], "mode") == RT.SuctionGrasp.value
        try:
            contacts[grasp] = Contacts(
                "suction" if is_cup else "three_fingers",
                np.array([[_number(row, name) for name in "xyz"] for row in mine]),
                np.array([[_number(row, "n" + name) for name in "xyz"] for row in mine]),
                _number(mine[0], "seal") if is_cup else None,
            )
        except ValueError as error:
            log.warning("%s is left out: %s", grasp, error)
            # Left out with a warning: one grasp of a careless robot must not fail the recall of
            # all.
            contacts[grasp] = None
    return contacts


def _grasps(
    rows: Iterable[Row],
    tallies: Mapping[Key, list[Tally]],
    contacts: Mapping[str, Contacts | None],
) -> tuple[Remembered, ...]:
    """Combine grasps with their tallies, ordered by geometry for reproducibility."""
    latest: dict[Key, Row] = {}
    # Robots may have measured an object differently; the smaller size is used, whatever the order.
    for row in sorted(rows, key=lambda row: _size(row) or ()):
        latest.setdefault(_key(row), row)
    grasps = [
        replace(_remembered(key, row, tallies.get(key, [])), contacts=contacts.get(key[1]))
        for key, row in latest.items()
        if key[1] not in contacts or contacts[key[1]] is not None
    ]
    return tuple(sorted(grasps, key=lambda g: (g.of_class, g.x, g.y, g.z, g.theta, g.grasp)))


def _remembered(key: Key, row: Row, tallies: list[Tally]) -> Remembered:
    iri, grasp, of_class = key
    x, y, z, opening, quality = (_number(row, name) for name in _NUMBERS)
    theta, quaternion = _orientation(row)
    order = sorted(tallies, key=lambda t: (t.held, t.lost, t.is_fast, t.count, t.robot))
    return Remembered(
        grasp, iri, of_class, x, y, z, theta, opening, quality,
        _text(row, "gripper"), _size(row), tuple(order),
        None if row["quality"] is None else min(max(quality, 0.0), 1.0),
        quaternion, None if row["contact"] is None else _number(row, "contact"),
    )  # fmt: skip


def _episode(rows: Iterable[Row]) -> tuple[Trial, ...]:
    """Return the attempts of the current episode: the last series numbered 1, 2, 3 ...

    An episode that ended with the object held is over, so it is never the current one.
    """
    trials = {
        _text(row, "attempt"): Trial(
            _text(row, "grasp"), _number(row, "x"), _number(row, "y"), _number(row, "z"),
            _orientation(row)[0], bool(row.value("held")), int(_number(row, "number")),
            _text(row, "ended"), bool(row.value("is_fast")), _orientation(row)[1],
            bool(row.value("lost")),
        )
        for row in rows
    }  # fmt: skip
    # From the newest back: a success, or a number that does not fall, ends the episode.
    newest_first = sorted(trials.values(), key=lambda t: (t.ended, t.number), reverse=True)
    run: list[Trial] = []
    for trial in newest_first:
        if trial.held or (run and trial.number >= run[-1].number):
            break
        run.append(trial)
    return tuple(reversed(run))
