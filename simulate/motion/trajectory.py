"""Time parametrisation of paths in joint space.

A waypoint is (p, v, a, t): position, velocity, acceleration and time (Gatto 2016, 4.2). The path
is a C2 cubic spline through the corners; its speed is the highest that the limits of velocity and
acceleration allow, found by a forward and a backward pass over the path (Bobrow 1985), a little
below the optimum because the two components of the acceleration are bounded separately.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulate.robots.description import Floats

__all__ = ["ACCELERATION", "CARRYING_ACCELERATION", "Trajectory", "join", "reverse", "time_path"]

ACCELERATION = 12.0
"""rad/s^2, limit of every joint."""
CARRYING_ACCELERATION = 3.0
"""rad/s^2 with an object in the hand, which friction alone holds."""
_SAMPLE_S = 0.010
_GRID = 120


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Waypoints.

    Parameters
    ----------
    positions, velocities, accelerations : (n, dof) float; rad, rad/s, rad/s^2
    times : (n,) float, s
        Rising from 0, 10 ms apart except for the last.
    """

    positions: Floats
    velocities: Floats
    accelerations: Floats
    times: Floats

    @property
    def duration(self) -> float:
        """Seconds from the first to the last waypoint."""
        return float(self.times[-1])

    def at(self, time: float) -> tuple[Floats, Floats]:
        """Return position and velocity (dof,) at a time in s, clamped to the ends."""
        if time >= self.duration:
            return self.positions[-1], np.zeros_like(self.velocities[-1])
        index = int(np.searchsorted(self.times, time, side="right")) - 1
        index = min(max(index, 0), len(self.times) - 2)
        span = self.times[index + 1] - self.times[index]
        share = (time - self.times[index]) / span if span > 0 else 1.0
        share = min(max(share, 0.0), 1.0)
        position = self.positions[index] + share * (
            self.positions[index + 1] - self.positions[index]
        )
        velocity = self.velocities[index] + share * (
            self.velocities[index + 1] - self.velocities[index]
        )
        return position, velocity


def time_path(
    corners: Floats,
    velocity: Floats,
    acceleration: float = ACCELERATION,
    is_free: Callable[[Floats], NDArray[np.bool_]] | None = None,
) -> Trajectory:
    """Compute the timing of a path.

    Parameters
    ----------
    corners : (k, dof) float, rad
        k >= 2 postures; equal neighbours are dropped.
    velocity : (dof,) float, rad/s
        Largest joint velocities.
    acceleration
        rad/s^2, of every joint.
    is_free
        Checks the spline, which deviates slightly from the straight edges; if it collides, the path
        is followed edge by edge with a stop at each corner. None skips the check.
    """
    corners = np.atleast_2d(np.asarray(corners, dtype=np.float64))
    if corners.ndim != 2 or velocity.shape != corners.shape[1:]:
        raise ValueError(
            f"corners (k, dof) and velocity (dof,) do not fit: {corners.shape}, {velocity.shape}"
        )
    moves = np.concatenate([[True], np.abs(np.diff(corners, axis=0)).max(axis=1) > 1e-9])
    corners = corners[moves]
    if len(corners) == 1:
        zero = np.zeros_like(corners)
        return Trajectory(corners, zero, zero, np.zeros(1))
    if len(corners) > 2:
        smooth = _time_spline(corners, velocity, acceleration)
        if is_free is None or bool(is_free(smooth.positions[::3]).all()):
            return smooth
    edges = [
        _time_spline(corners[i : i + 2], velocity, acceleration) for i in range(len(corners) - 1)
    ]
    return join(edges)


def join(parts: list[Trajectory]) -> Trajectory:
    """Return the concatenation of trajectories, each beginning where the previous ends."""
    starts = np.cumsum([0.0, *(part.duration for part in parts[:-1])])
    keep = [slice(0, None), *[slice(1, None)] * (len(parts) - 1)]
    return Trajectory(
        np.concatenate([p.positions[k] for p, k in zip(parts, keep, strict=True)]),
        np.concatenate([p.velocities[k] for p, k in zip(parts, keep, strict=True)]),
        np.concatenate([p.accelerations[k] for p, k in zip(parts, keep, strict=True)]),
        np.concatenate([p.times[k] + s for p, k, s in zip(parts, keep, starts, strict=True)]),
    )


def reverse(way: Trajectory, faster: float = 1.0) -> Trajectory:
    """Return a trajectory run backwards, ``faster`` times as fast."""
    return Trajectory(
        way.positions[::-1],
        -way.velocities[::-1] * faster,
        way.accelerations[::-1] * faster**2,
        (way.times[-1] - way.times[::-1]) / faster,
    )


def _time_spline(corners: Floats, velocity: Floats, acceleration: float) -> Trajectory:
    chords = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(chords)])
    if len(corners) == 2:  # a straight edge: constant direction
        direction = (corners[1] - corners[0]) / knots[-1]
        curve = _Line(corners[0], direction)
    else:
        # Here, because servers import this file at their start and plan no motion yet.
        from scipy.interpolate import CubicSpline

        curve = CubicSpline(knots, corners, bc_type="natural")
    s = np.linspace(0.0, knots[-1], _GRID + 1)
    speeds = _speed_profile(curve, s, velocity, acceleration)
    return _sample(curve, s, speeds)


class _Line:
    """A straight edge with the interface of a spline."""

    def __init__(self, start: Floats, direction: Floats) -> None:
        self._start, self._direction = start, direction

    def __call__(self, s: Floats, order: int = 0) -> Floats:
        s = np.asarray(s, dtype=np.float64)[..., None]
        if order == 0:
            return self._start + s * self._direction
        return self._direction * np.ones_like(s) if order == 1 else 0.0 * s * self._direction


def _speed_profile(
    curve: Callable[..., Floats], s: Floats, velocity: Floats, acceleration: float
) -> Floats:
    """Return the path speed (g,) at every grid point: zero at both ends, within limits between."""
    first = np.maximum(np.abs(curve(s, 1)), 1e-9)
    second = np.maximum(np.abs(curve(s, 2)), 1e-9)
    by_velocity = (velocity / first).min(axis=1) ** 2
    by_curvature = (0.5 * acceleration / second).min(axis=1)
    squared = np.minimum(by_velocity, by_curvature)
    squared[0] = squared[-1] = 0.0
    step = s[1] - s[0]

    def gain(here: int, there: int) -> float:
        # The rest of the acceleration that curvature leaves, at either end of the cell.
        value = squared[here]
        rest = min(
            float(((acceleration - second[i] * value) / first[i]).min()) for i in (here, there)
        )
        return float(value + 2 * step * max(rest, 0.0))

    for k in range(len(s) - 1):
        squared[k + 1] = min(squared[k + 1], gain(k, k + 1))
    for k in range(len(s) - 1, 0, -1):
        squared[k - 1] = min(squared[k - 1], gain(k, k - 1))
    return np.asarray(np.sqrt(squared), dtype=np.float64)


def _sample(curve: Callable[..., Floats], s: Floats, speeds: Floats) -> Trajectory:
    step = s[1] - s[0]
    spans = 2 * step / np.maximum(speeds[:-1] + speeds[1:], 1e-12)
    at_grid = np.concatenate([[0.0], np.cumsum(spans)])
    count = max(int(np.ceil(at_grid[-1] / _SAMPLE_S - 1e-9)), 1)
    times = np.minimum(np.arange(count + 1) * _SAMPLE_S, at_grid[-1])
    cell = np.clip(np.searchsorted(at_grid, times, side="right") - 1, 0, len(spans) - 1)
    local = times - at_grid[cell]
    push = (speeds[cell + 1] - speeds[cell]) / spans[cell]
    along = s[cell] + speeds[cell] * local + 0.5 * push * local**2
    speed = speeds[cell] + push * local
    first, second = curve(along, 1), curve(along, 2)
    return Trajectory(
        curve(along),
        first * speed[:, None],
        second * speed[:, None] ** 2 + first * push[:, None],
        times,
    )
