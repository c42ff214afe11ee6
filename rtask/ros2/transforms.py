"""Poses of cameras by ``/tf`` and ``/tf_static``, at the time of their views.

A buffer of our own: tf2's is not in every environment, and its waits go by ROS time, which may
stand still.
"""

from __future__ import annotations

import bisect
import math
import threading
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

from rtask.errors import UsageError
from rtask.interop.ros.convert import JsonObject, time_of

__all__ = ["Transform", "TransformBuffer"]

_WAIT_S = 0.5
_BUFFER_NS = 10 * 10**9
_MAX_DEPTH = 100
_LONG_GAP_NS = 5 * 10**8
_MOVED_M, _TURNED_RAD = 0.005, 0.01
"""What moves less between two of its transforms may be taken to lie on the way between them."""
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Transform(NamedTuple):
    """target_from_source: a translation, m, and a unit quaternion (x, y, z, w)."""

    move: Vector
    turn: Quaternion

    def __matmul__(self, other: Transform) -> Transform:
        """Return target_from_other, where ``other`` is source_from_other.

        >>> up, left = Transform((0, 0, 1), (0, 0, 0, 1)), Transform((0, 1, 0), (0, 0, 1, 0))
        >>> (left @ up).move, (left @ Transform((1, 0, 0), (0, 0, 0, 1))).move
        ((0, 1, 1), (-1, 1, 0))
        """
        x, y, z = _rotated(self.turn, other.move)
        a, b, c = self.move
        return Transform((a + x, b + y, c + z), _product(self.turn, other.turn))

    def inverse(self) -> Transform:
        """Return source_from_target."""
        x, y, z, w = self.turn
        back = (-x, -y, -z, w)
        i, j, k = _rotated(back, self.move)
        return Transform((-i, -j, -k), back)

    def as_matrix(self) -> list[list[float]]:
        """Return it as the rows of a (4, 4) matrix.

        >>> Transform((1, 2, 3), (0, 0, 1, 0)).as_matrix()[0]
        [-1.0, 0.0, 0.0, 1.0]
        """
        columns = [_rotated(self.turn, axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        rows = [
            [float(column[k]) + 0.0 for column in columns] + [float(self.move[k])] for k in range(3)
        ]
        return [*rows, [0.0, 0.0, 0.0, 1.0]]

    def as_pose(self) -> JsonObject:
        """Return it as geometry_msgs/Pose, of the source in the target."""
        return {
            "position": dict(zip("xyz", self.move, strict=True)),
            "orientation": dict(zip("xyzw", self.turn, strict=True)),
        }


_IDENTITY = Transform((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


class _Edge:
    """Poses of one frame in its parent, by time."""

    def __init__(self, parent: str) -> None:
        self.parent = parent
        self.times: list[int] = []
        self.poses: list[Transform] = []

    def add(self, stamp_ns: int, pose: Transform) -> None:
        place = bisect.bisect_left(self.times, stamp_ns)
        if place < len(self.times) and self.times[place] == stamp_ns:
            self.poses[place] = pose
            return
        self.times.insert(place, stamp_ns)
        self.poses.insert(place, pose)
        # Counted from the newest stamp, not from the clock: a recording replays another time.
        old = bisect.bisect_left(self.times, self.times[-1] - _BUFFER_NS)
        del self.times[:old], self.poses[:old]

    def at(self, stamp_ns: int) -> Transform | None:
        """Return the pose at a time, between its neighbours; None outside of what was heard."""
        after = bisect.bisect_left(self.times, stamp_ns)
        if after == len(self.times):
            return None
        if self.times[after] == stamp_ns:
            return self.poses[after]
        if after == 0:
            return None
        before = self.times[after - 1]
        share = (stamp_ns - before) / (self.times[after] - before)
        return _between(self.poses[after - 1], self.poses[after], share)

    def doubt(self, stamp_ns: int) -> str:
        """Return why a pose between its neighbours is a guess; empty if it is none."""
        after = bisect.bisect_left(self.times, stamp_ns)
        if not 0 < after < len(self.times) or self.times[after] == stamp_ns:
            return ""
        gap_ns = self.times[after] - self.times[after - 1]
        before, then = self.poses[after - 1], self.poses[after]
        moved_m = math.dist(before.move, then.move)
        cosine = abs(sum(p * q for p, q in zip(before.turn, then.turn, strict=True)))
        turned_rad = 2 * math.acos(min(cosine, 1.0))
        if gap_ns <= _LONG_GAP_NS or (moved_m < _MOVED_M and turned_rad < _TURNED_RAD):
            return ""
        return (
            f"its transforms are {gap_ns / 1e9:.1f} s apart then, {moved_m:.2f} m and "
            f"{math.degrees(turned_rad):.0f} degrees: taken for an even way between them"
        )


class TransformBuffer:
    """Transforms of the last ten seconds, and the static ones."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._moving: dict[str, _Edge] = {}
        self._static: dict[str, tuple[str, Transform]] = {}

    def __bool__(self) -> bool:
        return bool(self._moving or self._static)

    def take(self, message: Any, *, is_static: bool = False) -> None:
        """Accept a tf2_msgs/TFMessage."""
        with self._changed:
            for stamped in message.transforms:
                child = stamped.child_frame_id.lstrip("/")
                parent = stamped.header.frame_id.lstrip("/")
                pose = _transform_of(stamped.transform)
                if pose is None or not child or child == parent:
                    continue
                if is_static:
                    self._static[child] = (parent, pose)
                    continue
                edge = self._moving.get(child)
                # What was hung elsewhere begins anew: between poses in two parents there is no
                # pose.
                if edge is None or edge.parent != parent:
                    edge = self._moving[child] = _Edge(parent)
                secs, nsecs = time_of(stamped.header.stamp)
                edge.add(secs * 10**9 + nsecs, pose)
            self._changed.notify_all()

    def clear(self) -> None:
        """Forget everything but the static ones, as after a jump back in time."""
        with self._changed:
            self._moving.clear()

    def lookup(self, target: str, source: str, stamp: Any, wait_s: float = _WAIT_S) -> Transform:
        """Return target_from_source at a time; never of another time.

        Parameters
        ----------
        wait_s
            Longest wait, s of the wall clock.

        Raises
        ------
        UsageError
            There is no such transform at that time.
        """
        secs, nsecs = time_of(stamp)
        deadline = time.monotonic() + wait_s
        with self._changed:
            while True:
                made = self.find(target, source, secs * 10**9 + nsecs)
                if isinstance(made, Transform):
                    return made
                left_s = deadline - time.monotonic()
                if left_s <= 0 or not self._changed.wait(left_s):
                    raise UsageError(
                        f"no transform from {source} to {target} at {secs + nsecs / 1e9:.3f} s: "
                        f"{made}; see `ros2 run tf2_ros tf2_echo {target} {source}`"
                    )

    def find(self, target: str, source: str, stamp_ns: int) -> Transform | str:
        """Return target_from_source at a time, or in words why it is not known."""
        with self._changed:
            return self._find(target.lstrip("/"), source.lstrip("/"), stamp_ns)

    def doubt(self, target: str, source: str, stamp_ns: int) -> str:
        """Return why target_from_source at a time is a guess; empty if it is none.

        tf2 goes straight between two transforms however long ago the first one was, and a robot
        that moved and stood in between was elsewhere.
        """
        with self._changed:
            for end in (target.lstrip("/"), source.lstrip("/")):
                for frame, _ in self._named_steps(end, stamp_ns):
                    edge = None if frame in self._static else self._moving.get(frame)
                    words = edge.doubt(stamp_ns) if edge is not None else ""
                    if words:
                        return f"{frame}: {words}"
        return ""

    def _find(self, target: str, source: str, stamp_ns: int) -> Transform | str:
        ways: dict[str, dict[str, Transform]] = {}
        for end in (target, source):
            reached = ways[end] = {end: _IDENTITY}
            pose = _IDENTITY
            for parent, step in self._steps(end, stamp_ns):
                if step is None:
                    break
                pose = step @ pose
                reached[parent] = pose
        common = next((frame for frame in ways[source] if frame in ways[target]), None)
        if common is not None:
            return ways[target][common].inverse() @ ways[source][common]
        for end in (target, source):
            missing = next((f for f, step in self._named_steps(end, stamp_ns) if step is None), "")
            if missing:
                first, last = self._moving[missing].times[0], self._moving[missing].times[-1]
                return f"{missing} is known from {first / 1e9:.3f} to {last / 1e9:.3f} s only"
        lacking = [end for end in (target, source) if not self._is_published(end)]
        return f"nobody publishes {' or '.join(lacking)}" if lacking else "they are not connected"

    def _is_published(self, frame: str) -> bool:
        parents = [edge.parent for edge in self._moving.values()]
        parents += [parent for parent, _ in self._static.values()]
        return frame in self._moving or frame in self._static or frame in parents

    def _named_steps(self, frame: str, stamp_ns: int) -> Iterator[tuple[str, Transform | None]]:
        """Yield each frame on the way up, and its pose in its parent."""
        # A bound, since publishers that contradict each other can close a ring of frames.
        for _ in range(_MAX_DEPTH):
            if frame in self._static:
                parent, step = self._static[frame]
                yield frame, step
            elif frame in self._moving:
                parent = self._moving[frame].parent
                yield frame, self._moving[frame].at(stamp_ns)
            else:
                return
            frame = parent

    def _steps(self, frame: str, stamp_ns: int) -> Iterator[tuple[str, Transform | None]]:
        """Yield each parent on the way up, and the pose of the frame below in it."""
        for child, step in self._named_steps(frame, stamp_ns):
            moving = self._moving.get(child)
            static = self._static.get(child)
            yield (static[0] if static is not None else moving.parent if moving else ""), step


def _transform_of(message: Any) -> Transform | None:
    """Return a geometry_msgs/Transform; None if its quaternion is no rotation."""
    move, turn = message.translation, message.rotation
    values = (turn.x, turn.y, turn.z, turn.w)
    length = math.sqrt(sum(value * value for value in values))
    if not math.isfinite(length) or length < 1e-6:
        return None
    x, y, z, w = (value / length for value in values)
    return Transform((move.x, move.y, move.z), (x, y, z, w))


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _rotated(turn: Quaternion, v: Vector) -> Vector:
    x, y, z, _ = _product(_product(turn, (*v, 0)), (-turn[0], -turn[1], -turn[2], turn[3]))
    return x, y, z


def _between(a: Transform, b: Transform, share: float) -> Transform:
    """Return the pose at a share of the way: straight, and turning evenly."""
    move = tuple(p + share * (q - p) for p, q in zip(a.move, b.move, strict=True))
    cosine = sum(p * q for p, q in zip(a.turn, b.turn, strict=True))
    # q and -q are the same rotation: one of the two goes the long way round.
    end = b.turn if cosine >= 0 else tuple(-q for q in b.turn)
    angle = math.acos(min(abs(cosine), 1.0))
    # Both sines vanish, and a straight mixture is exact enough.
    if angle < 1e-6:
        weights = (1 - share, share)
    else:
        weights = (math.sin((1 - share) * angle), math.sin(share * angle))
    mixed = [weights[0] * p + weights[1] * q for p, q in zip(a.turn, end, strict=True)]
    length = math.sqrt(sum(value * value for value in mixed))
    x, y, z, w = (value / length for value in mixed)
    return Transform((move[0], move[1], move[2]), (x, y, z, w))
