"""Candidates of grasps for the MoveIt Task Constructor; knows neither rospy nor rclpy.

Its stage ``DeepGraspPose`` sends the name of the action, takes the candidates from the feedback,
each with a cost, and plans from each that its robot can reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from rtask.errors import UsageError
from rtask.interop.ros.convert import Make

__all__ = ["ACTION", "AGAIN_S", "candidates", "sampling_goal", "target_of"]

ACTION = "rtask/sample_grasp_poses"
AGAIN_S = 0.2
"""After which the candidates are sent again, before the result. The stage takes them from feedback
alone, which a client drops before it hears that its goal was accepted and after it has the result;
what it took is replaced by the same."""


def sampling_goal(make: Make) -> Any:
    """Return the goal of a view in which grasps are proposed for whatever stands there."""
    return SimpleNamespace(
        header=make("std_msgs/Header"), gripper_id="", task="", propose=True, max_grasps=0,
        min_confidence=(),
    )  # fmt: skip


def target_of(name: str, objects: Sequence[Any]) -> int:
    """Return the place of the object that grasps are sampled for.

    Parameters
    ----------
    name
        IRI, its last part, label or class of the object; empty for the only one in view.
    objects
        ``rtask_msgs/SeenObject`` of each.

    Raises
    ------
    UsageError
        None is called so, or several are.
    """
    seen = ", ".join(each.name or f"unknown-{each.label}" for each in objects) or "nothing"
    chosen = [place for place, each in enumerate(objects) if not name or name in _names(each)]
    if len(chosen) == 1:
        return chosen[0]
    if not name:
        raise UsageError(
            f"{len(objects)} objects in view ({seen}); name one, by the parameter grasp_target or "
            "in action_name"
        )
    what = "nothing" if not chosen else f"{len(chosen)} objects"
    raise UsageError(f"{what} in view is called {name!r}; seen: {seen}")


def _names(each: Any) -> set[str]:
    label = f"unknown-{each.label}"
    tail = each.object.rstrip("/").rpartition("/")[2].rpartition("#")[2]
    given = {each.object, tail, each.name, each.class_iri, each.class_name}
    return {*given, label, f"rtask/{label}"} - {""}


def candidates(each: Any) -> tuple[list[Any], list[float]]:
    """Return the poses of an object's grasps and their costs, best first.

    Raises
    ------
    UsageError
        There are none.
    """
    if not each.grasps:
        why = f": {each.error}" if each.error else f" ({each.task_response})"
        raise UsageError(f"no grasp of {each.name or 'the object'} is known or proposed{why}")
    order = sorted(each.grasps, key=lambda grasp: -grasp.grasp_quality)
    return [g.grasp_pose for g in order], [1.0 - float(g.grasp_quality) for g in order]
