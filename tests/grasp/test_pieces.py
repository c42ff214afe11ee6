"""Pieces of work at several seats: the order, slow ones, and those that are not wanted any more."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from grasp import pieces
from grasp.pieces import Pieces, handed_out


class Seats:
    """Jobs that end when they are told to, and what became of them."""

    def __init__(self) -> None:
        self.begun: list[int] = []
        self.dropped: list[int] = []
        self.ready: list[int] = []

    def begin(self, number: int) -> int:
        self.begun.append(number)
        return len(self.begun) - 1

    def wait(self, jobs: list[int], seconds: float) -> list[int]:
        found = [job for job in self.ready if job in jobs]
        self.ready = [job for job in self.ready if job not in found]
        if not found:
            time.sleep(0.001)
        return found

    def run(self, count: int, seats: int) -> Iterator[tuple[int, int]]:
        return handed_out(count, seats, self.begin, self.wait, self.dropped.append)


@pytest.fixture(autouse=True)
def impatience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "_SLOW_S", 0.01)


def test_no_more_pieces_are_begun_than_there_are_seats():
    seats = Seats()
    run = seats.run(5, 2)
    seats.ready = [1, 0]
    assert next(run) == (1, 1)
    assert seats.begun == [0, 1]
    assert next(run) == (0, 0)
    seats.ready = [2, 3, 4]
    assert sorted(run) == [(2, 2), (3, 3), (4, 4)]
    assert seats.begun == [0, 1, 2, 3, 4]
    assert seats.dropped == []


def test_a_piece_that_takes_long_is_begun_once_more_and_the_first_end_counts():
    seats = Seats()
    run = seats.run(3, 2)
    seats.ready = [1, 2]  # and not 0, which was begun first
    assert [next(run), next(run)] == [(1, 1), (2, 2)]
    seats.ready = [3]  # the second job of piece 0
    assert list(run) == [(0, 3)]
    assert seats.begun == [0, 1, 2, 0], "not a third time, though a seat was free"
    assert seats.dropped == [0, 0], "at once, and again at the end, where it still runs"


def test_the_late_first_job_may_still_win():
    class Late(Seats):
        def begin(self, number: int) -> int:
            job = super().begin(number)
            if job == 2:  # piece 0 once more
                self.ready = [0]
            return job

    seats = Late()
    seats.ready = [1]
    assert list(seats.run(2, 2)) == [(1, 1), (0, 0)]
    assert seats.begun == [0, 1, 0]
    assert 2 in seats.dropped


def test_what_is_not_wanted_any_more_is_dropped():
    seats = Seats()
    run = seats.run(4, 3)
    seats.ready = [2]
    assert next(run) == (2, 2)
    run.close()  # type: ignore[attr-defined]
    assert seats.dropped == [0, 1]


def test_a_failure_does_not_say_how_long_pieces_take():
    work = Pieces(2)
    assert [work.next([]), work.next([])] == [0, 1]
    assert work.ended(0)
    assert work.next([(1, time.monotonic() - 100)]) is None, "nothing to compare with"
    assert not work.ended(0), "it had ended"
    assert work.ended(1, 0.5)
    assert not work.is_going
