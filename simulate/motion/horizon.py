"""Motions in pieces that end at rest, for robots that nobody stops when their link is lost.

Each piece follows the same path at the same speed, except near its ends, where time is stretched so
that the joints come to rest smoothly: along a ramp, path time runs at sin^2 of the ramp's phase.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from simulate.motion.motion_limits import MotionLimits, slowed
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = ["pieces_of"]

_SAMPLE_S = 0.01
_RAMPS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0)
"""Lengths of a ramp, as shares of the path time of its piece; at 1, the ramps meet."""
_HALVINGS = 8
_SHORTEST_S = 1e-3
_REST_RAD_S = 1e-9


def pieces_of(way: Trajectory, limits: MotionLimits, horizon_s: float) -> list[Trajectory]:
    """Return a motion in pieces that start and end at rest and last at most so long.

    Parameters
    ----------
    way
        Starts and ends at rest.
    limits
        Of the joints; each piece keeps them.
    horizon_s
        Longest piece, s.

    Examples
    --------
    >>> from simulate.motion.trajectory import time_path
    >>> way = time_path(np.array([[0.0], [1.0]]), np.array([0.5]))
    >>> limits = MotionLimits(np.array([0.5]), np.array([2.5]), np.array([np.inf]))
    >>> pieces = pieces_of(way, limits, 1.0)
    >>> len(pieces), bool(max(piece.duration for piece in pieces) <= 1.0)
    (4, True)
    """
    if not horizon_s > 0:
        raise ValueError(f"horizon_s: expected above 0, got {horizon_s}")
    whole = slowed(way, limits)
    if whole.duration <= horizon_s:
        return [whole]
    return [piece for part in _between_rests(way) for piece in _cut(part, limits, horizon_s)]


def _between_rests(way: Trajectory) -> list[Trajectory]:
    """Return the parts of a way between the waypoints at which it rests anyway."""
    rests = np.flatnonzero(np.abs(way.velocities).max(axis=1) < _REST_RAD_S)
    ends = sorted({0, len(way.times) - 1} | {int(k) for k in rests})
    return [
        Trajectory(
            way.positions[a : b + 1], way.velocities[a : b + 1], way.accelerations[a : b + 1],
            way.times[a : b + 1] - way.times[a],
        )
        for a, b in pairwise(ends)
    ]  # fmt: skip


def _cut(way: Trajectory, limits: MotionLimits, horizon_s: float) -> list[Trajectory]:
    """Return the pieces of a way that rests at its own ends only.

    Each is slowed for itself: where the way is straight, it need not wait for its bends.
    """
    whole = slowed(way, limits)
    if whole.duration <= horizon_s:
        return [whole]
    pieces, start = [], 0.0
    while start < way.duration - _SHORTEST_S:
        piece, start = _longest(way, start, limits, horizon_s)
        pieces.append(piece)
    return pieces


def _longest(
    way: Trajectory, start: float, limits: MotionLimits, horizon_s: float
) -> tuple[Trajectory, float]:
    """Return the piece from a path time that gets farthest in the horizon, and where it ends, s."""
    far = min(start + horizon_s, way.duration)
    piece = _quickest(way, start, far, limits)
    if piece.duration <= horizon_s:
        return piece, far
    near, best = start, None
    for _ in range(_HALVINGS):
        end = (near + far) / 2
        piece = _quickest(way, start, end, limits)
        if piece.duration <= horizon_s:
            near, best = end, piece
        else:
            far = end
    if best is None:
        raise ValueError(f"horizon_s: no joint can start and stop within {horizon_s} s")
    return best, near


def _quickest(way: Trajectory, start: float, end: float, limits: MotionLimits) -> Trajectory:
    """Return the way between two path times, s, with the ramps that take the least time."""
    tries = [slowed(_ramped(way, start, end, share), limits) for share in _RAMPS]
    return min(tries, key=lambda one: one.duration)


def _ramped(way: Trajectory, start: float, end: float, share: float) -> Trajectory:
    """Return the way between two path times, s; at rest at both, along ramps of a share of it.

    Where the way itself rests, at its own ends, there is no ramp.
    """
    span = end - start
    up = share * span if start > 0 else 0.0
    down = share * span if end < way.duration else 0.0
    total = span + (up + down) / 2  # a ramp gets half as far as the same time at full pace
    count = max(int(np.ceil(total / _SAMPLE_S)), 2)
    times = np.linspace(0.0, total, count + 1)
    covered, pace, change = _risen(times, up)
    left, pace_left, change_left = _risen(total - times, down)
    is_early = times <= up + (total - up - down) / 2
    along = np.where(is_early, start + covered, end - left)
    pace = np.where(is_early, pace, pace_left)[:, None]
    change = np.where(is_early, change, -change_left)[:, None]
    first = _columns(along, way.times, way.velocities)
    second = _columns(along, way.times, way.accelerations)
    return Trajectory(
        _columns(along, way.times, way.positions),
        first * pace,
        second * pace**2 + first * change,
        times,
    )


def _risen(
    times: Floats, ramp: float
) -> tuple[
    Floats,
    Floats,
    Floats,
]:
    """Return path time (n,), s, its pace, and the change of that, 1/s, after a ramp from rest."""
    if not ramp:
        return times, np.ones_like(times), np.zeros_like(times)
    phase = np.minimum(times, ramp) * (np.pi / (2 * ramp))
    in_ramp = np.minimum(times, ramp) / 2 - np.sin(2 * phase) * (ramp / (2 * np.pi))
    is_ramp = times < ramp
    pace = np.where(is_ramp, np.sin(phase) ** 2, 1.0)
    change = np.where(is_ramp, np.sin(2 * phase) * (np.pi / (2 * ramp)), 0.0)
    return in_ramp + np.maximum(times - ramp, 0.0), pace, change


def _columns(
    at: Floats,
    times: Floats,
    rows: Floats,
) -> Floats:
    """Interpolate rows (n, dof) at times (m,), s."""
    return np.stack([np.interp(at, times, column) for column in rows.T], axis=1)
