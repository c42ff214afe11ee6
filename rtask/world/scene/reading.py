"""Reading the scene at an instant from the graph."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import TooLargeError, UnknownTermError
from rtask.rdf.namespaces import CORA, RDF, RT
from rtask.rdf.terms import NamedNode, iri, python_value
from rtask.world.frames import Rooted
from rtask.world.names import find_frame, label_of
from rtask.world.placement import Placement
from rtask.world.scene.grasps import DEFAULT_GRASPS, StoredGrasp, grasps_of
from rtask.world.scene.nodes import Fact, Kind, Scene, SceneNode, SceneSurface, Unplaced
from rtask.world.spots import Spot, Spots, carried, size_of
from rtask.world.surfaces import read_surface, stored_mesh

if TYPE_CHECKING:
    from rtask.world.state import WorldState

__all__ = ["MAX_EXEMPLARS", "MAX_FRAMES", "read_scene"]

MAX_EXEMPLARS = 2_000
MAX_FRAMES = 5_000
"""Things and frames of one scene."""
_RELATIONS = {"on": "on", "in": "in", "held_by": "held by", "at": "at"}


def read_scene(
    world: WorldState,
    time_s: float,
    frame: str | None = None,
    max_grasps: int = DEFAULT_GRASPS,
    surfaces: bool = True,
) -> Scene:
    """Return the scene at a time: a tree of frames with robots, things and their grasps.

    Frames of different trees cannot be compared, so a scene is of one tree.

    Parameters
    ----------
    time_s
        Unix time. Places are those of that time; sizes and grasps are what is known now.
    frame
        Name or IRI of any frame of the tree; default: the tree in which most things are.
    max_grasps
        Grasps of a thing, those that held most often first.
    surfaces
        Whether to read the reconstructed surfaces of products, some 100 kB each.

    Raises
    ------
    UnknownTermError, UsageError
        There is no such frame, or several have the name.
    TooLargeError
        There are more things or frames than one scene may have.
    """
    reader = _Reader(world, time_s, surfaces)
    reader.read_frames()
    reader.read_exemplars()
    if frame is None:
        root = reader.fullest_root()
    else:
        named = find_frame(world, frame)
        if not world.kb.match(iri(named), RDF.type, RT.Frame):
            raise UnknownTermError(f"frame: the graph has no frame {frame!r}", field="frame")
        root = world.frames.rooted(named, time_s).root
    return reader.scene(root, max_grasps)


@dataclass(frozen=True, eq=False)
class _Located:
    """A thing with a pose: the frame above it, and its pose (4, 4), m, there."""

    iri: str
    placement: Placement
    spot: Spot
    parent: str
    parent_from_exemplar: NDArray[np.float64]


@dataclass
class _Reader:
    world: WorldState
    time_s: float
    with_surfaces: bool
    _rooted: dict[str, Rooted] = field(default_factory=dict)
    _bodies: dict[str, list[tuple[Kind, str]]] = field(default_factory=dict)
    _located: list[_Located] = field(default_factory=list)
    _unplaced: list[Unplaced] = field(default_factory=list)
    _surfaces: dict[str, SceneSurface | None] = field(default_factory=dict)

    def read_frames(self) -> None:
        """Read the tree of frames, and which of them are those of robots, tables and boxes."""
        frames = self._subjects(RDF.type, RT.Frame)
        if len(frames) > MAX_FRAMES:
            raise TooLargeError(f"a scene has at most {MAX_FRAMES} frames; there are {len(frames)}")
        for frame in frames:
            rooted = self.world.frames.rooted(frame, self.time_s)
            if rooted.fault:
                label = self.world.frames.name_of(frame)
                self._unplaced.append(Unplaced(frame, label, rooted.fault))
            else:
                self._rooted[frame] = rooted
        # Products and cameras have a body frame as well.
        all_robots = set(self._subjects(RDF.type, CORA.Robot))
        all_places = set(self._subjects(RDF.type, RT.SupportSurface))
        for quad in self.world.kb.match(None, RT.bodyFrame):
            if not (isinstance(quad.object, NamedNode) and isinstance(quad.subject, NamedNode)):
                continue
            kind: Kind = "robot" if quad.subject.value in all_robots else "place"
            if kind == "place" and quad.subject.value not in all_places:
                continue
            bodies = self._bodies.setdefault(quad.object.value, [])
            if (kind, quad.subject.value) not in bodies:
                bodies.append((kind, quad.subject.value))

    def read_exemplars(self) -> None:
        """Read the things that have a place."""
        spots = Spots(self.world, self.time_s)
        things = spots.placed(MAX_EXEMPLARS)
        if len(things) > MAX_EXEMPLARS:
            raise TooLargeError(f"a scene has at most {MAX_EXEMPLARS} things; there are more")
        for thing in things:
            placement = self.world.placement_at(thing, self.time_s)
            if placement is None:
                continue
            spot = spots.of(thing)
            now = carried(self.world, placement, self.time_s)
            if spot is None:
                reason = self._why_unplaced(now)
                self._unplaced.append(Unplaced(thing, label_of(self.world, thing), reason))
            else:
                self._located.append(self._placed(thing, now, spot))

    def fullest_root(self) -> str:
        """Return the root of the tree in which most things are, then most frames; "" for none."""
        trees = self._trees()
        return max(sorted(trees), key=lambda root: trees[root], default="")

    def scene(self, root: str, max_grasps: int) -> Scene:
        """Return the scene of the tree below a root."""
        nodes: list[SceneNode] = []
        number: dict[str, int] = {}

        def add(kind: Kind, node: str, parent: str | None, pose: NDArray[np.float64],
                label: str = "", **more: Any) -> None:  # fmt: skip
            above = None if parent is None else number[parent]
            number.setdefault(node, len(nodes))
            label = label or label_of(self.world, node)
            nodes.append(SceneNode(kind, node, label, above, pose, **more))

        for frame, rooted in self._frames_below(root):
            parent = rooted.path[1] if len(rooted.path) > 1 else None
            pose = rooted.poses[1] if parent else np.eye(4)
            add("frame", frame, parent, pose, self.world.frames.name_of(frame))
            for body, node in self._bodies.get(frame, ()):
                size = size_of(self.world.kb, node) if body == "place" else None
                add(body, node, frame, np.eye(4), size_m=size)
        shown = [thing for thing in self._located if thing.spot.root == root]
        products = {thing.iri: self.world.product_of(thing.iri) for thing in shown}
        grasps = grasps_of(self.world.kb, set(products.values()) - {""}, max_grasps)
        for thing in shown:
            product = products[thing.iri]
            if thing.placement.frame_from_subject is None:
                # A box, or a grasp, at a pose that nobody knows would be a picture of a guess.
                add("thing", thing.iri, thing.parent, thing.parent_from_exemplar,
                    region_m=self._region(thing.placement.place),
                    facts=self._facts(thing, product))  # fmt: skip
                continue
            add("thing", thing.iri, thing.parent, thing.parent_from_exemplar,
                size_m=self._size(product), surface=self._surface(product),
                facts=self._facts(thing, product))  # fmt: skip
            for grasp in grasps.get(product, ()):
                _add_grasp(nodes, number[thing.iri], grasp)
        others = sorted((tree, count) for tree, (count, _) in self._trees().items() if tree != root)
        return Scene(self.time_s, tuple(nodes), tuple(others), tuple(self._unplaced))

    def _frames_below(self, root: str) -> Iterable[tuple[str, Rooted]]:
        """Return the frames of a tree, each after its parent."""
        if not root:
            return []
        tree = {f: rooted for f, rooted in self._rooted.items() if rooted.root == root}
        tree.setdefault(root, self.world.frames.rooted(root, self.time_s))
        for rooted in list(tree.values()):
            for frame in rooted.path:  # a parent may be named without being described
                if frame not in tree:
                    tree[frame] = self.world.frames.rooted(frame, self.time_s)
        return sorted(tree.items(), key=lambda item: (len(item[1].path), item[0]))

    def _trees(self) -> dict[str, tuple[int, int]]:
        """Return the numbers of things and frames in the tree of each root that has any use.

        A frame alone, in which nothing was seen and no robot stands, is not worth a scene.
        """
        things = Counter(thing.spot.root for thing in self._located)
        frames = Counter(rooted.root for rooted in self._rooted.values())
        return {
            root: (things[root], frames[root]) for root in {*things, *frames}
            if things[root] or frames[root] > 1 or root in self._bodies
        }  # fmt: skip

    def _placed(self, thing: str, placement: Placement, spot: Spot) -> _Located:
        """Return a thing below the frame in which it was measured, if that still tells its place.

        A robot's frame does not: the robot may have moved since. Nor does a place without a pose.
        """
        frame, pose = placement.frame, placement.frame_from_subject
        if pose is not None and frame != spot.root and not self.world.frames.is_of_robot(frame):
            return _Located(thing, placement, spot, frame, pose)
        return _Located(thing, placement, spot, spot.root, spot.root_from_node)

    def _why_unplaced(self, placement: Placement) -> str:
        words = _RELATIONS[placement.relation]
        if placement.frame_from_subject is None:
            place = label_of(self.world, placement.place) or "an unknown place"
            return f"{words} {place}, whose pose is not known"
        return self.world.frames.rooted(placement.frame, self.time_s, placement.begin).fault

    def _facts(self, thing: _Located, product: str) -> dict[str, Fact]:
        placement = thing.placement
        facts: dict[str, Fact] = {
            "product": product, "relation": placement.relation, "place": placement.place,
            "placeLabel": label_of(self.world, placement.place), "agent": placement.agent,
            "stillThere": round(thing.spot.still_there, 6), "sigma_m": thing.spot.sigma_m,
            "since": placement.begin, "seen": min(placement.confirmed, self.time_s),
            "poseOf": "thing" if placement.frame_from_subject is not None else "place",
        }  # fmt: skip
        if placement.frame_from_subject is None:
            words = "somewhere on" if placement.relation == "on" else "somewhere in"
            facts["somewhere"] = f"{words} {facts['placeLabel']}"
        return {name: value for name, value in facts.items() if value != ""}

    def _region(self, place: str) -> tuple[float, float, float] | None:
        return size_of(self.world.kb, place, self.world.product_of(place))

    def _surface(self, product: str) -> SceneSurface | None:
        """Return the current surface of a product; equal products share it."""
        if self.with_surfaces and product and product not in self._surfaces:
            stored = stored_mesh(self.world.kb, iri(product))
            read = None
            if stored is not None and stored.is_current:
                read = read_surface(self.world.kb, stored.blob)
            self._surfaces[product] = (
                None if read is None else SceneSurface(read.vertices, read.faces, read.seen)
            )
        return self._surfaces.get(product)

    def _size(self, product: str) -> tuple[float, float, float] | None:
        if not product:
            return None
        stored = [
            [float(str(python_value(quad.object))) for quad in self.world.kb.match(iri(product), p)]
            for p in (RT.extentX, RT.extentY, RT.extentZ)
        ]
        if not all(stored):
            return None
        x, y, z = (max(values) for values in stored)
        return x, y, z

    def _subjects(self, predicate: NamedNode, value: NamedNode) -> list[str]:
        quads = self.world.kb.match(None, predicate, value)
        return sorted({q.subject.value for q in quads if isinstance(q.subject, NamedNode)})


def _add_grasp(nodes: list[SceneNode], thing: int, grasp: StoredGrasp) -> None:
    facts: dict[str, Fact] = {"attempts": grasp.attempts, "successes": grasp.successes}
    if grasp.gripper:
        facts["gripper"] = grasp.gripper
    nodes.append(
        SceneNode("grasp", grasp.iri, grasp.label, thing, grasp.object_from_gripper,
                  opening_m=grasp.opening_m, facts=facts)
    )  # fmt: skip
