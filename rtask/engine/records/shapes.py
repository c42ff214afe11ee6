"""Best stored shape of an object for grasp planning.

This is a closed mesh, else the model grown from its views, else the clouds of the views, in the
object's own frame, where z = 0 is the support.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.gripper import ParallelGripper
from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import recall
from rtask.engine.perception.observation import stored_frame
from rtask.engine.records.objects import resolve_object
from rtask.errors import DataError, MissingBlobError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import iri
from rtask.world.surfaces import read_surface, stored_mesh

if TYPE_CHECKING:
    from features.modelling import ObjectModel
    from grasp.spatial.candidate import Proposals
    from grasp.spatial.grasp_plan import SpatialOptions
    from grasp.spatial.gripper import EndEffector
    from grasp.spatial.hand_search.shipped import Filter
    from grasp.spatial.meshes.mesh import Mesh
    from rtask.engine.context import Context

__all__ = ["ObjectShape", "object_cloud", "object_shape"]

_CLOSED, _LINES, _SLOPE = 0.9, 400, 0.4
_NEAR_M = 0.002
_MIN_VIEWS, _MIN_SEEN, _MAX_RESIDUAL_M = 4, 0.5, 0.003


@dataclass(frozen=True, eq=False)
class ObjectShape:
    """Surface of an object in its own frame, m.

    Parameters
    ----------
    object_iri
        IRI of the object.
    kind
        ``mesh``, ``model`` (the cloud grown from its views) or ``views``.
    sources
        IRIs of its sources.
    points : (n, 3)
        Of the surface; the vertices of a mesh.
    mesh
        None unless the surface is closed.
    viewpoints : (k, 3)
        Positions of the cameras.
    note
        One line for people.
    """

    object_iri: str
    kind: Literal["mesh", "model", "views"]
    sources: tuple[str, ...]
    points: NDArray[np.float64]
    mesh: Mesh | None = None
    viewpoints: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    note: str = ""

    def plan(
        self,
        gripper: EndEffector,
        options: SpatialOptions,
        classifier: Filter = None,
        floating: bool = False,
    ) -> Proposals:
        """Plan grasps in space; see :mod:`grasp.spatial.grasp_plan`.

        Parameters
        ----------
        floating
            Whether the object has no support below it.
        """
        from grasp.spatial.contact_plan import OtherHand, plan_contacts, plan_contacts_on_cloud
        from grasp.spatial.grasp_plan import plan_on_cloud, plan_on_mesh

        support = None if floating else Support(0.0)
        eyes = self.viewpoints if len(self.viewpoints) else None
        if isinstance(gripper, OtherHand):
            if self.mesh is not None:
                return plan_contacts(self.mesh, gripper, Surroundings(support), options)
            return plan_contacts_on_cloud(self.points, gripper, support, eyes, options)
        assert isinstance(gripper, ParallelGripper)
        if self.mesh is not None:
            return plan_on_mesh(self.mesh, gripper, Surroundings(support), options)
        return plan_on_cloud(self.points, gripper, support, eyes, options, classifier)


def object_shape(context: Context, name: str, surface: bool = False) -> ObjectShape:
    """Return the best stored shape of an object.

    Parameters
    ----------
    name
        IRI, objectId or name.
    surface
        Whether a reconstructed surface that is good enough comes before the cloud.

    Raises
    ------
    UnknownTermError
        There is no such object.
    DataError
        No shape of it is stored.
    """
    object_iri = resolve_object(context, name)
    for node, blob in _meshes(context, object_iri):
        mesh = _read_mesh(context, blob)
        if mesh is not None and _is_closed(mesh):
            note = f"{object_iri}: closed mesh of {len(mesh.faces)} faces"
            return ObjectShape(object_iri, "mesh", (node,), mesh.vertices, mesh, note=note)
    stored_model = context.models.of(iri(object_iri))
    swept = None
    if stored_model is not None and _is_round(context, object_iri):
        swept = _swept(stored_model[1])
    if stored_model is not None and swept is not None:
        note = f"{object_iri}: round, {len(swept.faces)} faces swept about its axis"
        return ObjectShape(
            object_iri, "mesh", (stored_model[0].iri.value,), swept.vertices, swept, note=note
        )
    reconstructed = _good_surface(context, object_iri) if surface else None
    if reconstructed is not None:
        return reconstructed
    if stored_model is None or len(stored_model[1].sources) < 2:
        # A single view is denser than the model made from it.
        _, points, views, eyes = _views(context, object_iri)
        note = f"{object_iri}: {len(points)} points of {len(views)} views"
        return ObjectShape(object_iri, "views", views, points, None, eyes, note)
    stored, model = stored_model
    seen = [pose[:3, 3] for view, pose in model.sources if _is_of_camera(context, view)]
    points = model.cloud[:, :3].astype(np.float64)
    note = f"{object_iri}: {len(points)} points grown from {len(model.sources)} views"
    eyes = np.array(seen).reshape(-1, 3)
    return ObjectShape(object_iri, "model", (stored.iri.value,), points, None, eyes, note)


def _good_surface(context: Context, object_iri: str) -> ObjectShape | None:
    """Return the reconstructed surface of an object, if it is current and good enough to plan on.

    Its bounds are those of the comparison of grasps in ``docs/benchmarks/perception.md``: nothing
    is known of surfaces of fewer views, or of which less was seen.
    """
    from grasp.spatial.meshes.mesh import as_mesh

    stored = stored_mesh(context.kb, iri(object_iri))
    if stored is None or not stored.is_current or stored.views < _MIN_VIEWS:
        return None
    if stored.seen_share < _MIN_SEEN or stored.residual_90_m > _MAX_RESIDUAL_M:
        return None
    read = read_surface(context.kb, stored.blob)
    if read is None:
        return None
    mesh = as_mesh(read.vertices, read.faces)
    note = (
        f"{object_iri}: surface of {len(mesh.faces)} faces from {stored.views} views, "
        f"{stored.seen_share:.0%} of it seen"
    )
    return ObjectShape(object_iri, "mesh", (stored.iri,), mesh.vertices, mesh, note=note)


def object_cloud(context: Context, name: str) -> tuple[str, NDArray[np.float64]]:
    """Return the IRI of an object and the points (n, 3) of all its views in its own frame, m.

    Parameters
    ----------
    name
        IRI, objectId or name.

    Raises
    ------
    UnknownTermError
        There is no such object.
    DataError
        No view has a cloud with a known viewpoint.
    """
    return _views(context, resolve_object(context, name))[:2]


Views = tuple[str, NDArray[np.float64], tuple[str, ...], NDArray[np.float64]]


def _views(context: Context, object_iri: str) -> Views:
    """Return the object, the points (n, 3) of its views, their IRIs and where the cameras were."""
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?view ?blob ?x ?y ?z ?qx ?qy ?qz ?qw WHERE {{
  {iri(object_iri)} rt:hasView ?view . ?view rt:viewContent ?content ; rt:viewpoint ?pose .
  ?content a rt:CompressedPointCloud ; rt:hasBlob ?blob .
  ?pose rt:x ?x ; rt:y ?y ; rt:z ?z ; rt:qx ?qx ; rt:qy ?qy ; rt:qz ?qz ; rt:qw ?qw
}} ORDER BY ?view""")
    clouds, views, eyes = [], [], []
    for row in rows:
        at: dict[str, Any] = row.to_dict()
        pose = [float(at[k]) for k in ("x", "y", "z", "qx", "qy", "qz", "qw")]
        try:
            points, is_camera = _points(context.kb.blobs.read(str(row.value("blob"))), pose)
        except (MissingBlobError, ValueError):
            continue
        clouds.append(points)
        views.append(str(row.value("view")))
        if is_camera:
            eyes.append(pose[:3])
    if not clouds:
        raise DataError(
            f"no view of {object_iri} has a cloud with a known viewpoint; insert one first"
        )
    return object_iri, np.vstack(clouds), tuple(views), np.array(eyes).reshape(-1, 3)


def _points(data: bytes, pose: Sequence[float]) -> tuple[NDArray[np.float64], bool]:
    """Return the points (n, 3) of a view in the object's frame, and whether a camera saw them."""
    from features.codec import decode
    from features.geometry import Frame
    from grasp.spatial.frames import matrix_from_pose
    from rtask.engine.perception.images import frame_of_cloud

    decoded = decode(data)
    is_camera = isinstance(decoded, Frame)
    if isinstance(decoded, Frame):
        frame = decoded
    else:
        frame, _ = frame_of_cloud(decoded.points(), decoded.colours)
    points = frame.points()[frame.object_mask()].astype(np.float64)
    object_from_camera = matrix_from_pose(np.array(pose[:3]), np.array(pose[3:]))
    moved = points @ object_from_camera[:3, :3].T + object_from_camera[:3, 3]
    return np.asarray(moved[np.isfinite(moved).all(axis=1)]), is_camera


def _meshes(context: Context, object_iri: str) -> list[tuple[str, str]]:
    """Return IRIs and blobs of stored meshes: imported ones first, then by number of views."""
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?mesh ?blob ?model (COUNT(DISTINCT ?view) AS ?n) WHERE {{
  {iri(object_iri)} rt:hasFeature ?mesh . ?mesh a rt:TriangleMesh ; rt:hasBlob ?blob
  FILTER NOT EXISTS {{ ?mesh rt:seenShare ?share }}
  OPTIONAL {{ ?mesh prov:wasDerivedFrom ?model . ?model rt:builtFrom ?view }}
}} GROUP BY ?mesh ?blob ?model""")
    meshes = [
        (row["model"] is not None, -int(str(row.value("n"))), str(row.value("mesh")),
         str(row.value("blob")))
        for row in rows
    ]  # fmt: skip
    return [(mesh, blob) for _, _, mesh, blob in sorted(meshes)]


def _read_mesh(context: Context, blob: str) -> Mesh | None:
    from grasp.spatial.meshes.mesh_files import mesh_from_ply

    try:
        return mesh_from_ply(context.kb.blobs.read(blob))
    except (MissingBlobError, ValueError):
        return None


def _is_of_camera(context: Context, view: str) -> bool:
    """Tell whether a view was taken by a camera; other clouds have no viewpoint."""
    frame = stored_frame(context.kb, view)
    return frame is not None and frame[1]


def _swept(model: ObjectModel) -> Mesh | None:
    """Return the closed surface of revolution of a round object, or None."""
    from scipy.spatial import cKDTree

    from grasp.spatial.meshes.mesh import as_mesh

    swept = model.revolved()
    vertices, faces, _ = swept.mesh()
    # Beyond the last measurement the surface continues for two cells in a wrong direction.
    near = cKDTree(swept.cloud[:, :3]).query(vertices, distance_upper_bound=_NEAR_M)[0] < _NEAR_M
    faces = faces[near[faces].all(axis=1)]
    mesh = as_mesh(vertices, faces) if len(faces) else None
    return mesh if mesh is not None and _is_closed(mesh) else None


def _is_round(context: Context, object_iri: str) -> bool:
    remembered = recall(context.kb, Question(objects=(object_iri,))).objects.get(object_iri)
    return remembered is not None and remembered.is_round


def _is_closed(mesh: Mesh) -> bool:
    """Tell whether nearly every horizontal line through the body enters and leaves it.

    The underside is seldom observed and is not needed for grasping.
    """
    from grasp.spatial.meshes.rays import crossings

    if len(mesh.faces) == 0:
        return False
    rng = np.random.default_rng(0)
    yaw, rise = rng.uniform(0, 2 * np.pi, _LINES), rng.uniform(-_SLOPE, _SLOPE, _LINES)
    lines = np.stack([np.cos(yaw), np.sin(yaw), rise], axis=1)
    lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    through = low + rng.uniform(0.1, 0.9, (_LINES, 3)) * (high - low)
    far = float(np.linalg.norm(high - low))
    _, index, counts = crossings(mesh.tree, through, lines, -far, far)
    met = np.flatnonzero(counts > 0)
    if len(met) < _LINES // 10:
        return False
    enters, leaves = (
        np.einsum("ni,ni->n", mesh.tree.normals[index[met, at]], lines[met])
        for at in (0, counts[met] - 1)
    )
    return bool(((enters < 0) & (leaves > 0)).mean() >= _CLOSED)
