"""What a node takes from MoveIt's planning scene for its grasps, and puts into it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rtask.interop.ros.convert import Make
from rtask.interop.ros.looking import Look, Obstacles
from rtask.interop.ros.scene.matrix import CollisionMatrix
from rtask.interop.ros.scene.obstacles import FrameLookup
from rtask.interop.ros.scene.source import SceneSource
from rtask.interop.ros.showing import SceneChanges

__all__ = ["SceneExchange"]


class SceneExchange:
    """The scene of one node, in and out.

    Parameters
    ----------
    source
        MoveIt's scene; None to leave it aside.
    frames_at
        Returns what looks up frames at a time, in the frame of the robot.
    frame
        Of the robot.
    make
        Makes empty messages.
    """

    def __init__(
        self,
        source: SceneSource | None,
        frames_at: Callable[[Any], FrameLookup],
        frame: str,
        make: Make,
    ) -> None:
        self._source, self._frames_at = source, frames_at
        self._changes = SceneChanges(frame, make, source.hand.links if source else ())
        self._matrix: CollisionMatrix | None = None

    def obstacles(self, look: Look) -> Obstacles | None:
        """Return what of MoveIt's scene stands around at the time of a view; None without one.

        Raises
        ------
        RtaskError
            MoveIt does not answer, part of its scene cannot be read, or TF does not know where.
        """
        if self._source is None:
            return None
        scene = self._source.newest()
        self._matrix = scene.matrix if scene is not None else None
        return self._source.obstacles(scene, self._frames_at(look.stamp), self._changes.shown)

    def change(self, look: Look, objects: Sequence[Any], target: int | None = None) -> Any:
        """Return the change of MoveIt's scene that shows a view; see :meth:`SceneChanges.change`.

        Its matrix is the scene's of the last :meth:`obstacles`.
        """
        return self._changes.change(look, objects, self._matrix, target)
