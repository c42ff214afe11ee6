"""SPARQL 1.1 Graph Store HTTP Protocol: read and write whole graphs.

`?default` is the graph that receives statements without a graph: the default graph of a plain
store, otherwise the caller's own graph or the shared one. What is put there is what is read back.
"""

from __future__ import annotations

import tempfile
import uuid
from dataclasses import dataclass
from pathlib import PurePosixPath

from pyoxigraph import DefaultGraph, NamedNode, Quad, RdfFormat

from endpoint.access.auth import Caller
from endpoint.http.compression import wants_gzip
from endpoint.http.conditional import Versions, is_current, names
from endpoint.http.form_data import FORM_DATA_TYPE, form_parts
from endpoint.http.messages import (
    RefusedError,
    Request,
    Response,
    refuse_unknown,
    remark_header,
    split_media_type,
)
from endpoint.http.plan import Plan, RunningQuery
from endpoint.routes.addresses import STORE
from endpoint.served import ServedGraph, embedded
from endpoint.settings import Config
from endpoint.sparql import negotiation
from endpoint.sparql.answers import GRACE_S, Answers, FilePieces, Question
from endpoint.sparql.readable import require_read
from endpoint.sparql.request import QueryRequest, absolute_iri
from rtask.errors import VersionConflictError
from rtask.kb.commit.transaction import Transaction
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.formats import read_document
from rtask.rdf.terms import GraphName

FORMATS = {
    "text/turtle": "turtle",
    "application/x-turtle": "turtle",
    "application/n-triples": "nt",
    "application/rdf+xml": "rdfxml",
    "application/ld+json": "jsonld",
    "text/n3": "n3",
    "application/n-quads": "nquads",
    "application/trig": "trig",
}
_SUFFIXES = {
    ".ttl": "turtle",
    ".nt": "nt",
    ".rdf": "rdfxml",
    ".jsonld": "jsonld",
    ".n3": "n3",
    ".nq": "nquads",
    ".trig": "trig",
}
_QUADS = ("nquads", "trig")


@dataclass(frozen=True)
class Part:
    """One document of a request body; `format` as the loader names it."""

    data: bytes
    format: str


class GraphStore:
    """The addresses below ``/store``.

    Parameters
    ----------
    kb
        The knowledge base that holds the graphs.
    config
        Settings: public address and profile.
    versions
        Entity tags of graphs.
    answers
        Reads whole graphs.
    """

    def __init__(
        self,
        kb: ServedGraph,
        config: Config,
        versions: Versions,
        answers: Answers,
    ) -> None:
        self._served = kb
        self._config = config
        self._versions = versions
        self._answers = answers

    @property
    def _kb(self) -> KnowledgeBase:
        return embedded(self._served, "the graph store")

    def plan(self, request: Request, caller: Caller) -> Plan:
        """Plan the answer to a request; its caller may read or write in general.

        Raises
        ------
        RefusedError
            400, 405, 406 or 415; the message says what to do instead.
        """
        graph = self._target(request, caller)
        require_read(caller.access, graph, self._served)
        if request.method in ("GET", "HEAD"):
            return self._plan_read(request, caller, graph)
        if request.method == "DELETE":
            return Plan(lambda: self._delete(request, caller, graph))
        write = self._put if request.method == "PUT" else self._post
        parts = _parts(request)
        return Plan(lambda: write(request, caller, graph, parts))

    def _target(self, request: Request, caller: Caller) -> GraphName | None:
        """Return the graph that a request names; none for the whole dataset (GSP, 4.1 and 4.2)."""
        refuse_unknown((name for name, _ in request.parameters), ("graph", "default"))
        names = request.values("graph")
        default = any(name == "default" for name, _ in request.parameters)
        if len(names) > 1 or (names and default):
            raise RefusedError(400, "usage", "name one graph: `graph=<iri>` or `default`")
        if names:
            return absolute_iri(names[0], "graph")
        if default:
            return self._kb.access(access=caller.access).home()
        if request.raw_path.rstrip("/") == STORE:
            return None
        return absolute_iri(request.url, "graph")

    # Reading

    def _plan_read(self, request: Request, caller: Caller, graph: GraphName | None) -> Plan:
        offers = negotiation.DATASET_TYPES if graph is None else negotiation.GRAPH_TYPES
        media_type = negotiation.choose(request.header("accept"), offers)
        timeout_s = self._config.effective_timeout(None, caller.access.role)
        text = f"CONSTRUCT {{ ?s ?p ?o }} WHERE {_pattern(graph)}"
        running = RunningQuery(request.id, caller.key, caller.name, text, timeout_s)

        def run() -> Response:
            if graph is not None and not self._exists(graph):
                raise _missing(graph)
            etag = self._versions.of_graph(graph, media_type)
            headers = (("ETag", etag),)
            if is_current(request, etag):
                return Response(304, headers=headers)
            content_type = negotiation.content_type(media_type)
            if request.method == "HEAD":
                return Response(200, b"", content_type, headers)
            if graph is None:
                return Response(200, b"", content_type, headers, self._dump(media_type))
            question = Question(
                QueryRequest(text),
                media_type,
                wants_gzip(request),
                headers,
                running,
                running.started + timeout_s,
            )
            return self._answers.open(question, point=False)

        return Plan(run, timeout_s + GRACE_S, "query", "GRAPH", text, running)

    def _dump(self, media_type: str) -> FilePieces:
        """Write all graphs to a temporary file, deleted once it has been sent."""
        file = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the pieces
        try:
            self._kb.dump(file, RdfFormat.from_media_type(media_type))
        except BaseException:
            file.close()
            raise
        file.seek(0)
        return FilePieces(file)

    def _exists(self, graph: GraphName) -> bool:
        """Tell whether a graph exists, even empty; the default graph always does."""
        if isinstance(graph, DefaultGraph) or graph == self._kb.graphs.shared:
            return True
        return bool(self._kb.query(f"ASK {{ GRAPH <{graph.value}> {{}} }}"))

    # Writing

    def _put(
        self, request: Request, caller: Caller, graph: GraphName | None, parts: list[Part]
    ) -> Response:
        """Replace a graph, or every graph the caller may write (GSP, 5.3)."""
        existed = graph is None or self._exists(graph)
        version = self._check_preconditions(request, graph, existed)
        quads = self._read(request, graph, parts)
        own = self._kb.access(access=caller.access)
        self._kb.check_change(len(quads), access=own, empties=existed)
        note = f"graph store PUT, {caller.note(request)}"

        def replace_contents(tx: Transaction) -> None:
            if graph is None:
                tx.update("DROP ALL")
            else:
                tx.update(f"CLEAR SILENT {_reference(graph)}")
            if isinstance(graph, NamedNode):
                tx.update(f"CREATE SILENT GRAPH <{graph.value}>")
            tx.add_quads(quads, graph if isinstance(graph, NamedNode) else None)

        done = self._kb.commit_work(
            replace_contents, note, access=caller.access, if_version=version, size=len(quads)
        )
        return Response(204 if existed else 201, headers=remark_header(done.remark))

    def _post(
        self, request: Request, caller: Caller, graph: GraphName | None, parts: list[Part]
    ) -> Response:
        """Merge into a graph, or create one (GSP, 5.5)."""
        headers: tuple[tuple[str, str], ...] = ()
        if graph is None and not all(part.format in _QUADS for part in parts):
            graph = NamedNode(f"{request.site}{STORE}/{uuid.uuid4()}")
            headers = (("Location", graph.value),)
        existed = graph is None or self._exists(graph)
        version = self._check_preconditions(request, graph, existed)
        quads = self._read(request, graph, parts)
        self._kb.check_change(len(quads), access=self._kb.access(access=caller.access))
        note = f"graph store POST, {caller.note(request)}"

        def merge(tx: Transaction) -> None:
            if isinstance(graph, NamedNode) and not existed:
                tx.update(f"CREATE SILENT GRAPH <{graph.value}>")
            tx.add_quads(quads, graph if isinstance(graph, NamedNode) else None)

        done = self._kb.commit_work(
            merge, note, access=caller.access, if_version=version, size=len(quads)
        )
        return Response(204 if existed else 201, headers=(*headers, *remark_header(done.remark)))

    @staticmethod
    def _read(request: Request, graph: GraphName | None, parts: list[Part]) -> list[Quad]:
        """Parse the documents, which may take long, before the writers' lock is taken."""
        base = graph.value if isinstance(graph, NamedNode) else request.url
        quads: list[Quad] = []
        for part in parts:
            if graph is not None and part.format in _QUADS:
                raise RefusedError(
                    400, "usage", "a document with graphs of its own; send it to /store itself"
                )
            quads += read_document(part.data, part.format, base)
        return quads

    def _delete(self, request: Request, caller: Caller, graph: GraphName | None) -> Response:
        """Delete a graph (GSP, 5.4); the default graph is emptied instead."""
        existed = graph is None or self._exists(graph)
        if graph is not None and not existed:
            raise _missing(graph)
        version = self._check_preconditions(request, graph, existed)
        if graph is None:
            text = "DROP ALL"
        elif isinstance(graph, DefaultGraph) or graph == self._kb.graphs.shared:
            text = f"CLEAR SILENT {_reference(graph)}"
        else:
            text = f"DROP {_reference(graph)}"
        note = f"graph store DELETE, {caller.note(request)}"
        self._kb.update(text, access=caller.access, note=note, if_version=version)
        return Response(204)

    def _check_preconditions(
        self, request: Request, graph: GraphName | None, existed: bool
    ) -> int | None:
        """Compare If-Match and If-None-Match (RFC 9110, 13.1).

        Returns
        -------
        version
            Number of the commit that was compared, if the change depends on it: a commit in between
            makes the change fail.
        """
        version = self._kb.seq
        if request.header("if-none-match") == "*" and existed:
            raise VersionConflictError("the graph exists already")
        tags = request.header("if-match")
        if not tags:
            return None
        if not existed or (tags != "*" and not names(tags, self._etag(graph))):
            raise VersionConflictError("the graph is no longer the one that If-Match names")
        return version

    def _etag(self, graph: GraphName | None) -> str:
        return self._versions.of_graph(graph, "any")


def _parts(request: Request) -> list[Part]:
    """Read the documents in a body, each by its own Content-Type."""
    media_type, _ = request.content_type
    if media_type == FORM_DATA_TYPE:
        return _multipart(request)
    if not request.body.strip():
        return []
    return [Part(request.body, _format(media_type))]


def _multipart(request: Request) -> list[Part]:
    parts = []
    for piece in form_parts(request):
        if piece.media_type:
            format_ = _format(piece.media_type)
        else:
            format_ = _SUFFIXES.get(PurePosixPath(piece.filename).suffix.lower(), "")
        if not format_:
            raise RefusedError(415, "unsupported-media-type", "a part without a Content-Type")
        parts.append(Part(piece.data, format_))
    return parts


def _format(media_type: str) -> str:
    format_ = FORMATS.get(split_media_type(media_type)[0])
    if not format_:
        raise RefusedError(
            415,
            "unsupported-media-type",
            f"Content-Type {media_type or '(none)'} is not RDF; use {', '.join(FORMATS)}",
            headers=(("Accept", ", ".join(FORMATS)),),
        )
    return format_


def _pattern(graph: GraphName | None) -> str:
    if graph is None:
        return "{ GRAPH ?g { ?s ?p ?o } }"
    if isinstance(graph, DefaultGraph):
        return "{ ?s ?p ?o }"
    return f"{{ GRAPH <{graph.value}> {{ ?s ?p ?o }} }}"


def _reference(graph: GraphName) -> str:
    return "DEFAULT" if isinstance(graph, DefaultGraph) else f"GRAPH <{graph.value}>"


def _missing(graph: GraphName) -> RefusedError:
    name = graph.value if isinstance(graph, NamedNode) else "the default graph"
    return RefusedError(404, "not-found", f"no graph {name}", graph=name)
