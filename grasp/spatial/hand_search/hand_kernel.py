"""The inner loops of the hand search (compiled).

Hand frame at a sample: y along the approach, x along the closing direction, z along the local
axis, origin on the surface. The fingertips lie at y = bite, the palm at y = bite - depth.
"""

from __future__ import annotations

import numba
import numpy as np

from grasp.spatial.clouds.neighbours import within
from grasp.spatial.hand_search.antipodal import opposing

__all__ = ["COLUMNS", "best_slot", "search_samples", "support"]

COLUMNS = (
    "sample",
    "turn",
    "x",
    "bite",
    "width",
    "opening",
    "left",
    "right",
    "left_seen",
    "right_seen",
    "between",
    "left_y",
    "left_z",
    "right_y",
    "right_z",
    "surface_y",
)
"""The fields that :func:`search_samples` returns of each hand; lengths in m, in the hand frame."""


_MIN_BITE = 0.5


@numba.njit(cache=True, nogil=True)
def best_slot(local, count, thick, opening, depth, bite, slots, free, filled):  # type: ignore[no-untyped-def]
    """Return the middle one of the slots where the open hand is free, or -1.

    Parameters
    ----------
    local : (n, 3), m
        Points in the hand frame; the first ``count`` count.
    free : (slots,) out
        Largest bite at which each slot is free.
    filled : (slots,) out
        Whether it has a point between the fingers at ``bite``.
    """
    span = opening + thick  # from the outside of one finger to the inside of the other
    step = span / (slots - 1)
    for s in range(slots):
        free[s] = np.inf
        filled[s] = False
    for k in range(count):
        x, y = local[k, 0], local[k, 1]
        first = max(0, int(np.ceil((x - thick) / step)))
        last = min(slots - 1, int(np.floor((x + span) / step)))
        for s in range(first, last + 1):
            at = x - s * step  # from the inner side of the finger at +x
            if at >= 0.0 or at <= -opening:
                if y < free[s]:
                    free[s] = y
            elif y + depth < free[s]:
                free[s] = y + depth
            if -opening < at < 0.0 and y < bite:
                filled[s] = True
    usable = 0
    for s in range(slots):
        if filled[s] and free[s] >= bite:
            usable += 1
    if usable == 0:
        return -1
    run = usable // 2
    for s in range(slots):
        if filled[s] and free[s] >= bite:
            if run == 0:
                return s
            run -= 1
    return -1


@numba.njit(cache=True, nogil=True)
def _free_bite(local, count, centre, thick, opening, depth):  # type: ignore[no-untyped-def]
    """Return the largest bite at which a hand around ``centre`` is free."""
    limit = np.inf
    for k in range(count):
        at = abs(local[k, 0] - centre)
        if at >= opening / 2 + thick:
            continue
        y = local[k, 1] if at >= opening / 2 else local[k, 1] + depth
        limit = min(limit, y)
    return limit


@numba.njit(cache=True, nogil=True)
def support(local, along_x, flags, count, centre, opening, low, high, cos_angle, touch, out):  # type: ignore[no-untyped-def]
    """Measure what lies between the fingers and count what opposes them.

    Parameters
    ----------
    along_x : (n,)
        Part of each normal along the closing direction.
    flags : (n,) int64
        1 = its normal counts, 2 = it was not seen.
    low, high
        Palm and fingertips along y, m.
    touch
        Points as near as this to the outermost one are the contact, m.
    out : (12,)
        From, to, left, right, left seen, right seen, between, then y and z of the left and of the
        right contact, y of the first surface.

    Returns
    -------
    How many points lie between.
    """
    first, last, surface = np.inf, -np.inf, np.inf
    for k in range(12):
        out[k] = 0.0
    between = 0
    for k in range(count):
        x, y = local[k, 0] - centre, local[k, 1]
        if abs(x) >= opening / 2 or y >= high or y < low:
            continue
        between += 1
        first, last = min(first, local[k, 0]), max(last, local[k, 0])
        surface = min(surface, y)
        if flags[k] & 1:
            side = opposing(along_x[k], cos_angle)
            if side < 0:
                out[2] += 1
                out[4] += 1 if flags[k] & 2 == 0 else 0
            elif side > 0:
                out[3] += 1
                out[5] += 1 if flags[k] & 2 == 0 else 0
    out[0], out[1], out[6], out[11] = first, last, between, surface
    lefts = rights = 0
    for k in range(count):
        x, y = local[k, 0] - centre, local[k, 1]
        if abs(x) >= opening / 2 or y >= high or y < low:
            continue
        if local[k, 0] <= first + touch:
            out[7] += y
            out[8] += local[k, 2]
            lefts += 1
        if local[k, 0] >= last - touch:
            out[9] += y
            out[10] += local[k, 2]
            rights += 1
    if between:
        out[7], out[8] = out[7] / lefts, out[8] / lefts
        out[9], out[10] = out[9] / rights, out[10] / rights
    return between


@numba.njit(cache=True, nogil=True)
def _bite_over_table(  # type: ignore[no-untyped-def]
    origin, rotation, centre, outer, slim, wide, bite, depth, room, table
):
    """Return the largest bite, at most ``bite``, at which fingertips and palm stay ``room`` m over
    a plane (4,); -inf where drawing back does not help."""
    height = table[3] - room
    along = np.zeros(3)
    for k in range(3):
        height += table[k] * origin[k]
        for j in range(3):
            along[j] += rotation[j, k] * table[k]
    height += along[0] * centre - abs(along[0]) * outer / 2
    tips = height - abs(along[2]) * slim + along[1] * bite
    palm = height - abs(along[2]) * wide + along[1] * (bite - depth)
    lack = -min(tips, palm)
    if lack <= 0:
        return bite
    return bite + lack / along[1] if along[1] < -1e-6 else -np.inf


@numba.njit(cache=True, nogil=True)
def search_samples(grid, normals, flags, samples, frames, cameras, table, counts, hand, rule):  # type: ignore[no-untyped-def]
    """Return the hands (m, 16) found at samples, one at most for each turn; see :data:`COLUMNS`.

    Parameters
    ----------
    grid
        Arrays of a :class:`~grasp.spatial.clouds.neighbours.PointGrid`.
    normals, flags : (n, 3), (n,) int64
        Of its points; flags as in :func:`support`.
    samples, frames : (s,) int64, (s, 3, 3)
        Where, and local frames with rows axis, normal, binormal.
    cameras : (k, 3), m
    table : (4,)
        Zeros when there is none.
    counts
        Turns about the axis over the full circle, slots.
    hand
        Thickness of a finger, opening, depth, half the height of the slice of points looked at,
        of a finger and of the palm, reach of the fingers beyond the pads' middle, m.
    rule
        First bite, step, room wanted between object and jaws on each side, and between hand and
        table, m; cosine of the antipodal angle; thickness of a contact, m.
    """
    points = grid[0]
    turns, slots = counts
    thick, opening, depth, half, _, _, _ = hand
    outer = opening + 2 * thick
    reach = np.sqrt(outer * outer + (depth + rule[0]) ** 2 + half * half)
    rows = np.empty((samples.shape[0] * turns, 16))
    total = 0
    near = np.empty(points.shape[0], np.int64)
    local = np.empty((points.shape[0], 3))
    along_x = np.empty(points.shape[0])
    own_flags = np.empty(points.shape[0], np.int64)
    free, filled = np.empty(slots), np.empty(slots, np.bool_)
    rotation = np.empty((3, 3))
    for s in range(samples.shape[0]):
        origin = points[samples[s]]
        around = within(*grid, origin, reach, near)  # type: ignore[call-arg]
        # The slice that the hand can touch is the same for all turns about the axis.
        count_near = _sliced(points, origin, frames[s, 0], half, near, around)
        for k in range(count_near):
            own_flags[k] = flags[near[k]]
        for turn in range(turns):
            _turn(frames[s], 2 * np.pi * turn / turns, rotation)
            if not _seen_from_behind(origin, rotation[1], cameras):
                continue
            _to_hand(points, origin, rotation, near, count_near, local)
            slot = best_slot(local, count_near, thick, opening, depth, rule[0], slots, free, filled)
            if slot < 0:
                continue
            for k in range(count_near):
                n = normals[near[k]]
                along_x[k] = rotation[0, 0] * n[0] + rotation[0, 1] * n[1] + rotation[0, 2] * n[2]
            centre = slot * (opening + thick) / (slots - 1) - opening / 2
            row = rows[total]
            if _placed(
                local, along_x, own_flags, count_near, centre, free[slot], origin, rotation, table,
                hand, rule, row,
            ):  # fmt: skip
                row[0], row[1] = s, turn
                total += 1
    return rows[:total].copy()


@numba.njit(cache=True, nogil=True)
def _placed(  # type: ignore[no-untyped-def]
    local, along_x, flags, count, centre, limit, origin, rotation, table, hand, rule, row
):
    """Push a free hand forward, centre it on what it holds, and measure it into ``row`` (16,).

    Returns
    -------
    False when there is no room for it there, or nothing between the fingers.
    """
    thick, opening, depth, _, slim, wide, tip = hand
    init_bite, step, room, tip_room, cos_angle, touch = rule
    out = row[4:]
    bite = _deepest(limit, init_bite, step, depth)
    support(local, along_x, flags, count, centre, opening, bite - depth, bite, cos_angle, touch,
            out)  # fmt: skip
    # Close around the middle of what lies between; less open where neighbours are near.
    middle, width, margin = (out[0] + out[1]) / 2, out[1] - out[0], opening
    limit = _free_bite(local, count, middle, thick, margin, depth)
    if limit < init_bite:
        margin = min(opening, width + 2 * (room + step))
        limit = _free_bite(local, count, middle, thick, margin, depth)
    if limit < init_bite:
        return False
    bite = min(bite, _deepest(limit, init_bite, step, depth))
    if table[0] != 0 or table[1] != 0 or table[2] != 0:
        outer = margin + 2 * thick
        bite = _bite_over_table(
            origin, rotation, middle, outer, slim, wide, bite, depth, tip_room, table
        )
        if bite < _MIN_BITE * init_bite:
            return False
    if not support(local, along_x, flags, count, middle, margin, bite - depth, bite, cos_angle,
                   touch, out):  # fmt: skip
        return False
    # Too deep is as bad as too shallow: the pads shall meet what the jaws would touch first.
    pads = (out[7] + out[9]) / 2 + tip
    if pads < bite:
        bite = max(pads, min(bite, init_bite))
        support(local, along_x, flags, count, middle, margin, bite - depth, bite, cos_angle, touch,
                out)  # fmt: skip
    middle, width = (out[0] + out[1]) / 2, out[1] - out[0]
    row[2], row[3], row[4], row[5] = middle, bite, width, margin
    return True


@numba.njit(cache=True, nogil=True)
def _sliced(points, origin, axis, half, near, count):  # type: ignore[no-untyped-def]
    """Keep of the first ``count`` numbers in ``near`` those within ``half`` along the axis."""
    count_near = 0
    for k in range(count):
        i = near[k]
        z = 0.0
        for j in range(3):
            z += (points[i, j] - origin[j]) * axis[j]
        if abs(z) < half:
            near[count_near] = i
            count_near += 1
    return count_near


@numba.njit(cache=True, nogil=True)
def _turn(frame, angle, rotation):  # type: ignore[no-untyped-def]
    """Write the rows x, y, z of the hand frame, turned about the local axis."""
    c, s = np.cos(angle), np.sin(angle)
    for j in range(3):
        rotation[1, j] = s * frame[2, j] - c * frame[1, j]
        rotation[2, j] = frame[0, j]
    for j in range(3):
        a, b = (j + 1) % 3, (j + 2) % 3
        rotation[0, j] = rotation[1, a] * rotation[2, b] - rotation[1, b] * rotation[2, a]


@numba.njit(cache=True, nogil=True)
def _to_hand(points, origin, rotation, near, count, local):  # type: ignore[no-untyped-def]
    for k in range(count):
        i = near[k]
        x, y, z = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        for j in range(3):
            local[k, j] = rotation[j, 0] * x + rotation[j, 1] * y + rotation[j, 2] * z


@numba.njit(cache=True, nogil=True)
def _deepest(limit, bite, step, depth):  # type: ignore[no-untyped-def]
    while bite + step <= min(limit, depth) + 1e-12:
        bite += step
    return bite


@numba.njit(cache=True, nogil=True)
def _seen_from_behind(origin, approach, cameras):  # type: ignore[no-untyped-def]
    """Tell whether some camera looks along the approach to within 90 degrees, or none is known."""
    for c in range(cameras.shape[0]):
        dot = 0.0
        for j in range(3):
            dot += approach[j] * (origin[j] - cameras[c, j])
        if dot > 0:
            return True
    return cameras.shape[0] == 0
