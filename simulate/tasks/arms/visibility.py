"""Whether a camera sees that something is gone, or does not see where it was.

An arm that holds a thing up hides what stands behind it. Not seen is then not gone: only where the
camera looks through the place that a thing had filled, the thing is no longer there.
"""

from __future__ import annotations

import numpy as np

from features.geometry import FloatArray, Frame
from simulate.robots.description import Floats

__all__ = ["is_seen_through"]

_DEEPER_M = 0.02
_SHARE = 0.5
"""Of the points of a thing, behind which something farther has to be seen."""


def is_seen_through(points: FloatArray, frame: Frame, base_from_camera: Floats) -> bool:
    """Return whether a frame shows what is behind a thing that was there.

    Parameters
    ----------
    points
        (n, 3), m, base frame: the surface of the thing as it was seen before.
    frame
        A whole frame.
    base_from_camera
        (4, 4), its pose.

    Examples
    --------
    >>> from features.geometry import Intrinsics
    >>> frame = Frame(np.full((4, 4), 2.0, np.float32), Intrinsics(4, 4, 4.0, 4.0, 2.0, 2.0))
    >>> [is_seen_through(np.array([[0.0, 0.0, z]]), frame, np.eye(4)) for z in (1.0, 2.0, 3.0)]
    [True, False, False]
    """
    at = (points - base_from_camera[:3, 3]) @ base_from_camera[:3, :3]
    at = at[at[:, 2] > 0]
    intrinsics, (height, width) = frame.intrinsics, frame.depth_m.shape
    u = np.rint(intrinsics.fx * at[:, 0] / at[:, 2] + intrinsics.cx).astype(int)
    v = np.rint(intrinsics.fy * at[:, 1] / at[:, 2] + intrinsics.cy).astype(int)
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    deeper = frame.depth_m[v[inside], u[inside]] > at[inside, 2] + _DEEPER_M
    # Beyond the border, or without depth, a point says nothing: all of them count.
    return len(points) > 0 and float(deeper.sum()) > _SHARE * len(points)
