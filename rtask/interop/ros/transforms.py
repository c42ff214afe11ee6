"""Poses of a robot's camera by TF of ROS 1."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.frames import matrix_from_pose
from rtask.errors import UsageError

__all__ = ["Transforms"]

_TF_S = 0.2


class Transforms:
    """Poses of cameras by TF, at the time of their clouds."""

    def __init__(self) -> None:
        import tf2_ros

        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer)

    def clear(self) -> None:
        """Forget everything, as after a jump back in time."""
        self._buffer.clear()

    def lookup(self, target: str, source: str, stamp: Any) -> NDArray[np.float64]:
        """Return target_from_source (4, 4) at a time; never one of another time.

        Raises
        ------
        UsageError
            TF has no such transform at that time within 0.2 s of the wall clock.
        """
        import rospy
        import tf2_ros

        deadline = time.monotonic() + _TF_S
        # tf2_ros waits by ROS time, which may stand still, and has no event for new transforms.
        while True:
            try:
                stamped = self._buffer.lookup_transform(target, source, stamp, rospy.Duration(0))
                break
            except (
                tf2_ros.LookupException,
                tf2_ros.ConnectivityException,
                tf2_ros.ExtrapolationException,
                tf2_ros.InvalidArgumentException,
            ) as error:
                if time.monotonic() >= deadline:
                    raise UsageError(
                        f"no transform from {source} to {target} at {stamp.to_sec():.3f} s: "
                        f"{str(error).strip()}; see `rosrun tf tf_echo {target} {source}`"
                    ) from error
            time.sleep(0.01)  # the wait of lookup_transform goes by /clock, which may stand still
        move, turn = stamped.transform.translation, stamped.transform.rotation
        return np.asarray(
            matrix_from_pose(
                np.array([move.x, move.y, move.z]), np.array([turn.x, turn.y, turn.z, turn.w])
            ),
            dtype=np.float64,
        )
