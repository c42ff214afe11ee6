"""Doubts about identity: which things may be which, and two that turn out to be one."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode, iri
from rtask.world.placement import Placement

if TYPE_CHECKING:
    from rtask.world.state import WorldState

__all__ = ["doubts_about", "is_moved_together", "mutual_doubts"]


def doubts_about(world: WorldState, exemplar: str) -> list[str]:
    """Return the things that may be a given one, sorted."""
    return sorted(
        quad.subject.value
        for quad in world.kb.match(None, RT.possiblyIdenticalTo, iri(exemplar))
        if isinstance(quad.subject, NamedNode)
    )


def mutual_doubts(
    world: WorldState, exemplar: str, named: Collection[str]
) -> tuple[tuple[str, float], ...]:
    """Return the things that may be this one, which then may be any of them."""
    chances = (
        (other, dict(world.doubts(other)).get(exemplar))
        for other in doubts_about(world, exemplar)
        if other not in named and not world.is_merged(other)
    )
    return tuple((other, chance) for other, chance in chances if chance is not None)


def is_moved_together(world: WorldState, first: Placement, other: Placement, time_s: float) -> bool:
    """Whether two places came together only because frames were tied or moved after the last look.

    Two robots with a map each see one cup, and a thing each is made of it. Once somebody states how
    the maps stand to each other, both are at one spot, where two bodies cannot be. Two that were
    ever seen in one look are two, whatever the frames say.
    """
    if first.frame == other.frame:
        return False
    if world.kb.match(iri(first.subject), RT.distinctFrom, iri(other.subject)):
        return False
    if world.kb.match(iri(other.subject), RT.distinctFrom, iri(first.subject)):
        return False
    begins = [{entry.begin for entry in world.entries(p.subject)} for p in (first, other)]
    if begins[0] & begins[1]:
        return False
    since_s = max(first.begin, other.begin)
    ways = (world.frames.rooted(p.frame, time_s, p.begin).path for p in (first, other))
    frames = {frame for way in ways for frame in way if not world.frames.is_of_robot(frame)}
    return any(world.index.begins(frame, since_s, time_s) for frame in frames)
