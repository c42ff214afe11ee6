"""Test whether the surface between two jaws opposes them (ten Pas and Platt 2015, 4).

A jaw at -x pushes along +x, so the surface it needs has normals along -x, and the other way round.
"""

from __future__ import annotations

import numba

from grasp.spatial.candidate import Antipodal

__all__ = ["REFERENCE_VOXEL_M", "antipodal_label", "opposing", "support_needed"]

REFERENCE_VOXEL_M = 0.003
"""Distance between points for which the published count of six holds, m."""


@numba.njit(cache=True, nogil=True)
def opposing(along_x, cos_angle):  # type: ignore[no-untyped-def]
    """Return -1 when a normal with this part along the closing direction opposes the jaw at -x,
    1 the one at +x, 0 neither. ``cos_angle``: of the largest angle between them."""
    if along_x < -cos_angle:
        return -1
    if along_x > cos_angle:
        return 1
    return 0


def support_needed(count: float, voxel: float) -> float:
    """Return the number of points that must be exceeded at a voxel edge of ``voxel`` m.

    ``count`` holds at 3 mm; a patch of surface holds (3 mm / voxel)^2 as many points.

    >>> support_needed(6, 0.006)
    1.5
    """
    return count * (REFERENCE_VOXEL_M / voxel) ** 2


def antipodal_label(left: float, right: float, needed: float) -> Antipodal:
    """Return ``full``, ``half`` or ``none``.

    Parameters
    ----------
    left, right
        Points that oppose the jaw at -x and at +x.
    needed
        A side counts if it has more points than this.

    Examples
    --------
    >>> antipodal_label(7, 7, 6), antipodal_label(7, 6, 6), antipodal_label(6, 6, 6)
    ('full', 'half', 'none')
    """
    if left > needed and right > needed:
        return "full"
    return "half" if left > needed or right > needed else "none"
