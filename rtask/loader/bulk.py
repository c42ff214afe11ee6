"""Documents larger than a commit, streamed into the store in one atomic step.

Derived statements follow in a separate commit; until then the closure is behind. The document is
not held in memory, apart from the buffers of the store's bulk loader.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pyoxigraph import Quad, RdfFormat

from rtask.errors import ParseError
from rtask.kb.commit.bulk import TripleText
from rtask.kb.commit.commit import Request
from rtask.kb.core import GraphCore
from rtask.loader.report import Counts
from rtask.rdf.bounds import MAX_IRI
from rtask.rdf.documents import Document
from rtask.rdf.formats import Format, explain
from rtask.rdf.terms import GraphName

__all__ = ["load_bulk", "load_text", "readable_by_the_store"]

TEXT_BYTES = 16 << 20
_CHUNK = 4 << 20
_MARKS = {
    RdfFormat.N_TRIPLES: (b"_:", b"<<", b"owl#Ontology>"),
    RdfFormat.TURTLE: (b"_:", b"<<", b"[", b"(", b"Ontology", b'"""', b"'''"),
}


def readable_by_the_store(document: Document, form: Format) -> bool:
    """Whether a document is large and contains only data without blank nodes and long terms.

    The store then parses it itself, which is faster. Text that merely looks like a blank node makes
    this ``False``, and the document is loaded the slower way. So does a line that is long enough
    for a literal or an IRI beyond its bound.
    """
    marks = _MARKS.get(form.rdf) if form.rdf is not None else None
    if marks is None or document.size < TEXT_BYTES:
        return False
    rest, line = b"", 0
    with document.open() as stream:
        while chunk := stream.read(_CHUNK):
            seen = rest + chunk
            if any(mark in seen for mark in marks):
                return False
            lengths = [len(part) for part in chunk.split(b"\n")]
            lengths[0] += line
            if max(lengths) > MAX_IRI:
                return False
            rest, line = chunk[-16:], lengths[-1]
    return True


def load_text(
    kb: GraphCore,
    document: Document,
    form: Format,
    graph: GraphName,
    request: Request,
    *,
    base: str | None,
    replace: bool,
) -> tuple[Counts, str | None]:
    """Let the store parse a document; the result is that of :func:`load_bulk`.

    Only statements that the graph did not already hold are counted as read.
    """
    assert form.rdf is not None
    removed = _clear(kb, graph, request) if replace else 0
    before = kb.catalogue.triple_count(graph)
    try:
        derived, remark = kb.bulk_add(TripleText(document.open, form.rdf, base), graph, request)
    except (SyntaxError, UnicodeDecodeError) as error:
        raise explain(error, document, form) from error
    except ValueError as error:
        raise ParseError(f"{document.name}: {error}") from error
    added = kb.catalogue.triple_count(graph) - before
    return Counts(added, added, removed, derived), remark


def load_bulk(
    kb: GraphCore, quads: Iterable[Quad], graph: GraphName, request: Request, *, replace: bool
) -> tuple[Counts, str | None]:
    """Load the statements of a large document; return the numbers, and a remark on identities.

    Parameters
    ----------
    quads
        Statements with their target graphs.
    graph
        Graph of the statements that named none.
    replace
        Whether to withdraw the previous content of the graph.
    """
    removed = _clear(kb, graph, request) if replace else 0
    counted = _Counted(quads)
    before = kb.catalogue.triple_count(graph)
    derived, remark = kb.bulk_add(counted, graph, request)
    after = kb.catalogue.triple_count(graph)
    return Counts(counted.count, after - before, removed, derived), remark


def _clear(kb: GraphCore, graph: GraphName, request: Request) -> int:
    with kb.commit_block(request) as tx:
        tx.clear(graph)
        return tx.counts()[1]


class _Counted:
    """Iterable that counts its items."""

    def __init__(self, quads: Iterable[Quad]) -> None:
        self._quads = quads
        self.count = 0

    def __iter__(self) -> Iterator[Quad]:
        for quad in self._quads:
            self.count += 1
            yield quad
