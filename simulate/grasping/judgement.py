"""A robot's judgement of its own grasp from its fingers, its arm and its camera.

Every judgement is ``yes``, ``no`` or ``unknown`` with its evidence, and uses only what a real robot
can measure: the opening of the hand, the height of the tool, and points seen by its cameras.

The thresholds were measured over whole-arm attempts of a NAO and a Panda with frictions of 0.05 to
0.8 and masses of 1 to 8 times the usual: see docs/benchmarks/demo.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from simulate.robots.description import Floats

__all__ = [
    "CLOSED_ON_SOMETHING",
    "Answer",
    "HeightMap",
    "Judgement",
    "is_stuck",
    "judge_held",
    "judge_off_table",
    "judge_old_place",
    "judge_placed",
    "narrowest_hold",
    "new_cells",
    "share_left",
]

Answer = Literal["yes", "no", "unknown"]

CLOSED_ON_SOMETHING = 0.08
"""Share of the opening range that a closed hand keeps around an object; the noise is 0.02."""
_MOVED_OPENING = 0.05
_WIDTH_ERROR_M = 0.003
"""By which an object may be wider than it was seen to be."""
_GIVEN_WAY_SHARE = 0.5
"""Share of the seen width between closing fingers below which what was there has given way."""
MIN_RISE_M = 0.02
_MIN_OPENING_SHARE = 0.75
"""Share of the opening after the lift that must remain; a slipping object lets the hand close."""
_CELL_M = 0.006
_OCCUPIED_M = 0.008
_MIN_NEW_CELLS, _HEAPED_SHARE = 4, 0.5
_PUSHED_SHARE = 0.25
"""Share of the object's volume by which what lies in a box that was pushed about must have grown:
what only tipped over covers other cells, and more of them, but does not grow."""
_ON_TABLE_SHARE = 0.5
"""Share of the object's volume from which on it counts as lying on the table."""
_MIN_SEEN_SHARE, _ALL_SEEN_SHARE = 0.15, 0.75
_MIN_OLD_CELLS = 4
_GONE_SHARE = 0.30
_MAX_LOW_CELLS = 5


@dataclass(frozen=True)
class Judgement:
    """An answer and the measurements on which it is based.

    Parameters
    ----------
    answer
        ``yes``, ``no`` or ``unknown``.
    evidence
        The measurements in words, such as ``opening .68 -> .66``.
    is_new_there
        Of a place: whether something lies there that did not before and may be the object.
    """

    answer: Answer = "unknown"
    evidence: str = ""
    is_new_there: bool = False

    @property
    def is_yes(self) -> bool:
        """Whether the answer is ``yes``; ``unknown`` is not."""
        return self.answer == "yes"


def is_stuck(before: float, closed: float, width: float, mouth: float) -> bool:
    """Tell whether fingers that were to close moved less than even a wide object would let them.

    They are stuck if they moved by less than .05 and less than a quarter of their way to the
    object. Where it may fill the whole opening, only a look after the lift can tell.

    Parameters
    ----------
    before, closed
        Opening of the hand, 0..1, before and after closing.
    width
        Of the object as it was seen, m.
    mouth
        Widest opening of the hand, m.
    """
    way = before - (width + _WIDTH_ERROR_M) / mouth
    return before - closed < min(_MOVED_OPENING, way / 4)


def narrowest_hold(width: float, mouth: float) -> float:
    """Return the opening, 0..1, below which closing fingers hold nothing as wide as was seen.

    What was there has broken, or one finger has missed it; the other then goes on pushing, and
    throws it over. Of a NAO's hand that kept hold, none was narrower than .60 of the width that was
    seen: its mouth is V-shaped, so that the mean opening of its fingers is not the gap.

    Parameters
    ----------
    width
        Of the object as it was seen, m.
    mouth
        Widest opening of the hand, m.
    """
    return _GIVEN_WAY_SHARE * width / mouth


def judge_held(openings: Mapping[str, float], rise_m: float) -> Judgement:
    """Judge whether the hand holds an object after the lift.

    Parameters
    ----------
    openings
        Of the hand, 0..1, at the ends of ``close``, ``lift`` and ``hold``.
    rise_m
        Of the tool from closing to the end of the hold, m.
    """
    path = " -> ".join(f"{openings[phase]:.2f}" for phase in ("close", "lift", "hold"))
    evidence = f"opening {path}, tool rose {1000 * rise_m:.0f} mm"
    if not np.isfinite(rise_m) or not np.isfinite(openings["hold"]):
        return Judgement("unknown", evidence)
    is_gripped = openings["hold"] > max(CLOSED_ON_SOMETHING, _MIN_OPENING_SHARE * openings["lift"])
    held = is_gripped and rise_m > MIN_RISE_M
    return Judgement("yes" if held else "no", evidence)


def judge_off_table(after: HeightMap, place: NDArray[np.bool_]) -> Judgement:
    """Judge by a look below the lifted hand whether all of the object has left the table.

    A thing held far from its centre of mass turns in the hand until one end is on the table, which
    neither the fingers nor the height of the tool tell. What is seen beside its place says nothing:
    lifting it uncovers the sides of its neighbours.

    Parameters
    ----------
    after
        Points up to a finger's breadth over the table, after the lift.
    place : (nx, ny) bool
        Cells on which the object stood.
    """
    if not np.isfinite(after.heights[place]).mean() >= _MIN_SEEN_SHARE:
        return Judgement("unknown", "the table below the hand is out of view")
    count = int((after.occupied & place).sum())
    return Judgement("no" if count > _MAX_LOW_CELLS else "yes", f"{count} cells still on the table")


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Median heights of seen points over a floor, in cells of 6 mm.

    Parameters
    ----------
    heights : (nx, ny) float, m
        NaN where no point was seen.
    origin : (2,) float, m
        Lower corner of the first cell, base frame.
    """

    heights: Floats
    origin: Floats

    @classmethod
    def of(
        cls,
        points: Floats,
        x_range: tuple[float, float],
        y_range: tuple[float, float],
        floor: float,
        ceiling: float = np.inf,
    ) -> HeightMap:
        """Return the map of a rectangle.

        Parameters
        ----------
        points : (n, 3) float, m
            Base frame.
        x_range, y_range
            Of the rectangle, m.
        floor, ceiling
            Heights, m, base frame; points above the ceiling are left out.
        """
        low, high = np.array([x_range[0], y_range[0]]), np.array([x_range[1], y_range[1]])
        shape = np.maximum(np.ceil((high - low) / _CELL_M).astype(int), 1)
        inside = ((points[:, :2] >= low) & (points[:, :2] < high)).all(axis=1)
        inside_points = points[inside & (points[:, 2] < ceiling)]
        cells = ((inside_points[:, :2] - low) / _CELL_M).astype(int)
        index = cells[:, 0] * shape[1] + cells[:, 1]
        heights = np.full(int(shape[0] * shape[1]), np.nan)
        order = np.lexsort((inside_points[:, 2], index))
        starts = np.flatnonzero(np.diff(index[order], prepend=-1))
        ends = np.append(starts[1:], len(order))
        middle = (starts + ends - 1) // 2
        heights[index[order[starts]]] = inside_points[order[middle], 2] - floor
        return cls(heights.reshape(tuple(shape)), low)

    @property
    def is_seen(self) -> bool:
        """Whether enough of the rectangle is in view to judge its contents."""
        return bool(np.isfinite(self.heights).mean() >= _MIN_SEEN_SHARE)

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """Occupied cells (nx, ny)."""
        return np.asarray(np.nan_to_num(self.heights, nan=0.0) > _OCCUPIED_M)

    @property
    def volume(self) -> float:
        """Of what is seen on the floor, m3."""
        return float(self.heights[self.occupied].sum()) * _CELL_M**2

    def within(self, x: float, y: float, yaw: float, length: float, width: float) -> NDArray[Any]:
        """Return the cells (nx, ny) whose middles lie in a turned rectangle, m and rad."""
        index = np.indices(self.heights.shape).transpose(1, 2, 0)
        off = self.origin + (index + 0.5) * _CELL_M - [x, y]
        along = off @ [np.cos(yaw), np.sin(yaw)]
        across = off @ [-np.sin(yaw), np.cos(yaw)]
        return np.asarray((np.abs(along) <= length / 2) & (np.abs(across) <= width / 2))

    def centre_of(self, cells: NDArray[np.bool_]) -> Floats:
        """Return the mean position (2,), m, base frame, of chosen cells (nx, ny)."""
        return np.asarray(self.origin + (np.argwhere(cells).mean(axis=0) + 0.5) * _CELL_M)


def new_cells(before: HeightMap, after: HeightMap) -> NDArray[np.bool_]:
    """Return the cells (nx, ny) that are occupied now and were free, or have grown higher."""
    with np.errstate(invalid="ignore"):
        grown = after.heights - before.heights > _OCCUPIED_M
    return np.asarray(after.occupied & (~before.occupied | grown))


def judge_placed(
    is_gripped: bool,
    before: HeightMap,
    after: HeightMap,
    volume: float = np.inf,
    on_table: float = 0.0,
) -> Judgement:
    """Judge whether an object arrived at its destination.

    Cells along the edge do not count, because they may show the walls of a box, and cells that
    became free count against it: what was only pushed about leaves as many as it takes. What came
    to lie on it takes no more cells, but heaps up its volume. What was tipped over may take more
    cells than it left, but heaps up nothing; then it is unknown what arrived, and so it is if the
    hand had lost the object before.

    Parameters
    ----------
    is_gripped
        Whether the hand still held something at the end of the transport. If not, what is new at
        the place may be an object that leans on its rim, or what the object pushed about, unless
        there is as much of it as of the object; and that nothing is new there says that it is
        elsewhere only where the whole place is seen.
    before, after
        The place before the grasp, and after the arm has returned home.
    volume
        Of the object, m3; inf = not known.
    on_table
        Share of the object that has not left the table beside the place: if it is half of it or
        more, the object lies there. 0 if that is not known.
    """
    if not (before.is_seen and after.is_seen):
        return Judgement("unknown", "the place is out of view")
    seen = np.isfinite(after.heights)
    came, went = (
        int(cells[1:-1, 1:-1].sum())
        for cells in (new_cells(before, after), new_cells(after, before) & seen)
    )
    evidence = f"place +{came} -{went} cells, {'held' if is_gripped else 'lost'} in transport"
    heaped = float(np.nansum((after.heights - before.heights)[1:-1, 1:-1])) * _CELL_M**2
    arrived = heaped > _HEAPED_SHARE * volume or (is_gripped and came - went >= _MIN_NEW_CELLS)
    # A few cells may also be a thing that the hand lost and that leans on the wall from outside.
    least = 0.0 if is_gripped else _PUSHED_SHARE * volume
    is_new = arrived or (came - went >= _MIN_NEW_CELLS and heaped >= least)
    pushed = went >= _MIN_NEW_CELLS and np.isfinite(volume)
    if arrived and pushed and not (is_gripped and heaped >= _PUSHED_SHARE * volume):
        return Judgement("unknown", f"{evidence}, what lay there was pushed about", is_new)
    if arrived:
        return Judgement("yes", evidence, is_new)
    if not is_gripped and on_table > _ON_TABLE_SHARE:
        return Judgement("no", f"{evidence}, it is on the table")
    if seen[1:-1, 1:-1].mean() < _ALL_SEEN_SHARE:
        return Judgement("unknown", f"{evidence}, a part of the place is hidden", is_new)
    if not is_gripped and came - went >= _MIN_NEW_CELLS:
        return Judgement("unknown", f"{evidence}, a part of it may lie there", is_new)
    return Judgement("no", evidence)


def share_left(before: HeightMap, after: HeightMap, volume: float) -> float:
    """Return the share of an object that has not left a place, by what the place lost in volume.

    Whatever else was only moved about within the place neither adds to it nor takes from it.

    Parameters
    ----------
    before, after
        The place with the object, and after it was taken away.
    volume
        Of the object as it was seen there, m3.
    """
    change = float(np.nansum(after.heights - before.heights)) * _CELL_M**2
    return max(1.0 + change / volume, 0.0) if volume > 0 else 0.0


def judge_old_place(before: HeightMap, after: HeightMap) -> Judgement:
    """Judge whether the object is still at its original place; ``no`` means that it is gone."""
    old = before.occupied
    seen = old & np.isfinite(after.heights)
    if old.sum() < _MIN_OLD_CELLS or seen.sum() < old.sum() / 2:
        return Judgement("unknown", "old place out of view")
    left = float(after.occupied[seen].mean())
    answer: Answer = "no" if left < _GONE_SHARE else "yes"
    return Judgement(answer, f"old place {100 * left:.0f} % occupied")
