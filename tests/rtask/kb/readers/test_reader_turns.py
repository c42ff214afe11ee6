"""Long queries run in long turns, which quick ones may interrupt; answers do not depend on it."""

from __future__ import annotations

import ctypes
import os
import platform
from concurrent.futures import ThreadPoolExecutor

import pytest

import rtask
from rtask.errors import ClosedError
from rtask.kb.readers import scheduling
from rtask.kb.readers.scheduling import in_long_turns
from tests.processes import wait_until
from tests.rtask.kb.numbered_things import fill

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="readers are forked")

_ENDLESS = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
_GET_ATTRIBUTES = {"x86_64": 315, "aarch64": 275}


def _slice_ns(pid: int = 0) -> int:
    """Return the slice of a process that the kernel reports; 0 if it reports none."""
    number = _GET_ATTRIBUTES.get(platform.machine())
    if number is None or not hasattr(os, "sched_getscheduler"):
        return 0
    layout = scheduling._ATTRIBUTES
    told = ctypes.create_string_buffer(layout.size)
    if ctypes.CDLL(None).syscall(number, pid, told, layout.size, 0):
        return 0
    return int(layout.unpack(told.raw)[5])


def test_turns_are_long_meanwhile_and_as_before_afterwards() -> None:
    before = _slice_ns()
    if not before:
        pytest.skip("this kernel has no slices that can be set (Linux 6.12 has)")
    with in_long_turns():
        assert _slice_ns() > 3 * before
    assert _slice_ns() == before


def test_a_long_query_runs_in_long_turns_and_a_quick_one_after_it_does_not() -> None:
    before = _slice_ns()
    if not before:
        pytest.skip("this kernel has no slices that can be set (Linux 6.12 has)")
    with rtask.open(":memory:", reason=False, ontologies=False) as kb:
        fill(kb)

        def long_turns() -> int:
            return sum(_slice_ns(pid) > 3 * before for pid in kb.stats()["readers"]["processes"])

        with ThreadPoolExecutor(1) as pool:
            endless = pool.submit(kb.query, _ENDLESS, timeout_s=60.0)
            wait_until(lambda: long_turns() == 1)
            assert kb.query("ASK { <urn:thing:1> <urn:number> 1 }", timeout_s=30.0) is True
            assert long_turns() == 1
            kb.readers.close()
            with pytest.raises(ClosedError):
                endless.result()
