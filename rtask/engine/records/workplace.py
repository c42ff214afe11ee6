"""Tables and boxes of a robot: what they are called, how large they are, and where they stand."""

from __future__ import annotations

from collections.abc import Sequence
from time import time
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from rtask.engine.records.places import state_frame_of
from rtask.engine.records.task_tree import place_iri
from rtask.engine.triples import Triples
from rtask.errors import UsageError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode
from rtask.world import WorldEdit
from rtask.world.standing import is_same_standing

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["Surface", "state_places"]


class Surface(Protocol):
    """A table or box as a robot describes it; lengths in m."""

    @property
    def name(self) -> str: ...
    @property
    def pose(self) -> NDArray[np.float64]: ...
    @property
    def frame_id(self) -> str | None: ...
    @property
    def length(self) -> float: ...
    @property
    def width(self) -> float: ...
    @property
    def rim_height(self) -> float: ...


def state_places(
    context: Context,
    triples: Triples,
    robot: NamedNode,
    author: Access,
    places: Sequence[Surface],
    frames: Sequence[str],
) -> WorldEdit:
    """Add the places at which a robot works; return where they stand from now on.

    A place stands in the root of the robot's frames, if the robot has said where it is itself: a
    table does not walk along. One that has not moved keeps its interval.

    Parameters
    ----------
    frames
        Names of the robot's frames, the base frame first.

    Raises
    ------
    UsageError
        Two places have one name, or the frame of a place is not named.
    """
    edit = WorldEdit(context.world, context.home_graph(author))
    names = [place.name for place in places]
    for k, place in enumerate(places):
        if place.name in names[:k]:
            raise UsageError(f"places[{k}].name: {place.name!r} is given twice",
                             field=f"places[{k}].name")  # fmt: skip
        frame_id = place.frame_id or next(iter(frames), None)
        if frame_id is None:
            raise UsageError(f"places[{k}].frame_id: give it, or frames with the base frame first",
                             field=f"places[{k}].frame_id")  # fmt: skip
        node = place_iri(robot, place.name)
        frame = state_frame_of(triples, robot, frame_id)
        if place.name == frame_id:
            raise UsageError(
                f"places[{k}].frame_id: {frame_id!r} is the place's own frame; name the frame in "
                "which that stands", field=f"places[{k}].frame_id",
            )  # fmt: skip
        own = state_frame_of(triples, robot, place.name)
        triples.node(
            node,
            [RT.SupportSurface],
            {
                RT.name: place.name,
                RT.bodyFrame: own,
                RT.surfaceLength: place.length,
                RT.surfaceWidth: place.width,
                RT.rimHeight: place.rim_height or None,
            },
        )
        _stand(edit, own.value, frame.value, place.pose, robot.value)
    return edit


def _stand(
    edit: WorldEdit, frame: str, parent: str, parent_from_frame: NDArray[np.float64], agent: str
) -> None:
    now_s = time()
    rooted = edit.world.frames.rooted(parent, now_s)
    pose = parent_from_frame
    if not rooted.fault:
        parent, pose = rooted.root, rooted.poses[-1] @ parent_from_frame
    last = edit.world.last_placement(frame, now_s)
    if last is None or not is_same_standing(last, parent, pose):
        edit.stand(frame, parent, pose, now_s, agent=agent)
