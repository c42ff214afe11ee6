"""Segmentation of a view of a table as a service (Gatto 2016, 2.4 to 2.6)."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from annotated_types import Ge, Len
from pydantic import Field

from rtask.engine.perception.cutting import as_seen, cut, cut_together, refuse_doubtful
from rtask.errors import DataError, ServiceError, UsageError
from rtask.services.service import Service, method, startup
from rtask.wire.message import Answer, Message
from rtask.wire.types import Array, Bytes, Cloud, Flag, Json, Pose, Unit, Whole

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from features.codec.types import Cloud as DecodedCloud
    from features.geometry import Frame
    from features.segmentation import Scene, SegmentedObject, SeveralViews
    from rtask.interop.ros.looking import Board

__all__ = [
    "BoxInFrame",
    "JointObject",
    "PerceivedObject",
    "PerceivedView",
    "PlacedCloud",
    "Segmentation",
    "SegmentedThing",
    "SegmentedView",
    "ViewedCrop",
    "ViewsTogether",
]

MAX_VIEWS = 16


class SegmentedThing(Answer):
    """One object of a view."""

    label: int
    """number in the labels"""
    points: int
    """how many points it has"""
    centroid: Annotated[Array, Unit("m")]
    """in the camera frame"""
    box_min: Annotated[Array, Unit("m")]
    """smallest coordinates, in the camera frame"""
    box_max: Annotated[Array, Unit("m")]
    """largest coordinates, in the camera frame"""
    touches_border: bool
    """whether it reaches the edge of the table or of the image"""
    cloud: Bytes
    """its crop of the view, packed as operations of the engine take it"""


class SegmentedView(Answer):
    """The objects of a view, by falling size."""

    status: str
    """ok, empty, no_table, table_only, or grazing where the table is seen edge-on"""
    objects: list[SegmentedThing]
    table: Annotated[Array, Unit("m")] | None = None
    """a, b, c, d of the table's plane ax + by + cz + d = 0; null without a table"""
    doubts: list[str] = Field(default_factory=list)
    """what of the view is doubtful, such as its unit, and in which frame it was read"""


class BoxInFrame(Answer):
    """A box in the frame of the robot."""

    pose: Json
    """geometry_msgs/Pose of its middle; z up"""
    size: list[float]
    """length, width and height, m"""


class PerceivedObject(BoxInFrame):
    """One object on the table."""

    cloud: Bytes
    """its crop of the view, packed as operations of the engine take it"""
    neighbours: list[list[float]]
    """points of what stands near it, m, as recognise_for_grasp takes them"""
    points: Bytes | None = None
    """with points: its points in the camera frame as data of a sensor_msgs/PointCloud2: x, y, z
    and rgb, 16 bytes each"""


class PerceivedView(Answer):
    """The table and the objects on it, from the nearest to the farthest."""

    status: str
    """ok, empty, no_table or table_only"""
    table_height: float | None = None
    """m; null without a table"""
    table: BoxInFrame | None = None
    """a board below the visible part of the table"""
    objects: list[PerceivedObject]
    doubts: list[str] = Field(default_factory=list)
    """what of the view is doubtful, such as the unit of its depth; nothing was changed for it"""


class PlacedCloud(Message):
    """A view of a table, and where its camera was."""

    cloud: Cloud
    """point cloud or depth image: packed, PLY, PCD or sensor_msgs/PointCloud2; m, camera frame"""
    sensor_pose: Pose
    """pose of the camera's optical frame in a frame with z up, one for all views"""


class ViewedCrop(Answer):
    """An object as one of several views shows it."""

    view: int
    """number of the view in the request, from 0"""
    cloud: Bytes
    """its crop of that view, packed as operations of the engine take it"""


class JointObject(Answer):
    """One object of several views."""

    points: int
    """how many points it has in all views"""
    centroid: Annotated[Array, Unit("m")]
    """in the common frame"""
    box_min: Annotated[Array, Unit("m")]
    """smallest coordinates, in the common frame"""
    box_max: Annotated[Array, Unit("m")]
    """largest coordinates, in the common frame"""
    touches_border: bool
    """whether it reaches the edge of what is seen of the table"""
    cloud: Bytes
    """its points of all views in the common frame, packed"""
    seen: list[ViewedCrop]
    """its crops, for recognition: the one with most points first, the others as further looks"""


class ViewsTogether(Answer):
    """The objects of several views together, by falling size."""

    status: str
    """ok, empty, no_table or table_only"""
    table_height: float | None = None
    """in the common frame, m; null without a table"""
    objects: list[JointObject]
    doubts: list[str] = Field(default_factory=list)
    """what of the views is doubtful, such as their unit, and in which frame one was read"""


class Segmentation(Service):
    """Views of tables cut into objects."""

    name = "rtask/Segmentation"
    version = "1.3.0"
    extra = "perception"

    @startup
    def compile(self) -> None:
        """Compile the kernels; they are kept on disk."""
        from features.segmentation import warm_up

        warm_up()

    @method
    def segment(
        self,
        cloud: Cloud,
        method: Literal["auto", "default", "near", "concave", "components", "euclidean"] = "auto",
        min_points: Annotated[Whole, Ge(1)] | None = None,
    ) -> SegmentedView:
        """Cut a view of a table into the objects on it.

        Parameters
        ----------
        cloud
            Point cloud or depth image: packed, PLY, PCD or sensor_msgs/PointCloud2; m, camera
            frame with x right, y down, z forward.
        method
            How to cut; auto decides by the distance of the table.
        min_points
            Smaller segments are left out; default: by the method.
        """
        from features.codec import decode

        try:
            view, doubts = as_seen(decode(cloud))
        except ValueError as error:
            raise ServiceError(f"cloud: {error}", field="cloud") from error
        scene = cut(view, method, min_points)
        plane = scene.plane
        return SegmentedView(
            status=scene.status,
            objects=[_segmented(view, scene, segment) for segment in scene.objects],
            table=None if plane is None else np.append(plane.normal, plane.offset),
            doubts=list(doubts),
        )

    @method
    def segment_views(
        self,
        views: Annotated[list[PlacedCloud], Len(1, MAX_VIEWS)],
        min_points: Annotated[Whole, Ge(1)] | None = None,
    ) -> ViewsTogether:
        """Cut several views of one table together: of several cameras, or of one that moves.

        Parameters
        ----------
        views
            Each with the pose of its camera.
        min_points
            Smaller objects are left out; default: by the height of the cameras.
        """
        from features.codec import decode

        decoded = []
        doubts: list[str] = []
        for number, view in enumerate(views):
            try:
                seen, of_view = as_seen(decode(view.cloud))
                decoded.append((seen, np.asarray(view.sensor_pose, np.float64)))
                doubts += [f"views[{number}]: {doubt}" for doubt in of_view]
            except ValueError as error:
                where = f"views[{number}].cloud"
                raise ServiceError(f"{where}: {error}", field=where) from error
        together = cut_together(decoded, min_points)
        height = together.table_height
        return ViewsTogether(
            status=together.status,
            table_height=None if np.isnan(height) else height,
            objects=[_joined([seen for seen, _ in decoded], together, k) for k in
                     range(len(together.objects))],
            doubts=doubts,
        )  # fmt: skip

    @method
    def perceive(
        self,
        sensor_pose: Pose,
        cloud: Cloud | None = None,
        depth: Json | None = None,
        image: Json | None = None,
        camera_info: Json | None = None,
        is_rectified: Flag = False,
        points: Flag = False,
        body: list[Json] | None = None,
    ) -> PerceivedView:
        """Find the table and the objects on it in the frame of the robot, as a node of ROS does.

        Parameters
        ----------
        sensor_pose
            Pose of the camera's optical frame in a frame of the robot with z up.
        cloud
            Coloured view: packed, PLY, PCD or an organised sensor_msgs/PointCloud2.
        depth, image, camera_info
            In place of a cloud: registered sensor_msgs/Image or CompressedImage, and CameraInfo.
        is_rectified
            Whether depth and image were rectified before they were published.
        points
            Answer with the points of each object.
        body
            Shapes of the robot itself, whose points are no object: kind (box, sphere, cylinder or
            points), size (m; sides, radius, or height and radius) and pose, 16 numbers of a matrix,
            row by row, in the frame of the robot. Points are the surface of a mesh: float32 x, y
            and z in base64 in points, and as their size how far it may be from the next of them.
        """
        from features.perception import perceive
        from rtask.interop.ros.clouds import cloud_rows
        from rtask.interop.ros.perceived import look_of, points_of
        from rtask.interop.ros.robot.body import body_of_json, body_pixels

        view = _view(cloud, depth, image, camera_info, is_rectified)
        try:
            solids = body_of_json(body or [])
        except UsageError as error:
            raise ServiceError(f"body: {error}", field="body") from error
        own = body_pixels(view.points(), sensor_pose, solids) if solids else None
        try:
            seen = perceive(view, sensor_pose, body=own)
        except ValueError as error:
            raise ServiceError(f"cloud: {error}", field="cloud") from error
        if not seen.objects:
            refuse_doubtful(view)
        look = look_of(seen, sensor_pose, None, view.doubts)
        height = None if np.isnan(look.table_height) else look.table_height
        table = None if look.table is None else _box(look.table)
        rows = [cloud_rows(*points_of(segment)) if points else None for segment in seen.objects]
        objects = [
            PerceivedObject(
                pose=viewed.pose,
                size=list(viewed.size),
                cloud=base64.b64decode(viewed.data),
                neighbours=viewed.neighbours,
                points=row,
            )
            for viewed, row in zip(look.objects, rows, strict=True)
        ]
        return PerceivedView(
            status=look.status, table_height=height, table=table, objects=objects,
            doubts=list(look.doubts),
        )  # fmt: skip


def _view(
    cloud: bytes | None,
    depth: dict[str, object] | None,
    image: dict[str, object] | None,
    camera_info: dict[str, object] | None,
    is_rectified: bool,
) -> Frame:
    """Return the view of a cloud, or of depth and colour.

    Raises
    ------
    ServiceError
        Neither is whole, or it does not read.
    """
    from features.codec import decode
    from features.geometry import Frame
    from features.imaging.camera import frame_of_grid
    from rtask.interop.ros.clouds import doubts_of_cloud, frame_of_images

    if cloud is None:
        if depth is None or image is None or camera_info is None:
            raise ServiceError("cloud is missing, and so is depth with image and camera_info")
        try:
            return frame_of_images(depth, image, camera_info, is_rectified)
        except DataError as error:
            raise ServiceError(f"depth: {error}", field="depth") from error
    try:
        decoded = decode(cloud)
        view = decoded if isinstance(decoded, Frame) else frame_of_grid(decoded)
    except ValueError as error:
        raise ServiceError(f"cloud: {error}", field="cloud") from error
    if view is None or view.rgb is None:
        raise ServiceError(
            "cloud: it is not organised or has no colours, which recognition needs; publish the "
            "registered cloud of the camera (depth_registered/points)",
            field="cloud",
        )
    return replace(view, doubts=doubts_of_cloud(view))


def _box(board: Board) -> BoxInFrame:
    return BoxInFrame(pose=board.pose, size=list(board.size))


def _joined(
    views: Sequence[Frame | DecodedCloud], together: SeveralViews, place: int
) -> JointObject:
    from features.codec import encode_cloud

    each = together.objects[place]
    most = sorted(
        together.seen_by(each.label), key=lambda k: -int((together.labels[k] == each.label).sum())
    )
    return JointObject(
        points=len(each.indices),
        centroid=each.centroid,
        box_min=each.box[0],
        box_max=each.box[1],
        touches_border=each.touches_border,
        cloud=encode_cloud(together.points[each.indices]),
        seen=[ViewedCrop(view=k, cloud=_crop(views[k], together.labels[k], each.label))
              for k in most],
    )  # fmt: skip


def _segmented(
    view: Frame | DecodedCloud, scene: Scene, segment: SegmentedObject
) -> SegmentedThing:
    return SegmentedThing(
        label=segment.label,
        points=len(segment.indices),
        centroid=segment.centroid,
        box_min=segment.box[0],
        box_max=segment.box[1],
        touches_border=segment.touches_border,
        cloud=_crop(view, scene.labels, segment.label),
    )


def _crop(view: Frame | DecodedCloud, labels: NDArray[np.int32], label: int) -> bytes:
    """Return the part of a view that shows an object, in the form that robots send."""
    from features.codec import encode_cloud, encode_frame
    from features.geometry import Frame

    mask = labels == label
    if isinstance(view, Frame):
        return encode_frame(view.crop(mask))
    points, colours = view.grid()
    chosen = np.flatnonzero(mask)
    inks = None if colours is None else colours.reshape(-1, 3)[chosen]
    return encode_cloud(points.reshape(-1, 3)[chosen], inks)
