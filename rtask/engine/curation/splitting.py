"""Split an object that turns out to be two; forget views or whole objects."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from rtask.engine.curation.edit import Edit
from rtask.engine.curation.merging import move_frame, withdraw_models
from rtask.engine.memory.statistics import judged, state, statistics_of
from rtask.engine.names import slug, tail
from rtask.engine.perception.growth import posed_views, regrown, state_model
from rtask.engine.records.objects import body_frame
from rtask.engine.records.task_tree import parts_of
from rtask.engine.triples import Triples, stamp
from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES, PROV, RDF, RT, SOSA
from rtask.rdf.terms import NamedNode, Quad, iri

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit

__all__ = ["forget_object", "forget_view", "forget_views", "split_object"]

_HISTORY = ("task", "attempt", "outcome", "feedback", "grasp", "statistics", "recognition",
            "observation", "view", "statement", "symmetry", "direction", "model")  # fmt: skip


def split_object(
    context: Context, object_iri: NamedNode, views: list[str], name: str | None, author: Access
) -> tuple[NamedNode, Commit]:
    """Move some views of an object, and the attempts made on them, to a new object.

    Parameters
    ----------
    views
        IRIs of the views that move; at least one must stay.
    name
        Of the new object.

    Returns
    -------
    The new object and the commit.
    """
    moving = _views_of(context, object_iri, views)
    with context.writing:
        kb = context.kb
        new = context.names.counted("object")
        edit, triples = Edit(kb), Triples()
        _state_twin(context, edit, triples, object_iri, new, name, author)
        frame = body_frame(context, new)
        events, poses = _move_views(edit, object_iri, new, moving)
        poses |= _move_attempts(context, edit, object_iri, new, events)
        # Both objects start from one shape, so that their frames coincide: poses change their frame
        # and no number.
        move_frame(
            context, edit, body_frame(context, object_iri), frame, np.eye(4), frozenset(poses)
        )
        withdraw_models(edit, object_iri)
        # Of the graph as it is, where all views still belong to the old object.
        posed = posed_views(kb, object_iri)
        for owner, mine in (
            (object_iri, [v for v in posed if iri(v[0]) not in moving]),
            (new, [v for v in posed if iri(v[0]) in moving]),
        ):
            model = regrown(kb, mine)
            if model is not None:
                state_model(context, triples, owner, model)
        edit.state(triples, context.home_graph(author))
        return new, edit.commit(context, f"split {tail(new)} from {tail(object_iri)}", author)


def _views_of(context: Context, object_iri: NamedNode, views: Iterable[str]) -> set[NamedNode]:
    object_views = {q.object for q in context.kb.match(object_iri, RT.hasView)}
    chosen = {iri(view) for view in views}
    if not chosen:
        raise UsageError("views is missing: the views of the object to move", field="views")
    strange = sorted(view.value for view in chosen - object_views)
    if strange:
        raise UnknownTermError(f"views: {strange[0]} is not a view of {object_iri.value}")
    if chosen == object_views:
        raise UsageError("views: at least one view of the object must stay", field="views")
    return chosen


def _state_twin(
    context: Context, edit: Edit, triples: Triples, object_iri: NamedNode, new: NamedNode,
    name: str | None, author: Access,
) -> None:  # fmt: skip
    """Add the new object, with the classes, size and symmetry of the old one."""
    alike = (RDF.type, RT.extentX, RT.extentY, RT.extentZ, RT.graspWidth, RT.roundness,
             RT.hasFunction, RT.hasSymmetry)  # fmt: skip
    for quad in edit.match(object_iri):
        if quad.predicate in alike:
            edit.added[Quad(new, quad.predicate, quad.object, quad.graph_name)] = None
    frame = body_frame(context, new)
    triples.node(
        new,
        [RT.ManipulableObject],
        {
            RT.objectId: f"{slug(author.agent or 'shared')}/{tail(new)}",
            RT.name: name or f"object {tail(new)}",
            RT.bodyFrame: frame,
            PROV.wasDerivedFrom: object_iri,
        },
    )
    triples.node(frame, [RT.Frame], {RT.frameId: f"object/{tail(new)}"})


def _move_views(
    edit: Edit, object_iri: NamedNode, new: NamedNode, views: set[NamedNode]
) -> tuple[set[NamedNode], set[NamedNode]]:
    """Move views and their observations; return the observations and the viewpoints."""
    events: set[NamedNode] = set()
    poses: set[NamedNode] = set()
    for view in views:
        for quad in edit.match(object_iri, RT.hasView, view):
            edit.replace(quad, Quad(new, RT.hasView, view, quad.graph_name))
        poses |= _objects(edit, view, RT.viewpoint)
        events |= _objects(edit, view, PROV.wasDerivedFrom)
    for event in events:
        for quad in edit.match(event, SOSA.hasFeatureOfInterest, object_iri):
            edit.replace(quad, Quad(event, quad.predicate, new, quad.graph_name))
    return events, poses


def _objects(edit: Edit, subject: NamedNode, predicate: NamedNode) -> set[NamedNode]:
    return {q.object for q in edit.match(subject, predicate) if isinstance(q.object, NamedNode)}


def _move_attempts(
    context: Context, edit: Edit, object_iri: NamedNode, new: NamedNode, events: set[NamedNode]
) -> set[NamedNode]:
    """Move the attempts reported with observations; return the poses of the moved grasps.

    A grasp that was also tried on the old object is copied to the new one.
    """
    ids = {q.object for event in events for q in edit.match(event, RT.requestId)}
    if not ids:
        return set()
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?task ?attempt ?grasp ?id WHERE {{
  ?task rt:handles {object_iri} ; rt:through ?attempt .
  ?attempt rt:executesGrasp ?grasp OPTIONAL {{ ?attempt rt:requestId ?id }} }}""")
    moved: dict[NamedNode, list[NamedNode]] = {}
    stays: set[NamedNode] = set()
    tasks: set[NamedNode] = set()
    for row in rows:
        task, attempt, grasp = row["task"], row["attempt"], row["grasp"]
        assert isinstance(task, NamedNode)
        assert isinstance(attempt, NamedNode)
        assert isinstance(grasp, NamedNode)
        if row["id"] not in ids:
            stays.add(grasp)
            continue
        moved.setdefault(grasp, []).append(attempt)
        tasks |= {*parts_of(task)}
    _move_tasks(edit, object_iri, new, tasks)
    poses: set[NamedNode] = set()
    for grasp, attempts in moved.items():
        if grasp not in stays:
            for quad in edit.match(object_iri, RT.hasGrasp, grasp):
                edit.replace(quad, Quad(new, RT.hasGrasp, grasp, quad.graph_name))
            contacts = _objects(edit, grasp, RT.hasContact)
            poses |= _objects(edit, grasp, RT.graspPose) | contacts
            for contact in contacts:
                poses |= _objects(edit, contact, RT.contactNormal)
        else:
            _copy_grasp(context, edit, new, grasp, attempts)
    return poses


def _move_tasks(edit: Edit, object_iri: NamedNode, new: NamedNode, tasks: set[NamedNode]) -> None:
    """Move tasks to another object; what they are parts of goes along if all its parts go."""
    wholes = {q.subject for task in tasks for q in edit.match(None, RT.hasSubTask, task)}
    going = set(tasks)
    for whole in wholes:
        assert isinstance(whole, NamedNode)
        parts = edit.match(whole, RT.hasSubTask)
        # A whole whose parts are of both objects now handles neither alone.
        if all(quad.object in tasks for quad in parts):
            going.add(whole)
        else:
            edit.remove(quad for quad in parts if quad.object in tasks)
    for task in going:
        for quad in edit.match(task, RT.handles, object_iri):
            edit.replace(quad, Quad(task, RT.handles, new, quad.graph_name))


def _copy_measure(
    edit: Edit, node: NamedNode, owners: tuple[NamedNode, NamedNode], frame: NamedNode
) -> NamedNode:
    """Copy a pose, a contact or a normal to another frame and owner; return the copy."""
    # Nodes of a grasp carry its IRI in front: the copy's names follow from its own, so that nothing
    # has to be counted.
    copy = iri(node.value.replace(owners[0].value, owners[1].value, 1))
    for part in edit.match(node):
        value = frame if part.predicate == RT.inFrame else part.object
        if part.predicate == RT.contactNormal and isinstance(value, NamedNode):
            value = _copy_measure(edit, value, owners, frame)
        edit.added[Quad(copy, part.predicate, value, part.graph_name)] = None
    return copy


def _copy_grasp(
    context: Context, edit: Edit, new: NamedNode, grasp: NamedNode, attempts: list[NamedNode]
) -> None:
    twin = context.names.counted("grasp")
    frame = body_frame(context, new)
    for quad in edit.match(grasp):
        value, graph = quad.object, quad.graph_name
        if quad.predicate in (RT.graspPose, RT.hasContact) and isinstance(value, NamedNode):
            value = _copy_measure(edit, value, (grasp, twin), frame)
        edit.added[Quad(twin, quad.predicate, value, graph)] = None
        edit.added[Quad(new, RT.hasGrasp, twin, graph)] = None
    for attempt in attempts:
        for quad in edit.match(attempt, RT.executesGrasp, grasp):
            edit.replace(quad, Quad(attempt, RT.executesGrasp, twin, quad.graph_name))
    _recount(context, edit, grasp, twin, attempts)


def _recount(
    context: Context, edit: Edit, grasp: NamedNode, twin: NamedNode, attempts: list[NamedNode]
) -> None:
    """Recount a grasp without some attempts, and its copy with them."""
    totals: dict[tuple[NamedNode, NamedNode, str], list[int]] = {}
    every, moved = judged(context, grasp=[grasp]), judged(context, attempt=attempts)
    # The old grasp keeps what did not move; nobody's attempt is counted twice.
    for rows, owner, sign in ((every, grasp, 1), (moved, grasp, -1), (moved, twin, 1)):
        for _, robot, gripper_type, held, n in rows:
            total = totals.setdefault((owner, robot, gripper_type), [0, 0])
            total[0] += sign * n * held
            total[1] += sign * n
    for link in edit.match(None, RT.statisticsOf, grasp):
        assert isinstance(link.subject, NamedNode)
        edit.remove(edit.match(link.subject))
    for (owner, robot, gripper_type), (successes, tries) in totals.items():
        if tries:
            triples, node = Triples(), statistics_of(context, owner, robot)
            state(triples, node, owner, gripper_type, robot, successes, tries)
            edit.state(triples, context.kb.graphs.agent(tail(robot)))


def forget_views(
    context: Context, object_iri: NamedNode, views: list[str], purge: bool, author: Access
) -> Commit:
    """Forget some views of an object and rebuild its model from the others."""
    gone = _views_of(context, object_iri, views)
    with context.writing:
        kb, edit, triples = context.kb, Edit(context.kb), Triples()
        freed = [blob for view in sorted(gone, key=str) for blob in forget_view(edit, view)]
        withdraw_models(edit, object_iri)
        model = regrown(kb, [v for v in posed_views(kb, object_iri) if iri(v[0]) not in gone])
        if model is not None:
            state_model(context, triples, object_iri, model)
        edit.state(triples, context.home_graph(author))
        commit = edit.commit(context, f"forget {len(gone)} views of {tail(object_iri)}", author)
        _discard(context, freed if purge else [])
        return commit


def forget_view(edit: Edit, view: NamedNode) -> list[NamedNode]:
    """Withdraw a view with its content and all that refers to it; return the blobs it frees."""
    freed = []
    for content in _objects(edit, view, RT.viewContent):
        freed += edit.forget_bytes(content)
        for word in _objects(edit, content, RT.hasWord):
            edit.remove(edit.match(word))
        edit.remove(edit.match(content))
        edit.remove(edit.match(None, None, content))
    for pose in _objects(edit, view, RT.viewpoint):
        edit.remove(edit.match(pose))
    edit.remove(edit.match(view))
    edit.remove(edit.match(None, None, view))
    return freed


def forget_object(context: Context, object_iri: NamedNode, purge: bool, author: Access) -> Commit:
    """Forget an object, so that it is no longer recognised.

    Parameters
    ----------
    purge
        Delete its attempts as well, and its bytes at once; the journal of the knowledge base keeps
        the statements. Otherwise attempts and outcomes stay as history, with the grasps that they
        executed and whose these were, and the bytes until they are collected.
    """
    with context.writing:
        edit = Edit(context.kb)
        freed = [
            blob
            for view in sorted(_objects(edit, object_iri, RT.hasView), key=str)
            for blob in forget_view(edit, view)
        ]
        withdraw_models(edit, object_iri)
        _forget_places(edit, object_iri)
        tried = set[object]()
        if purge:
            gone = _history(context, edit, object_iri)
            edit.remove(edit.match(None, None, object_iri))
        else:
            grasps = _objects(edit, object_iri, RT.hasGrasp)
            # Attempts are history and stay, with the grasps that they executed; only purging takes
            # both.
            tried.update(g for g in grasps if edit.match(None, RT.executesGrasp, g))
            gone = _depending(context, edit, [g for g in grasps if g not in tried])
        for node in gone:
            freed += edit.forget_bytes(node)
            edit.remove(edit.match(node))
            edit.remove(edit.match(None, None, node))
        frame = body_frame(context, object_iri)
        edit.remove(edit.match(frame))
        edit.remove(
            q
            for q in edit.match(object_iri)
            if q not in edit.removed and not (q.predicate == RT.hasGrasp and q.object in tried)
        )
        _forget_notes(edit, object_iri)
        triples = Triples()
        # A mark is left, so that a robot that still knows the IRI is told that it was forgotten.
        triples.add(object_iri, PROV.invalidatedAtTime, stamp(dt.datetime.now(dt.UTC)))
        edit.state(triples, context.home_graph(author))
        how = "forget for good" if purge else "forget"
        commit = edit.commit(context, f"{how} {tail(object_iri)}", author)
        _discard(context, freed if purge else [])
        return commit


def _forget_places(edit: Edit, object_iri: NamedNode) -> None:
    """Withdraw the estimates of an object's pose, and its things with their placements."""
    for link in edit.match(None, RT.exemplarOf, object_iri):
        exemplar = link.subject
        if isinstance(exemplar, NamedNode) and edit.match(exemplar, RDF.type, RT.Exemplar):
            _forget_exemplar(edit, exemplar)
    for link in edit.match(None, RT.poseOf, object_iri):
        if isinstance(link.subject, NamedNode):
            for pose in _objects(edit, link.subject, RT.estimatedPose):
                edit.remove(edit.match(pose))
            edit.remove(edit.match(link.subject))


def _forget_exemplar(edit: Edit, exemplar: NamedNode) -> None:
    """Withdraw a thing, its placements with all that they have, and what others say of it."""
    for link in edit.match(None, RT.placementOf, exemplar):
        if isinstance(link.subject, NamedNode):
            for quad in edit.match(link.subject):
                value = quad.object
                if isinstance(value, NamedNode) and value.value.startswith(link.subject.value):
                    edit.remove(edit.match(value))
            edit.remove(edit.match(link.subject))
    _forget_notes(edit, exemplar)
    edit.remove(edit.match(exemplar))
    edit.remove(q for q in edit.match(None, None, exemplar) if q not in edit.removed)


def _forget_notes(edit: Edit, object_iri: NamedNode) -> None:
    """Withdraw the annotations on statements about an object."""
    from rtask.rdf.terms import Triple

    for quad in edit.match(None, RDF.reifies, None):
        statement = quad.object
        if isinstance(statement, Triple) and statement.subject == object_iri:
            assert isinstance(quad.subject, NamedNode)
            edit.remove(edit.match(quad.subject))


def _history(context: Context, edit: Edit, object_iri: NamedNode) -> set[NamedNode]:
    """Return everything that depends on an object: attempts, outcomes, grasps, counts."""
    inverse = (RT.handles, SOSA.hasFeatureOfInterest)
    nodes: list[object] = [q.subject for p in inverse for q in edit.match(None, p, object_iri)]
    return _depending(context, edit, [*nodes, *(q.object for q in edit.match(object_iri))])


def _depending(context: Context, edit: Edit, nodes: Iterable[object]) -> set[NamedNode]:
    """Return records, and those that depend on them, as far as they are parts of a history."""
    starts = tuple(f"{context.kb.base}{kind}/" for kind in _HISTORY)
    seen: set[NamedNode] = set()
    todo = list(nodes)
    while todo:
        node = todo.pop()
        if not isinstance(node, NamedNode) or node in seen or not node.value.startswith(starts):
            continue
        seen.add(node)
        # Not to where it came from: that is a source of others as well.
        todo += [q.object for q in edit.match(node) if q.predicate != PROV.wasDerivedFrom]
        for predicate in (RT.statisticsOf, RT.executesGrasp):
            todo += [q.subject for q in edit.match(None, predicate, node)]
    return seen


def _discard(context: Context, blobs: Iterable[NamedNode]) -> None:
    """Delete blobs that are no longer referenced."""
    kb = context.kb
    for blob in blobs:
        # Asked after the commit: another view may hold the same bytes.
        if not kb.match(None, RT.hasBlob, blob) and kb.blobs.has(blob):
            kb.blobs.discard(blob.value.rpartition(":")[2], 0.0)
