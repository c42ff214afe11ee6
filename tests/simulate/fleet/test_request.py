"""A request in words, from the camera to the box: real engine, real reasoning, coarse physics."""

from __future__ import annotations

import pytest

from simulate.fleet.request import Request, carry_out


@pytest.mark.slow
def test_of_a_ball_and_a_bottle_the_bottle_is_to_drink_from() -> None:
    done = carry_out(Request("something to drink from", seed=3, objects=2, preset="fast"))
    assert len(done["seen"]) == 2
    chosen = {one["label"].split()[0] for one in done["tried"]}
    assert chosen == {"bottle"}
    # Whether the coarse physics lets it slip is not the point; nothing else may be taken.
    assert done["took"].startswith("bottle") if done["placed"] else done["took"] == ""
    assert done["answer"]["understood"]["functions"]
