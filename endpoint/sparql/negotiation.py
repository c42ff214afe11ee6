"""Content negotiation by the Accept header (RFC 9110, 12.5.1)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from endpoint.http.messages import RefusedError

RESULTS_JSON = "application/sparql-results+json"
RESULTS_XML = "application/sparql-results+xml"
CSV, TSV = "text/csv", "text/tab-separated-values"
TURTLE, N_TRIPLES, RDF_XML = "text/turtle", "application/n-triples", "application/rdf+xml"
JSON_LD, TRIG, N_QUADS, N3 = (
    "application/ld+json",
    "application/trig",
    "application/n-quads",
    "text/n3",
)

# The first of each list is what `*/*` gets.
SOLUTION_TYPES = (RESULTS_JSON, RESULTS_XML, CSV, TSV)
GRAPH_TYPES = (TURTLE, N_TRIPLES, RDF_XML, JSON_LD, TRIG, N_QUADS, N3)
DATASET_TYPES = (N_QUADS, TRIG, JSON_LD)

# Other names under which clients ask for the same bytes.
ALIASES = {
    "application/json": (RESULTS_JSON, JSON_LD),
    "application/xml": (RESULTS_XML, RDF_XML),
    "text/xml": (RESULTS_XML, RDF_XML),
    "application/x-turtle": (TURTLE,),
}
_NAME = re.compile(r"[\w!#$&^.+*-]+/[\w!#$&^.+*-]+")
_MAX_ACCEPT = 8_000


@dataclass(frozen=True)
class MediaRange:
    """One element of an Accept header.

    Parameters
    ----------
    name
        ``type/subtype``, ``type/*`` or ``*/*`` in lower case.
    quality
        0 (never) to 1.
    """

    name: str
    quality: float

    @property
    def specificity(self) -> int:
        """2 for a full type, 1 for ``type/*``, 0 for ``*/*``."""
        if self.name == "*/*":
            return 0
        return 1 if self.name.endswith("/*") else 2

    def covers(self, media_type: str) -> bool:
        """Tell whether a media type falls in this range, aliases included."""
        if self.name == "*/*":
            return True
        if self.name.endswith("/*"):
            return media_type.startswith(self.name[:-1])
        return self.name == media_type or media_type in ALIASES.get(self.name, ())


@lru_cache(maxsize=256)
def parse_accept(text: str) -> tuple[MediaRange, ...]:
    """Parse an Accept header; a malformed or empty one means ``*/*``.

    Examples
    --------
    >>> [(r.name, r.quality) for r in parse_accept("text/csv;q=0.2, */*")]
    [('text/csv', 0.2), ('*/*', 1.0)]
    """
    ranges = []
    for element in text.split(","):
        name, *parameters = element.split(";")
        name = name.strip().lower()
        if not _NAME.fullmatch(name):
            continue
        quality = 1.0
        for parameter in parameters:
            key, _, value = parameter.partition("=")
            if key.strip().lower() == "q":
                try:
                    quality = min(1.0, max(0.0, float(value.strip())))
                except ValueError:
                    quality = 1.0
        ranges.append(MediaRange(name, quality))
    return tuple(ranges) or (MediaRange("*/*", 1.0),)


def _best_range(ranges: Sequence[MediaRange], media_type: str) -> MediaRange | None:
    """Return the range that applies to a type: the most specific one that covers it."""
    covering = [r for r in ranges if r.covers(media_type)]
    return max(covering, key=lambda r: r.specificity, default=None)


@lru_cache(maxsize=256)
def choose(accept: str, offers: tuple[str, ...]) -> str:
    """Choose the media type to answer in.

    The highest quality wins; among equals, the more specific range, then the server's order.

    Parameters
    ----------
    accept
        The Accept header as sent; empty accepts anything.
    offers
        Media types that the server can write, in order of preference.

    Raises
    ------
    RefusedError
        406 if none is acceptable; the message lists them.

    Examples
    --------
    >>> choose("text/csv;q=0.2,text/tab-separated-values", SOLUTION_TYPES)
    'text/tab-separated-values'
    >>> choose("", GRAPH_TYPES)
    'text/turtle'
    """
    if len(accept) > _MAX_ACCEPT:
        raise RefusedError(431, "usage", f"Accept header above {_MAX_ACCEPT} bytes")
    ranges = parse_accept(accept)
    ranked = []
    for order, offer in enumerate(offers):
        match = _best_range(ranges, offer)
        if match and match.quality > 0:
            ranked.append((-match.quality, -match.specificity, order, offer))
    if not ranked:
        raise RefusedError(
            406,
            "not-acceptable",
            f"nothing acceptable for Accept: {accept[:200]}; available: {', '.join(offers)}",
            available=list(offers),
        )
    return min(ranked)[3]


def prefers_html(accept: str) -> bool:
    """Tell whether a browser asks, one that gives ``text/html`` the highest quality.

    Examples
    --------
    >>> prefers_html("text/html,application/xml;q=0.9,*/*;q=0.8"), prefers_html("*/*")
    (True, False)
    """
    ranges = parse_accept(accept)
    best = max(r.quality for r in ranges)
    return any(r.name == "text/html" and r.quality == best > 0 for r in ranges)


def content_type(media_type: str) -> str:
    """Return the Content-Type of an answer; text types name UTF-8 as charset."""
    if media_type == CSV:
        return f"{CSV}; charset=utf-8; header=present"
    return f"{media_type}; charset=utf-8" if media_type.startswith("text/") else media_type
