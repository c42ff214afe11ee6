"""Stored grasps of products, those that held most often first."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.frames import matrix_from_pose, pose_from_planar
from rtask.rdf.namespaces import PREFIXES, local_name
from rtask.rdf.terms import iri

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore
    from rtask.sparql.results import Row

__all__ = ["DEFAULT_GRASPS", "StoredGrasp", "grasps_of"]

DEFAULT_GRASPS = 3
_DEFAULT_OPENING_M = 0.05
_GRASPS = """
SELECT ?product ?grasp (SAMPLE(?kind) AS ?gripper) (SAMPLE(?jaw) AS ?opening)
  (SAMPLE(?px) AS ?x) (SAMPLE(?py) AS ?y) (SAMPLE(?pz) AS ?z) (SAMPLE(?turn) AS ?theta)
  (SAMPLE(?q0) AS ?qx) (SAMPLE(?q1) AS ?qy) (SAMPLE(?q2) AS ?qz) (SAMPLE(?q3) AS ?qw)
  (COUNT(DISTINCT ?counted) AS ?attempts) (COUNT(DISTINCT ?held) AS ?successes)
WHERE {
  VALUES ?product { $products }
  ?product rt:hasGrasp ?grasp . ?grasp rt:graspPose ?pose .
  ?pose rt:x ?px ; rt:y ?py ; rt:z ?pz
  OPTIONAL { ?pose rt:theta ?turn }
  OPTIONAL { ?pose rt:qx ?q0 ; rt:qy ?q1 ; rt:qz ?q2 ; rt:qw ?q3 }
  OPTIONAL { ?grasp rt:gripperType ?kind }
  OPTIONAL { ?grasp rt:jawOpening ?jaw }
  OPTIONAL {
    ?grasp rt:triedIn ?counted . ?counted rt:hasOutcome/rt:judgedSuccess ?success
    BIND(IF(?success, ?counted, ?none) AS ?held)
  }
} GROUP BY ?product ?grasp"""


@dataclass(frozen=True, eq=False)
class StoredGrasp:
    """A grasp of a product.

    Parameters
    ----------
    object_from_gripper : (4, 4) float64, m
        The fingers point along z and close along x.
    opening_m
        Of the jaws before they close.
    attempts, successes
        Outcomes that count, and those of them that held.
    """

    iri: str
    label: str
    gripper: str
    object_from_gripper: NDArray[np.float64]
    opening_m: float
    attempts: int
    successes: int


def grasps_of(kb: GraphCore, products: Collection[str], most: int) -> dict[str, list[StoredGrasp]]:
    """Return at most so many grasps of each product that have a pose in the product's frame."""
    if not products or most < 1:
        return {}
    names = " ".join(str(iri(product)) for product in sorted(products))
    grasps: dict[str, list[StoredGrasp]] = {}
    for row in kb.select(PREFIXES + _GRASPS.replace("$products", names)):
        pose = _pose(row)
        if pose is not None:
            grasps.setdefault(str(row.value("product")), []).append(_read(row, pose))
    for stored in grasps.values():
        stored.sort(key=lambda grasp: (-grasp.successes, -grasp.attempts, grasp.iri))
        del stored[most:]
    return grasps


def _read(row: Row, pose: NDArray[np.float64]) -> StoredGrasp:
    node = str(row.value("grasp"))
    opening = _number(row, "opening")
    gripper = "" if row["gripper"] is None else str(row.value("gripper"))
    return StoredGrasp(
        node, f"grasp {local_name(node)}", gripper, pose,
        _DEFAULT_OPENING_M if opening is None else opening,
        int(str(row.value("attempts"))), int(str(row.value("successes"))),
    )  # fmt: skip


def _pose(row: Row) -> NDArray[np.float64] | None:
    x, y, z = (_number(row, axis) or 0.0 for axis in "xyz")
    theta = _number(row, "theta")
    if theta is not None:
        return np.asarray(pose_from_planar(x, y, z, theta), np.float64)
    quaternion = [_number(row, name) for name in ("qx", "qy", "qz", "qw")]
    if None in quaternion:
        return None
    position = np.array([x, y, z])
    return np.asarray(matrix_from_pose(position, np.array(quaternion, np.float64)), np.float64)


def _number(row: Row, name: str) -> float | None:
    return None if row[name] is None else float(str(row.value(name)))
