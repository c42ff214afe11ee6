"""Background work of the engine: stored views are compared before a request needs it."""

from __future__ import annotations

import logging
import shutil
import threading
import time

import pytest

import rtask
from rtask.engine import Engine
from rtask.engine.upkeep import Upkeep

WAIT_S = 60.0
"""Far more than the work takes; only a failure waits so long."""


def test_work_goes_on_until_nothing_is_left_and_again_when_announced() -> None:
    left, done = [3], threading.Semaphore(0)

    def step() -> int:
        left[0] -= 1
        if left[0] == 0:
            done.release()
        return left[0]

    upkeep = Upkeep("test", step, quiet_s=0.01)
    try:
        time.sleep(0.1)
        assert left == [3]  # nothing was announced yet
        for count in (3, 2):
            left[0] = count
            upkeep.announce()
            assert done.acquire(timeout=WAIT_S)
    finally:
        upkeep.close()
    assert left == [0]


def test_a_failing_step_is_reported_and_tried_again_when_announced(caplog) -> None:
    called = threading.Semaphore(0)

    def step() -> int:
        called.release()
        raise OSError("disk gone")

    upkeep = Upkeep("test-upkeep", step, quiet_s=0.01)
    with caplog.at_level(logging.ERROR):
        for _ in range(2):
            upkeep.announce()
            assert called.acquire(timeout=WAIT_S)
        upkeep.close()
    assert caplog.text.count("test-upkeep stopped") == 2


def test_closing_ends_work_that_has_no_end() -> None:
    started = threading.Event()

    def step() -> int:
        started.set()
        return 1

    upkeep = Upkeep("test", step, quiet_s=0.0)
    upkeep.announce()
    assert started.wait(WAIT_S)
    upkeep.close()
    assert not upkeep._thread.is_alive()


def wait_until_compared(engine: Engine) -> None:
    end = time.monotonic() + WAIT_S
    while engine.context.views.recogniser.compare_outdated(0):
        assert time.monotonic() < end, "nobody compares the stored views"
        time.sleep(0.05)


@pytest.mark.slow
def test_views_from_the_graph_and_of_a_rebuilt_index_are_compared(bench, tmp_path) -> None:
    folder = tmp_path / "kb"
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        robot.register()
        robot.insert(bench.sight(bench.CAN))
        robot.insert(bench.sight(bench.BOX))
    shutil.rmtree(folder / "index")
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        outdated = engine.context.views.recogniser.compare_outdated
        assert outdated(0) == 2
        engine.keep_compared()
        wait_until_compared(engine)
        engine.rebuild_index()
        wait_until_compared(engine)
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        assert engine.context.views.recogniser.compare_outdated(0) == 0
