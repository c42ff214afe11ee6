"""Looks of a robot at what it grasps: the place of the object, the hand, and the box."""

from __future__ import annotations

import numpy as np

from simulate.grasping.attempt.station import Station
from simulate.grasping.judgement import HeightMap
from simulate.grasping.placing import held_load
from simulate.grasping.rules import PlannedGrasp
from simulate.robots.description import Floats
from simulate.world.robot_body import REST_OPENING
from simulate.world.world import PlaceBox

__all__ = ["Looks"]

_HIGHEST_M = 0.20
_BESIDE_M = 0.05
_MARGIN_M = 0.005
_OVER_TABLE_M = 0.010
_ARM_MARGIN_M = 0.010
_ACROSS_M = 0.05
"""Beyond the middle of the table, seen in a look at one side of it."""
_LOW_M = 0.030
"""Over the table: a lifted hand and what it holds are higher."""


class Looks:
    """Takes views of one object, of the hand that holds it, and of the box that it goes into.

    Parameters
    ----------
    station
        The robot at its workplace.
    plan
        The planned grasp of the object.
    """

    def __init__(self, station: Station, plan: PlannedGrasp) -> None:
        self._station, self._plan = station, plan

    def old_place(self) -> HeightMap:
        """Return the height map of the object's original place."""
        request = self._plan.request
        half = max(request.width, request.length) / 2 + _MARGIN_M
        return self.table(request.x, request.y, half)

    def low(self, outline: tuple[float, float, float, float, float]) -> HeightMap:
        """Return the map of what is low around an object, given x, y, yaw, length and width."""
        x, y, _, length, _ = outline
        return self.table(x, y, length / 2 + _BESIDE_M / 2, _LOW_M)

    def table(
        self, x: float, y: float, half: float = _BESIDE_M, height: float = _HIGHEST_M
    ) -> HeightMap:
        """Return the height map, up to a height, of the square of side ``2 half`` around (x, y)."""
        floor = self._plan.request.table_height
        points = self._station.eyes.points("left" if y > 0 else "right")
        return HeightMap.of(
            points, (x - half, x + half), (y - half, y + half), floor, floor + height
        )

    def area(self, x_range: tuple[float, float], y_range: tuple[float, float]) -> HeightMap:
        """Return the height map of an area of the table, m, base frame, without the arms."""
        points = self._station.eyes.points("left" if sum(y_range) > 0 else "right")
        return self._without_arms(points, x_range, y_range, self._plan.request.table_height)

    def box(self, box: PlaceBox) -> HeightMap:
        """Return the height map of a box, without the arms that hide a part of it."""
        points = self._station.eyes.box_points(box.side)
        return self._without_arms(points, box.x_range, box.y_range, box.floor)

    def beside(self, box: PlaceBox) -> HeightMap:
        """Return the height map of the table up to the inner wall of a box, without the arms."""
        place = self._station.robot.description.workplace
        inner = min(abs(y) for y in box.y_range) - box.wall - _MARGIN_M
        y_range = (-_ACROSS_M, inner) if box.side == "left" else (-inner, _ACROSS_M)
        points = self._station.eyes.points(box.side)
        return self._without_arms(points, place.table_x, y_range, self._plan.request.table_height)

    def _without_arms(
        self,
        points: Floats,
        x_range: tuple[float, float],
        y_range: tuple[float, float],
        floor: float,
    ) -> HeightMap:
        """Return the height map of a rectangle of what is seen, but for the robot's arms."""
        ceiling = floor + _HIGHEST_M
        low, high = np.array([x_range, y_range]).T
        over = ((points[:, :2] >= low) & (points[:, :2] < high)).all(axis=1)
        points = points[over & (points[:, 2] < ceiling)]
        robot = self._station.robot
        space = self._station.space_of(robot.stance)
        for arm in space.chains:
            spheres = space.spheres(arm, REST_OPENING)
            points = points[~spheres.shows(robot.arm_joints(arm), points, _ARM_MARGIN_M)]
        return HeightMap.of(points, x_range, y_range, floor, ceiling)

    def turn_in_hand(self) -> float | None:
        """Return how far what is held has turned about the closing axis, rad; None if not seen.

        The hand may hide it in the look at its side, and not from straight ahead.
        """
        plan, robot = self._plan, self._station.robot
        tool = robot.tool_pose(plan.arm)
        gap = robot.finger_opening(plan.arm) * robot.arm(plan.arm).mouth
        load = held_load(plan, self._station.space_of(plan.stance).chains[plan.arm])
        for direction in ("left" if plan.request.y > 0 else "right", "ahead"):
            points = self._station.eyes.points(direction)
            points = points[points[:, 2] > plan.request.table_height + _OVER_TABLE_M]
            turn = load.seen_turn((points - tool[:3, 3]) @ tool[:3, :3], gap)
            if turn is not None:
                return turn
        return None
