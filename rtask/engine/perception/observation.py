"""Decode, describe and measure a robot's observation: one object's compressed cloud."""

from __future__ import annotations

import hashlib
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from rtask.engine.context import Context
from rtask.engine.observation import Observation
from rtask.engine.perception.placement import classify_shape
from rtask.errors import UsageError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode
from rtask.wire.message import Also, Message
from rtask.wire.types import Cloud, Image, Number, Pose, Stamp, Text, Unit

if TYPE_CHECKING:
    from features.tabletop import TabletopShape

__all__ = ["Look", "OptionalLook", "observe", "observe_once"]


class OptionalLook(Message):
    """One look at one object, where the object may be named instead."""

    data: Annotated[Cloud, Also("new_point_cloud")] | None = None
    """base64 of one object's compressed cloud; default: given by object"""
    image: Image | None = None
    """base64 PNG or JPEG of the object; default: the colours of the cloud"""
    sensor_pose: Pose | None = None
    """pose of the camera in frame_id; default: identity"""
    frame_id: Text | None = None
    """frame of the robot with z up, e.g. base_footprint; default: that of the camera"""
    support_height: Annotated[Number, Unit("m")] | None = None
    """height of the table in frame_id; default: lowest point"""
    stamp: Stamp | None = None
    """when the cloud was taken; default: now"""


class Look(OptionalLook):
    """One look at one object."""

    data: Annotated[Cloud, Also("new_point_cloud")]
    """base64 of one object's compressed cloud"""


def observe_once(context: Context, request: Look, where: str = "") -> Observation:
    """Return the observation of a request, decoded at most once; see :func:`observe`."""
    key = _digest(request)
    known = context.observations.get(key)
    if known is not None:
        known.seconds.update(decode_s=0.0, extraction_s=0.0)
        return known
    made = observe(request, where)
    context.observations.put(key, made)
    return made


def observe(request: Look, where: str = "") -> Observation:
    """Decode, describe and measure what a request carries.

    Parameters
    ----------
    request
        What was seen, and where from.
    where
        Path of the request inside a larger message, for errors.

    Raises
    ------
    UsageError
        If the bytes are not a cloud or image of an object.
    """
    from features.codec import decode
    from features.geometry import Frame, transform
    from features.recognition.views.view import describe_frame
    from rtask.engine.perception.images import frame_of_cloud, shaded, with_image

    started = time.perf_counter()
    sensor_pose = request.sensor_pose
    pose = np.eye(4) if sensor_pose is None else np.asarray(sensor_pose, dtype=np.float64)
    try:
        decoded = decode(request.data)
    except ValueError as error:
        raise UsageError(f"{where}data: {error}", field=where + "data") from error
    decoded_s = time.perf_counter() - started
    started = time.perf_counter()
    try:
        if isinstance(decoded, Frame):
            frame, camera_pose, is_rendered = decoded, pose, False
        else:
            frame, cloud_from_camera = frame_of_cloud(decoded.points(), decoded.colours)
            camera_pose, is_rendered = pose @ cloud_from_camera, True
        if request.image is not None:
            frame, is_rendered = with_image(frame, request.image), False
        if frame.rgb is None:
            picture = shaded(frame.depth_m, frame.object_mask())
            frame, is_rendered = replace(frame, rgb=picture), True
        features = describe_frame(frame)
    except ValueError as error:
        raise UsageError(f"{where}data: {error}", field=where + "data") from error
    cloud = frame.points()[frame.object_mask()].astype(np.float64)
    finite = cloud[np.isfinite(cloud).all(axis=1)]
    points = np.asarray(transform(camera_pose, finite), dtype=np.float64)
    shape = _measure(points, request.support_height)
    # A crop of a depth image lies in the optical frame, whose z looks forward and not up.
    frame_id = request.frame_id or decoded.frame_id
    is_upright = not isinstance(decoded, Frame) and bool(frame_id)
    is_posed = sensor_pose is not None or is_upright
    return Observation(
        data=request.data,
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
        seconds={"decode_s": decoded_s, "extraction_s": time.perf_counter() - started},
    )


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
    found = None if shape is None else classify_shape(shape, points)
    return None if found is None else (getattr(RT, found[0]), found[1])


def _digest(request: Look) -> str:
    digest = hashlib.sha256(request.data)
    pose = request.sensor_pose
    digest.update(b"" if pose is None else np.asarray(pose, dtype=np.float64).tobytes())
    digest.update(request.image or b"")
    rest = (request.frame_id, request.support_height, request.stamp)
    digest.update(repr(rest).encode())
    return digest.hexdigest()
