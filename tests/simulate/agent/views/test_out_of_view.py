"""What stands outside of the present view is kept clear of on the way to a thing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from features.perception import Perceived
from simulate.agent.grasp_choice import choose_grasp
from simulate.agent.second_look import look_at_side
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.agent.tracking import Tracker
from simulate.world.objects import product
from simulate.world.scene import Placement
from tests.simulate.agent.doubles import Body, Server, seen_at

RIGHT, LEFT = (0.15, -0.05), (0.18, 0.16)


@dataclass
class _TurningHead(Body):
    """Sees one half of the table at a time; notes around what it planned."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.around: list[tuple[float, list[Any]]] = []

    def look(self, side: str, camera: str | None = None) -> Any:
        frame, pose = super().look(side, camera)
        pose[1, 3] = {"right": -1.0, "left": 1.0}.get(side, 0.0)
        return frame, pose

    def plan(self, request: Any, obstacles: Any, seed: int) -> Any:
        self.around.append((request.y, obstacles))
        return super().plan(request, obstacles, seed)

    def see(self, frame: Any, pose: Any, ignored: Any) -> Perceived:
        seen = [seen_at(x, y) for x, y in self.table if y * pose[1, 3] > 0]
        return Perceived("ok", 0.27, tuple(seen))


def test_the_other_half_is_an_obstacle_before_it_was_cleared_and_not_after(run: Any) -> None:
    body = _TurningHead([RIGHT, LEFT])
    run(body, Server(), [RIGHT, LEFT], see=body.see)
    (first, around_right), (second, around_left) = body.around
    assert (first, second) == (RIGHT[1], LEFT[1])
    assert around_left == []  # what was put into the box stands there no longer
    [cloud] = around_right
    low, high = cloud[:, :2].min(axis=0), cloud[:, :2].max(axis=0)
    np.testing.assert_allclose((low + high) / 2, LEFT, atol=1e-6)
    assert np.all((high - low > 0.015) & (high - low < 0.05))  # it may have moved


def test_without_another_way_an_old_view_forbids_nothing(run: Any) -> None:
    class Crowded(_TurningHead):
        def plan(self, request: Any, obstacles: Any, seed: int) -> Any:
            return "rrt_time" if obstacles else super().plan(request, obstacles, seed)

    body = Crowded([RIGHT, LEFT])
    assert all(e.placed for e in run(body, Server(), [RIGHT, LEFT], see=body.see))


def test_what_the_view_shows_whole_or_is_to_be_grasped_is_not_remembered_too() -> None:
    tracker, target, near = Tracker(), seen_at(0.15, -0.01), seen_at(0.15, 0.06)
    [track] = tracker.update([target], side=-1)
    tracker.note([seen_at(0.15, 0.001), seen_at(0.15, 0.061)], 1)
    assert tracker.remembered(track, [target, near]) == []
    [whole] = tracker.remembered(track, [target, replace(near, touches_border=True)])
    assert np.ptp(whole[:, 0]) == 0.0  # its place is seen


@pytest.mark.deep
@pytest.mark.slow
def test_an_arm_that_crosses_the_other_half_throws_nothing_over_there(tmp_path: Path) -> None:
    class OnlyLeft(SimulatedBody):
        def plan(self, request: Any, obstacles: Any, seed: int) -> Any:
            arm = next(arm for arm in self.robot.description.arms.values() if arm.side > 0)
            return super().plan(replace(request, arm=arm.name), obstacles, seed)

    placements = [Placement(product("can", 3), 0.17, -0.01, 0.0),
                  Placement(product("bottle", 7), *LEFT, 0.0)]  # fmt: skip
    body = OnlyLeft(placements, tmp_path, Conditions("nao", "fast"))
    with body.world as world:
        world.step(0.3)
        tracker = Tracker()
        view = look_at_side(body, tracker, None, "right").perceived
        assert all(seen.position[1] < 0.1 for seen in view.objects)
        [track] = tracker.in_view(-1)
        x, y = track.seen.position
        grasp = {"id": "g:1", "source": "candidate", "x": x, "y": y, "z": 0.3, "theta": 0.0,
                 "width": track.seen.shape.width, "opening": 0.05, "mean": 0.9}  # fmt: skip
        remembered = tracker.remembered(track, view.objects)
        choice = choose_grasp(body, track, view, [grasp], 10, 1, remembered)
        before = world.object_pose(body.laid[1].body).position
        assert choice.plan is not None
        record, _ = body.execute(choice.plan)
        after = world.object_pose(body.laid[1].body).position
    assert record.held
    assert np.linalg.norm(np.subtract(after, before)) < 0.005
