"""Grasps from above on a tabletop object (Gatto 2016, 3.3.4: X, Y, theta).

The closing directions follow from the footprint, the height of the fingertips from the measured
size, never from a name: a cylinder is taken at any angle, a box across the sides that fit, a pen
across its long side with some freedom along and about it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.collision import FREE, finger_clearances
from grasp.spatial.footprint import Footprint, JawLines
from grasp.spatial.frames import wrap_axis
from grasp.spatial.gripper import ParallelGripper

__all__ = ["PlanarGrasp", "Side", "openings", "propose_planar", "rate", "rate_all", "tip_heights"]

Side = Literal["full", "half", "none"]

_FRICTION_ANGLE = float(np.arctan(0.5))
_ROUND_ANGLES = 12
_TURNS = np.deg2rad([0.0, 12.5, -12.5, 25.0, -25.0])
_SLIDES_M = (
    0.0, 0.015, -0.015, 0.030, -0.030, 0.045, -0.045, 0.060, -0.060, 0.075, -0.075,
)  # fmt: skip
_END_MARGIN_M = 0.012
_SPARE_M = 0.002
_EASY_M = 0.010
_HEIGHT_STEPS_M = (0.0, 0.007, 0.014)
_TOP_MARGIN_M = 0.002
_TIP_ROOM_M = 0.002


@dataclass(frozen=True)
class PlanarGrasp:
    """One way to take an object from above.

    Parameters
    ----------
    x, y
        Point midway between the jaws, m, in the frame of the footprint.
    z
        Height of the tool centre point over the support, m.
    theta
        Closing direction about +z, rad; which of its two signs suits a hand with unequal jaws is
        for the executor to find out.
    width
        Between the contacts, m.
    opening
        Between the jaws before closing, m.
    quality
        0..1 by geometry alone: an order among candidates, not a probability of success.
    source
        ``outline`` or ``memory``.
    seed
        That ordered equally good candidates.
    antipodal
        ``full``: the outline's normals at both jaws lie within the friction cone; ``half``, at
        one; ``none``. The far side of an outline from one view is assumed, not seen.
    clearance
        From the opened fingers to the nearest neighbour, m, at most 5 cm.
    """

    x: float
    y: float
    z: float
    theta: float
    width: float
    opening: float
    quality: float
    source: Literal["outline", "memory"] = "outline"
    seed: int = 0
    antipodal: Side = "full"
    clearance: float = FREE


def tip_heights(height: float, width: float, length: float, fingertip: float = 0.0) -> list[float]:
    """Return heights of the tool centre point over the support to try, m, best first.

    Tall things are held at half their height within the reach of a small hand, low thick ones
    above the middle, thin lying ones just above the support; each also 7 and 14 mm higher, for an
    arm that cannot come so low.

    Parameters
    ----------
    fingertip
        How far the fingertips reach below the tool centre point, m: they stay 2 mm over the
        support, on which they would jam.

    Examples
    --------
    >>> [round(z, 3) for z in tip_heights(0.08, 0.035, 0.035)]
    [0.04, 0.047, 0.054]
    >>> [round(z, 3) for z in tip_heights(0.018, 0.018, 0.1, fingertip=0.009)]
    [0.011]
    """
    if height >= 0.045:
        base = float(np.clip(0.5 * height, 0.026, 0.045))
    elif height < 0.024 or (width < 0.024 and length > 2.5 * width):
        base = 0.008
    else:
        base = max(0.55 * height, 0.018)
    base = max(base, fingertip + _TIP_ROOM_M)
    tried = [base + step for step in _HEIGHT_STEPS_M]
    return [tried[0], *(z for z in tried[1:] if z <= height - _TOP_MARGIN_M)]


def openings(width: float, footprint: Footprint, gripper: ParallelGripper) -> list[float]:
    """Return openings before the grasp to try, m, best first.

    Wide for tall things, less for low round ones, which a wide hand would push away.
    """
    if footprint.height < 0.045 and footprint.kind == "round":
        shares = (0.7, 0.9)
    elif footprint.height < 0.024:
        shares = (0.75, 1.0)
    else:
        shares = (1.0, 0.8)
    least = min(width + 3 * _SPARE_M, gripper.max_opening)
    tried = [max(share * gripper.max_opening, least) for share in shares]
    return tried if abs(tried[0] - tried[1]) > 1e-9 else tried[:1]


def propose_planar(
    footprint: Footprint,
    gripper: ParallelGripper,
    neighbours: NDArray[np.float64] | None = None,
    seed: int = 0,
    max_candidates: int = 50,
) -> list[PlanarGrasp]:
    """Propose grasps from above, best first.

    Parameters
    ----------
    footprint
        Of the object, in the frame in which grasps are returned.
    neighbours : (m, 3) or None, m
        Points of what stands around: x, y in the same frame, z over the support.
    seed
        Orders candidates of equal quality.
    max_candidates
        How many at most; height and opening variants give way to other directions.

    Returns
    -------
    Empty when no side fits between the jaws or nothing can be reached between the neighbours.

    Examples
    --------
    >>> hand = ParallelGripper("hand", "nao_hand", 0.0, 0.05)
    >>> box = Footprint((0.1, 0.0), 0.0, 0.045, 0.03, 0.05)
    >>> best = propose_planar(box, hand)[0]
    >>> round(best.theta, 3), round(best.width, 3), round(best.z, 3)
    (1.571, 0.03, 0.026)
    """
    if max_candidates < 1:
        raise ValueError(f"max_candidates must be at least 1, got {max_candidates}")
    if neighbours is not None and (neighbours.ndim != 2 or neighbours.shape[1] != 3):
        raise ValueError(f"neighbours must have shape (m, 3) in m, got {neighbours.shape}")
    lines = list(_approaches(footprint))
    thetas = np.array([theta for _, theta in lines])
    met = footprint.contacts_along(
        np.array([through for through, _ in lines]), thetas, gripper.finger_width
    )
    drafts: list[PlanarGrasp] = []
    line: list[int] = []
    for i, (width, (x, y)) in enumerate(
        zip(met.widths.tolist(), met.centres.tolist(), strict=True)
    ):
        if not gripper.fits(width, _SPARE_M):  # nor does NaN, where the jaws close on nothing
            continue
        for z in tip_heights(footprint.height, width, footprint.length, gripper.fingertip):
            for opening in openings(width, footprint, gripper):
                drafts.append(PlanarGrasp(x, y, z, lines[i][1], width, opening, 0.0, seed=seed))
                line.append(i)
    judged = _judged(drafts, footprint, gripper, neighbours, met.of(np.array(line, dtype=np.intp)))
    free = [grasp for grasp in judged if grasp.clearance > 0]
    tie = np.random.default_rng(seed).permutation(len(free))
    order = sorted(range(len(free)), key=lambda i: (-free[i].quality, tie[i]))
    if len(order) > max_candidates:
        # The best of each place and direction first: its variants would fill the list.
        seen: Counter[tuple[float, float, float]] = Counter()
        variant = []
        for i in order:
            aim = (free[i].x, free[i].y, free[i].theta)
            variant.append(seen[aim])
            seen[aim] += 1
        chosen = sorted(range(len(order)), key=lambda k: (variant[k], k))[:max_candidates]
        order = [order[k] for k in sorted(chosen)]
    return [free[i] for i in order]


def rate(
    footprint: Footprint,
    gripper: ParallelGripper,
    grasp: PlanarGrasp,
) -> PlanarGrasp | None:
    """Judge a grasp that comes from elsewhere on an object as it is measured now.

    Parameters
    ----------
    grasp
        In the footprint's frame; its width, quality, clearance and antipodal label are replaced.

    Returns
    -------
    None when the jaws would close on nothing or the object no longer fits between them.
    """
    return rate_all(footprint, gripper, [grasp])[0]


def rate_all(
    footprint: Footprint,
    gripper: ParallelGripper,
    grasps: Sequence[PlanarGrasp],
    neighbours: NDArray[np.float64] | None = None,
) -> list[PlanarGrasp | None]:
    """Judge many grasps at once; see :func:`rate`."""
    rated: list[PlanarGrasp | None] = [None] * len(grasps)
    met = footprint.contacts_along(
        np.array([(g.x, g.y) for g in grasps]).reshape(-1, 2),
        np.array([g.theta for g in grasps]),
        gripper.finger_width,
    )
    widths = met.widths.tolist()
    held = [i for i, width in enumerate(widths) if gripper.fits(width, 0.0)]
    drafts = [
        replace(
            grasps[i],
            width=widths[i],
            opening=float(np.clip(grasps[i].opening, widths[i], gripper.max_opening)),
        )
        for i in held
    ]
    lines = met.of(np.array(held, dtype=np.intp))
    for i, grasp in zip(held, _judged(drafts, footprint, gripper, neighbours, lines), strict=True):
        rated[i] = grasp
    return rated


def _approaches(footprint: Footprint) -> Iterator[tuple[tuple[float, float], float]]:
    """Yield points to close around and closing directions after the kind of footprint."""
    centre = (float(footprint.centre[0]), float(footprint.centre[1]))
    along, across = footprint.yaw, footprint.yaw + np.pi / 2
    if footprint.kind in ("round", "irregular"):
        for k in range(_ROUND_ANGLES):
            yield centre, wrap_axis(along + k * np.pi / _ROUND_ANGLES)
        return
    free = footprint.length / 2 - _END_MARGIN_M
    for slide in _SLIDES_M:
        if slide == 0 or abs(slide) <= free:
            x = centre[0] + slide * float(np.cos(along))
            y = centre[1] + slide * float(np.sin(along))
            for turn in _TURNS:
                yield (x, y), wrap_axis(across + turn)
    if footprint.kind == "rectangle":
        for turn in _TURNS[:3]:
            yield centre, wrap_axis(along + turn)


def _judged(
    drafts: Sequence[PlanarGrasp],
    footprint: Footprint,
    gripper: ParallelGripper,
    neighbours: NDArray[np.float64] | None,
    lines: JawLines,
) -> list[PlanarGrasp]:
    """Return drafts with clearance, antipodal label and quality filled in.

    The quality multiplies what is left over by: room between the jaws, slip angle at the contacts,
    room for the fingers, distance from the middle, and height and opening off the preferred ones.

    Parameters
    ----------
    lines
        Along which each draft closes.
    """
    if not drafts:
        return []
    at = np.array([(g.x, g.y, g.z, g.theta, g.opening) for g in drafts])
    z, thetas, opened = at[:, 2], at[:, 3], at[:, 4]
    clearance = finger_clearances(at[:, :2], thetas, opened, z, gripper, neighbours)
    spare = (gripper.max_opening - lines.widths - _SPARE_M) / _EASY_M
    slips = lines.deviations / _FRICTION_ANGLE
    offset = at[:, :2] - np.asarray(footprint.centre)
    aside = offset[:, 1] * np.cos(thetas) - offset[:, 0] * np.sin(thetas)
    arm = np.abs(aside) / (footprint.length / 2)
    widths = lines.widths.tolist()
    tip, height, length = gripper.fingertip, footprint.height, footprint.length
    lift = z - [tip_heights(height, w, length, tip)[0] for w in widths]
    excess = opened - [openings(w, footprint, gripper)[0] for w in widths]
    factors = (
        0.6 + 0.4 * np.clip(spare, 0.0, 1.0),
        np.clip(1.0 - 0.6 * slips.max(axis=1) ** 2, 0.1, 1.0),
        0.4 + 0.6 * np.minimum(clearance / 0.02, 1.0),
        np.clip(1.0 - 0.35 * arm**2, 0.2, 1.0),
        np.clip(1.0 - 10.0 * np.abs(lift), 0.3, 1.0),
        1.0 - 0.5 * np.minimum(np.abs(excess) / gripper.max_opening, 1.0),
        np.where(z <= footprint.height, 1.0, 0.2),
    )
    quality = np.clip(0.95 * np.prod(factors, axis=0), 0.02, 0.98)
    within = (slips <= 1).sum(axis=1).tolist()
    sides: tuple[Side, ...] = ("none", "half", "full")
    return [
        # Rounded, so that equally good candidates are equal in every bit on every machine.
        replace(draft, quality=round(q, 9), antipodal=sides[w], clearance=free)
        for draft, q, w, free in zip(
            drafts, quality.tolist(), within, clearance.tolist(), strict=True
        )
    ]
