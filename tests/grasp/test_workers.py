"""Worker processes: killed ones, broken tasks, and pieces that take much longer than the others."""

from __future__ import annotations

import os
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from grasp.push.shards import open_executor
from grasp.workers import Processes

pytestmark = pytest.mark.slow  # starts processes


def square(number: int) -> int:
    return number * number


def pid(_: int) -> int:
    return os.getpid()


def die_once(folder: Path, number: int) -> int:
    """Kill the process at the first try of every third piece."""
    if number % 3 == 0:
        try:
            (folder / str(number)).touch(exist_ok=False)
        except FileExistsError:
            return number
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die(number: int) -> int:
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def fail(number: int) -> int:
    if number == 1:
        raise LookupError(f"no {number}")
    return number


class TwoReasonsError(Exception):
    """Cannot be made again from its pickle."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(f"{first}, {second}")


def fail_in_two_ways(number: int) -> int:
    if number == 1:
        raise TwoReasonsError("late", "wrong")
    return number


def hang_once(folder: Path, number: int) -> int:
    """Never end the first try of piece 0; the second ends at once."""
    if number == 0:
        try:
            (folder / "first").touch(exist_ok=False)
        except FileExistsError:
            return number
        while True:
            time.sleep(1)
    return number


def die_once_in(folder: Path, first: int, count: int) -> list[int]:
    die_once(folder, first)
    return list(range(first, first + count))


def test_every_piece_is_done_once_and_processes_serve_several_runs():
    with Processes(2) as workers:
        found = {i: one.result() for i, one in workers.finished(square, range(20))}
        assert found == {i: i * i for i in range(20)}
        first = {one.result() for _, one in workers.finished(pid, range(6))}
        second = {one.result() for _, one in workers.finished(pid, range(6))}
        assert len(first | second) <= 2
        assert os.getpid() not in first
        assert list(workers.finished(square, [])) == []


def test_what_a_killed_process_was_doing_is_done_again(tmp_path: Path):
    with Processes(2) as workers:
        run = workers.finished(partial(die_once, tmp_path), range(7))
        assert sorted(one.result() for _, one in run) == list(range(7))
    assert len(list(tmp_path.iterdir())) == 3


def test_a_piece_that_kills_every_process_is_an_error_and_the_others_are_done():
    with Processes(2) as workers:
        found = dict(workers.finished(die, range(4)))
    assert {i: one.value for i, one in found.items() if i != 2} == {0: 0, 1: 1, 3: 3}
    with pytest.raises(RuntimeError, match="exit code -9, 3 times"):
        found[2].result()


def test_an_error_of_the_task_comes_back_with_its_trace():
    with Processes(1) as workers:
        found = dict(workers.finished(fail, range(3)))
    assert (found[0].value, found[2].value) == (0, 2)
    with pytest.raises(LookupError, match="no 1"):
        found[1].result()
    assert 'raise LookupError(f"no {number}")' in found[1].trace


def test_an_error_that_no_other_process_can_read_comes_back_in_words():
    with Processes(1) as workers:
        found = dict(workers.finished(fail_in_two_ways, range(3)))
    assert (found[0].value, found[2].value) == (0, 2)
    with pytest.raises(RuntimeError, match="TwoReasonsError: late, wrong"):
        found[1].result()


def test_a_piece_that_hangs_is_given_to_an_idle_process_as_well(tmp_path: Path):
    with Processes(2) as workers:
        run = workers.finished(partial(hang_once, tmp_path), range(4))
        assert sorted(one.result() for _, one in run) == list(range(4))
        # The process that hangs was ended, and another takes its place.
        assert {one.result() for _, one in workers.finished(square, [3])} == {9}


def test_what_is_not_wanted_any_more_is_stopped(tmp_path: Path):
    with Processes(2) as workers:
        run = workers.finished(partial(hang_once, tmp_path), range(2))
        assert next(run)[0] == 1
        run.close()
        assert [one.result() for _, one in workers.finished(square, [2])] == [4]


def test_ranges_of_a_killed_process_are_run_again(tmp_path: Path):
    with open_executor("processes", 2) as executor:
        ranges = [(0, 3), (3, 2), (5, 1)]
        done = executor.finished(partial(die_once_in, tmp_path), ranges)
        found = [one for _, one in sorted(done)]
    assert found == [[0, 1, 2], [3, 4], [5]]
