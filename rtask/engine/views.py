"""Stored views, as the index of recognition is made again from them."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rtask.engine.vocabulary import PREFIXES, RT
from rtask.errors import MissingBlobError

if TYPE_CHECKING:
    from features.recognition.view import ViewFeatures
    from rtask.kb.knowledge_base import KnowledgeBase

__all__ = ["StoredView", "stored_views"]

log = logging.getLogger(__name__)

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
    """A view whose descriptors the graph keeps."""

    view: str
    object: str
    class_iri: str
    blob: str

    def features(self, kb: KnowledgeBase) -> ViewFeatures | None:
        """Return what the view shows, or None when the bytes are gone or of another version."""
        from features.recognition.view import ViewFeatures

        try:
            return ViewFeatures.from_bytes(kb.blobs.read(self.blob))
        except (MissingBlobError, ValueError) as error:
            log.warning("view %s cannot be indexed: %s", self.view, error)
            return None


def stored_views(kb: KnowledgeBase) -> list[StoredView]:
    """Return every stored view, in the order of their IRIs, which is that of their making."""
    found: dict[tuple[str, str, str], dict[str, int]] = {}
    for row in kb.select(_VIEWS):
        key = (str(row.value("view")), str(row.value("object")), str(row.value("blob")))
        classes = found.setdefault(key, {})
        if row["class"] is not None:
            name = str(row.value("class"))
            classes[name] = classes.get(name, 0) + (row["above"] is not None)
    views = []
    for (view, thing, blob), classes in sorted(found.items()):
        lowest = min(classes, key=lambda c: (-classes[c], c), default=RT.ManipulableObject.value)
        views.append(StoredView(view, thing, lowest, blob))
    return views
