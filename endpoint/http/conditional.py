"""Entity tags for conditional requests (RFC 9110, 8.8 and 13)."""

from __future__ import annotations

import hashlib
import re
import threading
from functools import lru_cache

from endpoint.http.messages import Request
from endpoint.served import ServedGraph
from rtask.kb.commit.commit import Change
from rtask.rdf.terms import GraphName
from rtask.sparql.tokens import shape

_UNSTEADY = re.compile(r"\b(?:NOW|RAND|UUID|STRUUID|BNODE|SERVICE)\b", re.I)


class Versions:
    """Entity tags of answers, derived from commit numbers.

    A graph's number is that of the last commit that changed it since this server started, otherwise
    that of the last commit before the start. At worst it is too new, and a client reads once more
    than necessary.

    Parameters
    ----------
    kb
        The knowledge base.
    """

    def __init__(self, kb: ServedGraph) -> None:
        self._kb = kb
        self._epoch = kb.epoch
        self._started_at = kb.seq
        self._graphs: dict[GraphName, int] = {}
        self._lock = threading.Lock()
        self._stop = kb.on_commit(self._note)

    def _note(self, change: Change) -> None:
        with self._lock:
            for graph in change.graphs:
                self._graphs[graph] = change.commit.seq

    def current(self) -> str:
        """Return the epoch and number of the last commit."""
        return f"{self._epoch}:{self._kb.seq}"

    def of_query(self, text: str, *parts: object) -> str:
        """Return the weak entity tag of the answer to a query; empty if it has none.

        Parameters
        ----------
        text
            The query.
        *parts
            Everything else on which the answer depends: dataset, media type, rights.
        """
        if is_unsteady(text):
            return ""
        asked = text.encode("utf-8", "replace") + _described(parts)
        digest = hashlib.blake2b(asked, digest_size=8).hexdigest()
        return f'W/"{self._epoch}-{self._kb.seq}-{digest}"'

    def of_graph(self, graph: GraphName | None, media_type: str) -> str:
        """Return the strong entity tag of a graph, or of the whole dataset, in a media type.

        Call it before reading the graph: a commit in between then makes the tag too old, never too
        new.
        """
        if graph is None:
            number = self._kb.seq
        else:
            with self._lock:
                number = self._graphs.get(graph, self._started_at)
        return f'"{self._epoch}-{number}-{media_type.replace("/", "-").replace("+", "-")}"'

    def close(self) -> None:
        """Stop listening to commits."""
        self._stop()


@lru_cache(maxsize=1_024)
def _described(parts: tuple[object, ...]) -> bytes:
    return repr(parts).encode("utf-8", "replace")


def is_unsteady(text: str) -> bool:
    """Tell whether a query may have another answer each time, though nothing was written."""
    return _is_unsteady(shape(text))


@lru_cache(maxsize=2_048)
def _is_unsteady(masked: str) -> bool:
    return _UNSTEADY.search(masked) is not None


def is_current(request: Request, etag: str) -> bool:
    """Tell whether a client has this answer already (RFC 9110, 13.1.2: weak comparison)."""
    sent = request.headers.get("if-none-match")
    if not sent or not etag:
        return False
    tags = [tag.strip().removeprefix("W/") for tag in sent.split(",")]
    return sent.strip() == "*" or _opaque(etag) in {_opaque(tag) for tag in tags}


def names(header: str, etag: str) -> bool:
    """Tell whether If-Match names the state of the graph in `etag`, in any media type."""
    version = _opaque(etag).rpartition("-")[0]
    stem = "-".join(_opaque(etag).split("-")[:2])
    tags = [tag.strip() for tag in header.split(",") if not tag.strip().startswith("W/")]
    return bool(version) and any("-".join(_opaque(tag).split("-")[:2]) == stem for tag in tags)


def _opaque(etag: str) -> str:
    """Return the text between the quotes, without the suffix of compressed answers."""
    return etag.removeprefix("W/").strip('"').removesuffix("-gzip")
