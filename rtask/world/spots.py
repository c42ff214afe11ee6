"""Spots: where things, frames, robots and places are in the root of their tree, to be compared.

Tables and boxes have a size as well, so that a pose can be on, in or beside one.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import NamedNode, iri, python_value
from rtask.world.frames import Rooted
from rtask.world.names import present
from rtask.world.placement import Placement
from rtask.world.uncertainty import MOVED_M, Spread

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore
    from rtask.world.state import WorldState

__all__ = ["Pose", "Spot", "Spots", "carried", "extents_of", "is_at", "size_of"]

_MAX_NESTING = 64
_SURFACE = (RT.surfaceLength, RT.surfaceWidth, RT.rimHeight)
_EXTENTS = (RT.extentX, RT.extentY, RT.extentZ)
_CHANCE = 0.9
_BELOW_M = 0.05
"""By how much the origin of a thing may be below the surface: poses are measured to centimetres."""
_STACK_M = 0.3
"""Height of a stack on a table or above the rim of a box; a shelf above is further up."""


@dataclass(frozen=True, eq=False)
class Spot:
    """Where something is.

    Parameters
    ----------
    node
        Its IRI.
    root, root_from_node
        IRI of the root of its tree of frames, and its pose (4, 4) there, m.
    sigma_m
        Standard deviation of the position per axis.
    still_there
        Chance that a thing is still there; 1 for what is no thing.
    """

    node: str
    root: str
    root_from_node: NDArray[np.float64]
    sigma_m: float = 0.0
    still_there: float = 1.0

    @property
    def position(self) -> NDArray[np.float64]:
        """Position (3,), m, in the root."""
        return self.root_from_node[:3, 3]


def extents_of(kb: GraphCore, product: str) -> list[float]:
    """Return the horizontal extents of a product, m, as far as they are stored."""
    return [
        float(str(python_value(quad.object)))
        for name in (RT.extentX, RT.extentY)
        for quad in kb.match(iri(product), name)
    ]


@dataclass
class Spots:
    """Spots of one world at one time.

    Parameters
    ----------
    time_s
        Unix time.
    """

    world: WorldState
    time_s: float
    _rooted: dict[tuple[str, float], Rooted] = field(default_factory=dict)

    def of(self, node: str, depth: int = 0) -> Spot | None:
        """Return the spot of a thing, frame, robot or place, or None if it is not known."""
        placement = self.world.placement_at(present(self.world, node), self.time_s)
        if placement is not None and self.is_exemplar(node):
            return self._of_exemplar(node, placement, depth)
        if self.world.kb.match(iri(node), RDF.type, RT.Frame):
            return self.in_frame(node, node)
        for quad in self.world.kb.match(iri(node), RT.bodyFrame):
            if isinstance(quad.object, NamedNode):
                return self.in_frame(node, quad.object.value)
        return None

    def in_frame(self, node: str, frame: str) -> Spot | None:
        """Return the spot of what stands in the origin of a frame; None if that is not known."""
        return self._in_frame(node, frame, np.eye(4), self.time_s)

    def placed(self, most: int) -> list[str]:
        """Return the things that have a place at this time, sorted, at most so many and one."""
        # A thing that turned out to be another one has its places of before under its own name.
        subjects = {present(self.world, name) for name in self.world.index.held_at(self.time_s)}
        things = (subject for subject in sorted(subjects) if self.is_exemplar(subject))
        return list(itertools.islice(things, most + 1))

    def is_exemplar(self, node: str) -> bool:
        """Whether an IRI is of a thing."""
        return bool(self.world.kb.match(iri(node), RDF.type, RT.Exemplar))

    def containers(self, thing: str) -> list[str]:
        """Return what a thing is in, the innermost first."""
        containers: list[str] = []
        node = present(self.world, thing)
        while True:  # however deep: a cut would say of a thing that it is not inside
            placement = self.world.placement_at(node, self.time_s)
            if placement is None or placement.relation != "in" or placement.place in containers:
                return containers
            containers.append(placement.place)
            node = placement.place

    def extent(self, thing: str) -> float | None:
        """Return the larger horizontal extent of a thing's product, m, or None."""
        product = self.world.product_of(thing) or thing
        return max(extents_of(self.world.kb, product), default=None)

    def _of_exemplar(self, thing: str, placement: Placement, depth: int) -> Spot | None:
        still = self.world.spread(placement, self.time_s).still_there * placement.confidence
        placement = carried(self.world, placement, self.time_s)
        if placement.frame_from_subject is not None:
            measured_s = min(placement.begin, self.time_s)
            pose, sigma = placement.frame_from_subject, placement.sigma_m
            return self._in_frame(thing, placement.frame, pose, measured_s, sigma, still)
        around = self.of(placement.place, depth + 1) if depth < _MAX_NESTING else None
        if around is None:
            return None
        still *= around.still_there
        return Spot(thing, around.root, around.root_from_node, around.sigma_m, still)

    def _in_frame(
        self,
        node: str,
        frame: str,
        pose: NDArray[np.float64],
        measured_s: float,
        sigma_m: float = 0.0,
        still: float = 1.0,
    ) -> Spot | None:
        key = frame, measured_s if self.world.frames.is_of_robot(frame) else self.time_s
        rooted = self._rooted.get(key)
        if rooted is None:
            rooted = self.world.frames.rooted(frame, self.time_s, measured_s)
            self._rooted[key] = rooted
        if rooted.fault:
            return None
        sigma = float(np.hypot(sigma_m, np.sqrt(rooted.variances_m2[-1])))
        return Spot(node, rooted.root, rooted.poses[-1] @ pose, sigma, still)


def carried(world: WorldState, placement: Placement, time_s: float) -> Placement:
    """Return a placement with the pose that its thing has at a time, as what it is on or in moved.

    A cup on a tray, or in a box, goes where that goes. Its pose was measured from somewhere else,
    so that it would stay behind. Without a pose where nobody knows that of the tray any more.
    """
    if placement.relation not in ("on", "in") or placement.frame_from_subject is None:
        return placement
    measured_s = min(placement.begin, time_s)
    then = Spots(world, measured_s).of(placement.place)
    if then is None:
        return placement
    now = Spots(world, time_s).of(placement.place)
    if now is None:
        return replace(placement, frame="", frame_from_subject=None)
    if now.root == then.root and np.allclose(now.root_from_node, then.root_from_node, atol=1e-9):
        return placement
    there = world.frames.rooted(placement.frame, measured_s)
    if there.fault or there.root != then.root:
        return placement
    place_from_subject = np.linalg.inv(then.root_from_node) @ there.poses[-1]
    pose = now.root_from_node @ place_from_subject @ placement.frame_from_subject
    sigma_m = float(np.linalg.norm(
        [placement.sigma_m, then.sigma_m, now.sigma_m, np.sqrt(there.variances_m2[-1])]
    ))  # fmt: skip
    return replace(placement, frame=now.root, frame_from_subject=pose, sigma_m=sigma_m)


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
