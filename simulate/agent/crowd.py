"""Grasps of things that touch, planned on a whole view instead of on one thing at a time.

A segment's neighbours are then obstacles as they are seen, and what lies on top comes first (Gatto
2016, chapter 5). What the graph knows of a recognised object still goes before: a grasp that held
more often than a planned one is likely to. A plan on a view knows nothing of what cannot be seen,
such as an end that breaks; so each failure at a thing takes from what the others promise there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from features.codec import encode_frame, to_wire
from features.geometry import FloatArray, Frame
from features.perception import Perceived, Seen
from simulate.agent.messages import pose_message, tool_pose
from simulate.agent.tracking import TrackedObject
from simulate.robots.description import Floats

__all__ = ["Crowd", "touching"]

_TOUCHING_M = 0.012
_SAME_M = 0.03
_AROUND_M = 0.02
_REPEATED_M, _REPEATED_COS = 0.015, float(np.cos(np.deg2rad(25)))
_MOST = 50
_STRENGTH = 2.0
"""Pseudo-attempts that a planned confidence counts for, as quality by geometry does."""


class Planner(Protocol):
    """The operation of the engine that plans on a view."""

    def plan_on_scene(self, **request: Any) -> Mapping[str, Any]: ...


@dataclass(frozen=True, eq=False)
class _Look:
    """A view of a table, as :meth:`Crowd.look` was given it."""

    frame: Frame
    base_from_camera: NDArray[np.float64]
    view: Perceived
    request: Mapping[str, Any]


class Crowd:
    """Grasps of the things in the latest view of a table: of those that touch, and on demand.

    Parameters
    ----------
    planner
        The shared graph.
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._order: list[int] = []
        self._grasps: dict[int, list[dict[str, Any]]] = {}
        self._failed: dict[int, list[Floats]] = {}
        self._latest: _Look | None = None

    def look(
        self,
        frame: Frame,
        base_from_camera: NDArray[np.float64],
        view: Perceived,
        tracks: Sequence[TrackedObject],
        request: Mapping[str, Any],
    ) -> None:
        """Plan on a view if some of the things touch another in it, else forget the last one.

        What stands free has no grasps from here unless :meth:`look_closer` asks for them: nothing
        keeps the hand from those of the graph.

        Parameters
        ----------
        tracks
            Whose grasps are wanted, as the view shows them.
        request
            Further fields: the gripper, the frame's name, the seed.
        """
        self._order, self._grasps = [], {}
        self._latest = _Look(frame, base_from_camera, view, request)
        crowded = touching(view.objects)
        tracks = [track for track in tracks if any(track.seen is seen for seen in crowded)]
        if tracks:
            self._plan(self._latest, tracks)

    def look_closer(self, track: TrackedObject) -> bool:
        """Plan on the latest view for one thing, wherever it stands; tell whether it has grasps.

        The graph proposes grasps from above across a thing's sides, and knows those of before. What
        is too wide for them, or was missed, may have a narrow part.
        """
        if not self.has_grasps(track) and self._latest is not None:
            self._plan(self._latest, [track])
        return self.has_grasps(track)

    def _plan(self, look: _Look, tracks: Sequence[TrackedObject]) -> None:
        answer = self._planner.plan_on_scene(
            data=to_wire(encode_frame(look.frame)),
            sensor_pose=pose_message(look.base_from_camera),
            support_height=look.view.table_height,
            region=_region(look.view.objects),
            max_grasps=_MOST,
            **look.request,
        )
        owner = _owners(answer["segments"], look.view.objects, tracks)
        for grasp in answer["grasps"]:
            number = owner.get(grasp["segment"])
            if number is None or self._has_failed(number, grasp):
                continue
            if number not in self._grasps:
                self._order.append(number)
            self._grasps.setdefault(number, []).append(dict(grasp))

    def first(self, tracks: Iterable[TrackedObject]) -> TrackedObject | None:
        """Return the thing with the best grasp, or None where nothing was planned on."""
        rank = {number: k for k, number in enumerate(self._order)}
        able = [track for track in tracks if track.number in rank and not track.waiting]
        return min(able, key=lambda track: rank[track.number], default=None)

    def has_grasps(self, track: TrackedObject) -> bool:
        """Tell whether grasps of a thing were planned on the latest view."""
        return bool(self._grasps.get(track.number))

    def merged(
        self, track: TrackedObject, grasps: Sequence[dict[str, Any]], most: int
    ) -> list[dict[str, Any]]:
        """Return the graph's grasps of a thing with at most ``most`` of its planned ones.

        Those that the graph knows to hold more often than the best planned one is likely to come
        first, the others last; all of the graph's come first once planned ones failed so often that
        its first is likelier to hold.
        """
        left = _STRENGTH / (_STRENGTH + len(self._failed.get(track.number, ())))
        planned = [
            {**grasp, "source": "scene", "mean": left * grasp["confidence"]}
            for grasp in self._grasps.get(track.number, ())[:most]
        ]
        if not planned:
            return list(grasps)
        if left < 1 and grasps and grasps[0]["mean"] >= planned[0]["mean"]:
            return [*grasps, *planned]
        sure = [
            grasp for grasp in grasps
            if grasp["source"] == "memory" and grasp["mean"] >= planned[0]["mean"]
        ]  # fmt: skip
        return [*sure, *planned, *(grasp for grasp in grasps if grasp not in sure)]

    def fail(self, track: TrackedObject, grasp: Mapping[str, Any]) -> None:
        """Remember a planned grasp that did not hold, so that it is not tried again."""
        if grasp.get("source") == "scene":
            pose = tool_pose(grasp)
            assert pose is not None
            self._failed.setdefault(track.number, []).append(pose)

    def _has_failed(self, number: int, grasp: Mapping[str, Any]) -> bool:
        pose = tool_pose(grasp)
        assert pose is not None
        return any(
            np.linalg.norm(pose[:3, 3] - other[:3, 3]) < _REPEATED_M
            and abs(float(pose[:3, 0] @ other[:3, 0])) > _REPEATED_COS
            for other in self._failed.get(number, ())
        )


def touching(objects: Sequence[Seen]) -> list[Seen]:
    """Return the things that are closer to another than a finger is thick."""
    touching_indices: set[int] = set()
    for (i, first), (j, other) in combinations(enumerate(objects), 2):
        if not {i, j} <= touching_indices and _touch(first.points, other.points):
            touching_indices |= {i, j}
    return [objects[k] for k in sorted(touching_indices)]


def _touch(a: FloatArray, b: FloatArray) -> bool:
    apart = np.maximum(a.min(axis=0) - b.max(axis=0), b.min(axis=0) - a.max(axis=0))
    if float(apart.max()) > _TOUCHING_M:
        return False
    away, _ = cKDTree(a).query(b, distance_upper_bound=_TOUCHING_M)
    return bool(np.isfinite(away).any())


def _region(objects: Sequence[Seen]) -> list[float]:
    """Return x from, x to, y from, y to, m, of all things with a margin."""
    low = np.min([seen.points.min(axis=0) for seen in objects], axis=0) - _AROUND_M
    high = np.max([seen.points.max(axis=0) for seen in objects], axis=0) + _AROUND_M
    return [float(low[0]), float(high[0]), float(low[1]), float(high[1])]


def _owners(
    segments: Iterable[Mapping[str, Any]],
    objects: Sequence[Seen],
    tracks: Sequence[TrackedObject],
) -> dict[int, int]:
    """Return the number of the thing that each segment shows, where there is one."""
    middles = np.array([(o.points.min(axis=0) + o.points.max(axis=0)) / 2 for o in objects])
    owner_of_segment = {}
    for segment in segments:
        away = np.linalg.norm(middles - segment["centre"], axis=1)
        nearest = int(away.argmin())
        track = next((t for t in tracks if t.seen is objects[nearest]), None)
        if track is not None and away[nearest] < _SAME_M:
            owner_of_segment[int(segment["segment"])] = track.number
    return owner_of_segment
