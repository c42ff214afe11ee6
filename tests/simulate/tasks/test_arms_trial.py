"""What comes between while whole arms work: where a person puts a thing, when a program ends."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from simulate.study.tasks.arms_trial import KilledError, _Event
from simulate.tasks.arms.layouts import own_table, sorting_table
from simulate.tasks.body import Deed


def event(layout, kind, now, target):
    bench = SimpleNamespace(layout=layout, area_of=lambda body: now)
    return _Event(kind, bench, 0, target, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("layout", "kind", "now", "target", "areas"),
    [
        # The other arm alone gets to the other half, and hands do not meet.
        (own_table("nao-1", "nao"), "moved", "left half", "left box", {"left half"}),
        (own_table("panda-1", "panda"), "moved", "left half", "left box", {"right half"}),
        (own_table("panda-1", "panda"), "dropped", "left half", "left box",
         {"left half", "right half"}),
        (sorting_table(), "moved", "left part", "right box", {"middle", "right part"}),
        (sorting_table(), "moved", "middle", "left part", {"right part"}),
        (sorting_table(), "dropped", "middle", "left part", {"middle", "right part"}),
    ],
)  # fmt: skip
def test_a_person_leaves_things_where_hands_still_get_them_to_the_goal_and_not_there(
    layout, kind, now, target, areas
):
    chosen = event(layout, kind, now, target)._areas()
    assert {area.name for area in chosen} == areas


def test_each_event_happens_once_at_its_step():
    declined = event(sorting_table(), "declined", "middle", "left part")
    assert [declined.before("nao-1 picks can up from middle") for _ in range(2)] == [False, True]
    killed = event(sorting_table(), "killed", "middle", "left part")
    assert killed.before("nao-1 picks can up from middle")
    killed.kill("body", Deed(False))
    with pytest.raises(KilledError) as ended:
        killed.kill("body", Deed(True))
    assert ended.value.body == "body"
    killed.kill("body", Deed(True))
