"""Object models grown from views that fit together, one for each object (Kehoe 2014, 4.3).

The first view fixes the frame, in which grasps are also given. A later view is added if the
camera's pose relative to the object is known and the view does not contradict the model; otherwise
it stays a separate view. The graph keeps one model for each object and author, as a blob with a
list of its views; of several models the one with the most views is used. All can be rebuilt from
the views.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.frames import tilt
from rtask.engine.perception.observation import stored_frame, viewpoint
from rtask.engine.perception.surroundings import surrounded, with_table
from rtask.engine.triples import Triples
from rtask.rdf.namespaces import PROV, RT
from rtask.rdf.terms import NamedNode, Value, iri

if TYPE_CHECKING:
    from features.geometry import Frame
    from features.modelling import ObjectModel, Registration
    from rtask.engine.context import Context
    from rtask.engine.observation import Observation
    from rtask.engine.stored import Models
    from rtask.engine.view_index import Progress
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = [
    "Growth",
    "grow",
    "old_models",
    "posed_views",
    "rebuild_models",
    "regrown",
    "state_model",
]

log = logging.getLogger(__name__)

_MODEL = "application/vnd.rtask.model"
_MESH = "model/ply"
_CODEC = "RTASK-model/1"
_ENOUGH_VIEWS, MAX_VIEWS = 8, 48
_WORTH = 1.02
_UPRIGHT, MAX_FLOAT_M = np.deg2rad(20), 0.012


@dataclass(frozen=True, eq=False)
class Growth:
    """A model grown by one view.

    Parameters
    ----------
    before
        Bytes of the model before this view; empty for the first view.
    """

    model: ObjectModel
    registration: Registration
    before: str = ""


def grow(
    models: Models,
    object_iri: NamedNode | None,
    seen: Observation,
    object_from_camera: NDArray[np.float64] | None,
    view: NamedNode,
    is_round: bool = False,
) -> Growth | None:
    """Add a view to an object's model if it fits and shows something new.

    Parameters
    ----------
    object_iri
        The object; None for a new one.
    object_from_camera : (4, 4) float64, m
        Pose of the camera in the object's frame, or None if unknown.
    is_round
        Whether to prepare the model as that of a round object.
    """
    from features.modelling import ObjectModel

    if object_from_camera is None or seen.shape is None:
        return None
    stored = None if object_iri is None else models.of(object_iri)
    if stored is not None and view.value in stored[0].views:
        return None
    before = ObjectModel() if stored is None else stored[1]
    if stored is not None and not _stands(seen, object_from_camera):
        log.info("view %s shows the model above or below the table", view.value)
        return None
    extended = _extended(before, surrounded(seen)[0], object_from_camera, view.value)
    if extended is None:
        return None
    try:
        # Prepared now rather than while a caller waits for a pose; this also rejects models of
        # size no object has.
        extended[0].pose_model(is_round)
    except ValueError as error:
        log.info("view %s gives no model: %s", view.value, error)
        return None
    return Growth(*extended, "" if stored is None else stored[0].blob)


def _stands(seen: Observation, object_from_camera: NDArray[np.float64]) -> bool:
    """Tell whether an upright object has its origin on the table, if the table is known.

    Otherwise the model could be fitted to the top of a taller object, above the table.
    """
    if not seen.is_posed or seen.shape is None:
        return True
    frame_from_object = seen.frame_from_camera @ np.linalg.inv(object_from_camera)
    off = abs(float(frame_from_object[2, 3]) - seen.shape.support_height)
    return tilt(frame_from_object) > _UPRIGHT or off < MAX_FLOAT_M


def _extended(
    before: ObjectModel, frame: Frame, object_from_camera: NDArray[np.float64], view: str
) -> tuple[ObjectModel, Registration] | None:
    """Return a model with one more view, or None if the view does not fit or adds nothing."""
    if len(before.sources) >= MAX_VIEWS:
        return None
    try:
        grown, registration = before.add(frame, object_from_camera=object_from_camera, name=view)
    except ValueError as error:
        log.info("view %s cannot be registered with the model: %s", view, error)
        return None
    if registration is None:
        log.info("view %s does not fit the model", view)
        return None
    shows_new = len(grown.cloud) > _WORTH * len(before.cloud)
    if len(before.sources) >= _ENOUGH_VIEWS and not shows_new:
        return None
    return grown, registration


def posed_views(kb: GraphCore, object_iri: NamedNode) -> list[tuple[str, NDArray[np.float64]]]:
    """Return the views of an object whose viewpoint is known, oldest first."""
    views = {q.object for q in kb.match(object_iri, RT.hasView) if isinstance(q.object, NamedNode)}
    poses = [(view.value, viewpoint(kb, view)) for view in sorted(views, key=str)]
    return [(view, pose) for view, pose in poses if pose is not None]


def regrown(kb: GraphCore, views: Sequence[tuple[str, NDArray[np.float64]]]) -> ObjectModel | None:
    """Return the model rebuilt from the bytes of views, or None if there are none.

    Parameters
    ----------
    views
        IRI and ``object_from_camera`` (4, 4) of each; the first defines the frame.
    """
    from features.modelling import ObjectModel

    model = ObjectModel()
    for view, pose in views:
        stored = stored_frame(kb, view)
        if stored is None:
            continue
        frame, is_camera = stored
        # In the object's frame the table is the plane z = 0.
        plane = np.array([*pose[2, :3], pose[2, 3]]) if pose[2, 3] > 0 else None
        shown = with_table(frame, plane) if is_camera else frame
        extended = _extended(model, shown, pose, view)
        model = model if extended is None else extended[0]
    return None if model.is_empty else model


def rebuild_models(context: Context, progress: Progress | None = None) -> tuple[Commit, int]:
    """Rebuild the models of all objects from their views in one commit.

    Parameters
    ----------
    progress
        Called with how many objects are done and how many there are.

    Returns
    -------
    Commit
    Number of models.
    """
    kb = context.kb
    with context.writing:
        objects = {
            q.subject for q in kb.match(None, RT.hasView) if isinstance(q.subject, NamedNode)
        }
        objects |= {
            q.subject for q in kb.match(None, RT.hasModel) if isinstance(q.subject, NamedNode)
        }
        triples, made = Triples(), 0
        old: list[tuple[NamedNode, NamedNode, Value, NamedNode]] = []
        for number, object_iri in enumerate(sorted(objects, key=str), 1):
            old += old_models(kb, object_iri)
            model = regrown(kb, posed_views(kb, object_iri))
            if model is not None:
                state_model(context, triples, object_iri, model)
                made += 1
            if progress is not None:
                progress(number, len(objects))
        rights = kb.access()
        with kb.transaction(note="rebuild models") as tx:
            for subject, predicate, value, graph in old:
                if rights.may_write(graph):
                    tx.remove(subject, predicate, value, graph)
            triples.write(tx)
        return tx.commit, made


def state_model(
    context: Context, triples: Triples, object_iri: NamedNode, model: ObjectModel
) -> tuple[NamedNode, str]:
    """State a model with cloud and mesh; return its IRI and that of its stored blob."""
    from features.modelling import mesh_to_ply

    node = context.names.unique("model")
    cloud = context.kb.blobs.put(model.to_bytes(), _MODEL)
    triples.add(object_iri, RT.hasModel, node)
    triples.node(
        node,
        [RT.ObjectModel],
        {RT.hasBlob: triples.blob(cloud), RT.pointCount: len(model.cloud), RT.codec: _CODEC},
    )
    for name, _ in model.sources:
        triples.add(node, RT.builtFrom, iri(name))
    vertices, faces, colours = model.mesh()
    if len(faces):
        mesh = iri(f"{node.value}/mesh")
        data = context.kb.blobs.put(mesh_to_ply(vertices, faces, colours), _MESH)
        triples.add(object_iri, RT.hasFeature, mesh)
        triples.node(
            mesh,
            [RT.TriangleMesh],
            {RT.hasBlob: triples.blob(data), RT.vertexCount: len(vertices),
             RT.faceCount: len(faces), PROV.wasDerivedFrom: node},
        )  # fmt: skip
    return node, cloud.iri.value


def old_models(
    kb: GraphCore, object_iri: NamedNode, graph: NamedNode | None = None
) -> list[tuple[NamedNode, NamedNode, Value, NamedNode]]:
    """Return the statements to withdraw for an object's models, in one graph or in all."""
    quads: list[tuple[NamedNode, NamedNode, Value, NamedNode]] = []
    for link in kb.match(object_iri, RT.hasModel, graph=graph):
        model, where = link.object, link.graph_name
        if not isinstance(model, NamedNode) or not isinstance(where, NamedNode):
            continue
        mesh = iri(f"{model.value}/mesh")
        quads.append((object_iri, RT.hasModel, model, where))
        quads.append((object_iri, RT.hasFeature, mesh, where))
        for node in (model, mesh):
            quads += [
                (node, quad.predicate, quad.object, where) for quad in kb.match(node, graph=where)
            ]
    return quads
