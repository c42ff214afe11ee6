"""Supports: where tables and boxes are, how large they are, and whether a pose is on or in one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import RT
from rtask.rdf.terms import iri, python_value
from rtask.world.spots import Spots
from rtask.world.uncertainty import MOVED_M, Spread

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore
    from rtask.world.state import WorldState

__all__ = ["Pose", "is_at", "size_of"]

_SURFACE = (RT.surfaceLength, RT.surfaceWidth, RT.rimHeight)
_EXTENTS = (RT.extentX, RT.extentY, RT.extentZ)
_CHANCE = 0.9
_BELOW_M = 0.05
"""By how much the origin of a thing may be below the surface: poses are measured to centimetres."""
_STACK_M = 0.3
"""Height of a stack on a table or above the rim of a box; a shelf above is further up."""


@dataclass(frozen=True, eq=False)
class Pose:
    """A measured pose.

    Parameters
    ----------
    frame, frame_from_exemplar
        IRI of the frame, and the pose (4, 4) in it, m.
    time_s
        When it was measured, Unix time.
    sigma_m
        Standard deviation of the position per axis, m.
    """

    frame: str
    frame_from_exemplar: NDArray[np.float64]
    time_s: float
    sigma_m: float


def size_of(kb: GraphCore, node: str, product: str = "") -> tuple[float, float, float] | None:
    """Return length, width and height of the rim of a support, m; None if they are not stored.

    A thing on or in which others are, such as a tray, has the extents of its product.
    """
    for named, terms in ((node, _SURFACE), (node, _EXTENTS), (product, _EXTENTS)):
        if not named:
            continue
        length, width, height = (
            max((float(str(python_value(q.object))) for q in kb.match(iri(named), term)),
                default=None)
            for term in terms
        )  # fmt: skip
        if length is not None and width is not None:
            return length, width, height or 0.0
    return None


def is_at(world: WorldState, place: str, pose: Pose) -> bool | None:
    """Whether a pose is on or in a place, as far as the graph can tell.

    Returns
    -------
    None if the place, its size, or the way from its frame to that of the pose is not known.
    """
    size = size_of(world.kb, place, world.product_of(place))
    spot = None if size is None else Spots(world, pose.time_s).of(place)
    if size is None or spot is None:
        return None
    seen = world.frames.rooted(pose.frame, pose.time_s)
    if seen.fault or seen.root != spot.root:
        return None
    root_from_exemplar = seen.poses[-1] @ pose.frame_from_exemplar
    x, y, z = (np.linalg.inv(spot.root_from_node) @ root_from_exemplar)[:3, 3]
    sigma_m = float(np.sqrt(pose.sigma_m**2 + spot.sigma_m**2 + seen.variances_m2[-1]))
    margin_m = MOVED_M + Spread(sigma_m, 1.0, 0.0).radius(_CHANCE)
    length, width, rim = size
    is_beside = abs(x) > length / 2 + margin_m or abs(y) > width / 2 + margin_m
    return not is_beside and -_BELOW_M - sigma_m <= z <= rim + _STACK_M
