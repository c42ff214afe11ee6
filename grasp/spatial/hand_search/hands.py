"""Free places of an open hand on a cloud, whatever opposes its jaws (ten Pas and Platt 2015, 4).

At points drawn from the cloud a hand is turned about the local axis of least curvature, slid
sideways until both open fingers are free, and pushed forward until something is in the way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.clouds.cloud import SurfaceCloud
from grasp.spatial.clouds.surfaces import surface_frames
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_search.hand_kernel import COLUMNS, search_samples

__all__ = ["Hands", "SearchOptions", "find_hands"]


_COLUMN = {name: k for k, name in enumerate(COLUMNS)}
_CELL_M = 0.02
_PALM_ROOM_M = 0.005
_PLACING_M = 0.004


@dataclass(frozen=True)
class SearchOptions:
    """Options of the search; the defaults are those of the published implementation.

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
        Normals further than this from the view ray do not count: what a camera grazes it measures
        badly, and one view of a round object would else have two opposed sides.
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
    silhouette_deg: float = 70.0

    def __post_init__(self) -> None:
        if self.turns < 1 or self.slots < 2 or self.init_bite <= 0 or self.step <= 0:
            raise ValueError(
                "expected turns >= 1, slots >= 2, init_bite and step > 0 m, got "
                f"{self.turns}, {self.slots}, {self.init_bite}, {self.step}"
            )
        if not (0 < self.angle_deg < 90 and self.support >= 0):
            raise ValueError(
                f"expected 0 < angle_deg < 90 and support >= 0, got {self.angle_deg}, "
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
        Columns of :data:`grasp.spatial.hand_search.hand_kernel.COLUMNS`.
    """

    poses: FloatArray
    table: FloatArray

    def __len__(self) -> int:
        return len(self.poses)

    def column(self, name: str) -> FloatArray:
        """Return one column (m,) of the table."""
        return self.table[:, _COLUMN[name]]

    def row(self, i: int) -> dict[str, float]:
        """Return one hand's columns by name."""
        return {name: float(self.table[i, k]) for name, k in _COLUMN.items()}

    def take(self, index: NDArray[np.int64]) -> Hands:
        """Return some of them."""
        return Hands(self.poses[index], self.table[index])


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
    frames, has_frame = surface_frames(
        grid,
        np.where(cloud.counted[:, None], cloud.normals, 0.0),
        drawn,
        max(options.frame_radius, 4 * cloud.voxel),
        cloud.axes[0],
        options.frames == "quadric",
    )
    drawn, frames = drawn[has_frame], np.ascontiguousarray(frames[has_frame])
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
            gripper.finger_width / 2,
            max(gripper.finger_width, palm[1]) / 2,
            gripper.fingertip,
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
    origins: FloatArray, frames: FloatArray, rows: FloatArray, turns: int, gripper: ParallelGripper
) -> FloatArray:
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
