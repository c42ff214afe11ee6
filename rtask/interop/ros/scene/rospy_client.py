"""The planning scene of MoveIt in ROS 1: its service and its topic."""

from __future__ import annotations

import threading
from typing import Any

from rtask.errors import RemoteUnavailableError
from rtask.interop.ros.scene.source import ALL_COMPONENTS, SceneSource

__all__ = ["scene_source"]

_ANSWER_S = 5.0


def scene_source(hand_links: tuple[str, ...]) -> SceneSource:
    """Return the scene that ``get_planning_scene`` or ``monitored_planning_scene`` tells."""
    import rospy
    from moveit_msgs.msg import PlanningScene

    source = SceneSource(_fetch, hand_links)
    rospy.Subscriber("monitored_planning_scene", PlanningScene, source.take, queue_size=100)
    return source


def _fetch() -> Any:
    """Ask for the scene; None where no node offers it."""
    import rosgraph
    import rospy
    from moveit_msgs.srv import GetPlanningScene

    name = rospy.resolve_name("get_planning_scene")
    try:
        rosgraph.Master(rospy.get_name()).lookupService(name)
    except rosgraph.MasterError:  # the master knows no such service
        return None
    except OSError as error:
        raise RemoteUnavailableError(f"the ROS master does not answer: {error}") from error
    answers: list[Any] = []

    def ask() -> None:
        request = GetPlanningScene._request_class()
        request.components.components = ALL_COMPONENTS
        try:
            answers.append(rospy.ServiceProxy(name, GetPlanningScene)(request).scene)
        except (rospy.ServiceException, rospy.ROSException) as error:
            answers.append(error)

    # A call of rospy has no time limit of its own.
    thread = threading.Thread(target=ask, daemon=True, name="rtask-planning-scene")
    thread.start()
    thread.join(_ANSWER_S)
    answer = answers[0] if answers else f"it did not answer within {_ANSWER_S:g} s"
    if isinstance(answer, str | Exception):
        raise RemoteUnavailableError(
            f"{name} is offered, but {answer}: where MoveIt's obstacles are is not known"
        )
    return answer
