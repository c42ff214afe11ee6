"""Sightings of robots that recognise things with their own eyes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated
from urllib.parse import unquote

import numpy as np
from annotated_types import Ge, Le, MaxLen, MinLen
from pydantic import Field

from rtask.engine.operations.operation import operation
from rtask.engine.operations.world.frames import frame_named
from rtask.engine.operations.world.instants import stated_instant
from rtask.engine.operations.world.state import check_held
from rtask.engine.records.identity import check_agent
from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import iri
from rtask.wire.message import Answer, Message
from rtask.wire.types import Iri, Number, Pose, Probability, Stamp, Text, Texts, Unit
from rtask.world import WorldEdit
from rtask.world.edit import Seen
from rtask.world.names import find_exemplars
from rtask.world.spots import extents_of

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["ReportSightings", "report_sightings"]


_WIDE_FRAMES = ("odom", "map", "world", "earth")
"""Frames in which a robot may be far from the origin (REP 105)."""
_FARTHEST_M = 100.0


class SeenThing(Message):
    """A thing that was recognised and located."""

    object: Annotated[Text, MinLen(1), MaxLen(1000)]
    """IRI, objectId or name of its product"""
    pose: Pose
    """geometry_msgs/Pose of the thing in the frame of the report"""
    sigma: Annotated[Number, Unit("m"), Ge(1e-6), Le(100)] = 0.01
    """standard deviation of the position per axis"""
    confidence: Probability = 1.0
    """that it is of this product and there"""
    thing: Iri | None = None
    """IRI of the thing, if the robot knows which one it is; default: decided by place and time"""


class ReportSightings(Message):
    """What a robot saw in one look."""

    frame: Annotated[Text, MinLen(1), MaxLen(1000)]
    """frame of the poses: its name in tf, robot/name or its IRI"""
    seen: Annotated[list[SeenThing], MaxLen(500)] = Field(default_factory=list)
    """what was seen"""
    gone: Annotated[Texts, MaxLen(500)] = Field(default_factory=list)
    """IRIs of things that were looked for where they were, in plain view, and are not there"""
    stamp: Stamp | None = None
    """when the robot looked; default: now"""
    agent: Text | None = None
    """in whose name; default: the caller"""


class ReportedSightings(Answer):
    """Which things these are, and the commit, which can be undone."""

    things: list[str]
    """IRI of each thing that was seen, in the order of the report"""
    new: int
    """how many of them nobody had seen before"""
    commit: str
    """empty if all of it was known"""


@operation("write", "writes", "store which things a robot saw where, and which are gone",
           repeatable=True)  # fmt: skip
def report_sightings(
    context: Context, request: ReportSightings, access: Access
) -> ReportedSightings:
    """State what a robot recognised and located itself, in one commit.

    What is gone ends first, so that a thing which was moved is the same one where it is seen next.

    Raises
    ------
    ForbiddenError
        A robot reports in the name of another, or that what another one holds is gone.
    UnknownTermError
        The graph has no such product or thing.
    UsageError
        Several products have the name, or a thing is not of the product.
    """
    check_agent(request.agent, access)
    author = context.author(access, request.agent)
    time_s = stated_instant(request.stamp)
    agent = context.agent_iri(author).value
    with context.writing:
        frame, declared = frame_named(context, request.frame, author)
        edit = WorldEdit(context.world, context.home_graph(author))
        hands = [hand.iri.value for hand in context.grippers.all() if hand.robot.value == agent]
        gone = [_thing(context, thing) for thing in request.gone]
        for k, thing in enumerate(gone):
            check_held(context, thing, access, f"gone[{k}]")
        edit.lose_all(gone, time_s)
        look = []
        for k, seen in enumerate(request.seen):
            _check_near(context, frame, seen, k)
            product = _product(context, seen.object)
            if seen.thing is not None and not edit.is_of(_thing(context, seen.thing), product):
                raise UsageError(f"thing: {seen.thing} is not of {seen.object}", field="thing")
            extents = extents_of(context.kb, product)
            look.append(
                Seen(
                    product, frame, seen.pose, time_s, seen.sigma, seen.confidence,
                    min(extents, default=0.0), robot=agent, hands=hands, agent=agent,
                    exemplar=seen.thing or "",
                )
            )  # fmt: skip
        things = edit.see_all(look)
        new = edit.made
        if not (edit.statements or edit.withdrawn):
            return ReportedSightings(things=things, new=new, commit="")
        with context.kb.transaction(access=author, note="report sightings") as tx:
            for statement in edit.withdrawn:
                tx.remove(*statement)
            for statement in (*declared, *edit.statements):
                tx.add(*statement)
    return ReportedSightings(things=things, new=new, commit=context.commit_id(tx.commit))


def _check_near(context: Context, frame: str, seen: SeenThing, k: int) -> None:
    """Refuse a pose that no camera of a robot sees; a map may be wider.

    Raises
    ------
    UsageError
        It is too far from the robot's own frame.
    """
    # By its address: a frame that this very report declares has no name in the graph yet.
    name = unquote(frame.rpartition("/frame/")[2])
    if name in _WIDE_FRAMES or not context.world.frames.is_of_robot(frame):
        return
    away_m = float(np.linalg.norm(seen.pose[:3, 3]))
    if away_m > _FARTHEST_M:
        field = f"seen[{k}].pose"
        raise UsageError(
            f"{field}: {away_m:.3g} m from a frame of the robot: is it in another unit?",
            field=field,
        )


def _thing(context: Context, thing: str) -> str:
    if not context.kb.match(iri(thing), RDF.type, RT.Exemplar):
        raise UnknownTermError(f"thing: the graph has no thing {thing}", field="thing")
    return thing


def _product(context: Context, name: str) -> str:
    pairs, _ = find_exemplars(context.world, name, 1_000)
    products = sorted({product for _, product in pairs})
    if not products:
        raise UnknownTermError(f"object: the graph has no product {name!r}", field="object")
    if len(products) > 1:
        raise UsageError(
            f"object: {len(products)} products are called {name!r}; give the IRI: "
            f"{', '.join(products[:5])}", field="object",
        )  # fmt: skip
    return products[0]
