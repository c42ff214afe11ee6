"""Frames and viewpoints of stored views."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.frames import matrix_from_pose
from rtask.errors import MissingBlobError, UsageError
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import NamedNode, iri, python_value

if TYPE_CHECKING:
    from features.geometry import Frame
    from rtask.kb.core import GraphCore

__all__ = ["stored_frame", "viewpoint"]

log = logging.getLogger(__name__)


def stored_frame(kb: GraphCore, view: str) -> tuple[Frame, bool] | None:
    """Return the crop of a stored view, and whether it was taken by a camera.

    A cloud without pixels is rendered again as on arrival. None if the bytes are missing.
    """
    from features.codec import decode
    from features.geometry import Frame
    from rtask.engine.perception.images import frame_of_cloud

    rows = kb.select(f"""{PREFIXES}
SELECT ?blob WHERE {{ {iri(view)} rt:viewContent ?content .
  ?content a rt:CompressedPointCloud ; rt:hasBlob ?blob }} ORDER BY ?blob LIMIT 1""")
    for row in rows:
        try:
            decoded = decode(kb.blobs.read(str(row.value("blob"))))
            if isinstance(decoded, Frame):
                return decoded, True
            return frame_of_cloud(decoded.points(), decoded.colours)[0], False
        except (MissingBlobError, UsageError, ValueError) as error:
            log.warning("view %s has no cloud: %s", view, error)
    return None


def viewpoint(kb: GraphCore, view: NamedNode) -> NDArray[np.float64] | None:
    """Return the stored pose (4, 4) of the camera of a view in the object's frame, or None."""
    for link in kb.match(view, RT.viewpoint):
        if not isinstance(link.object, NamedNode):
            continue
        said = {q.predicate: python_value(q.object) for q in kb.match(link.object)}
        numbers = [said.get(getattr(RT, name)) for name in ("x", "y", "z", "qx", "qy", "qz", "qw")]
        if all(isinstance(number, float | int) for number in numbers):
            seven = np.array(numbers, dtype=np.float64)
            return np.asarray(matrix_from_pose(seven[:3], seven[3:]), dtype=np.float64)
    return None
