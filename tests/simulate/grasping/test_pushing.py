"""Pushes by an arm that cannot point its hand wherever it likes."""

from __future__ import annotations

import numpy as np
import pytest

from rtask.engine.perception.clutter import ClutterView
from simulate.grasping.executor import Workcell
from simulate.grasping.pushing import carry_out_push, plan_push
from simulate.motion.kinematics import Chain
from simulate.robots import describe

_ARM = "right_arm"


def _block(x: float, y: float, side: float, height: float, table: float) -> np.ndarray:
    """Return points (n, 3) of an upright block's top and sides, m, base frame."""
    grid = np.linspace(-side / 2, side / 2, 7)
    levels = np.linspace(0.005, height, 6)
    return np.array([
        [x + a, y + b, table + z] for a in grid for b in grid for z in levels
        if z == height or abs(a) == side / 2 or abs(b) == side / 2
    ])  # fmt: skip


def _view(table: float, own: np.ndarray, *others: np.ndarray) -> ClutterView:
    points = np.concatenate([own, *others])
    labels = np.repeat([1, 2], [len(own), len(points) - len(own)]).astype(np.int32)
    plane = np.array([0.0, 0.0, 1.0, -table])
    return ClutterView(points, labels, np.arange(len(points)), np.zeros(3), plane, table)


@pytest.mark.slow
def test_an_arm_of_five_joints_pushes_a_thing_off_its_neighbour() -> None:
    nao = describe("nao")
    assert not Chain.of(nao, _ARM).orients_freely
    table = nao.workplace.table_height
    own, other = (_block(0.165, y, 0.03, 0.04, table) for y in (-0.11, -0.142))
    with Workcell(nao, "fast") as cell:
        plan = plan_push(_view(table, own, other), 1, cell.executor, _ARM)
        assert plan is not None
        tool = Chain.of(nao, _ARM).tool_poses(plan.lift.positions)[1]
        way = tool[-1] - tool[0]
        assert 0.05 < np.linalg.norm(way[:2]) < 0.07  # beside the thing, and three cm with it
        assert way[1] > 0  # away from the neighbour
        # So low that it moves the thing and does not tip it over.
        assert tool[:, 2].max() - table < 0.035
        assert carry_out_push(cell.executor, plan) == "ok"
