"""What a robot makes of its looks at the thing in its hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from simulate.grasping.attempt import looking
from simulate.motion.load import Load

_SIZE = np.array([0.12, 0.026, 0.030])
_TURN = 0.5
_TOOL = np.array([[1.0, 0, 0, 0.15], [0, -1.0, 0, -0.10], [0, 0, -1.0, 0.45], [0, 0, 0, 1.0]])
"""``base_from_tool`` of a hand that points down and closes along x."""


@pytest.mark.parametrize(
    ("directions", "turn"), [(("right",), _TURN), (("ahead",), _TURN), ((), None)]
)
def test_a_turn_that_the_hand_hides_is_looked_for_from_straight_ahead(
    monkeypatch: pytest.MonkeyPatch, directions: tuple[str, ...], turn: float | None
) -> None:
    base_from_load = np.eye(4)
    base_from_load[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    base_from_load[:3, 3] = _TOOL[:3, 3]
    load = Load.of(_TOOL, base_from_load, _SIZE)
    monkeypatch.setattr(looking, "held_load", lambda plan, chain: load)
    local = (np.random.default_rng(5).random((400, 3)) - 0.5) * _SIZE
    local[:200, 0], local[200:, 2] = _SIZE[0] / 2, _SIZE[2] / 2
    turned = load.turned(_TURN).tool_from_load
    in_tool = local @ turned[:3, :3].T + turned[:3, 3]
    shown = in_tool @ _TOOL[:3, :3].T + _TOOL[:3, 3]
    asked: list[str] = []

    def points(direction: str) -> Any:
        asked.append(direction)
        return shown if direction in directions else shown[:10]

    hand = SimpleNamespace(mouth=0.052)
    robot = SimpleNamespace(
        tool_pose=lambda arm: _TOOL, finger_opening=lambda arm: 0.5, arm=lambda arm: hand
    )
    space = SimpleNamespace(chains={"right_arm": None})
    station: Any = SimpleNamespace(
        robot=robot, eyes=SimpleNamespace(points=points), space_of=lambda stance: space
    )
    request = SimpleNamespace(y=-0.10, table_height=0.27)
    plan: Any = SimpleNamespace(request=request, arm="right_arm", stance="")
    seen = looking.Looks(station, plan).turn_in_hand()
    assert seen == (None if turn is None else pytest.approx(turn, abs=0.15))
    assert asked == (["right"] if directions == ("right",) else ["right", "ahead"])
