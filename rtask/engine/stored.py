"""Stored views and models of objects, read from their bytes and cached."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from math import isfinite
from typing import TYPE_CHECKING, Generic, TypeVar

from rtask.errors import MissingBlobError
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from features.modelling import ObjectModel
    from features.recognition.views.view import ViewFeatures
    from rtask.graph import Graph
    from rtask.kb.core import GraphCore

__all__ = [
    "Models",
    "Recent",
    "StoredModel",
    "StoredView",
    "stored_models",
    "stored_views",
    "view_features",
]

log = logging.getLogger(__name__)

T = TypeVar("T")


_VIEWS = f"""{PREFIXES}
SELECT DISTINCT ?view ?object ?blob ?class ?above WHERE {{
  ?object rt:hasView ?view . ?view rt:viewContent ?content .
  ?content a rt:SIFTFeatureSet ; rt:hasBlob ?blob
  OPTIONAL {{ ?object a ?class . ?class rdfs:subClassOf rt:ManipulableObject
    FILTER(?class != rt:ManipulableObject && isIRI(?class))
    OPTIONAL {{ ?class rdfs:subClassOf ?above . ?above rdfs:subClassOf rt:ManipulableObject
      FILTER(?above != ?class && isIRI(?above)) }} }}
}}"""


@dataclass(frozen=True)
class StoredView:
    """A view with stored descriptors."""

    view: str
    object: str
    class_iri: str
    blob: str

    def features(self, kb: GraphCore) -> ViewFeatures | None:
        """Return the features of the view; None if the bytes are missing or of another version."""
        from features.recognition.views.view import ViewFeatures

        try:
            features = ViewFeatures.from_bytes(kb.blobs.read(self.blob))
        except (MissingBlobError, ValueError) as error:
            log.warning("view %s cannot be indexed: %s", self.view, error)
            return None
        has_shape = features.shape is not None or features.is_cut or not isfinite(features.size_m)
        return features if features.picture and has_shape else _completed(kb, self.view, features)


def _completed(kb: GraphCore, view: str, features: ViewFeatures) -> ViewFeatures:
    """Take from its cloud what was not kept yet when a view was described: picture and shape."""
    import numpy as np

    from features.codec import decode
    from features.geometry import Frame
    from features.recognition.views.picture import take_picture
    from features.recognition.views.shape import shape_histogram

    rows = kb.select(f"""{PREFIXES}
SELECT ?blob WHERE {{ <{view}> rt:viewContent ?content .
  ?content a rt:CompressedPointCloud ; rt:hasBlob ?blob }} ORDER BY ?blob LIMIT 1""")
    for row in rows:
        try:
            frame = decode(kb.blobs.read(str(row.value("blob"))))
        except (MissingBlobError, ValueError):
            continue
        if not isinstance(frame, Frame):
            continue
        mask = frame.object_mask()
        if features.shape is None and isfinite(features.size_m) and not features.is_cut:
            features = replace(features, shape=shape_histogram(frame.points()[mask]))
        v, u = np.nonzero(mask)
        box = [u.min(), v.min(), np.ptp(u) + 1, np.ptp(v) + 1] if len(u) else []
        # A picture that came beside the cloud has pixels of its own.
        is_same_image = np.array_equal(box, features.mask_px)
        if frame.rgb is not None and is_same_image and not features.picture:
            features = replace(features, picture=take_picture(frame.rgb, mask))
    return features


def stored_views(kb: GraphCore) -> list[StoredView]:
    """Return every stored view, in the order of their IRIs, which is the order of creation."""
    class_counts: dict[tuple[str, str, str], dict[str, int]] = {}
    for row in kb.select(_VIEWS):
        key = (str(row.value("view")), str(row.value("object")), str(row.value("blob")))
        classes = class_counts.setdefault(key, {})
        if row["class"] is not None:
            name = str(row.value("class"))
            classes[name] = classes.get(name, 0) + (row["above"] is not None)
    views = []
    for (view, object_iri, blob), classes in sorted(class_counts.items()):
        lowest = min(classes, key=lambda c: (-classes[c], c), default=RT.ManipulableObject.value)
        views.append(StoredView(view, object_iri, lowest, blob))
    return views


def view_features(kb: GraphCore, view: NamedNode) -> ViewFeatures | None:
    """Return the features of one stored view, or None if they cannot be read."""
    rows = kb.select(f"""{PREFIXES}
SELECT ?blob WHERE {{ {view} rt:viewContent ?content .
  ?content a rt:SIFTFeatureSet ; rt:hasBlob ?blob }} ORDER BY ?blob LIMIT 1""")
    for row in rows:
        return StoredView(view.value, "", "", str(row.value("blob"))).features(kb)
    return None


@dataclass(frozen=True)
class StoredModel:
    """A stored model.

    Parameters
    ----------
    views
        IRIs of its views.
    """

    iri: NamedNode
    blob: str
    views: frozenset[str]


def stored_models(kb: GraphCore | Graph, object_iri: NamedNode) -> list[StoredModel]:
    """Return the models of an object, by decreasing number of views."""
    models = []
    for model in {quad.object for quad in kb.match(object_iri, RT.hasModel)}:
        if not isinstance(model, NamedNode):
            continue
        blobs = {quad.object for quad in kb.match(model, RT.hasBlob)}
        if len(blobs) != 1:
            continue
        (blob,) = blobs
        assert isinstance(blob, NamedNode)
        views = frozenset(
            quad.object.value
            for quad in kb.match(model, RT.builtFrom)
            if isinstance(quad.object, NamedNode)
        )
        models.append(StoredModel(model, blob.value, views))
    return sorted(models, key=lambda model: (-len(model.views), model.iri.value))


class Recent(Generic[T]):
    """Cache of the most recently used values by key, safe for use from several threads.

    Examples
    --------
    >>> kept = Recent[int](size=2)
    >>> for key in "aba", "c":
    ...     kept.put(key, len(key))
    >>> kept.put("d", 4)
    >>> kept.get("aba"), kept.get("c")
    (None, 1)
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._entries: OrderedDict[str, T] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: str | None) -> T | None:
        """Return a value, or None if it is not kept."""
        with self._lock:
            value = None if key is None else self._entries.get(key)
            if key is not None and value is not None:
                self._entries.move_to_end(key)
            return value

    def put(self, key: str, value: T) -> None:
        """Keep a value."""
        with self._lock:
            self._entries[key] = value
            self._entries.move_to_end(key)
            while len(self._entries) > self._size:
                self._entries.popitem(last=False)


class Models:
    """Cache of recently used decoded models by the IRI of their bytes."""

    def __init__(self, kb: GraphCore, size: int = 64) -> None:
        self.kb = kb
        self._decoded: Recent[ObjectModel] = Recent(size)

    def of(self, object_iri: NamedNode) -> tuple[StoredModel, ObjectModel] | None:
        """Return the model of an object, or None if there is none or its bytes are missing."""
        for stored in stored_models(self.kb, object_iri):
            model = self.read(stored.blob)
            if model is not None:
                return stored, model
        return None

    def read(self, blob: str) -> ObjectModel | None:
        """Return the model of some bytes, or None if they are missing or of another version."""
        from features.modelling import ObjectModel

        decoded = self._decoded.get(blob)
        if decoded is not None:
            return decoded
        try:
            model = ObjectModel.from_bytes(self.kb.blobs.read(blob))
        except (MissingBlobError, ValueError) as error:
            log.warning("cannot read the model %s: %s", blob, error)
            return None
        self.keep(blob, model)
        return model

    def keep(self, blob: str, model: ObjectModel) -> None:
        """Keep a model that was just stored."""
        self._decoded.put(blob, model)
