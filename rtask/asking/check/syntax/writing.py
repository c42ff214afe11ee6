"""Terms as a query writes them, with the prefixes that it declares."""

from __future__ import annotations

import re
from collections.abc import Mapping

import ontology

__all__ = ["written"]

_LOCAL = re.compile(r"\w(?:[\w\-]*\w)?")


def written(iri: str, prefixes: Mapping[str, str], base: str = "") -> str:
    """Return an IRI with a declared prefix, or in brackets.

    >>> written("urn:x#mug", {"x": "urn:x#"}), written("urn:x#mug", {})
    ('x:mug', '<urn:x#mug>')
    """
    known = prefixes or {**ontology.PREFIXES, **({"kb": base} if base else {})}
    for prefix, start in known.items():
        if start and iri.startswith(start) and _LOCAL.fullmatch(iri[len(start) :]):
            return f"{prefix}:{iri[len(start) :]}"
    return f"<{iri}>"
