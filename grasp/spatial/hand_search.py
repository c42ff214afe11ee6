"""Antipodal grasps on partial clouds (ten Pas and Platt 2015; Gatto 2016, 3.3.3).

At points drawn from the cloud a hand is turned about the local axis of least curvature, slid
sideways until both open fingers are free, and pushed forward until something is in the way. How
much of the surface between the fingers opposes them decides whether it is a grasp.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.antipodal import antipodal_label, support_needed
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.cloud import SurfaceCloud, prepare_cloud
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_kernel import COLUMNS, search_samples
from grasp.spatial.surfaces import surface_frames

__all__ = ["Hands", "SearchOptions", "find_hands", "propose_from_cloud"]

Floats = NDArray[np.float64]

_COLUMN = {name: k for k, name in enumerate(COLUMNS)}
_CELL_M = 0.02
_PALM_ROOM_M = 0.005
_PLACING_M = 0.004


@dataclass(frozen=True)
class SearchOptions:
    """What the search does; defaults are those of the published implementation.

    Parameters
    ----------
    voxel
        Edge, m.
    normal_radius, frame_radius
        Neighbourhoods of a point's normal and of a sample's frame, m.
    turns, slots
        Directions about the local axis over the full circle; sideways positions of the hand.
    init_bite, step
        How far the fingertips reach past the surface at first, and each step deeper, m.
    angle_deg, support
        A jaw is opposed by more than ``support`` points (at 3 mm) whose normals are within this
        angle of the closing direction.
    frames
        Local frames from the points' normals (``pca``) or from quadrics (``quadric``).
    room, table_room
        Wanted between object and jaws on either side, and between hand and table, m.
    silhouette_deg
        Normals further than this from the view ray do not count.
    """

    voxel: float = 0.003
    normal_radius: float = 0.01
    frame_radius: float = 0.03
    turns: int = 8
    slots: int = 10
    init_bite: float = 0.01
    step: float = 0.005
    angle_deg: float = 20.0
    support: float = 6.0
    frames: Literal["pca", "quadric"] = "pca"
    room: float = 0.002
    table_room: float = 0.002
    silhouette_deg: float = 80.0

    def __post_init__(self) -> None:
        if self.turns < 1 or self.slots < 2 or self.init_bite <= 0 or self.step <= 0:
            raise ValueError(
                "turns >= 1, slots >= 2, init_bite and step > 0 m are wanted, got "
                f"{self.turns}, {self.slots}, {self.init_bite}, {self.step}"
            )
        if not (0 < self.angle_deg < 90 and self.support >= 0):
            raise ValueError(
                f"0 < angle_deg < 90 and support >= 0 are wanted, got {self.angle_deg}, "
                f"{self.support}"
            )


@dataclass(frozen=True)
class Hands:
    """Free hands found on a cloud, whatever opposes them.

    Parameters
    ----------
    poses : (m, 4, 4)
        ``frame_from_gripper``.
    table : (m, 16)
        Columns of :data:`grasp.spatial.hand_kernel.COLUMNS`.
    """

    poses: Floats
    table: Floats

    def __len__(self) -> int:
        return len(self.poses)

    def column(self, name: str) -> Floats:
        """Return one column (m,) of the table."""
        return self.table[:, _COLUMN[name]]


def propose_from_cloud(
    points: Floats,
    gripper: ParallelGripper,
    *,
    table: Floats | None = None,
    viewpoints: Floats | None = None,
    obstacles: Floats | None = None,
    samples: int = 200,
    seed: int = 0,
    options: SearchOptions | None = None,
    max_candidates: int = 100,
) -> Proposals:
    """Propose grasps of what a cloud shows, best first.

    Parameters
    ----------
    points : (n, 3), m
        One object, or a table with what stands on it; rows that are not finite are left out.
    gripper
        With its fingers, palm and stroke.
    table : (4,) or None
        Plane under the objects, n . p + d = 0 with n upwards: points near it are not grasped, and
        no hand goes below it.
    viewpoints : (k, 3) or None, m
        Where cameras were. Hands come from the side that some camera sees. None = seen from all
        around.
    obstacles : (m, 3) or None, m
        Points of what else stands there.
    samples
        Points at which a hand is tried.
    seed
        Of the draw: the same input and seed give the same candidates.
    max_candidates
        How many at most.

    Returns
    -------
    Candidates in the frame of ``points`` with label ``full`` or ``half``; when there are none, with
    a ``reason``.

    Raises
    ------
    ValueError
        When an array has the wrong shape or a number is out of range; never for what points say.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> ball = rng.normal(size=(4000, 3)); ball /= np.linalg.norm(ball, axis=1)[:, None]
    >>> hand = ParallelGripper("hand", "jaw", 0.0, 0.08)
    >>> found = propose_from_cloud(0.025 * ball, hand, samples=20)
    >>> found[0].antipodal, round(found[0].width, 2)
    ('full', 0.05)
    >>> propose_from_cloud(0.06 * ball, hand, samples=20).reason
    'every side of what is seen is wider than the stroke of 80 mm'
    """
    if samples < 1 or max_candidates < 1:
        raise ValueError(
            f"samples and max_candidates must be at least 1, got {samples}, {max_candidates}"
        )
    options = options or SearchOptions()
    cloud = prepare_cloud(
        points,
        table=table,
        viewpoints=viewpoints,
        obstacles=obstacles,
        voxel=options.voxel,
        normal_radius=options.normal_radius,
        silhouette_deg=options.silhouette_deg,
    )
    return propose_on(cloud, gripper, samples, seed, options, max_candidates)


def propose_on(
    cloud: SurfaceCloud,
    gripper: ParallelGripper,
    samples: int = 200,
    seed: int = 0,
    options: SearchOptions | None = None,
    max_candidates: int = 100,
) -> Proposals:
    """Propose grasps on a cloud that is ready; see :func:`propose_from_cloud`."""
    options = options or SearchOptions()
    if cloud.reason:
        return Proposals(reason=cloud.reason, notes=cloud.notes)
    hands = find_hands(cloud, gripper, samples, seed, options)
    if len(hands) == 0:
        reason = _wider(cloud, gripper) or "no room for the open fingers on both sides of anything"
        return Proposals(reason=reason, notes=cloud.notes, counts={"hands": 0})
    needed = support_needed(options.support, cloud.voxel)
    width = hands.column("width")
    fits = (width >= gripper.min_opening) & (width <= gripper.max_opening - 2 * options.room)
    weaker = np.minimum(hands.column("left"), hands.column("right"))
    stronger = np.maximum(hands.column("left"), hands.column("right"))
    counts = Counter(
        hands=len(hands),
        wide=int((~fits).sum()),
        full=int((fits & (weaker > needed)).sum()),
        half=int((fits & (weaker <= needed) & (stronger > needed)).sum()),
    )
    chosen = np.flatnonzero(fits & (stronger > needed))
    if len(chosen) == 0:
        reason = _wider(cloud, gripper) or (
            "no surface between the fingers opposes a jaw"
            if fits.any()
            else "what lies between the fingers does not fit the gripper's stroke"
        )
        return Proposals(reason=reason, notes=cloud.notes, counts=dict(counts))
    score = _plausibility(cloud, gripper, hands, needed)
    best = chosen[np.argsort(-score[chosen], kind="stable")][:max_candidates]
    candidates = [
        candidate
        for i in best
        for candidate in _candidates(cloud, gripper, hands, int(i), float(score[i]), needed)
    ]
    return Proposals(tuple(candidates[:max_candidates]), "", cloud.notes, dict(counts))


def _wider(cloud: SurfaceCloud, gripper: ParallelGripper) -> str:
    """Return that no side of the object fits between the jaws, or ""."""
    sides = np.ptp(cloud.points[cloud.target] @ cloud.axes.T, axis=0)
    if sides.min() <= gripper.max_opening:
        return ""
    stroke = f"{1e3 * gripper.max_opening:.3g} mm"
    return f"every side of what is seen is wider than the stroke of {stroke}"


def find_hands(
    cloud: SurfaceCloud,
    gripper: ParallelGripper,
    samples: int = 200,
    seed: int = 0,
    options: SearchOptions | None = None,
) -> Hands:
    """Return all free hands with something between their fingers, in the order of the samples."""
    options = options or SearchOptions()
    rng = np.random.default_rng(seed)
    usable = np.flatnonzero(cloud.target)
    drawn = rng.choice(usable, size=min(samples, len(usable)), replace=False)
    grid = cloud.grid(max(options.normal_radius, 2.5 * cloud.voxel))
    frames, known = surface_frames(
        grid,
        np.where(cloud.counted[:, None], cloud.normals, 0.0),
        drawn,
        max(options.frame_radius, 4 * cloud.voxel),
        cloud.axes[0],
        options.frames == "quadric",
    )
    drawn, frames = drawn[known], np.ascontiguousarray(frames[known])
    palm = gripper.palm or (0.0, 2 * gripper.finger_width, 0.0)
    flags = cloud.counted.astype(np.int64) + 2 * cloud.completed
    depth = gripper.finger_length - _PALM_ROOM_M
    rows = search_samples(
        cloud.grid(_CELL_M).arrays,
        cloud.normals,
        flags * cloud.target,
        drawn,
        frames,
        cloud.viewpoints,
        np.zeros(4) if cloud.table is None else cloud.table,
        (options.turns, options.slots),
        (
            gripper.thickness,
            gripper.max_opening,
            depth,
            gripper.finger_width / 2 + _PLACING_M,
            max(gripper.finger_width, palm[1]) / 2,
        ),
        (
            min(options.init_bite, depth),
            options.step,
            options.room,
            options.table_room,
            float(np.cos(np.deg2rad(options.angle_deg))),
            cloud.voxel,
        ),
    )
    return Hands(_poses(cloud.points[drawn], frames, rows, options.turns, gripper), rows)


def _poses(
    origins: Floats, frames: Floats, rows: Floats, turns: int, gripper: ParallelGripper
) -> Floats:
    """Return ``frame_from_gripper`` (m, 4, 4) of rows of the kernel."""
    sample = rows[:, _COLUMN["sample"]].astype(np.int64)
    angle = 2 * np.pi * rows[:, _COLUMN["turn"]] / turns
    axis, normal, binormal = (frames[sample, k] for k in range(3))
    approach = np.sin(angle)[:, None] * binormal - np.cos(angle)[:, None] * normal
    closing = np.cross(approach, axis)
    poses = np.zeros((len(rows), 4, 4))
    poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2] = closing, -axis, approach
    poses[:, :3, 3] = (
        origins[sample]
        + rows[:, _COLUMN["x"], None] * closing
        + (rows[:, _COLUMN["bite"], None] - gripper.fingertip) * approach
    )
    poses[:, 3, 3] = 1.0
    return poses


def _plausibility(
    cloud: SurfaceCloud, gripper: ParallelGripper, hands: Hands, needed: float
) -> Floats:
    """Return what speaks for each hand by geometry alone (m,), 0..1: an order, no probability."""
    left, right = hands.column("left"), hands.column("right")
    weaker, stronger = np.minimum(left, right), np.maximum(left, right)
    seen = np.minimum(hands.column("left_seen"), hands.column("right_seen")) > needed
    label = np.where(weaker > needed, np.where(seen, 1.0, 0.8), 0.4)
    support = 1.0 - np.exp(-np.where(weaker > needed, weaker, stronger) / (4 * needed))
    between = np.maximum(hands.column("between"), 1.0)
    opposing = np.minimum((left + right) / between, 1.0)
    offset = hands.poses[:, :3, 3] - cloud.centroid
    closing = hands.poses[:, :3, 0]
    across = offset - np.einsum("ij,ij->i", offset, closing)[:, None] * closing
    size = np.linalg.norm(np.ptp(cloud.points[cloud.target], axis=0)) / 2
    arm = np.clip(np.linalg.norm(across, axis=1) / max(float(size), 1e-6), 0.0, 1.0)
    spare = np.clip((gripper.max_opening - hands.column("width")) / 0.02, 0.0, 1.0)
    return np.asarray(
        label * (0.3 + 0.7 * support) * (0.5 + 0.5 * opposing) * (1 - 0.5 * arm)
        * (0.6 + 0.4 * spare)
    )  # fmt: skip


def _candidates(
    cloud: SurfaceCloud,
    gripper: ParallelGripper,
    hands: Hands,
    i: int,
    score: float,
    needed: float,
) -> list[GraspCandidate]:
    """Return hand ``i`` as a candidate, and turned by half a turn where the jaws differ."""
    row = {name: float(hands.table[i, k]) for name, k in _COLUMN.items()}
    pose = hands.poses[i]
    label = antipodal_label(row["left"], row["right"], needed)
    seen = antipodal_label(row["left_seen"], row["right_seen"], needed)
    middle = pose[:3, 3] - (row["bite"] - gripper.fingertip) * pose[:3, 2]
    contacts = np.stack(
        [
            middle + sign * row["width"] / 2 * pose[:3, 0]
            + row[f"{side}_y"] * pose[:3, 2] - row[f"{side}_z"] * pose[:3, 1]
            for sign, side in ((-1, "left"), (1, "right"))
        ]
    )  # fmt: skip
    candidate = GraspCandidate(
        pose,
        row["width"],
        depth=row["bite"] - row["surface_y"],
        contacts=contacts,
        normals=np.stack([-pose[:3, 0], pose[:3, 0]]),
        source="cloud",
        antipodal=label,
        completed=label != seen,
        opening=row["opening"],
        scores={
            "geometry": score,
            "support_left": row["left"],
            "support_right": row["right"],
        },
    )
    if gripper.symmetric:
        return [candidate]
    turned = pose.copy()
    turned[:3, :2] *= -1
    other = replace(
        candidate,
        frame_from_gripper=turned,
        contacts=contacts[::-1].copy(),
        normals=np.stack([-turned[:3, 0], turned[:3, 0]]),
        scores={
            "geometry": score,
            "support_left": row["right"],
            "support_right": row["left"],
        },
    )
    return [candidate, other]
