"""What is where at an instant, in one frame, for programs that draw it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Ge, Le

from rtask.engine.operations.operation import operation
from rtask.wire.message import Answer, Message
from rtask.wire.types import Json, Stamp, Text, Whole

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.world.scene import Scene

__all__ = ["DrawnNode", "DrawnScene", "ShowWorld", "show_world"]

_CHANCE = 0.9


class ShowWorld(Message):
    """A question about what is where."""

    stamp: Stamp | None = None
    """time that is asked about; default: now"""
    frame: Text | None = None
    """any frame of the tree: its name in tf, robot/name or its IRI; default: the fullest tree"""
    max_nodes: Annotated[Whole, Ge(1), Le(10_000)] = 2_000
    """how many frames, robots, places and things are answered"""


class DrawnNode(Answer):
    """A frame, robot, place or thing."""

    kind: str
    """frame, robot, place (a table or box) or thing"""
    node: str
    """its IRI"""
    label: str
    pose: Json
    """geometry_msgs/Pose in the root of the tree; of a thing, the middle of its footprint; of a
    place, the middle of its surface; of a thing that is somewhere in a place, that of the place"""
    size: list[float]
    """extents of a thing's box along x, y and z, m, or length and width of a place and the height
    of its rim; empty if they are not known"""
    radius90: float | None
    """distance within which a thing is with a chance of 90 %, m, if it is still there; null for
    others"""
    still_there: float
    """chance that a thing is still there; 1 for others"""
    somewhere: str
    """in words where a thing is whose own pose nobody knows, such as "somewhere in left box"; empty
    for others"""
    region: list[float]
    """size of the place in which such a thing is somewhere, m; empty for others, and if it is not
    known"""


class DrawnScene(Answer):
    """What is where in one tree of frames, each after its parent."""

    time: float
    """time that the answer is about, Unix time, s"""
    root: str
    """IRI of the root of the tree; empty if the graph has no frames"""
    frame_id: str
    """name of the root in tf"""
    nodes: list[DrawnNode]
    nodes_left_out: int
    """how many more there are; max_nodes asks for them"""
    unplaced: list[str]
    """what has no pose, with the reason"""


@operation("read", "reads", "list what is where at a time: frames, robots, places and things")
def show_world(context: Context, request: ShowWorld, access: Access) -> DrawnScene:
    """Return what is where; grasps and surfaces are left out."""
    scene = context.world.scene(request.stamp, request.frame, 0, surfaces=False)
    return _drawn(scene, request.max_nodes)


def _drawn(scene: Scene, most: int) -> DrawnScene:
    from grasp.messages import pose_message
    from rtask.world.uncertainty import Spread

    poses = scene.root_from_nodes()
    drawn = [
        DrawnNode(
            kind=node.kind,
            node=node.iri,
            label=node.label,
            pose=pose_message(np.asarray(pose)),
            size=list(node.size_m or ()),
            radius90=(
                Spread(float(node.facts["sigma_m"]), 1.0, 0.0).radius(_CHANCE)
                if "sigma_m" in node.facts and "somewhere" not in node.facts
                else None
            ),
            still_there=float(node.facts.get("stillThere", 1.0)),
            somewhere=str(node.facts.get("somewhere", "")),
            region=list(node.region_m or ()),
        )
        for node, pose in zip(scene.nodes[:most], poses[:most], strict=True)
    ]
    return DrawnScene(
        time=scene.time_s,
        root=scene.root,
        frame_id=scene.nodes[0].label if scene.nodes else "",
        nodes=drawn,
        nodes_left_out=max(len(scene.nodes) - most, 0),
        unplaced=[f"{left.label}: {left.reason}" for left in scene.unplaced],
    )
