"""Races of a near and a far answer, with events instead of delays, and with a server that stops."""

from __future__ import annotations

import contextlib
import signal
import threading
from typing import Any

import pytest

import rtask
from rtask.client.race import Contender, race
from rtask.client.racing import _is_nothing
from rtask.errors import DeadlineError, UsageError
from tests.processes import EVER_LONGER_S
from tests.servers import running_server

LONG_S = 120.0


def never(_: Contender[Any]) -> Any:
    threading.Event().wait(LONG_S)


def fail(_: Contender[Any]) -> Any:
    raise LookupError("nothing known")


def race_to_the_end(local, remote, **options):
    """Race until the time is up; a busy machine may get to nothing in a short one."""
    for deadline_s in EVER_LONGER_S:
        with contextlib.suppress(DeadlineError):
            return race(local, remote, deadline_s=deadline_s, patience_s=0.0, **options)
    raise AssertionError("no side answered")


def test_the_remote_answer_counts_within_the_patience_and_the_local_one_after_it():
    near = threading.Event()

    def local(_: Contender[str]) -> str:
        near.set()
        return "near"

    def remote(_: Contender[str]) -> str:
        assert near.wait(LONG_S)
        return "far"

    found = race(local, remote, patience_s=LONG_S, deadline_s=LONG_S)
    assert (found.value, found.won_by, found.is_partial) == ("far", "remote", False)
    found = race(local, never, patience_s=0.0, deadline_s=LONG_S)
    assert (found.value, found.won_by, found.is_partial) == ("near", "local", False)


def test_a_side_that_fails_leaves_the_race_to_the_other():
    assert race(fail, lambda _: 1, patience_s=0, deadline_s=LONG_S).won_by == "remote"
    assert race(lambda _: 1, fail, patience_s=LONG_S, deadline_s=LONG_S).won_by == "local"
    with pytest.raises(LookupError, match="nothing known"):
        race(fail, fail, deadline_s=LONG_S)


@pytest.mark.slow  # waits for the deadline
def test_at_the_deadline_the_best_answer_so_far_counts():
    def growing(contender: Contender[int]) -> int:
        contender.offer(1)
        contender.offer(2)
        threading.Event().wait(LONG_S)
        return 3

    found = race_to_the_end(growing, never)
    assert (found.value, found.won_by, found.is_partial) == (2, "local", True)
    with pytest.raises(DeadlineError, match="no answer within"):
        race(never, never, patience_s=0.0, deadline_s=0.05)


@pytest.mark.slow  # waits for the deadline
def test_the_better_of_two_answers_counts_where_both_are_there():
    far = threading.Event()

    def local(_: Contender[int]) -> int:
        return 5

    def remote(contender: Contender[int]) -> int:
        contender.offer(9)
        far.set()
        threading.Event().wait(LONG_S)
        return 9

    def slow(contender: Contender[int]) -> int:
        assert far.wait(LONG_S)
        contender.offer(5)
        threading.Event().wait(LONG_S)
        return 5

    found = race_to_the_end(slow, remote, better=lambda one: one)
    assert (found.value, found.won_by) == (9, "remote")
    assert race(local, remote, patience_s=0.0, deadline_s=LONG_S, better=lambda one: one).value == 5


def test_the_loser_is_told_that_its_answer_is_not_wanted():
    told = threading.Event()

    def local(contender: Contender[str]) -> str:
        while contender.may_count:
            threading.Event().wait(0.01)
        told.set()
        return "late"

    assert race(local, lambda _: "far", deadline_s=LONG_S).value == "far"
    assert told.wait(LONG_S)


def test_a_patience_longer_than_the_deadline_is_refused():
    with pytest.raises(UsageError, match="patience_s=2"):
        race(fail, fail, patience_s=2, deadline_s=1)


@pytest.mark.slow
def test_a_robot_goes_on_with_its_slice_of_the_graph_while_the_server_does_not_answer():
    question = "SELECT ?place { <urn:mug> <urn:on> ?place }"
    with (
        running_server(None) as server,
        rtask.open(":memory:", plain=True) as kb,
        rtask.connect(server.url, timeout_s=LONG_S) as far,
    ):
        far.update("INSERT DATA { <urn:mug> <urn:on> <urn:shelf> }")
        kb.update("INSERT DATA { <urn:mug> <urn:on> <urn:table> }")

        def local(_: Contender[str]) -> str:
            return str(next(iter(kb.query(question)))["place"].value)

        def remote(_: Contender[str]) -> str:
            return str(far.query(question)[0]["place"])

        linked = race(local, remote, patience_s=LONG_S, deadline_s=LONG_S)
        assert (linked.value, linked.won_by) == ("urn:shelf", "remote")
        server.process.send_signal(signal.SIGSTOP)
        try:
            cut = race(local, remote, patience_s=0.05, deadline_s=LONG_S)
        finally:
            server.process.send_signal(signal.SIGCONT)
        assert (cut.value, cut.won_by) == ("urn:table", "local")
        again = race(local, remote, patience_s=LONG_S, deadline_s=LONG_S)
        assert (again.value, again.won_by) == ("urn:shelf", "remote")


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        ({"objects": [], "total": 3}, True),
        ({"objects": [], "places": []}, True),
        ({"objects": [], "places": ["shelf"]}, False),
        ({"total": 0}, False),
    ],
)
def test_an_answer_is_nothing_if_it_has_lists_and_all_are_empty(answer, expected):
    assert _is_nothing(answer) == expected
