"""Frames: stating where one stands in another, and asking for one in another at any instant."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated
from urllib.parse import quote, unquote

import numpy as np
from annotated_types import Ge, Le, MaxLen, MinLen
from numpy.typing import NDArray

from rtask.engine.operations.operation import operation
from rtask.engine.operations.world.instants import asked_instant, stated_instant
from rtask.engine.records.identity import check_agent
from rtask.errors import ForbiddenError, UnknownTermError, UsageError, nearest
from rtask.rdf.namespaces import CORA, RDF, RT
from rtask.rdf.terms import NamedNode, iri, literal, python_value
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Json, Number, Pose, Stamp, Text, Unit
from rtask.world import WorldEdit
from rtask.world.names import find_frame
from rtask.world.standing import check_standing

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.world.statements import Statement

__all__ = ["LocateFrame", "StateFrame", "frame_named", "locate_frame", "state_frame"]

_Name = Annotated[Text, MinLen(1), MaxLen(1000)]


class StateFrame(Message):
    """Where a frame stands from a time on."""

    frame: _Name
    """its name in tf, robot/name or its IRI; made if the graph has none of that name"""
    parent: _Name | None = None
    """the frame in which it stands; default: none, for the root of a tree"""
    pose: Pose | None = None
    """geometry_msgs/Pose of the frame in its parent; default: none, for the root of a tree"""
    sigma: Annotated[Number, Unit("m"), Ge(0), Le(100)] = 0.0
    """standard deviation of the position per axis"""
    stamp: Stamp | None = None
    """since when; default: now"""
    lost: Flag = False
    """whether it no longer stands where it did, and nobody knows where"""
    agent: Text | None = None
    """in whose name; default: the caller"""


class StatedFrame(Answer):
    """The frame, and the commit, which can be undone."""

    frame: str
    """its IRI"""
    parent: str
    """IRI of the frame in which it stands; empty without one"""
    commit: str
    """empty if all of it was known"""


class LocateFrame(Message):
    """A question about where a frame stands in another."""

    frame: _Name
    """its name in tf, robot/name or its IRI"""
    target: _Name | None = None
    """frame in which its pose is asked for; default: the root of its tree"""
    stamp: Stamp | None = None
    """time that is asked about; default: now"""


class LocatedFrame(Answer):
    """Where a frame stood in another; "not known" is an answer."""

    known: bool
    text: str
    frame: str
    """its IRI"""
    target: str
    """IRI of the frame in which the pose is"""
    pose: Json | None
    """geometry_msgs/Pose of the frame in the target; null if it is not known"""
    sigma: float | None
    """standard deviation of the position per axis, m; null if the pose is not known"""
    time: float
    """time that the answer is about, Unix time, s"""
    path: list[str]
    """IRIs of the frames from this one to the root of its tree"""


@operation("write", "writes", "state where a frame stands in another one", repeatable=True)
def state_frame(context: Context, request: StateFrame, access: Access) -> StatedFrame:
    """Declare a frame, move it, or say that nobody knows where it stands, in one commit.

    Raises
    ------
    ForbiddenError
        A robot states it in the name of another, or moves the frame of another.
    UsageError
        Parent and pose are not given together, contradict lost, or would make a ring.
    UnknownTermError
        The graph has no such parent.
    ConflictError
        The frame would stand in two frames at a time, or a later place of it is stored.
    """
    check_agent(request.agent, access)
    if (request.parent is None) != (request.pose is None):
        raise UsageError("give parent and pose together", field="pose")
    if request.lost and request.parent is not None:
        raise UsageError("give parent and pose, or lost", field="lost")
    author = context.author(access, request.agent)
    time_s = stated_instant(request.stamp)
    with context.writing:
        frame, declared = frame_named(context, request.frame, author)
        _check_owner(context, frame, author)
        parent = "" if request.parent is None else _parent(context, request.parent, author)
        edit = WorldEdit(context.world, context.home_graph(author))
        last = context.world.last_placement(frame)
        if parent or request.lost:
            check_standing(context.world, frame, parent, time_s)
        elif last is not None and last.is_current:
            raise UsageError(
                f"parent: {request.frame} stands in {context.world.frames.name_of(last.frame)}; "
                "give the frame in which it stands now, or lost", field="parent",
            )  # fmt: skip
        if request.pose is not None:
            agent = context.agent_iri(author).value
            edit.stand(frame, parent, request.pose, time_s, request.sigma, agent)
        elif request.lost:
            edit.lose(frame, time_s)
        if not (declared or edit.statements):
            return StatedFrame(frame=frame, parent=parent, commit="")
        with context.kb.transaction(access=author, note="state a frame") as tx:
            for statement in edit.withdrawn:
                tx.remove(*statement)
            for statement in (*declared, *edit.statements):
                tx.add(*statement)
    return StatedFrame(frame=frame, parent=parent, commit=context.commit_id(tx.commit))


@operation("read", "reads", "tell where a frame stood in another one at a time")
def locate_frame(context: Context, request: LocateFrame, access: Access) -> LocatedFrame:
    """Return the pose of a frame in another; "not known", with the reason, is an answer.

    Raises
    ------
    UnknownTermError
        The graph has no such frame.
    UsageError
        Several frames have the name.
    """
    world = context.world
    time_s = asked_instant(request.stamp)
    frame = find_frame(world, _own_name(context, request.frame, access))
    rooted = world.frames.rooted(frame, time_s)
    if request.target is None:
        target = rooted.root
    else:
        target = find_frame(world, _own_name(context, request.target, access))
    if request.target is None and rooted.fault:
        pose, variance, reason = None, 0.0, rooted.fault
    else:
        way = world.frames.way(target, frame, time_s, time_s)
        pose, variance, reason = way.target_from_source, way.variance_m2, way.reason
    names = [world.frames.name_of(node) for node in (frame, target)]
    return LocatedFrame(
        known=pose is not None, text=_text(names, pose, reason), frame=frame, target=target,
        pose=None if pose is None else _message(pose), time=time_s, path=rooted.path,
        sigma=None if pose is None else float(np.sqrt(variance)),
    )  # fmt: skip


def frame_named(context: Context, name: str, author: Access) -> tuple[str, list[Statement]]:
    """Return the IRI of a frame, and the statements that declare it if the graph lacks it.

    A name alone is that of the author's own frame if it has one, else of the one frame of that
    name (a robot passes over frames on the bodies of others), else of a new one that all share.

    Raises
    ------
    UsageError
        Several frames have the name, or the IRI is of something else.
    UnknownTermError
        The name is that of a frame of a robot which the graph does not know.
    ForbiddenError
        A robot would declare a frame on the body of another one.
    """
    own = _own_name(context, name, author)
    frames = [
        frame for frame in context.world.frames.find(own)
        if context.kb.match(iri(frame), RDF.type, RT.Frame)
        and not (_is_bare(name) and author.role == "robot" and _other_robot(context, frame, author))
    ]  # fmt: skip
    if frames:
        return frames[0] if len(frames) == 1 else find_frame(context.world, own), []
    base = context.kb.base
    if ":" in name:
        node = iri(name)
        if context.kb.match(node):
            raise UsageError(f"frame: {name} is no frame", field="frame")
        frame_id = unquote(name.rstrip("/#").replace("#", "/").rpartition("/")[2])
    elif "/" in name:
        robot, _, frame_id = name.partition("/")
        body = iri(f"{base}robot/{quote(robot, safe='')}")
        if not context.kb.match(body, RDF.type, CORA.Robot):
            robots = {
                str(python_value(quad.object))
                for robot in context.kb.match(None, RDF.type, CORA.Robot)
                for quad in context.kb.match(robot.subject, RT.name)
            }
            raise UnknownTermError(
                f"frame: the graph has no robot {robot!r}{nearest(robot, sorted(robots))}"
            )
        node = NamedNode(f"{body.value}/frame/{quote(frame_id, safe='')}")
    else:
        node, frame_id = NamedNode(f"{base}frame/{quote(name, safe='')}"), name
    _check_owner(context, node.value, author)  # what is there may be used; this would be declared
    return node.value, [
        (node, RDF.type, RT.Frame), (node, RT.frameId, literal(frame_id or name))
    ]  # fmt: skip


def _is_bare(name: str) -> bool:
    return not {":", "/"} & set(name)


def _own_name(context: Context, name: str, author: Access) -> str:
    """Return the IRI of the author's own frame of a name, if it has one, else the name."""
    if ":" in name or author.agent is None:
        return name
    own = f"{context.agent_iri(author).value}/frame/{quote(name, safe='')}"
    return own if context.kb.match(iri(own), RDF.type, RT.Frame) else name


def _parent(context: Context, name: str, author: Access) -> str:
    parent = find_frame(context.world, _own_name(context, name, author))
    if not context.kb.match(iri(parent), RDF.type, RT.Frame):
        raise UnknownTermError(
            f"parent: the graph has no frame {name!r}; declare it first", field="parent"
        )
    return parent


def _check_owner(context: Context, frame: str, author: Access) -> None:
    """Refuse a robot to declare a frame on the body of another one, or to say where it stands."""
    if author.role == "robot" and _other_robot(context, frame, author):
        raise ForbiddenError(
            f"frame: {frame} is on another robot's body than that of {author.agent!r}; that robot "
            "or a person states it", field="frame",
        )  # fmt: skip


def _other_robot(context: Context, frame: str, author: Access) -> str:
    """Return the robot on whose body a frame is, unless it is the author's own; or ""."""
    robot, located, _ = frame.rpartition("/frame/")
    if not located or robot == context.agent_iri(author).value:
        return ""
    return robot if context.kb.match(iri(robot), RDF.type, CORA.Robot) else ""


def _message(pose: NDArray[np.float64]) -> Json:
    from grasp.messages import pose_message

    return pose_message(pose)


def _text(names: list[str], pose: NDArray[np.float64] | None, reason: str) -> str:
    frame, target = names
    if pose is None:
        return f"{frame}: not known in {target}: {reason}"
    x, y, z = pose[:3, 3]
    return f"{frame}: at ({x:.3f}, {y:.3f}, {z:.3f}) m in {target}"
