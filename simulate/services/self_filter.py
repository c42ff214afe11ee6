"""A cloud without the robot's own body as a service, so that robots do not take an arm for a thing.

After ``realtime_urdf_filter`` and ``robot_body_filter`` of ROS, which need the model and the meshes
on the robot; here they are a dataset.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from features.geometry import Frame
from rtask.errors import RobotError, ServiceError
from rtask.services import Service, data_resource, method, startup
from rtask.wire.message import Answer
from rtask.wire.types import Array, Bytes, Cloud, Number, Pose, Text, Unit
from simulate.motion.self_filter import Body, SelfSeen
from simulate.robots.description import Floats
from simulate.robots.urdf_reader import read_urdf

if TYPE_CHECKING:
    from features.codec import Cloud as DecodedCloud

__all__ = ["Filtered", "SelfFilter"]


class Filtered(Answer):
    """A cloud without the robot."""

    cloud: Bytes | None = None
    """the points that are left, in the form they came in, packed as operations of the engine take
    it; null where none is left"""
    kept: int
    """how many are left"""
    on_body: int
    """how many were on the body"""
    behind: int
    """how many were in the body or hidden by it"""


class SelfFilter(Service):
    """Clouds without the robot that sees them.

    The body is that of the collision shapes in the model, placed by the joints.
    """

    name = "rtask/SelfFilter"
    version = "1.0.0"
    extra = "surfaces"
    robot = data_resource(
        "binary",
        default="robots/NAO",
        summary="/model is URDF; its meshes lie beside it, in a package they lie at its path",
    )

    @startup
    def load(self) -> None:
        """Read the model and its meshes."""
        model = self.robot.path("/model")
        try:
            read = read_urdf(model, strict=False, meshes_in=model.parent)
            self.body = Body(read.root, read.links, read.joints)
        except RobotError as error:
            # Callers know the dataset, not the folder that it is shown in.
            words = str(error).replace(str(model.parent), self.robot.name)
            raise ServiceError(words, field="robot") from error
        self.gaps = [words for words in read.warnings if "mesh" in words or "shape" in words]

    @method
    def remove(
        self,
        cloud: Cloud,
        joint_names: list[Text],
        joint_positions: Array,
        camera: Text | None = None,
        root_from_camera: Pose | None = None,
        padding: Annotated[Number, Unit("m"), Ge(0), Le(1)] = 0.005,
    ) -> Filtered:
        """Take the robot's body, and what it hides, out of a cloud.

        Parameters
        ----------
        cloud
            Point cloud or depth image: packed, PLY, PCD or sensor_msgs/PointCloud2; m, frame of
            the camera, whose origin is where the rays to the points begin.
        joint_names
            Joints as in sensor_msgs/JointState; all that move a part of the body or the camera.
        joint_positions
            Their values in the same order, rad, or m of prismatic joints.
        camera
            Link of the model that the cloud's frame is; default: the frame that the cloud names.
        root_from_camera
            Pose of that frame in the frame of the root link; default: by the link of the camera.
        padding
            How far from a surface of the body a point still belongs to it.
        """
        from features.codec import decode

        try:
            view = decode(cloud)
        except ValueError as error:
            raise ServiceError(f"cloud: {error}", field="cloud") from error
        try:
            poses, pose = self._placed(
                _values(joint_names, joint_positions), view.frame_id, camera, root_from_camera
            )
        except RobotError as error:
            raise ServiceError(f"joint_names: {error}", field="joint_names") from error
        if isinstance(view, Frame):
            points = view.points().reshape(-1, 3)
            is_point = np.asarray(np.isfinite(points).all(axis=1))
        else:
            points, is_point = view.positions, np.ones(len(view), dtype=bool)
        some = points[is_point].astype(np.float64)
        body_seen = self.body.seen(some, poses, pose, padding)
        is_free = is_point.copy()
        is_free[is_point] = ~(body_seen.on_body | body_seen.behind)
        return _filtered(view, is_free, body_seen)

    def _placed(
        self, values: dict[str, float], frame: str, camera: str | None, given: Floats | None
    ) -> tuple[dict[str, Floats], Floats]:
        """Return the poses of the links and that of the camera, in the frame of the root link.

        Raises
        ------
        ServiceError
            The pose of the camera is not known.
        """
        if given is not None:
            if camera is not None:
                raise ServiceError("camera: give it or root_from_camera, not both", field="camera")
            return self.body.poses(values), given
        link = camera or frame
        if not self.body.has_link(link):
            where = f"camera: the model has no link {link!r}" if link else "camera: is missing"
            hint = "the cloud names no frame" if not link else f"the cloud's frame is {frame!r}"
            raise ServiceError(
                f"{where}; {hint}: name a link of the model, or give root_from_camera",
                field="camera",
            )
        poses = self.body.poses(values, link)
        return poses, poses[link]


def _values(names: list[str], positions: Floats) -> dict[str, float]:
    if len(names) != len(positions):
        raise ServiceError(
            f"joint_positions: expected {len(names)}, as many as joint_names, got {len(positions)}",
            field="joint_positions",
        )
    if not np.isfinite(positions).all():
        raise ServiceError("joint_positions: expected finite numbers", field="joint_positions")
    return dict(zip(names, positions.tolist(), strict=True))


def _filtered(
    view: Frame | DecodedCloud, is_free: NDArray[np.bool_], body_seen: SelfSeen
) -> Filtered:
    count = int(is_free.sum())
    return Filtered(
        cloud=_packed(view, is_free) if count else None,
        kept=count,
        on_body=int(body_seen.on_body.sum()),
        behind=int(body_seen.behind.sum()),
    )


def _packed(view: Frame | DecodedCloud, is_free: NDArray[np.bool_]) -> bytes:
    from features.codec import encode_cloud, encode_frame

    if isinstance(view, Frame):
        mask = is_free.reshape(view.depth_m.shape)
        left = replace(
            view,
            depth_m=np.where(mask, view.depth_m, np.float32(0)),
            mask=None if view.mask is None else view.mask & mask,
        )
        return encode_frame(left)
    colours = None if view.colours is None else view.colours[is_free]
    return encode_cloud(
        view.positions[is_free], colours, frame_id=view.frame_id, stamp_s=view.stamp_s
    )
