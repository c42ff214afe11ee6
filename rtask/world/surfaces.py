"""Reconstructed surfaces of products, as the graph stores them.

A surface is current as long as the model that it was made from is the one in use: each view that
joins an object's model makes another model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rtask.errors import MissingBlobError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rtask.kb.core import GraphCore

__all__ = ["StoredMesh", "Surface", "read_surface", "stored_mesh"]


@dataclass(frozen=True)
class StoredMesh:
    """A reconstructed surface in the graph.

    Parameters
    ----------
    iri, blob
        IRIs of the mesh and of its bytes, a PLY file in the object's frame, m.
    views
        Number of views that it was made from.
    seen_share
        Share of its area that was measured; the rest is filled in.
    median_residual_m, residual_90_m
        Median and 90 % quantile of the distances of the measured points from it, m.
    is_watertight
        Whether every edge belongs to exactly two faces.
    is_current
        Whether it was made from the model that is in use now; if not, it is stale.
    """

    iri: str
    blob: str
    views: int
    seen_share: float
    median_residual_m: float
    residual_90_m: float
    is_watertight: bool
    is_current: bool


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface as it was stored.

    Parameters
    ----------
    vertices : (v, 3) float64
        m, object frame.
    faces : (f, 3) int64
    colours : (v, 3) uint8 RGB
    seen : (v,) bool
        Which vertices a measurement supports; the others are filled in.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colours: NDArray[np.uint8]
    seen: NDArray[np.bool_]


def stored_mesh(kb: GraphCore, object_iri: NamedNode) -> StoredMesh | None:
    """Return the reconstructed surface of an object, a current one first; None if there is none."""
    rows = kb.select(f"""{PREFIXES}
SELECT ?mesh ?blob ?seen ?median ?most ?closed (COUNT(DISTINCT ?view) AS ?views)
  (GROUP_CONCAT(DISTINCT STR(?model)) AS ?models) WHERE {{
  {object_iri} rt:hasFeature ?mesh .
  ?mesh rt:seenShare ?seen ; rt:hasBlob ?blob ; rt:medianResidual ?median ; rt:residual90 ?most ;
    rt:isWatertight ?closed
  OPTIONAL {{ ?mesh prov:wasDerivedFrom ?view . ?view a rt:View }}
  OPTIONAL {{ ?mesh prov:wasDerivedFrom ?model }}
}} GROUP BY ?mesh ?blob ?seen ?median ?most ?closed ORDER BY ?mesh""")
    in_use = _model_in_use(kb, object_iri)
    meshes = [
        StoredMesh(
            str(row.value("mesh")), str(row.value("blob")), int(str(row.value("views"))),
            float(str(row.value("seen"))), float(str(row.value("median"))),
            float(str(row.value("most"))), str(row.value("closed")).lower() == "true",
            in_use in str(row.value("models")).split(),
        )
        for row in rows
    ]  # fmt: skip
    return max(meshes, key=lambda mesh: (mesh.is_current, mesh.views), default=None)


def _model_in_use(kb: GraphCore, object_iri: NamedNode) -> str:
    """Return the model with the most views, or "" for none."""
    rows = kb.select(f"""{PREFIXES}
SELECT ?model (COUNT(DISTINCT ?view) AS ?views) WHERE {{
  {object_iri} rt:hasModel ?model . ?model rt:hasBlob ?blob
  OPTIONAL {{ ?model rt:builtFrom ?view }}
}} GROUP BY ?model ORDER BY DESC(?views) STR(?model) LIMIT 1""")
    return next((str(row.value("model")) for row in rows), "")


def read_surface(kb: GraphCore, blob: str) -> Surface | None:
    """Return a stored surface, or None if its bytes are missing or are none."""
    try:
        data = kb.blobs.read(blob)
    except MissingBlobError:
        return None
    head, mark, body = data.partition(b"end_header\n")
    counts = [int(line.split()[2]) for line in head.decode("ascii", "replace").splitlines()
              if line.startswith("element ")]  # fmt: skip
    corner = np.dtype([("place", "<f4", 3), ("colour", "u1", 3), ("seen", "u1")])
    face = np.dtype([("count", "u1"), ("corner", "<i4", 3)])
    if not mark or b"property uchar seen" not in head or len(counts) != 2:
        return None
    size = counts[0] * corner.itemsize
    if len(body) != size + counts[1] * face.itemsize:
        return None
    corners = np.frombuffer(body[:size], corner)
    faces = np.frombuffer(body[size:], face)["corner"].astype(np.int64)
    if len(faces) and (faces.min() < 0 or faces.max() >= len(corners)):
        return None
    return Surface(
        corners["place"].astype(np.float64), faces, corners["colour"].copy(),
        corners["seen"].astype(bool),
    )  # fmt: skip
