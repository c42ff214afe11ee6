"""A robot at a bench as grasps are chosen and planned for it: other arms stand in its way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from features.geometry import FloatArray
from features.perception import Ignored, Perceived, Seen, perceive
from simulate.agent.second_look import View
from simulate.agent.simulated_body import RobotAtTable
from simulate.grasping.executor import GraspRequest, PlannedGrasp
from simulate.motion.collision import Obstacle
from simulate.robots.description import Floats
from simulate.tasks.arms.bench import Station, moved_obstacle

__all__ = ["RobotAtBench"]

Spots = tuple[tuple[float, float], ...]

_EDGE_M = 0.02
_NO_STANCE = "ik"


class RobotAtBench(RobotAtTable):
    """A robot of a bench: looks at areas, and plans with one chosen arm.

    Parameters
    ----------
    station
        Where it stands.
    """

    def __init__(self, station: Station) -> None:
        super().__init__(station.executor)
        self.station = station
        self.arm = ""
        """Name of the arm to plan for; empty = any."""
        self.is_holding = False
        """Whether a hand of it holds something, so that it keeps its stance."""
        self.ignored = (*self._beyond(), *self._boxes(""))
        self._ways: dict[tuple[object, ...], tuple[float, ...]] = {}

    def plan(
        self, request: GraspRequest, obstacles: list[FloatArray], seed: int
    ) -> PlannedGrasp | str:
        """Plan a grasp with the chosen arm around what the camera saw and the other robots."""
        if self.is_holding and request.stances == "other":
            return _NO_STANCE
        if self.arm:
            request = replace(request, arm=self.arm)
        clouds = [cloud.astype(np.float64) for cloud in obstacles]
        return self.executor.plan(request, [*clouds, *self.station.others()], seed)

    def look_at(self, area: str, number: int = 0) -> tuple[View, list[Seen]]:
        """Look at an area; return the view and what is seen within it.

        Parameters
        ----------
        number
            Which of the :meth:`viewpoints`.
        """
        side, camera = self.viewpoints(area)[number]
        frame, base_from_camera = self.look(side, camera)
        is_box = self.station.bench.layout.area(area).is_box
        ignored = (*self._beyond(), *self._boxes(area)) if is_box else self.ignored
        perceived = perceive(frame, base_from_camera, ignored)
        inside = [s for s in perceived.objects if self.station.area_at(s.position) == area]
        return View(frame, base_from_camera, perceived), inside

    def viewpoints(self, area: str) -> list[tuple[str, str | None]]:
        """Return sides and cameras that show an area, the one that shows most of it first."""
        side = "left" if sum(self.station.ranges(area)[1]) > 0 else "right"
        cameras = self.robot.description.cameras
        first = next(iter(cameras.values()))
        if any(first.look.values()):
            box = f"box_{side}"
            is_box = self.station.bench.layout.area(area).is_box
            directions = (box, side, "ahead") if is_box else (side, "ahead", box)
            return [(name, None) for name in directions if name in first.look]
        shown = {name: self._share_shown(area, name) for name in cameras}
        best = sorted(shown, key=lambda name: (-shown[name], name != first.name))
        used = [name for name in best if shown[name] == _CORNERS] or best[:1]
        return [(side, None if name == first.name else name) for name in used]

    def shows(self, area: str) -> bool:
        """Whether a camera that stands still has all of an area in its picture."""
        cameras = self.robot.description.cameras
        turns = any(next(iter(cameras.values())).look.values())
        return not turns and any(self._share_shown(area, c) == _CORNERS for c in cameras)

    def _share_shown(self, area: str, camera: str) -> int:
        """Return how many corners of an area are in the picture of a camera that stands still."""
        (x0, x1), (y0, y1) = self.station.ranges(area)
        height = self.robot.description.workplace.table_height
        camera_from_base = np.linalg.inv(self.robot.base_from_camera(None, camera))
        intrinsics = self.eyes.camera.intrinsics
        shown = 0
        for corner in ([x0, y0], [x0, y1], [x1, y0], [x1, y1]):
            x, y, z = (camera_from_base @ [*corner, height, 1.0])[:3]
            u = intrinsics.fx * x / z + intrinsics.cx
            v = intrinsics.fy * y / z + intrinsics.cy
            shown += bool(0 <= u < intrinsics.width and 0 <= v < intrinsics.height)
        return shown

    def _beyond(self) -> Iterator[Ignored]:
        """Yield what is off the table, where robots stand."""
        x = self.robot.description.workplace.table_x
        everywhere = (-np.inf, np.inf)
        yield Ignored((-np.inf, x[0] - _EDGE_M), everywhere)
        yield Ignored((x[1] + _EDGE_M, np.inf), everywhere)

    def _boxes(self, but: str) -> Iterator[Ignored]:
        for name, box in self.station.bench.boxes.items():
            if name != but:
                seen = self.station.seen(box)
                yield Ignored(seen.x_range, seen.y_range)

    def free_spots(
        self, area: str, size: float, view: Perceived, request: GraspRequest | None = None,
        used: Spots = (),
    ) -> Spots:  # fmt: skip
        """Return spots (x, y), m, base frame, of an area for something of a size, best first.

        There are none where other things leave no room for it.

        Parameters
        ----------
        request
            The grasp that holds it: spots where the other robots of the area get their hands around
            it come first. By default the freest do.
        used
            Spots where it was before, which come last.
        """
        (x0, x1), (y0, y1) = self.station.ranges(area)
        margin = min(size / 2, (x1 - x0) / 2.2, (y1 - y0) / 2.2)
        xs, ys = np.linspace(x0 + margin, x1 - margin, 3), np.linspace(y0 + margin, y1 - margin, 5)
        spots = np.array([(x, y) for x in xs for y in ys])
        middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
        room = _room(spots, view)
        away = np.linalg.norm(spots - middle, axis=1)
        order = np.lexsort((away, -np.minimum(room, size + _ROOM_M)))
        free = [k for k in order if room[k] > size / 2 + _GAP_M]
        chosen = [(float(spots[k][0]), float(spots[k][1])) for k in free]
        if request is not None:
            ways = self._compared(area, chosen, request, self.beside(view, request))
            chosen.sort(key=lambda spot: -ways.get(spot, 0))
        chosen.sort(key=lambda spot: any(np.hypot(*np.subtract(spot, u)) < _SAME_M for u in used))
        return tuple(chosen[:_SPOTS])

    def beside(self, view: Perceived, request: GraspRequest) -> tuple[Obstacle, ...]:
        """Return what a view shows as obstacles, base frame."""
        floor = request.table_height
        return tuple(
            Obstacle.around("neighbour", seen.points.astype(np.float64), floor)
            for seen in view.objects
        )

    def _compared(
        self, area: str, spots: Sequence[tuple[float, float]], request: GraspRequest,
        beside: Sequence[Obstacle],
    ) -> dict[tuple[float, float], int]:  # fmt: skip
        """Return the number of ways to the freest spots, and to others where these have none."""
        ways: dict[tuple[float, float], int] = {}
        for spot in spots:
            if len(ways) >= _COMPARED and any(ways.values()):
                break
            ways[spot] = len(self.ways(area, spot, request, beside))
        return ways

    def ways(
        self, area: str, spot: tuple[float, float], request: GraspRequest,
        beside: Sequence[Obstacle] = (),
    ) -> tuple[float, ...]:  # fmt: skip
        """Return closing directions by which all robots of an area get to a thing at a spot.

        Robots at one table know how the others are built, and where these stand. There are none in
        an area of one robot.

        Parameters
        ----------
        spot
            (x, y) m, base frame.
        request
            The grasp that holds the thing now.
        beside
            What stands there, base frame: a hand needs room beside it.

        Returns
        -------
        tuple of float
            About the vertical, rad, base frame.
        """
        stands = tuple(np.round(obstacle.centre, 3).tobytes() for obstacle in beside)
        key = (area, spot, request.width, request.height, request.length, request.round, stands)
        if key not in self._ways:
            self._ways[key] = self._find_ways(area, spot, request, beside)
        return self._ways[key]

    def _find_ways(
        self, area: str, spot: tuple[float, float], request: GraspRequest,
        beside: Sequence[Obstacle],
    ) -> tuple[float, ...]:  # fmt: skip
        mine, x, y = self.station, *spot
        at = mine.world_from_base @ [x, y, 0.0, 1.0]
        yaw = float(np.arctan2(mine.world_from_base[1, 0], mine.world_from_base[0, 0]))
        hands = [(other, arm) for other in mine.bench.stations.values()
                 for arm, names in other.post.reach.items() if area in names]  # fmt: skip
        hands.sort(key=lambda hand: hand[0] is mine)
        if all(other is mine for other, _ in hands):
            return ()
        there = [moved_obstacle(obstacle, mine.world_from_base) for obstacle in beside]
        angles = _ANGLES[:1] if request.round else _ANGLES
        return tuple(
            angle for angle in angles
            if all(other.gets_to(arm, at, request, angle + yaw, there) for other, arm in hands)
        )  # fmt: skip


_SPOTS = 5
_COMPARED = 6
"""Spots of which it is asked whether others get to them."""
_SAME_M = 0.015
_ANGLES = (0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4)
"""Closing directions about the vertical, rad, at which a thing may come to lie."""
_CORNERS = 4
_ROOM_M, _GAP_M = 0.03, 0.01
"""Around a thing: as much as is of use, and the least."""


def _room(spots: Floats, view: Perceived) -> Floats:
    """Return the distance of spots (n, 2) from the nearest thing, m."""
    clouds = [seen.points[:, :2] for seen in view.objects]
    if not clouds:
        return np.full(len(spots), np.inf)
    points = np.concatenate(clouds)
    return np.array([np.linalg.norm(points - spot, axis=1).min() for spot in spots])
