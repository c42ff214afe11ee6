"""Which table or box a thing is on or in that is seen at a pose.

A robot that looks at its table tells poses, and seldom what they are on. Where the graph knows how
large the table is and where it stands, that follows. What is above it higher than the thing itself
reaches is in a hand, on a stack or on a shelf that nobody has described: on what is not known then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode, iri, python_value
from rtask.world.identities.seen import Seen
from rtask.world.placement import Relation
from rtask.world.spots import Spots, size_of
from rtask.world.state import WorldState
from rtask.world.uncertainty import Spread

__all__ = ["NO_SUPPORT", "Support", "support_of", "supports_at"]

NO_SUPPORT: tuple[Relation, str] = ("at", "")
_CHANCE = 0.9
_NOISE_M = 0.02
"""By how much the origin of a thing may be above its body, and its body below the surface."""
_UNKNOWN_HEIGHT_M = 0.3
"""Of a thing whose size nobody has stored."""
_SAME_HEIGHT_M = 0.05
"""The floor of a box that stands on a table is the table, or so much above it."""


@dataclass(frozen=True, eq=False)
class Support:
    """A table or box at one time.

    Parameters
    ----------
    node
        Its IRI.
    root, root_from_node
        IRI of the root of its tree of frames, and the pose (4, 4) of the middle of its surface, m.
    size
        Length and width of the surface and height of the rim, m.
    """

    node: str
    root: str
    root_from_node: NDArray[np.float64]
    size: tuple[float, float, float]

    @property
    def relation(self) -> Relation:
        """What is there is in a box, and on a table."""
        return "in" if self.size[2] > 0.0 else "on"

    @property
    def area_m2(self) -> float:
        """Area of its surface."""
        return self.size[0] * self.size[1]

    def holds(self, position: NDArray[np.float64], sigma_m: float, height_m: float) -> bool:
        """Whether a position (3,) in the root is that of a thing which rests here."""
        x, y, z = np.linalg.inv(self.root_from_node)[:3] @ [*position, 1.0]
        length, width, _ = self.size
        radius_m = Spread(sigma_m, 1.0, 0.0).radius(_CHANCE)
        is_within = abs(x) <= length / 2 and abs(y) <= width / 2
        # A thing is known to be on a table only if that is wider than what is not known of it.
        is_sure = radius_m <= min(length, width) / 2
        return is_within and is_sure and -_NOISE_M - radius_m <= z <= height_m + radius_m


def supports_at(world: WorldState, time_s: float) -> list[Support]:
    """Return the tables and boxes whose place and size are known at a time."""
    spots, supports = Spots(world, time_s), list[Support]()
    stated = {quad.subject for quad in world.kb.match(None, RT.surfaceLength)}
    for node in sorted(subject.value for subject in stated if isinstance(subject, NamedNode)):
        size = size_of(world.kb, node)
        spot = None if size is None else spots.of(node)
        if size is not None and spot is not None:
            supports.append(Support(node, spot.root, spot.root_from_node, size))
    return supports


def support_of(world: WorldState, seen: Seen, supports: Sequence[Support]) -> tuple[Relation, str]:
    """Return how a thing is on or in which support, :data:`NO_SUPPORT` where that is not known.

    A box that stands on a table is nearer to what is in it than the table. Where two robots have
    described one table each, it is on the one of the robot that sees it.
    """
    if not supports:
        return NO_SUPPORT
    there = world.frames.rooted(seen.frame, seen.time_s)
    if there.fault:
        return NO_SUPPORT
    position = (there.poses[-1] @ seen.frame_from_exemplar)[:3, 3]
    sigma_m = float(np.sqrt(seen.sigma_m**2 + there.variances_m2[-1]))
    beside = [support for support in supports if support.root == there.root]
    height_m = _height_of(world, seen.product) + _NOISE_M if beside else 0.0
    holding = [support for support in beside if support.holds(position, sigma_m, height_m)]
    top_m = max((support.root_from_node[2, 3] for support in holding), default=0.0)
    upper = [s for s in holding if top_m - s.root_from_node[2, 3] <= _SAME_HEIGHT_M]
    least_m2 = min((support.area_m2 for support in upper), default=0.0)
    nearest = [support for support in upper if support.area_m2 <= 1.1 * least_m2]
    if len(nearest) > 1:
        nearest = [support for support in nearest if support.node.startswith(f"{seen.robot}/")]
    return (nearest[0].relation, nearest[0].node) if len(nearest) == 1 else NO_SUPPORT


def _height_of(world: WorldState, product: str) -> float:
    """Return how high above its support the origin of a thing can be at most, m."""
    extents = [
        max((float(str(python_value(q.object))) for q in world.kb.match(iri(product), term)),
            default=None)
        for term in (RT.extentX, RT.extentY, RT.extentZ)
    ]  # fmt: skip
    stated = [extent for extent in extents if extent is not None]
    return max(stated) if len(stated) == len(extents) else _UNKNOWN_HEIGHT_M
