"""Vectors of a user's network beside SIFT: stored in the graph, searched where print is missing.

They propose what a thing may be. Nothing is accepted, and no outcome credited, by them.
"""

from __future__ import annotations

import logging
import threading
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from rtask.engine.observation import Observation
from rtask.engine.stored import stored_views
from rtask.engine.triples import Triples
from rtask.errors import MissingBlobError, UsageError
from rtask.extras import naming_extras
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import NamedNode, iri

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.recognition.recogniser import Recognition
    from rtask.kb.core import GraphCore

__all__ = ["Embeddings"]

log = logging.getLogger(__name__)

_MIN_COSINE = 0.5
_PRINT = 6


class Embeddings:
    """Vectors of all views of a knowledge base, of one network.

    Parameters
    ----------
    model
        The network's ONNX file.
    writing
        Lock of the writer.

    Raises
    ------
    UsageError
        The file is no network that can be used.
    MissingExtraError
        The extra ``embed`` is not installed.
    """

    def __init__(self, kb: GraphCore, model: Path, writing: threading.RLock) -> None:
        with naming_extras(str(model)):
            for needed in ("faiss", "onnxruntime"):
                import_module(needed)  # now, and not at the first view
            from features.embedding.embedder import Embedder
            from features.embedding.index import VectorIndex

        try:
            self._embedder = Embedder(model)
        except (OSError, ValueError) as error:
            raise UsageError(f"embedder: {error}") from error
        self._kb = kb
        self._writing = writing
        self._index = VectorIndex()
        self._searching = threading.Lock()

    def __len__(self) -> int:
        return len(self._index)

    @property
    def name(self) -> str:
        """Last part of the IRI of each stored vector: vectors of one network have the same."""
        return f"embedding-{self._embedder.digest[:12]}"

    def vector_of(self, seen: Observation) -> NDArray[np.float32] | None:
        """Return the vector of a look; None when the network gives none."""
        if seen.frame.rgb is None:
            return None
        try:
            return self._embedder.embed(seen.frame.rgb, seen.frame.object_mask())
        except ValueError as error:
            log.warning("no vector: %s", error)
            return None

    def state(self, triples: Triples, view: NamedNode, vector: NDArray[np.float32]) -> None:
        """State a view's vector as one more of its contents."""
        from features.embedding.embedder import vector_to_bytes

        data = vector_to_bytes(vector, self._embedder.digest)
        content = iri(f"{view.value}/{self.name}")
        triples.add(view, RT.viewContent, content)
        triples.node(
            content,
            [RT.DescriptorSet],
            {
                RT.hasBlob: triples.blob(self._kb.blobs.put(data, "application/x-npz")),
                RT.descriptorCount: 1,
                RT.descriptorLength: len(vector),
                RT.elementType: "float32",
            },
        )

    def learn(
        self, view: str, object_iri: str, class_iri: str, vector: NDArray[np.float32]
    ) -> None:
        """Search a view from now on."""
        with self._searching:
            self._index.add(view, object_iri, class_iri, vector)

    def sync(self) -> int:
        """Bring the vectors in step with the graph; return how many views have one.

        Views that were stored before the network came have none, and are not proposed.
        """
        from features.embedding.embedder import vector_from_bytes

        with self._writing:
            stored = {row.view: row for row in stored_views(self._kb)}
            blobs = self._stored()
            with self._searching:
                for view, (object_iri, kind) in self._index.views().items():
                    row = stored.get(view)
                    if row is None:
                        self._index.remove(view)
                    elif (object_iri, kind) != (row.object, row.class_iri):
                        self._index.relabel(view, row.object, row.class_iri)
                for view, row in stored.items():
                    if view in self._index or view not in blobs:
                        continue
                    try:
                        data = self._kb.blobs.read(blobs[view])
                        vector = vector_from_bytes(data, self._embedder.digest)
                        self._index.add(view, row.object, row.class_iri, vector)
                    except (MissingBlobError, ValueError) as error:
                        log.warning("view %s has no vector: %s", view, error)
                return len(self._index)

    def propose(
        self, recognition: Recognition, seen: Observation, most: int, confidence: float
    ) -> Recognition:
        """Return an answer with objects that look alike to the network, where print is missing.

        Parameters
        ----------
        most
            Length of the list.
        confidence
            The most that a proposal can have; below what is accepted.
        """
        from features.recognition.recogniser import Match

        if recognition.accepted or any(match.inliers >= _PRINT for match in recognition.matches):
            return recognition
        vector = self.vector_of(seen)
        if vector is None:
            return recognition
        with self._searching:
            near = self._index.nearest(vector, most)
        sure = {
            neighbour.object_iri: confidence * (neighbour.cosine - _MIN_COSINE) / (1 - _MIN_COSINE)
            for neighbour in near
            if neighbour.cosine > _MIN_COSINE
        }
        candidates = [
            replace(match, confidence=max(match.confidence, sure.pop(match.object_iri, 0.0)))
            for match in recognition.matches
        ]
        candidates += [
            Match(
                object_iri=neighbour.object_iri,
                class_iri=neighbour.class_iri,
                confidence=sure[neighbour.object_iri],
                inliers=0,
                views=(neighbour.view_iri,),
                appearance=neighbour.cosine,
                size_ok=None,
                query_from_view=None,
                view_iri=neighbour.view_iri,
            )
            for neighbour in near
            if neighbour.object_iri in sure
        ]
        candidates.sort(key=lambda match: -match.confidence)
        return replace(recognition, accepted=False, matches=tuple(candidates[:most]))

    def _stored(self) -> dict[str, str]:
        """Return the blob of each view's vector."""
        rows = self._kb.select(f"""{PREFIXES}
SELECT ?view ?blob WHERE {{ ?view rt:viewContent ?content . ?content rt:hasBlob ?blob
  FILTER(STRENDS(STR(?content), "/{self.name}")) }}""")
        return {str(row.value("view")): str(row.value("blob")) for row in rows}
