"""Index of placements: which one a thing had at an instant, and what came or went near a place.

It holds subject, begin, end, position and place of each placement in sorted arrays, is rebuilt
from the graph, and follows its commits. Placements since the last sorting lie in a short tail. No
question about one thing takes longer the longer it stays, or the more happened elsewhere since.
"""

from __future__ import annotations

import itertools
import math
import threading
from bisect import bisect_left, insort
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import PREFIXES, RDF, RT
from rtask.rdf.terms import NamedNode
from rtask.world.index.cache import PlacementCache
from rtask.world.index.cells import CELL_M, Cells, cell_of, cells_around
from rtask.world.index.columns import joined, order_of
from rtask.world.index.moments import Moments, moments_about
from rtask.world.index.stays import stays_from
from rtask.world.index.tail import Entry, Tail
from rtask.world.placement import RELATIONS, TIME, Placement, seconds

if TYPE_CHECKING:
    from rtask.kb.commit.commit import Change
    from rtask.kb.core import GraphCore
    from rtask.sparql.results import Row

__all__ = ["Moments", "PlacementIndex"]

_MIN_TAIL, _TAIL_RATIO = 1024, 256
"""Placements that lie in the tail until it is sorted in, at least, and as a share of all."""
_NEVER = float("inf")
_ALWAYS = -_NEVER, _NEVER
_WATCHED = frozenset({RT.placementOf, RT.placementPose, TIME.hasBeginning, TIME.hasEnd, *RELATIONS})
_ALL = """
SELECT ?placement ?subject ?begin (MIN(?ended) AS ?end) (SAMPLE(?in) AS ?frame)
  (SAMPLE(?px) AS ?x) (SAMPLE(?py) AS ?y) (SAMPLE(?pz) AS ?z)
  (SAMPLE(?onto) AS ?on) (SAMPLE(?into) AS ?inside) (SAMPLE(?hand) AS ?held_by)
WHERE {
  ?placement rt:placementOf ?subject ; time:hasBeginning/time:inXSDDateTimeStamp ?begin
  OPTIONAL { ?placement time:hasEnd/time:inXSDDateTimeStamp ?ended }
  OPTIONAL { ?placement rt:placedOn ?onto }
  OPTIONAL { ?placement rt:placedIn ?into }
  OPTIONAL { ?placement rt:heldBy ?hand }
  OPTIONAL {
    ?placement rt:placementPose ?pose .
    ?pose rt:inFrame ?in ; rt:x ?px ; rt:y ?py ; rt:z ?pz
  }
} GROUP BY ?placement ?subject ?begin"""


class PlacementIndex:
    """Placements of one knowledge base, by thing and time."""

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self._lock = threading.RLock()
        self._is_filled = False
        self._bulk_loads = 0
        self._touched: set[str] = set()
        self._cache = PlacementCache(kb)
        self._clear()
        self._stop = kb.on_commit(self._on_commit)

    def close(self) -> None:
        """Stop following the graph."""
        self._stop()

    def __len__(self) -> int:
        with self._lock:
            self._catch_up()
            return len(self._nodes) - len(self._gone) + len(self._tail)

    def at(self, subject: str, time_s: float) -> str | None:
        """Return the placement of a thing at an instant, or None if none is known."""
        last = self._last(subject, time_s)
        return last.node if last is not None and time_s < last.end else None

    def last(self, subject: str, time_s: float = _NEVER) -> str | None:
        """Return the last placement of a thing that had begun by an instant, ended or not."""
        last = self._last(subject, time_s)
        return None if last is None else last.node

    def _last(self, subject: str, time_s: float) -> Entry | None:
        with self._lock:
            self._catch_up()
            number = self._numbers.get(subject)
            return None if number is None else self._last_of(number, time_s)[0]

    def _last_of(
        self, number: int, time_s: float, *, before: bool = False
    ) -> tuple[Entry | None, int]:
        """Return the last placement that began by, or before, an instant, and its row.

        The row is -1 for one that is not sorted in yet.
        """
        low, k = self._last_sorted(number, time_s, "left" if before else "right")
        entry = self._tail.last(number, time_s, before=before)
        if k < low:
            return entry, -1
        row = self._entry(k)
        return (row, k) if entry is None or row > entry else (entry, -1)

    def _last_sorted(
        self, number: int, time_s: float, side: Literal["left", "right"] = "right"
    ) -> tuple[int, int]:
        """Return the first row of a thing, and the last one that began; less if there is none."""
        low, high = self._range(number)
        k = low + int(np.searchsorted(self._begins[low:high], time_s, side=side)) - 1
        while k >= low and k in self._gone:
            k -= 1
        return low, k

    def arrival(self, subjects: Sequence[str], placement: Placement) -> str:
        """Return the placement with which a thing came to where it is: on this, in that.

        Each time that it is seen to have moved there another one begins. Those that are sorted
        in are skipped, however many they are.

        Parameters
        ----------
        subjects
            All names of the thing.
        """
        with self._lock:
            self._catch_up()
            numbers = [self._numbers[name] for name in subjects if name in self._numbers]
            current = self._entry_of(placement)
            while True:
                last = [self._last_of(number, current.begin, before=True) for number in numbers]
                # By begin: names that were merged count alike.
                begun = [(e.begin, e.node, e, row) for e, row in last if e is not None]
                if not begun:
                    return current.node
                *_, before, row = max(begun)
                if not current.follows(before):
                    return current.node
                if row < 0:
                    current = self._first_of_late_stay(before, numbers)
                else:
                    current = self._entry(self._first_of_stay(row, numbers))

    def _first_of_stay(self, row: int, numbers: Sequence[int]) -> int:
        """Return the first row from which no other placement comes between, down from one."""
        begin, subject = float(self._begins[row]), int(self._subjects[row])
        first = int(self._stays[row])
        gone = self._gone_of.get(subject, [])
        k = bisect_left(gone, row)
        if k:
            first = max(first, gone[k - 1] + 1)
        others = [self._tail.last(number, begin) for number in numbers]
        others += [self._last_of(n, begin)[0] for n in numbers if n != subject]
        latest = max((entry.begin for entry in others if entry is not None), default=-_NEVER)
        low = first + int(np.searchsorted(self._begins[first:row], latest, side="right"))
        return min(low, row)

    def _first_of_late_stay(self, entry: Entry, numbers: Sequence[int]) -> Entry:
        """Return the first placement from which no other one comes between, in the tail."""
        low, row = self._last_sorted(entry.subject, entry.begin)
        others = [self._last_of(n, entry.begin)[0] for n in numbers if n != entry.subject]
        begins = [other.begin for other in others if other is not None]
        latest = max([*begins, float(self._begins[row]) if row >= low else -_NEVER])
        late = self._tail.of_subject(entry.subject)
        k = bisect_left(late, entry)
        while k and latest < late[k - 1].begin < late[k].begin and late[k].follows(late[k - 1]):
            k -= 1
        return late[k]

    def _entry_of(self, placement: Placement) -> Entry:
        end = _NEVER if placement.end is None else placement.end
        subject = self._numbers.get(placement.subject, -2)
        place = self._place(placement.relation, placement.place)
        return Entry(subject, placement.begin, placement.iri, end, -1, 0.0, 0.0, 0.0, place)

    def _place(self, relation: str, place: str) -> int:
        if relation == "at":
            return -1
        return self._places.setdefault((relation, place), len(self._places))

    def rival(self, subject: str, time_s: float) -> str | None:
        """Return another placement that holds at an instant and began when the last one did."""
        with self._lock:
            last = self._last(subject, time_s)
            if last is None or time_s >= last.end:
                return None
            low, high = self._range(last.subject)
            first = low + int(np.searchsorted(self._begins[low:high], last.begin, side="left"))
            rows = (self._entry(k) for k in range(first, high) if k not in self._gone)
            begun = itertools.takewhile(lambda entry: entry.begin == last.begin, rows)
            for entry in (*begun, *self._tail.of_subject(last.subject)):
                is_same = (entry.subject, entry.begin) == (last.subject, last.begin)
                if is_same and entry.node != last.node and time_s < entry.end:
                    return entry.node
            return None

    def begins(self, subject: str, since_s: float, until_s: float = _NEVER) -> list[float]:
        """Return when placements of a thing or frame began after one time and by another."""
        with self._lock:
            self._catch_up()
            number = self._numbers.get(subject)
            if number is None:
                return []
            low, high = self._range(number)
            first, end = low + np.searchsorted(
                self._begins[low:high], [since_s, until_s], side="right"
            )
            begins = [float(self._begins[k]) for k in range(first, end) if k not in self._gone]
            begins += [
                entry.begin for entry in self._tail.of_subject(number)
                if since_s < entry.begin <= until_s
            ]  # fmt: skip
            return sorted(begins)

    def history(self, subject: str) -> list[str]:
        """Return all placements of a thing, oldest first."""
        return [entry.node for entry in self.entries(subject)]

    def entries(self, subject: str) -> list[Entry]:
        """Return what is in the index of all placements of a thing, oldest first."""
        with self._lock:
            self._catch_up()
            number = self._numbers.get(subject)
            if number is None:
                return []
            low, high = self._range(number)
            rows = [self._entry(k) for k in range(low, high) if k not in self._gone]
            return sorted([*rows, *self._tail.of_subject(number)])

    def first(self, subject: str) -> str | None:
        """Return the first placement of a thing, or None if there is none."""
        with self._lock:
            self._catch_up()
            number = self._numbers.get(subject)
            if number is None:
                return None
            low, high = self._range(number)
            rows = (self._entry(k) for k in range(low, high) if k not in self._gone)
            firsts = [*itertools.islice(rows, 1), *self._tail.of_subject(number)[:1]]
            return min(firsts).node if firsts else None

    def last_with_pose(self, subject: str) -> str | None:
        """Return the last placement of a thing that has a pose, or None if none has."""
        with self._lock:
            self._catch_up()
            number = self._numbers.get(subject)
            if number is None:
                return None
            low, high = self._range(number)
            posed = (low + np.flatnonzero(self._frames[low:high] >= 0)[::-1]).tolist()
            rows = (self._entry(k) for k in posed if k not in self._gone)
            late = (entry for entry in reversed(self._tail.of_subject(number)) if entry.frame >= 0)
            lasts = [*itertools.islice(rows, 1), *itertools.islice(late, 1)]
            return max(lasts).node if lasts else None

    def open(self, subject: str) -> list[str]:
        """Return the placements of a thing that have no end, oldest first."""
        with self._lock:
            self._catch_up()
            number = self._numbers.get(subject)
            if number is None:
                return []
            low, high = self._range(number)
            rows = low + np.flatnonzero(np.isinf(self._ends[low:high]))
            entries = [self._entry(int(k)) for k in rows if int(k) not in self._gone]
            entries += [
                entry for entry in self._tail.of_subject(number) if math.isinf(entry.end)
            ]  # fmt: skip
            return [entry.node for entry in sorted(entries)]

    def held_at(self, time_s: float) -> set[str]:
        """Return the things and frames that have a placement at an instant."""
        with self._lock:
            self._catch_up()
            rows = np.flatnonzero((self._begins <= time_s) & (time_s < self._ends))
            numbers = {int(self._subjects[k]) for k in rows if int(k) not in self._gone}
            numbers |= {e.subject for e in self._tail.values() if e.begin <= time_s < e.end}
            return {name for name, number in self._numbers.items() if number in numbers}

    def moments(self, time_s: float) -> Moments | None:
        """Return when the first thing came somewhere, and when anything changed about a time.

        None if nothing has a place.
        """
        with self._lock:
            self._catch_up()
            changes = (self._begins, self._by_begin), (self._ends, self._by_end)
            return moments_about(time_s, self._tail.values(), changes, self._gone)

    def subjects(self) -> list[str]:
        """Return the things and frames that have placements."""
        with self._lock:
            self._catch_up()
            return list(self._numbers)

    def events_near(
        self,
        subject: str,
        frame: str,
        spot: NDArray[np.float64],
        window_s: tuple[float, float],
        radius_m: float,
        stood_s: tuple[float, float] = _ALWAYS,
    ) -> list[float]:
        """Return when other things came to, or left, the surroundings of a spot; Unix times, s.

        Those are the begins and ends of placements whose poses were measured in the same frame.

        Parameters
        ----------
        subject
            IRI of the thing that is there, whose own placements do not count.
        frame, spot : (3,), m
            IRI of the frame, and the position there.
        window_s
            Unix times: after the first, and by the second.
        radius_m
            At most the edge of a cell of the index, m.
        stood_s
            Unix times from and until which the frame stood where it does: only what was measured
            then. The end of a place is where it was measured, wherever the robot is by then.
        """
        assert radius_m <= CELL_M
        since_s, until_s = window_s
        with self._lock:
            self._catch_up()
            number = self._numbers.get(frame, -2)
            own = self._numbers.get(subject, -2)
            cell = cell_of(number, *spot.tolist())
            events: list[float] = []
            for cells, times in ((self._begin_cells, self._begins), (self._end_cells, self._ends)):
                rows = cells.rows_near(cell, since_s, until_s)
                rows = rows[(self._frames[rows] == number) & (self._subjects[rows] != own)]
                rows = rows[(stood_s[0] <= self._begins[rows]) & (self._begins[rows] < stood_s[1])]
                near = np.linalg.norm(self._positions[rows] - spot, axis=1) <= radius_m
                events += [float(times[k]) for k in rows[near] if int(k) not in self._gone]
            for entry in self._tail.in_cells(cells_around(cell)):
                is_then = stood_s[0] <= entry.begin < stood_s[1]
                is_near = math.dist((entry.x, entry.y, entry.z), spot) <= radius_m
                if is_then and is_near and entry.subject != own:
                    events += [t for t in (entry.begin, entry.end) if since_s < t <= until_s]
            return events

    def posed_frames(self) -> list[str]:
        """Return the frames in which poses of placements are, or were, measured."""
        with self._lock:
            self._catch_up()
            return list(self._posed.values())

    def _range(self, number: int) -> tuple[int, int]:
        low, high = np.searchsorted(self._subjects, [number, number + 1])
        return int(low), int(high)

    def _entry(self, k: int) -> Entry:
        x, y, z = self._positions[k].tolist()
        return Entry(
            int(self._subjects[k]), float(self._begins[k]), self._nodes[k], float(self._ends[k]),
            int(self._frames[k]), x, y, z, int(self._placed[k]),
        )  # fmt: skip

    def read(self, node: str) -> Placement | None:
        """Return a stored placement, or None if its subject or its begin is missing."""
        return self._cache.read(node)

    def _on_commit(self, change: Change) -> None:
        self._cache.forget(change)
        with self._lock:
            # The first question reads everything; until then there is nothing to follow.
            if not self._is_filled:
                return
            # Noted only, and read with the next question: commits do not wait for this index.
            for quad in (*change.added, *change.removed):
                if quad.predicate in _WATCHED and isinstance(quad.subject, NamedNode):
                    self._touched.add(quad.subject.value)

    def _catch_up(self) -> None:
        """Bring the index up to the graph: what was touched, or all of it at first.

        What was loaded in bulk is in no commit, so everything is read again then.
        """
        if not self._is_filled or self._bulk_loads != self._kb.bulk_loads:
            self._is_filled = True
            self._bulk_loads = self._kb.bulk_loads
            self._fill()
        touched, self._touched = self._touched, set()
        for node in touched:
            self._renew(node)
        if len(self._tail) > max(_MIN_TAIL, len(self._nodes) // _TAIL_RATIO):
            self._sort(self._tail.values())

    def _renew(self, node: str) -> None:
        k = self._row_of.pop(node, None)
        if k is not None:
            # The row stays until the next sorting, so that the numbers of all others stay true.
            self._gone.add(k)
            insort(self._gone_of.setdefault(int(self._subjects[k]), []), k)
        self._tail.remove(node)
        placement = self._cache.read(node)
        if placement is None:
            return
        end = _NEVER if placement.end is None else placement.end
        pose, frame, position = placement.frame_from_subject, -1, (0.0, 0.0, 0.0)
        if pose is not None:
            frame = self._frame_for(placement.subject, placement.frame)
            position = (float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3]))
        subject = self._number(placement.subject)
        place = self._place(placement.relation, placement.place)
        self._tail.add(Entry(subject, placement.begin, node, end, frame, *position, place))

    def _fill(self) -> None:
        self._clear()
        entries = []
        for row in self._kb.select(PREFIXES + _ALL):
            has_pose = row["frame"] is not None
            x, y, z = (float(str(row.value(axis))) if has_pose else 0.0 for axis in "xyz")
            entries.append(
                Entry(
                    self._number(str(row.value("subject"))),
                    seconds(row.value("begin")),
                    str(row.value("placement")),
                    _NEVER if row["end"] is None else seconds(row.value("end")),
                    self._frame_for(str(row.value("subject")), str(row.value("frame")))
                    if has_pose
                    else -1,
                    x,
                    y,
                    z,
                    self._place_of(row),
                )
            )
        self._sort(entries)

    def _place_of(self, row: Row) -> int:
        for relation, name in (("on", "on"), ("in", "inside"), ("held_by", "held_by")):
            if row[name] is not None:
                return self._place(relation, str(row.value(name)))
        return -1

    def _clear(self) -> None:
        self._numbers: dict[str, int] = {}
        self._posed: dict[int, str] = {}
        self._is_frame: dict[int, bool] = {}
        self._places: dict[tuple[str, str], int] = {}
        self._nodes: list[str] = []
        self._subjects: NDArray[np.int32] = np.empty(0, np.int32)
        self._begins: NDArray[np.float64] = np.empty(0, np.float64)
        self._ends: NDArray[np.float64] = np.empty(0, np.float64)
        self._frames: NDArray[np.int32] = np.empty(0, np.int32)
        self._positions: NDArray[np.float32] = np.empty((0, 3), np.float32)
        self._placed: NDArray[np.int32] = np.empty(0, np.int32)
        self._gone: set[int] = set()
        self._sort(())

    def _sort(self, entries: Sequence[Entry]) -> None:
        """Sort placements in, and leave out the rows that are gone."""
        staying = np.ones(len(self._nodes), bool)
        staying[list(self._gone)] = False
        nodes = [*itertools.compress(self._nodes, staying), *(entry.node for entry in entries)]
        subjects = joined(self._subjects, staying, [entry.subject for entry in entries])
        begins = joined(self._begins, staying, [entry.begin for entry in entries])
        ends = joined(self._ends, staying, [entry.end for entry in entries])
        frames = joined(self._frames, staying, [entry.frame for entry in entries])
        positions = joined(self._positions, staying, [(e.x, e.y, e.z) for e in entries])
        placed = joined(self._placed, staying, [entry.place for entry in entries])
        order = order_of(subjects, begins, nodes)
        self._subjects, self._begins, self._ends = subjects[order], begins[order], ends[order]
        self._frames, self._positions = frames[order], positions[order]
        self._placed = placed[order]
        self._nodes = [nodes[k] for k in order.tolist()]
        self._row_of: dict[str, int] = {node: k for k, node in enumerate(self._nodes)}
        self._by_begin: NDArray[np.intp] = np.argsort(self._begins, kind="stable")
        self._by_end: NDArray[np.intp] = np.argsort(self._ends, kind="stable")
        self._stays = stays_from(self._subjects, self._begins, self._ends, self._placed)
        self._begin_cells = Cells(self._frames, self._positions, self._begins)
        self._end_cells = Cells(self._frames, self._positions, self._ends)
        self._tail = Tail()
        self._gone = set()
        self._gone_of: dict[int, list[int]] = {}

    def _number(self, name: str) -> int:
        return self._numbers.setdefault(name, len(self._numbers))

    def _frame_for(self, subject: str, frame: str) -> int:
        """Return the number of the frame of a thing's pose; -1 for that of a frame.

        A table whose origin lies beside a cup is no other thing that came near the cup.
        """
        number = self._number(subject)
        if number not in self._is_frame:
            self._is_frame[number] = bool(self._kb.match(NamedNode(subject), RDF.type, RT.Frame))
        if self._is_frame[number]:
            return -1
        self._posed[self._number(frame)] = frame
        return self._number(frame)
