"""The newest planning scene of MoveIt: asked of it, or else heard from it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection
from typing import Any

from rtask.interop.ros.scene.obstacles import FrameLookup, HandRules, SceneObstacles
from rtask.interop.ros.scene.state import SceneState

__all__ = ["ALL_COMPONENTS", "SceneSource"]

ALL_COMPONENTS = 1023
"""Every bit of moveit_msgs/PlanningSceneComponents."""


class SceneSource:
    """The scene of a move_group, if there is one.

    Parameters
    ----------
    fetch
        Asks MoveIt for the whole scene, moveit_msgs/PlanningScene; None where it offers none.
        Raises an RtaskError where it offers one and does not answer.
    hand_links
        Links of the hand, as MoveIt names them.
    """

    def __init__(self, fetch: Callable[[], Any], hand_links: Collection[str] = ()) -> None:
        self._fetch = fetch
        self.hand = HandRules(tuple(hand_links))
        self._heard = SceneState()
        self._is_heard = False
        self._lock = threading.Lock()

    def take(self, message: Any) -> None:
        """Take a message of ``monitored_planning_scene``: the whole scene, or a change of it."""
        with self._lock:
            self._heard.take(message)
            self._is_heard = True

    def newest(self) -> SceneState | None:
        """Return the scene as it is now; None where nobody has one.

        Raises
        ------
        RtaskError
            MoveIt offers one and does not answer.
        """
        message = self._fetch()
        if message is not None:
            message.is_diff = False
            asked = SceneState()
            asked.take(message)
            return asked
        with self._lock:
            return self._heard if self._is_heard else None

    def obstacles(
        self, scene: SceneState | None, lookup: FrameLookup, ours: Collection[str] | None
    ) -> SceneObstacles | None:
        """Return what of a scene stands in the way; None without a scene.

        Raises
        ------
        UsageError
            Part of the scene cannot be read, or TF does not say where it is.
        """
        if scene is None:
            return None
        with self._lock:
            return SceneObstacles(scene, lookup, self.hand, ours)
