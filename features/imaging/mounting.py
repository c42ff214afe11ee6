"""How the cameras of a robot stand to one another, from its static transforms."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from features.geometry import Float64Array, pose_matrix

__all__ = ["Mounting"]


class Mounting:
    """Fixed transforms between frames.

    Examples
    --------
    >>> mounting = Mounting()
    >>> mounting.add("link", "depth", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    >>> mounting.add("link", "colour", (0.1, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    >>> mounting.pose("colour", "depth")[:3, 3].tolist()
    [-0.1, 0.0, 0.0]
    """

    def __init__(self) -> None:
        self._beside: dict[str, dict[str, Float64Array]] = {}

    def add(
        self,
        parent: str,
        child: str,
        place_m: tuple[float, float, float],
        quaternion: tuple[float, float, float, float],
    ) -> None:
        """Take a transform: the pose (x, y, z, w of the rotation) of a child in its parent.

        One that is no pose (a quaternion of zeros, numbers that are not finite) is passed over.
        """
        if not np.isfinite([*place_m, *quaternion]).all() or not np.any(quaternion):
            return
        pose = pose_matrix(Rotation.from_quat(quaternion).as_matrix(), place_m)
        parent, child = parent.lstrip("/"), child.lstrip("/")
        self._beside.setdefault(parent, {})[child] = pose
        self._beside.setdefault(child, {})[parent] = np.asarray(np.linalg.inv(pose), np.float64)

    def add_message(self, message: Any) -> None:
        """Take the transforms of a ``tf2_msgs/TFMessage``."""
        for stamped in message.transforms:
            at, turn = stamped.transform.translation, stamped.transform.rotation
            self.add(
                stamped.header.frame_id, stamped.child_frame_id, (at.x, at.y, at.z),
                (turn.x, turn.y, turn.z, turn.w),
            )  # fmt: skip

    def pose(self, target: str, source: str) -> Float64Array | None:
        """Return the pose (4, 4), m, of a frame in another; None where nothing joins them."""
        target, source = target.lstrip("/"), source.lstrip("/")
        seen: dict[str, Float64Array] = {target: np.eye(4)}
        waiting = deque([target])
        while waiting:
            frame = waiting.popleft()
            if frame == source:
                return seen[frame]
            for beside, pose in self._beside.get(frame, {}).items():
                if beside not in seen:
                    seen[beside] = seen[frame] @ pose
                    waiting.append(beside)
        return None
