"""Observed objects, decoded, described and measured: those received and those stored."""

from __future__ import annotations

import hashlib
import logging
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Ge, MaxLen
from numpy.typing import NDArray
from pydantic import Field

from grasp.spatial.frames import matrix_from_pose
from rtask.engine.context import Context
from rtask.engine.observation import Observation
from rtask.engine.perception.images import encode_photo, frame_of_cloud, shaded, with_image
from rtask.engine.perception.placement import classify_shape
from rtask.errors import MissingBlobError, UsageError
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import NamedNode, iri, python_value
from rtask.wire.fields import Also
from rtask.wire.message import Message
from rtask.wire.types import Box, Cloud, Image, Mask, Number, Pose, Stamp, Text, Unit, Whole

if TYPE_CHECKING:
    from features.codec.types import Cloud as DecodedCloud
    from features.geometry import Frame
    from features.tabletop import TabletopShape
    from rtask.kb.core import GraphCore

__all__ = [
    "Look",
    "Looks",
    "OptionalLook",
    "observe",
    "observe_all",
    "observe_once",
    "stored_frame",
    "viewpoint",
]

log = logging.getLogger(__name__)


class OptionalLook(Message):
    """An observation of one object, which may be named instead."""

    data: Annotated[Cloud, Also("new_point_cloud")] | None = None
    """base64 of one object's cloud, compressed or as sensor_msgs/PointCloud2; default: the image"""
    image: Image | None = None
    """base64 PNG or JPEG, or a sensor_msgs/CompressedImage; default: the colours of the cloud"""
    mask: Mask | None = None
    """the object's pixels, base64 PNG of labels or COCO run lengths; default: by depth or colour"""
    label: Annotated[Whole, Ge(1)] | None = None
    """which label of the mask; default: all"""
    box: Box | None = None
    """around the object: left, top, width, height in the image, px; default: the whole"""
    object_pose: Pose | None = None
    """pose of the object in frame_id that another estimator found; default: estimated"""
    sensor_pose: Pose | None = None
    """pose of the camera in frame_id; default: identity"""
    frame_id: Text | None = None
    """frame of the robot with z up, e.g. base_footprint; default: that of the camera"""
    support_height: Annotated[Number, Unit("m")] | None = None
    """height of the table in frame_id; default: lowest point"""
    stamp: Stamp | None = None
    """time of the observation; default: now"""


class Look(OptionalLook):
    """An observation of one object: data, an image, or both."""


class Looks(Look):
    """An observation of one object, with more of the same from other sides."""

    looks: Annotated[list[Look], MaxLen(8)] = Field(default_factory=list)
    """further observations of the same object: the answer is that of all of them together"""


def observe_once(context: Context, request: OptionalLook, where: str = "") -> Observation:
    """Return the observation of a request, decoded at most once; see :func:`observe`."""
    key = _digest(request)
    cached = context.observations.get(key)
    if cached is not None:
        cached.seconds.update(decode_s=0.0, extraction_s=0.0)
        return cached
    made = observe(request, where)
    context.observations.put(key, made)
    return made


def observe_all(context: Context, request: Looks) -> tuple[Observation, list[Observation]]:
    """Return the observation of a request, and its further looks."""
    others = [observe_once(context, look, f"looks[{k}].") for k, look in enumerate(request.looks)]
    return observe_once(context, request), others


def observe(request: OptionalLook, where: str = "") -> Observation:
    """Decode, describe and measure what a request carries.

    Parameters
    ----------
    request
        Observation and pose of the camera.
    where
        Path of the request inside a larger message, for errors.

    Raises
    ------
    UsageError
        If the bytes are not a cloud or image of an object, or there are none.
    """
    from features.geometry import transform
    from features.imaging.doubts import implausible_object, implausible_support
    from features.recognition.views.view import describe_frame

    if request.data is None and request.image is None:
        raise UsageError(
            f"{where}data is missing: send the object's compressed cloud, an image, or both",
            field=where + "data",
        )
    started = time.perf_counter()
    sensor_pose = request.sensor_pose
    pose = np.eye(4) if sensor_pose is None else np.asarray(sensor_pose, dtype=np.float64)
    part = "image" if request.data is None else "data"
    try:
        sight = _decoded(request)
        decoded_s = time.perf_counter() - started
        started = time.perf_counter()
        frame, is_rendered = _with_parts(sight, request)
        cloud = frame.points()[frame.object_mask()].astype(np.float64)
        finite = cloud[np.isfinite(cloud).all(axis=1)]
        doubt = implausible_object(finite)
        if doubt:
            raise ValueError(doubt)
        features = describe_frame(frame)
        data = request.data if request.data is not None else encode_photo(frame)
    except ValueError as error:
        raise UsageError(f"{where}{part}: {error}", field=where + part) from error
    camera_pose = pose @ sight.source_from_camera
    points = np.asarray(transform(camera_pose, finite), dtype=np.float64)
    shape = _measure(points, request.support_height)
    # A crop of a depth image lies in the optical frame, whose z looks forward and not up.
    frame_id = request.frame_id or sight.frame_id
    is_upright = not sight.is_optical and bool(frame_id)
    is_posed = sensor_pose is not None or is_upright
    if is_posed and request.support_height is not None:
        # A height in mm would be stored as the place of the thing, and believed.
        doubt = implausible_support(points[:, 2], request.support_height)
        if doubt:
            field = where + "support_height"
            raise UsageError(f"{field}: {doubt}", field=field)
    return Observation(
        data=data,
        frame=frame,
        features=features,
        frame_from_camera=camera_pose,
        points=points,
        shape=shape,
        frame_id=frame_id,
        stamp_s=request.stamp,
        is_rendered=is_rendered,
        is_posed=is_posed,
        guess=_guess(shape, points) if is_posed else None,
        object_pose=request.object_pose,
        seconds={"decode_s": decoded_s, "extraction_s": time.perf_counter() - started},
    )


@dataclass(frozen=True)
class _Sight:
    """A decoded frame of a camera, and the pose of that camera in the frame of the message."""

    frame: Frame
    source_from_camera: NDArray[np.float64]
    frame_id: str
    is_optical: bool
    is_rendered: bool = False


def _decoded(request: OptionalLook) -> _Sight:
    """Return the frame of the data; of an image alone the crop of its object."""
    from features.codec import decode
    from features.geometry import Frame
    from features.imaging.camera import frame_of_grid
    from features.imaging.photo import read_photo
    from features.imaging.selection import frame_of_photo

    if request.data is None:
        assert request.image is not None
        photo = read_photo(request.image)
        labels = _labels(request, photo.rgb.shape[:2])
        frame = frame_of_photo(photo, labels, request.label, _box(request))
        return _Sight(frame, np.eye(4), "", is_optical=True)
    decoded = decode(request.data)
    if isinstance(decoded, Frame):
        return _Sight(decoded, np.eye(4), decoded.frame_id, is_optical=True)
    if decoded.viewpoint is not None:
        return _from_viewpoint(decoded, is_posed=request.sensor_pose is not None)
    grid = frame_of_grid(decoded)
    if grid is not None:
        return _Sight(grid, np.eye(4), decoded.frame_id, is_optical=True)
    frame, cloud_from_camera = frame_of_cloud(decoded.points(), decoded.colours)
    return _Sight(frame, cloud_from_camera, decoded.frame_id, is_optical=False, is_rendered=True)


def _from_viewpoint(cloud: DecodedCloud, is_posed: bool) -> _Sight:
    """Return what the sensor of a PCD saw, whose place VIEWPOINT and the request may both say.

    The pose in the request is that of the sensor, so that its points are taken in the sensor's
    frame: placed by both, a thing would lie twice as far off.
    """
    from features.imaging.camera import frame_of_grid
    from features.imaging.placed import in_sensor_frame

    assert cloud.viewpoint is not None
    source_from_sensor = np.eye(4) if is_posed else np.asarray(cloud.viewpoint, np.float64)
    seen = in_sensor_frame(cloud)
    grid = frame_of_grid(seen)
    if grid is not None:
        return _Sight(grid, source_from_sensor, cloud.frame_id, is_optical=is_posed)
    frame, sensor_from_camera = frame_of_cloud(seen.points(), seen.colours)
    return _Sight(
        frame, source_from_sensor @ sensor_from_camera, cloud.frame_id, is_optical=is_posed,
        is_rendered=True,
    )  # fmt: skip


def _with_parts(sight: _Sight, request: OptionalLook) -> tuple[Frame, bool]:
    """Return the frame with the image and the mask of the request, and whether it is rendered."""
    from features.imaging.selection import chosen_object

    frame, is_rendered = sight.frame, sight.is_rendered
    if request.data is None:
        return frame, False
    if request.image is not None:
        frame, is_rendered = with_image(frame, request.image), False
    if not sight.is_rendered:
        labels = _labels(request, frame.depth_m.shape)
        frame = chosen_object(frame, labels, request.label, _box(request))
    if frame.rgb is None:
        picture = shaded(frame.depth_m, frame.object_mask())
        frame, is_rendered = replace(frame, rgb=picture), True
    return frame, is_rendered


def _labels(request: OptionalLook, shape: tuple[int, ...]) -> NDArray[np.int32] | None:
    """Return the labels of the request's mask, at whatever size it came."""
    from features.imaging.masks import read_labels

    return None if request.mask is None else read_labels(request.mask, (shape[0], shape[1]))


def _box(request: OptionalLook) -> list[float] | None:
    return None if request.box is None or not len(request.box) else request.box.tolist()


def _measure(points: NDArray[np.float64], support_height: float | None) -> TabletopShape | None:
    from features.tabletop import measure

    if len(points) == 0:
        return None
    lowest = float(points[:, 2].min()) if support_height is None else support_height
    try:
        return measure(points, lowest)
    except ValueError:
        return None


def _guess(
    shape: TabletopShape | None, points: NDArray[np.float64]
) -> tuple[NamedNode, float] | None:
    """Return the class that a measured shape suggests, with a confidence."""
    shape_class = None if shape is None else classify_shape(shape, points)
    return None if shape_class is None else (getattr(RT, shape_class[0]), shape_class[1])


def _digest(request: OptionalLook) -> str:
    digest = hashlib.sha256(request.data or b"")
    for pose in (request.sensor_pose, request.object_pose):
        digest.update(b"-" if pose is None else np.asarray(pose, dtype=np.float64).tobytes())
    digest.update(request.image or b"")
    rest = (
        request.frame_id, request.support_height, request.stamp, request.mask, request.label,
        _box(request), request.data is None, request.image is None,
    )  # fmt: skip
    digest.update(repr(rest).encode())
    return digest.hexdigest()


def stored_frame(kb: GraphCore, view: str) -> tuple[Frame, bool] | None:
    """Return the crop of a stored view, and whether it was taken by a camera.

    A cloud without pixels is rendered again as on arrival. None if the bytes are missing.
    """
    from features.codec import decode
    from features.geometry import Frame

    rows = kb.select(f"""{PREFIXES}
SELECT ?blob WHERE {{ {iri(view)} rt:viewContent ?content .
  ?content a rt:CompressedPointCloud ; rt:hasBlob ?blob }} ORDER BY ?blob LIMIT 1""")
    for row in rows:
        try:
            decoded = decode(kb.blobs.read(str(row.value("blob"))))
            if isinstance(decoded, Frame):
                return decoded, True
            return frame_of_cloud(decoded.points(), decoded.colours)[0], False
        except (MissingBlobError, UsageError, ValueError) as error:
            log.warning("view %s has no cloud: %s", view, error)
    return None


def viewpoint(kb: GraphCore, view: NamedNode) -> NDArray[np.float64] | None:
    """Return the stored pose (4, 4) of the camera of a view in the object's frame, or None."""
    for link in kb.match(view, RT.viewpoint):
        if not isinstance(link.object, NamedNode):
            continue
        properties = {q.predicate: python_value(q.object) for q in kb.match(link.object)}
        numbers = [
            properties.get(getattr(RT, name)) for name in ("x", "y", "z", "qx", "qy", "qz", "qw")
        ]
        if all(isinstance(number, float | int) for number in numbers):
            seven = np.array(numbers, dtype=np.float64)
            return np.asarray(matrix_from_pose(seven[:3], seven[3:]), dtype=np.float64)
    return None
