"""Where a frame may stand: below no frame that stands on it, and in one frame at a time."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.errors import ConflictError, UsageError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode, iri

if TYPE_CHECKING:
    from rtask.world.placement import Placement
    from rtask.world.state import WorldState

__all__ = ["check_standing", "is_same_standing"]

_SAME_M = 0.001
_SAME_RAD = float(np.deg2rad(0.2))


def check_standing(world: WorldState, frame: str, parent: str, time_s: float) -> None:
    """Refuse to let a frame stand in another one from a time on if the tree would be none.

    Parameters
    ----------
    frame, parent
        IRIs; the parent is "" for a frame that stands nowhere known.
    time_s
        Unix time.

    Raises
    ------
    UsageError
        The parent stands, then or later, on the frame itself.
    ConflictError
        The frame stands for ever in a frame, or a later statement says where it stands.
    """
    name = world.frames.name_of(frame)
    for quad in world.kb.match(iri(frame), RT.parentFrame):
        if isinstance(quad.object, NamedNode):
            above = world.frames.name_of(quad.object.value)
            raise ConflictError(
                f"frame: {name} stands in {above} for ever (rt:parentFrame, rt:poseInParent in "
                f"{quad.graph_name}); remove that first, or it would stand in two frames"
            )
    last = world.last_placement(frame)
    if last is not None and time_s < last.begin:
        raise ConflictError(
            f"stamp: {_time(last.begin)} is when {name} came to where it stood last; state what "
            "came before it in the order of time"
        )
    if parent:
        _check_ring(world, frame, parent, time_s)


def _check_ring(world: WorldState, frame: str, parent: str, time_s: float) -> None:
    todo, tried = {time_s}, set[float]()
    while todo:
        moment = todo.pop()
        tried.add(moment)
        rooted = world.frames.rooted(parent, moment)
        if frame in rooted.path:
            ring = [frame, *rooted.path[: rooted.path.index(frame) + 1]]
            names = " in ".join(world.frames.name_of(one) for one in ring)
            raise UsageError(
                f"parent: frames cannot stand in a ring: {names}, at {_time(moment)}",
                field="parent",
            )
        if rooted.fault:
            raise ConflictError(f"parent: {rooted.fault}, at {_time(moment)}")
        for above in rooted.path:
            todo.update(set(world.index.begins(above, time_s)) - tried)


def is_same_standing(
    last: Placement | None, parent: str, parent_from_frame: NDArray[np.float64]
) -> bool:
    """Whether a frame still stands where its last placement says, to 1 mm and 0.2 degrees."""
    if last is None or not last.is_current or last.frame != parent:
        return False
    if last.frame_from_subject is None:
        return False
    moved = np.linalg.inv(last.frame_from_subject) @ parent_from_frame
    cosine = (np.trace(moved[:3, :3]) - 1.0) / 2.0
    turned = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return float(np.linalg.norm(moved[:3, 3])) <= _SAME_M and turned <= _SAME_RAD


def _time(time_s: float) -> str:
    return dt.datetime.fromtimestamp(time_s, dt.UTC).isoformat().replace("+00:00", "Z")
