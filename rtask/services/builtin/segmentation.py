"""Segmentation of a view of a table as a service (Gatto 2016, 2.4 to 2.6)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from annotated_types import Ge

from rtask.engine.perception.cutting import cut
from rtask.errors import ServiceError
from rtask.services.service import Service, method, startup
from rtask.wire.message import Answer
from rtask.wire.types import Array, Bytes, Cloud, Unit, Whole

if TYPE_CHECKING:
    from features.codec.types import Cloud as DecodedCloud
    from features.geometry import Frame
    from features.segmentation import Scene, SegmentedObject

__all__ = ["Segmentation", "SegmentedThing", "SegmentedView"]


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


class Segmentation(Service):
    """Views of tables cut into objects."""

    name = "rtask/Segmentation"
    version = "1.0.0"
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
            view = decode(cloud)
        except ValueError as error:
            raise ServiceError(f"cloud: {error}", field="cloud") from error
        scene = cut(view, method, min_points)
        plane = scene.plane
        return SegmentedView(
            status=scene.status,
            objects=[_segmented(view, scene, segment) for segment in scene.objects],
            table=None if plane is None else np.append(plane.normal, plane.offset),
        )


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
        cloud=_crop(view, scene, segment),
    )


def _crop(view: Frame | DecodedCloud, scene: Scene, segment: SegmentedObject) -> bytes:
    """Return the part of a view that shows an object, in the form that robots send."""
    from features.codec import encode_cloud, encode_frame
    from features.geometry import Frame

    if isinstance(view, Frame):
        return encode_frame(view.crop(scene.labels == segment.label))
    points, colours = view.grid()
    flat = points.reshape(-1, 3)[segment.indices]
    return encode_cloud(flat, None if colours is None else colours.reshape(-1, 3)[segment.indices])
