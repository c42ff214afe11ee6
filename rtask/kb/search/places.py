"""Spatial index of poses in their frames (SQLite R*Tree, Beckmann et al. 1990)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pyoxigraph import Literal, NamedNode, Quad

import ontology
from rtask.errors import UsageError
from rtask.kb.store.graph_store import GraphStore

if TYPE_CHECKING:
    import sqlite3

__all__ = ["Place", "PlaceTable"]

_X, _Y, _Z = (NamedNode(ontology.NS + name) for name in "xyz")
_IN_FRAME = NamedNode(ontology.NS + "inFrame")


@dataclass(frozen=True)
class Place:
    """A pose near a point.

    Parameters
    ----------
    pose
        IRI of the pose, or of another individual with coordinates and a frame.
    point
        (3,) x, y, z in metres, in the frame of the query.
    distance
        Distance from the query point, in metres.
    """

    pose: NamedNode
    point: tuple[float, float, float]
    distance: float


class PlaceTable:
    """Table of the coordinates of poses; a planar pose has z = 0.

    Parameters
    ----------
    store
        Store from which the remaining coordinates of a pose are read when one changes.
    """

    predicates = frozenset({_X, _Y, _Z, _IN_FRAME})

    def __init__(self, store: GraphStore) -> None:
        self._store = store

    def create(self, db: sqlite3.Connection) -> None:
        """Create missing tables."""
        db.execute("CREATE TABLE IF NOT EXISTS frames(id INTEGER PRIMARY KEY, iri TEXT UNIQUE)")
        db.execute(
            "CREATE TABLE IF NOT EXISTS poses(id INTEGER PRIMARY KEY, iri TEXT UNIQUE, "
            "x REAL, y REAL, z REAL)"
        )
        # coordinates in the tree are 32-bit, rounded outwards; the exact ones are in poses
        db.execute(
            "CREATE VIRTUAL TABLE IF NOT EXISTS places USING rtree("
            "id, f0, f1, x0, x1, y0, y1, z0, z1)"
        )

    def fill(self, db: sqlite3.Connection, quads: Iterator[Quad]) -> None:
        """Rebuild the table."""
        db.execute("DELETE FROM places")
        db.execute("DELETE FROM poses")
        for quad in quads:
            if quad.predicate == _IN_FRAME and isinstance(quad.subject, NamedNode):
                self._put(db, quad.subject)

    def change(self, db: sqlite3.Connection, removed: list[Quad], added: list[Quad]) -> None:
        """Update the poses that a commit touched."""
        for subject in {quad.subject for quad in (*removed, *added)}:
            if isinstance(subject, NamedNode):
                self._put(db, subject)

    def _put(self, db: sqlite3.Connection, subject: NamedNode) -> None:
        existing = db.execute("SELECT id FROM poses WHERE iri = ?", (subject.value,)).fetchone()
        if existing is not None:
            db.execute("DELETE FROM places WHERE id = ?", existing)
            db.execute("DELETE FROM poses WHERE id = ?", existing)
        frame = self._value(subject, _IN_FRAME)
        x, y, z = (self._number(subject, axis) for axis in (_X, _Y, _Z))
        if not isinstance(frame, NamedNode) or x is None or y is None:
            return
        z = 0.0 if z is None else z
        number = self._frame(db, frame.value)
        row = db.execute(
            "INSERT INTO poses(iri, x, y, z) VALUES (?, ?, ?, ?)", (subject.value, x, y, z)
        )
        db.execute(
            "INSERT INTO places VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (row.lastrowid, number, number, x, x, y, y, z, z),
        )

    def _value(self, subject: NamedNode, predicate: NamedNode) -> object:
        quad = next(iter(self._store.quads_for_pattern(subject, predicate, None, None)), None)
        return None if quad is None else quad.object

    def _number(self, subject: NamedNode, predicate: NamedNode) -> float | None:
        value = self._value(subject, predicate)
        try:
            number = float(value.value) if isinstance(value, Literal) else math.nan
        except ValueError:
            return None
        return number if math.isfinite(number) else None

    def _frame(self, db: sqlite3.Connection, name: str) -> int:
        db.execute("INSERT OR IGNORE INTO frames(iri) VALUES (?)", (name,))
        row = db.execute("SELECT id FROM frames WHERE iri = ?", (name,)).fetchone()
        return int(row[0])

    def near(
        self, db: sqlite3.Connection, frame: NamedNode, point: Sequence[float], radius: float
    ) -> list[Place]:
        """Return the poses of a frame within a radius, nearest first.

        Parameters
        ----------
        point
            (3,) in metres, in ``frame``.
        radius
            In metres, inclusive.
        """
        if len(point) != 3 or not all(map(math.isfinite, (*point, radius))) or radius < 0:
            raise UsageError(
                f"expected a point of three finite numbers and a radius, got {point!r}"
            )
        frame_row = db.execute("SELECT id FROM frames WHERE iri = ?", (frame.value,)).fetchone()
        if frame_row is None:
            return []
        bounds = [bound for c in point for bound in (c + radius, c - radius)]
        rows = db.execute(
            "SELECT iri, x, y, z FROM places JOIN poses ON poses.id = places.id "
            "WHERE f0 <= ? AND f1 >= ? AND x0 <= ? AND x1 >= ? AND y0 <= ? AND y1 >= ? "
            "AND z0 <= ? AND z1 >= ?",
            (frame_row[0], frame_row[0], *bounds),
        )
        places = [
            Place(NamedNode(name), (x, y, z), math.dist((x, y, z), point)) for name, x, y, z in rows
        ]
        inside = [place for place in places if place.distance <= radius]
        return sorted(inside, key=lambda place: (place.distance, place.pose.value))
