"""Clouds of objects for browsers: decoded, moved into the object's frame and thinned here."""

from __future__ import annotations

from typing import TYPE_CHECKING

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.http.messages import RefusedError
from endpoint.pages.objects import resolve_object
from endpoint.pages.render import blueprint, context, embedded_graph
from rtask.engine.engine import Engine
from rtask.engine.stored import stored_models
from rtask.errors import UsageError
from rtask.extras import naming_extras
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import NamedNode, iri, python_value
from rtask.world.surfaces import stored_mesh

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Points = tuple[NDArray[np.float32], NDArray[np.uint8]]

MAX_POINTS = 200_000
DEFAULT_POINTS = 50_000
_GREY = 128


@blueprint.route("/object/cloud.ply", methods=["GET"])
def cloud() -> WerkzeugResponse:
    """Return the cloud of an object's model, or of one of its views, as binary PLY."""
    subject = iri(resolve_object("iri"))
    asked = flask.request.args
    view, most = asked.get("view", ""), asked.get("max", DEFAULT_POINTS, type=int)
    if not 1 <= most <= MAX_POINTS:
        raise UsageError(f"max={most}: expected 1 to {MAX_POINTS} points")
    blob = _blob_of_view(subject, iri(view)) if view else _blob_of_model(subject)
    etag = f"{blob.rpartition(':')[2][:32]}-{most}"
    response = flask.Response(content_type="application/ply")
    response.set_etag(etag)
    response.headers["Cache-Control"] = "private, no-cache"
    if flask.request.if_none_match.contains(etag):
        response.status_code = 304
        return response
    with naming_extras("clouds"):
        points, colours = _points_of_view(iri(view), blob) if view else _points_of_model(subject)
        response.set_data(ply_of(*thinned(points, colours, most)))
    return response


@blueprint.route("/object/mesh.ply", methods=["GET"])
def mesh() -> WerkzeugResponse:
    """Return the reconstructed surface of an object as binary PLY, m, in the object's frame."""
    subject = iri(resolve_object("iri"))
    kb = embedded_graph()
    stored = stored_mesh(kb, subject)
    if stored is None:
        raise RefusedError(
            404, "not-found", f"no surface of {subject.value} yet; reconstruct_mesh makes one"
        )
    response = flask.Response(content_type="model/ply")
    response.set_etag(stored.blob.rpartition(":")[2][:32])
    response.headers["Cache-Control"] = "private, no-cache"
    response.set_data(kb.blobs.read(stored.blob))
    return response.make_conditional(flask.request)


def _blob_of_model(model: NamedNode) -> str:
    models = stored_models(embedded_graph(), model)
    if not models:
        raise RefusedError(404, "not-found", f"there is no model of {model.value}; name a view")
    return models[0].blob


def _blob_of_view(model: NamedNode, view: NamedNode) -> str:
    """Return the IRI of the bytes of a view's cloud.

    Raises
    ------
    RefusedError
        404 if it is not a view of the object, or has no cloud.
    """
    kb = embedded_graph()
    if kb.match(model, RT.hasView, view):
        for content in kb.match(view, RT.viewContent):
            node = content.object
            if isinstance(node, NamedNode) and kb.match(node, RDF.type, RT.PointCloud):
                for blob in kb.match(node, RT.hasBlob):
                    assert isinstance(blob.object, NamedNode)
                    return blob.object.value
    raise RefusedError(404, "not-found", f"{view.value} is not a view with a cloud of the object")


def _points_of_model(subject: NamedNode) -> Points:
    engine = context().engine
    assert isinstance(engine, Engine)  # another has no models
    points = engine.context.models.of(subject)
    if points is None:
        raise RefusedError(404, "not-found", f"the model of {subject.value} cannot be read")
    model = points[1]
    return model.cloud[:, :3], model.colours


def _points_of_view(view: NamedNode, blob: str) -> Points:
    """Return the points of a view's cloud (n, 3), m, object frame, and their colours (n, 3)."""
    import numpy as np

    from grasp.spatial.frames import matrix_from_pose

    kb = embedded_graph()
    points, colours = coloured_points(kb.blobs.read(blob))
    poses = [quad.object for quad in kb.match(view, RT.viewpoint)]
    if not poses:
        raise RefusedError(404, "not-found", f"nobody knows from where {view.value} was seen")
    assert isinstance(poses[0], NamedNode)
    at = _numbers(poses[0], "x", "y", "z", "qx", "qy", "qz", "qw")
    object_from_camera = matrix_from_pose(np.array(at[:3]), np.array(at[3:]))
    moved = points @ object_from_camera[:3, :3].T + object_from_camera[:3, 3]
    return moved.astype(np.float32), colours


def _numbers(node: NamedNode, *names: str) -> list[float]:
    kb = embedded_graph()
    return [float(str(python_value(kb.match(node, getattr(RT, name))[0].object))) for name in names]


def coloured_points(data: bytes) -> Points:
    """Return the points (n, 3), m, and colours (n, 3) of an encoded cloud or depth image.

    In the camera's frame, of the object alone where it is marked; grey where there is no colour.

    Raises
    ------
    ValueError
        It is neither.
    """
    import numpy as np

    from features.codec import decode
    from features.geometry import Frame

    decoded = decode(data)
    if isinstance(decoded, Frame):
        mask = decoded.object_mask() & (decoded.depth_m > 0)
        points = decoded.points()[mask]
        colours = None if decoded.rgb is None else decoded.rgb[mask]
    else:
        points, colours = decoded.positions, decoded.colours
    if colours is None:
        colours = np.full((len(points), 3), _GREY, np.uint8)
    return np.asarray(points, np.float32), np.asarray(colours, np.uint8)


def thinned(points: NDArray[np.float32], colours: NDArray[np.uint8], most: int) -> Points:
    """Return at most so many points, evenly chosen; the same ones each time."""
    import numpy as np

    if len(points) > most:
        chosen = np.sort(np.random.default_rng(0).choice(len(points), most, replace=False))
        points, colours = points[chosen], colours[chosen]
    return points, colours


def ply_of(points: NDArray[np.float32], colours: NDArray[np.uint8]) -> bytes:
    """Return points and colours as binary little-endian PLY."""
    import numpy as np

    layout = [(axis, "<f4") for axis in "xyz"] + [(name, "u1") for name in ("r", "g", "b")]
    table = np.empty(len(points), layout)
    for column, axis in enumerate("xyz"):
        table[axis] = points[:, column]
    for column, name in enumerate("rgb"):
        table[name] = colours[:, column]
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    return head.encode() + table.tobytes()
