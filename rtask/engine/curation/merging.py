"""Merge two objects that turn out to be one, and resolve the IRIs of merged objects.

Views, grasps, outcomes and counts move to the object that is kept. Grasps and viewpoints are
transformed into its frame, estimated from matching views; the models are rebuilt. Each merge is one
commit.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.frames import matrix_from_pose, tilt, wrap_2pi, yaw_of
from rtask.engine.curation.edit import Edit
from rtask.engine.names import tail
from rtask.engine.perception.growth import posed_views, regrown, state_model
from rtask.engine.records.objects import body_frame
from rtask.engine.stored import view_features
from rtask.engine.triples import Triples
from rtask.errors import UsageError
from rtask.rdf.namespaces import RDF, RDFS, RT
from rtask.rdf.terms import Literal, NamedNode, Quad, Triple, iri, object_term, python_value
from rtask.wire.message import Message

if TYPE_CHECKING:
    from features.recognition.views.view import ViewFeatures
    from rtask.engine.context import Context
    from rtask.graph import Graph
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = ["find_target_from_other", "merge_objects", "move_frame", "withdraw_models"]

MAX_PAIRS = 6
MIN_AGREED = 8
MAX_SHIFT_M, MAX_TILT = 0.03, np.deg2rad(20)
_OF_ITS_OWN = (
    RT.objectId, RT.name, RT.extentX, RT.extentY, RT.extentZ, RT.graspWidth, RT.roundness,
    RT.bodyFrame, RT.hasSymmetry, RT.hasModel,
)  # fmt: skip
_NUMBERS = (RT.x, RT.y, RT.z, RT.theta, RT.qx, RT.qy, RT.qz, RT.qw)
_DIRECTION = (RT.dirX, RT.dirY, RT.dirZ)


def merge_objects(context: Context, target: NamedNode, other: NamedNode, author: Access) -> Commit:
    """Merge two objects into one; the IRI of the other then resolves to the one kept.

    Parameters
    ----------
    target, other
        IRIs of objects.

    Raises
    ------
    UsageError
        When both are the same.
    """
    if target == other:
        raise UsageError(f"into: {target.value} cannot be merged with itself", field="into")
    with context.writing:
        kb = context.kb
        target_from_other = find_target_from_other(context, target, other)
        edit = Edit(kb)
        # Read before they are renamed: people go on asking for the object by its former name.
        names = [str(python_value(q.object)) for q in kb.match(other, RT.name)]
        move_frame(
            context,
            edit,
            body_frame(context, other),
            body_frame(context, target),
            target_from_other,
        )
        for node in (target, other):
            withdraw_models(edit, node)
        _withdraw_likeness(edit, target, other)
        # A cup merged into a mug stays a mug: the one kept says what it is, unless it says nothing.
        kinds = {q.object for q in kb.match(target, RDF.type)} - {RT.ManipulableObject}

        def goes_along(quad: Quad) -> bool:
            if quad.predicate == RDF.type:
                return not kinds
            return quad.predicate not in _OF_ITS_OWN

        edit.rename(other, target, goes_along)
        triples = Triples()
        triples.add(other, RT.mergedInto, target)
        for name in sorted(set(names)):
            triples.add(other, RDFS.label, Literal(name))
        views = posed_views(kb, target) + [
            (v, target_from_other @ pose) for v, pose in posed_views(kb, other)
        ]
        model = regrown(kb, views)
        if model is not None:
            state_model(context, triples, target, model)
        edit.state(triples, context.home_graph(author))
        return edit.commit(context, f"merge {tail(other)} into {tail(target)}", author)


def _withdraw_likeness(edit: Edit, target: NamedNode, other: NamedNode) -> None:
    """Withdraw that two objects are alike, which would come to be said of one."""
    # Stated in either direction, by whoever saw the one first.
    for first, like in ((target, other), (other, target)):
        edit.remove(edit.match(first, RT.similarTo, like))
        likeness = Triple(first, RT.similarTo, like)
        for quad in edit.match(None, RDF.reifies, None):
            if quad.object == likeness and isinstance(quad.subject, NamedNode):
                edit.remove(edit.match(quad.subject))


def withdraw_models(edit: Edit, object_iri: NamedNode) -> None:
    """Withdraw an object's models of all agents, with their meshes."""
    for link in edit.match(object_iri, RT.hasModel):
        edit.remove([link])
        if not isinstance(link.object, NamedNode):
            continue
        mesh = iri(f"{link.object.value}/mesh")
        edit.remove(edit.match(object_iri, RT.hasFeature, mesh))
        for node in (link.object, mesh):
            edit.forget_bytes(node)
            edit.remove(edit.match(node))


def find_target_from_other(
    context: Context, target: NamedNode, other: NamedNode
) -> NDArray[np.float64]:
    """Return ``target_from_other`` (4, 4): yaw and translation on the table, from matching views.

    If no views match, the frames are assumed equal: both have their origin in the middle of the
    measured footprint and lie along its longer side.
    """
    from features.recognition.pairs import match_views

    here, there = (_posed_views(context, object_iri) for object_iri in (target, other))
    best, agreed = np.eye(4), MIN_AGREED - 1
    for features, target_from_camera in here[:MAX_PAIRS]:
        for others, other_from_camera in there[:MAX_PAIRS]:
            pairs = match_views(features, others)
            if pairs.first_from_second is None or int(pairs.agreed.sum()) <= agreed:
                continue
            target_from_other = (
                target_from_camera @ pairs.first_from_second @ np.linalg.inv(other_from_camera)
            )
            if (
                tilt(target_from_other) < MAX_TILT
                and np.linalg.norm(target_from_other[:2, 3]) < MAX_SHIFT_M
            ):
                best, agreed = target_from_other, int(pairs.agreed.sum())
    # Objects stand on a table: a tilt or height that matching gives is its error, and would lift
    # every grasp.
    flat = np.eye(4)
    yaw = yaw_of(best)
    flat[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    flat[:2, 3] = best[:2, 3]
    return flat


def _posed_views(
    context: Context, object_iri: NamedNode
) -> list[tuple[ViewFeatures, NDArray[np.float64]]]:
    """Return features and ``object_from_camera`` of the views whose viewpoint is known."""
    views = []
    for view, pose in posed_views(context.kb, object_iri):
        features = view_features(context.kb, iri(view))
        if features is not None:
            views.append((features, pose))
    return views


def _numbers(quads: Iterable[Quad]) -> dict[NamedNode, float]:
    return {
        q.predicate: float(str(python_value(q.object)))
        for q in quads
        if q.predicate in (*_NUMBERS, *_DIRECTION)
    }


def move_frame(
    context: Context,
    edit: Edit,
    old: NamedNode,
    new: NamedNode,
    new_from_old: NDArray[np.float64],
    only: frozenset[NamedNode] | None = None,
) -> None:
    """Express the poses of one frame in another.

    Parameters
    ----------
    new_from_old : (4, 4) float64
        A rotation about z and a translation.
    only
        Poses to transform; None = all, and the frame itself is withdrawn.
    """
    for link in edit.match(None, RT.inFrame, old):
        pose, graph = link.subject, link.graph_name
        if not isinstance(pose, NamedNode) or (only is not None and pose not in only):
            continue
        edit.replace(link, Quad(pose, RT.inFrame, new, graph))
        # A pose may be described in several graphs; each is moved by the numbers of its own.
        quads = [q for q in edit.match(pose) if q.graph_name == graph]
        numbers = _numbers(quads)
        triples = Triples()
        if RT.theta in numbers:
            place = np.array([*(numbers[p] for p in _NUMBERS[:3]), 1.0])
            x, y, z = (new_from_old @ place)[:3].tolist()
            theta = round(wrap_2pi(numbers[RT.theta] + yaw_of(new_from_old)), 6)
            triples.node(pose, [], {RT.x: x, RT.y: y, RT.z: z})
            # Rounding can turn the largest angle below a full turn into a full turn, which is out
            # of range.
            triples.add(pose, RT.theta, 0.0 if theta >= 2 * np.pi else theta)
        elif RT.qw in numbers:
            place = np.array([numbers[p] for p in _NUMBERS[:3]])
            quaternion = np.array([numbers[p] for p in _NUMBERS[4:]])
            triples.pose(pose, new, new_from_old @ matrix_from_pose(place, quaternion))
        elif RT.dirX in numbers:
            triples.direction(
                pose, new, new_from_old[:3, :3] @ np.array([numbers[p] for p in _DIRECTION])
            )
        elif RT.x in numbers:
            place = np.array([*(numbers[p] for p in _NUMBERS[:3]), 1.0])
            triples.position(pose, new, (new_from_old @ place)[:3])
        placed = [fact for fact in triples if fact[1] in (*_NUMBERS, *_DIRECTION)]
        for _, predicate, value in placed:
            for quad in quads:
                if quad.predicate == predicate:
                    edit.replace(quad, Quad(pose, predicate, object_term(value), graph))
    if only is None:
        edit.remove(edit.match(old))


def present_name(kb: GraphCore | Graph, name: str) -> str:
    """Return the current IRI of an object that may have been merged; other text unchanged."""
    seen = {name}
    while ":" in name:
        try:
            node = NamedNode(name)
        except ValueError:
            return name
        onwards = [q.object for q in kb.match(node, RT.mergedInto)]
        targets = sorted(o.value for o in onwards if isinstance(o, NamedNode))
        # Two merges in opposite directions make a ring.
        if not targets or targets[0] in seen:
            return name
        name = targets[0]
        seen.add(name)
    return name


Request = TypeVar("Request", bound=Message)


def followed(kb: GraphCore, request: Request) -> Request:
    """Return a request with the current IRIs of merged objects in ``object`` and ``objects``."""
    name, entries = getattr(request, "object", None), getattr(request, "objects", None)
    changed: dict[str, object] = {}
    if isinstance(name, str):
        changed["object"] = present_name(kb, name)
    if isinstance(entries, list):
        changed["objects"] = [
            followed(kb, entry) if isinstance(entry, Message) else entry for entry in entries
        ]
    return request.model_copy(update=changed)
