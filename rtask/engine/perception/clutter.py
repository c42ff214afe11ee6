"""Scenes of several things that may touch: from a frame or a cloud to labelled points on a table.

Gatto 2016, 2.5 and chapter 5: one view is segmented, and what is planned on it afterwards needs the
points of all things, those of the table left out, with the place of the camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError

if TYPE_CHECKING:
    from grasp.spatial.candidate import Proposals
    from grasp.spatial.gripper import EndEffector
    from grasp.spatial.scene_plan import SceneOptions

__all__ = ["ClutterView", "plan_in_view", "view_clutter"]

Floats = NDArray[np.float64]
Range = tuple[float, float]

_OVER_M, _HIGHEST_M = 0.004, 0.35
_ANYWHERE = (-np.inf, np.inf)


@dataclass(frozen=True, eq=False)
class ClutterView:
    """The things in one view, in a frame with z up, with the table under them.

    Parameters
    ----------
    points : (n, 3) float, m
        Over the table and within the region.
    labels : (n,) int
        Segment of each point, 0 = none.
    pixels : (n,) int
        Place of each point in the view, counted row by row.
    viewpoint : (3,) float, m
        Of the camera.
    table : (4,) float
        n . p + d = 0, n upwards.
    table_height
        Of the table below the camera, m.
    """

    points: Floats
    labels: NDArray[np.int32]
    pixels: NDArray[np.int64]
    viewpoint: Floats
    table: Floats
    table_height: float

    @property
    def segments(self) -> tuple[int, ...]:
        """Numbers of the segments."""
        return tuple(int(k) for k in np.unique(self.labels[self.labels > 0]))

    def of(self, segment: int) -> Floats:
        """Return the points (n, 3) of one segment, m."""
        return np.asarray(self.points[self.labels == segment])


def view_clutter(
    points: NDArray[np.floating],
    colours: NDArray[np.uint8] | None,
    frame_from_camera: Floats,
    x_range: Range = _ANYWHERE,
    y_range: Range = _ANYWHERE,
    table_height: float | None = None,
) -> ClutterView | None:
    """Segment a view; return the things on the table within a region, or None without a table.

    Parameters
    ----------
    points : (h, w, 3) or (n, 3), m
        From the camera; NaN = not seen.
    colours : same leading shape, uint8 RGB, or None
    frame_from_camera : (4, 4)
        In a frame with z up.
    x_range, y_range
        Region in which things count, m, in that frame.
    table_height
        Of the table in that frame, m; None = the largest level plane.

    Raises
    ------
    UsageError
        Nothing is seen near the given height, so that "the table is empty" would be untrue.
    """
    from features.geometry import transform
    from features.segmentation import segment_scene

    down = frame_from_camera[:3, :3].T @ np.array([0.0, 0.0, -1.0])
    scene = segment_scene(points, colours, gravity=down)
    if scene.plane is None:
        return None
    normal = frame_from_camera[:3, :3] @ scene.plane.normal
    on_plane = transform(frame_from_camera, -scene.plane.offset * scene.plane.normal)
    plane_z = float(on_plane[2])
    if table_height is not None:
        normal, on_plane = np.array([0.0, 0.0, 1.0]), np.array([*on_plane[:2], table_height])
    cloud = points.reshape(-1, 3).astype(np.float64)
    seen = np.isfinite(cloud).all(axis=1) & (np.abs(cloud) > 0).any(axis=1)
    placed = np.asarray(transform(frame_from_camera, cloud[seen]), dtype=np.float64)
    height = (placed - on_plane) @ normal
    inside = (height > _OVER_M) & (height < _HIGHEST_M)
    if table_height is not None and not (np.abs(height) < _HIGHEST_M).any():
        raise UsageError(
            f"support_height: nothing is seen near {table_height:g} m, and the largest level plane "
            f"lies at {plane_z:.3g} m: another unit, or another frame?",
            field="support_height",
        )
    for axis, (low, high) in enumerate((x_range, y_range)):
        inside &= (placed[:, axis] > low) & (placed[:, axis] < high)
    return ClutterView(
        placed[inside],
        scene.labels.ravel()[seen][inside],
        np.flatnonzero(seen)[inside],
        frame_from_camera[:3, 3].copy(),
        np.array([*normal, -float(normal @ on_plane)]),
        float(on_plane[2]),
    )


def plan_in_view(
    view: ClutterView, gripper: EndEffector, options: SceneOptions | None = None
) -> Proposals:
    """Rank grasps of what a view shows, each with its neighbours as obstacles.

    See :func:`grasp.spatial.scene_plan.plan_on_scene` of jaws and
    :func:`grasp.spatial.contact_plan.plan_contacts_on_scene` of other hands.
    """
    from grasp.spatial.candidate import Proposals
    from grasp.spatial.collision import Support
    from grasp.spatial.contact_plan import OtherHand, plan_contacts_on_scene
    from grasp.spatial.grasp_plan import SpatialOptions
    from grasp.spatial.gripper import ParallelGripper
    from grasp.spatial.scene_plan import SceneOptions, plan_on_scene

    if not len(view.points):
        return Proposals(reason="nothing is seen on the table, or within the region")
    if isinstance(gripper, OtherHand):
        scene_options = options or SceneOptions()
        spatial_options = SpatialOptions(
            noise=scene_options.noise,
            samples=scene_options.samples,
            seed=scene_options.seed,
            most=scene_options.most,
        )
        return plan_contacts_on_scene(
            view.points, view.labels, gripper, Support(view.table_height),
            view.viewpoint[None], spatial_options,
        )  # fmt: skip
    assert isinstance(gripper, ParallelGripper)
    return plan_on_scene(
        view.points, gripper, view.viewpoint[None], labels=view.labels, table=view.table,
        options=options,
    )  # fmt: skip
