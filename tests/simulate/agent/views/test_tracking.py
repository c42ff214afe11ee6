"""Tracking of things from one look to the next."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from simulate.agent.tracking import Tracker


@dataclass(frozen=True)
class _Shape:
    length: float = 0.10
    width: float = 0.03
    height: float = 0.045


@dataclass(frozen=True)
class _Seen:
    x: float
    y: float
    shape: _Shape = field(default_factory=_Shape)

    @property
    def position(self) -> np.ndarray:
        return np.array([self.x, self.y])

    @property
    def points(self) -> np.ndarray:
        """Of its upper face, 5 mm apart, m; it lies along x."""
        size = self.shape
        along, across = (np.arange(-s / 2, s / 2, 0.005) for s in (size.length, size.width))
        top = np.array([[self.x + a, self.y + b, size.height] for a in along for b in across])
        return top.astype(np.float32)


def _numbers(tracks: list) -> list[int]:
    return [track.number for track in tracks]


def test_things_keep_their_numbers_while_they_lie_still() -> None:
    tracker = Tracker()
    tracker.update([_Seen(0.15, -0.05), _Seen(0.15, -0.12)])
    again = tracker.update([_Seen(0.151, -0.121), _Seen(0.149, -0.051)])
    assert {track.number: track.seen.y for track in again} == {1: -0.051, 2: -0.121}


def test_a_thing_that_was_pushed_far_is_new_unless_it_was_handled() -> None:
    tracker = Tracker()
    (track,) = tracker.update([_Seen(0.15, -0.05)])
    assert _numbers(tracker.update([_Seen(0.15, -0.11)], handled=track)) == [1]
    assert _numbers(tracker.update([_Seen(0.15, -0.05)])) == [2]


def test_a_thing_that_was_dropped_far_away_is_still_itself() -> None:
    tracker = Tracker()
    track, _ = tracker.update([_Seen(0.15, -0.05), _Seen(0.12, -0.15)])
    again = tracker.update([_Seen(0.35, -0.25), _Seen(0.12, -0.15)], handled=track)
    assert {t.number: t.seen.x for t in again} == {1: 0.35, 2: 0.12}
    tracker.update([_Seen(0.12, -0.15)], handled=track)
    # Once it is out of sight for a look, what turns up later may be anything.
    assert _numbers(tracker.update([_Seen(0.40, -0.05), _Seen(0.12, -0.15)])) == [2, 3]


def test_of_two_strangers_the_one_of_its_size_is_the_thing_that_was_dropped() -> None:
    tracker, bar = Tracker(), _Shape(0.11, 0.028, 0.03)
    track, _ = tracker.update([_Seen(0.15, -0.05, bar), _Seen(0.12, -0.15)])
    again = tracker.update([_Seen(0.20, -0.15), _Seen(0.35, -0.25, bar)], handled=track)
    assert {t.number: t.seen.x for t in again} == {1: 0.35, 3: 0.20}


def test_a_thing_that_left_is_not_in_view_and_its_number_is_not_given_again() -> None:
    tracker = Tracker()
    tracker.update([_Seen(0.15, -0.05), _Seen(0.15, -0.15)])
    assert _numbers(tracker.update([_Seen(0.15, -0.15)])) == [2]
    assert _numbers(tracker.update([_Seen(0.15, -0.15), _Seen(0.13, -0.08)])) == [2, 3]


def test_a_look_at_one_side_leaves_the_other_side_alone() -> None:
    tracker = Tracker()
    tracker.update([_Seen(0.15, -0.05)], side=-1)
    both = tracker.update([_Seen(0.15, 0.05)], side=1)
    assert _numbers(both) == [1, 2]


def test_a_lost_thing_is_met_again_by_its_identity() -> None:
    tracker = Tracker()
    (track,) = tracker.update([_Seen(0.15, -0.05)])
    track.object_iri = "urn:o:1"
    assert tracker.lost("urn:o:1") is None, "it is in sight"
    tracker.update([])
    (found,) = tracker.update([_Seen(0.30, -0.15)])
    lost = tracker.lost("urn:o:1")
    assert lost is track
    tracker.join(lost, found)
    assert [(t.number, t.object_iri) for t in tracker.tracks] == [(1, "urn:o:1")]
    assert tracker.lost("urn:o:2") is None


def test_an_empty_look_is_fine() -> None:
    assert Tracker().update([]) == []


@pytest.mark.parametrize(
    ("shape", "is_it"),
    [
        (_Shape(), True),
        (_Shape(0.06, 0.044, 0.056), True),  # it leans on the wall of a box, which hides a part
        (_Shape(0.14, 0.03, 0.045), False),
    ],
)
def test_the_one_thing_that_is_missing_is_met_again_unless_it_had_to_grow(
    shape: _Shape, is_it: bool
) -> None:
    tracker = Tracker()
    (lost,) = tracker.update([_Seen(0.15, -0.05)])
    (found,) = tracker.update([_Seen(0.30, -0.20, shape)])
    assert tracker.stray(found) is (lost if is_it else None)


def test_of_two_missing_things_only_the_size_tells_which_is_met_again() -> None:
    tracker = Tracker()
    tracker.update([_Seen(0.15, -0.05), _Seen(0.15, -0.15, _Shape(0.05, 0.05, 0.05))])
    (found,) = tracker.update([_Seen(0.30, -0.20, _Shape(0.06, 0.044, 0.056))])
    assert tracker.stray(found) is None
    (cube,) = tracker.update([_Seen(0.45, -0.10, _Shape(0.05, 0.05, 0.05))])
    found.finished = True
    assert tracker.stray(cube).number == 2


def test_what_was_let_go_over_a_box_out_of_sight_is_met_again_by_its_size_alone() -> None:
    small = _Shape(0.065, 0.036, 0.036)
    tracker = Tracker()
    (pen,) = tracker.update([_Seen(0.15, -0.05)])
    pen.released = True
    (other,) = tracker.update([_Seen(0.12, -0.15, small)], handled=pen)
    assert other is not pen
    assert tracker.stray(other) is None
    (found,) = tracker.update([_Seen(0.30, -0.15)], handled=pen)
    assert found is pen


def test_what_was_put_into_a_box_is_met_again_whichever_way_up_it_lies() -> None:
    tracker = Tracker()
    (track,) = tracker.update([_Seen(0.15, -0.05, _Shape(0.031, 0.025, 0.052))])
    track.object_iri = "o:1"
    (found,) = tracker.update([_Seen(0.30, -0.20, _Shape(0.050, 0.026, 0.032))])
    assert not tracker.fell_out("o:1", found)  # it was not in a box
    track.gone = True
    assert tracker.fell_out("o:1", found)
    assert not tracker.fell_out("o:2", found)
    found.seen = _Seen(0.30, -0.20, _Shape(0.070, 0.026, 0.032))
    assert not tracker.fell_out("o:1", found)


def test_what_leans_on_the_wall_of_its_box_and_is_likely_by_its_looks_is_met_again() -> None:
    tracker = Tracker()
    (track,) = tracker.update([_Seen(0.40, -0.12, _Shape(0.094, 0.033, 0.050))])
    track.object_iri, track.gone = "o:1", True
    (found,) = tracker.update([_Seen(0.55, -0.19, _Shape(0.048, 0.027, 0.045))])
    assert not tracker.fell_out("o:1", found)
    assert tracker.fell_out("o:1", found, is_likely=True)
    assert not tracker.fell_out("o:2", found, is_likely=True)
    found.seen = _Seen(0.55, -0.19, _Shape(0.048, 0.044, 0.045))
    assert not tracker.fell_out("o:1", found, is_likely=True)  # it is too thick


_PEN, _HALF = _Shape(0.13, 0.02, 0.02), _Shape(0.045, 0.02, 0.02)


def test_what_was_seen_as_two_behind_a_thing_is_one_when_that_is_gone() -> None:
    tracker, can = Tracker(), _Seen(0.15, -0.07, _Shape(0.03, 0.03, 0.08))
    *_, front = tracker.update([_Seen(0.11, -0.10, _HALF), _Seen(0.19, -0.10, _HALF), can])
    front.gone = front.finished = True
    tracker.update([_Seen(0.15, -0.10, _PEN)], handled=front)
    assert len(tracker.in_view(-1)) == 1
    assert tracker.missing == []
    # What the robot has begun to handle has a history, and is not dropped for what covers it.
    tracker = Tracker()
    first, _, front = tracker.update([_Seen(0.11, -0.10, _HALF), _Seen(0.19, -0.10, _HALF), can])
    first.meet()
    front.gone = front.finished = True
    tracker.update([_Seen(0.15, -0.10, _PEN)], handled=front)
    assert tracker.missing == [first]


@pytest.mark.parametrize(("apart", "missing"), [(0.03, 0), (0.06, 1)])
def test_a_part_of_what_was_taken_is_not_looked_for(apart: float, missing: int) -> None:
    tracker = Tracker()
    pen, part = tracker.update([_Seen(0.11, -0.10, _HALF), _Seen(0.155 + apart, -0.10, _HALF)])
    pen.meet()
    pen.gone = pen.finished = True
    tracker.update([], handled=pen)
    assert tracker.missing == [part][:missing]


def test_what_is_seen_as_one_with_a_thing_that_it_came_to_touch_has_grown() -> None:
    tracker, box = Tracker(), _Shape(0.05, 0.035, 0.05)
    (track,) = tracker.update([_Seen(0.15, -0.10, box)])
    track.seen = _Seen(0.15, -0.10, _Shape(0.09, 0.035, 0.05))
    assert not track.has_grown  # a part was hidden before the robot came to it
    track.seen = _Seen(0.15, -0.10, box)
    track.meet()
    track.seen = _Seen(0.15, -0.10, _Shape(0.053, 0.055, 0.037))
    assert not track.has_grown  # it fell over
    track.seen = _Seen(0.15, -0.10, _Shape(0.09, 0.035, 0.05))
    assert track.has_grown


def test_where_a_pair_has_parted_the_thing_is_the_one_that_has_its_size() -> None:
    tracker, box, can = Tracker(), _Shape(0.05, 0.035, 0.05), _Shape(0.03, 0.03, 0.08)
    (track,) = tracker.update([_Seen(0.15, -0.10, box)])
    track.meet()
    tracker.update([_Seen(0.15, -0.105, _Shape(0.09, 0.035, 0.08))], handled=track)
    other, again = _Seen(0.15, -0.115, can), _Seen(0.15, -0.06, box)
    tracker.update([other, again], handled=track)
    assert track.seen is again


def test_a_view_that_does_not_show_what_is_looked_for_changes_nothing() -> None:
    tracker = Tracker()
    lost, part = tracker.update([_Seen(0.11, -0.20), _Seen(0.15, -0.05, _HALF)])
    lost.released = True
    tracker.update([_Seen(0.15, -0.05, _HALF)])
    # From elsewhere the part is seen as a piece of what covers it, and would be forgotten.
    assert not tracker.finds(lost, [_Seen(0.18, -0.05, _Shape(0.13, 0.02, 0.02))], -1)
    assert tracker.tracks == [lost, part]
    assert (lost.visible, part.visible) == (False, True)
