"""SERVICE and LOAD, carried out before the store sees the text.

The store's own HTTP client has no time limit and would call any address. So each SERVICE is queried
here and replaced by its solutions as VALUES, which is what evaluating it separately and joining
means (SPARQL 1.1 Federated Query, 2.2). Blank nodes of another server become IRIs: like them, they
name the same thing within one answer only.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from typing import Any

import pyoxigraph as ox

from endpoint.access.auth import Caller
from endpoint.http.messages import RefusedError
from endpoint.http.outbound_http import Outgoing
from endpoint.sparql.negotiation import RESULTS_JSON
from endpoint.sparql.request import UpdateRequest
from rtask.errors import ForbiddenError, RemoteUnavailableError, RtaskError, TooLargeError
from rtask.kb.commit.commit import Commit
from rtask.kb.commit.transaction import Transaction
from rtask.kb.readers.updating import needs_reader
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.formats import read_document
from rtask.sparql.lexer import body_start, find_block_end, tokenise
from rtask.sparql.templates import resolve
from rtask.sparql.tokens import Token
from rtask.sparql.update_outline import Operation, read_update

MAX_ROWS = 10_000
_RDF = "text/turtle, application/n-triples, application/rdf+xml;q=0.9, application/ld+json;q=0.8"
_SUFFIXES = {".ttl": "turtle", ".nt": "nt", ".rdf": "rdfxml", ".owl": "rdfxml", ".jsonld": "jsonld"}


def mentions(text: str, word: str) -> bool:
    """Tell whether a text may contain a keyword; cheap, errs only by saying yes."""
    return word in text.upper()


def answer_services(text: str, outgoing: Outgoing, deadline: float, base: str) -> str:
    """Return a query or update in which each SERVICE is replaced by its solutions.

    Parameters
    ----------
    text
        SPARQL.
    outgoing
        The addresses that SERVICE may call.
    deadline
        Time on the monotonic clock.
    base
        Base of relative IRIs.

    Raises
    ------
    ForbiddenError
        The address is not allowed, or a variable.
    RefusedError
        502 if the call failed and was not SILENT.
    """
    tokens = tokenise(text)
    prologue = text[: tokens[body_start(tokens)].start]
    pieces, done, at = [], 0, 0
    while tokens[at].kind != "end":
        if not tokens[at].is_word("SERVICE"):
            at += 1
            continue
        silent = tokens[at + 1].is_word("SILENT")
        where = tokens[at + 1 + silent]
        end = find_block_end(tokens, at + 2 + silent)
        block = tokens[at + 2 + silent : end]
        url = _address(where, block, prologue, base)
        pattern = text[block[0].start : block[-1].end]
        solutions = _solve(url, prologue, pattern, outgoing, deadline, silent)
        pieces += [text[done : tokens[at].start], solutions]
        done, at = tokens[end - 1].end, end
    return "".join([*pieces, text[done:]])


def _address(where: Token, block: list[Token], prologue: str, base: str) -> str:
    # It would be carried out by the other server, with its rights and not under our rules.
    if any(token.is_word("SERVICE") for token in block):
        raise ForbiddenError("a SERVICE within a SERVICE is not carried out", operation="SERVICE")
    if where.kind not in ("iri", "name"):
        raise ForbiddenError("SERVICE needs a constant address here", operation="SERVICE")
    return resolve(where.text, prologue, base or None).value


def _solve(
    url: str, prologue: str, pattern: str, outgoing: Outgoing, deadline: float, silent: bool
) -> str:
    outgoing.check(url)  # what is not allowed is refused even where failures are silent
    query = f"{prologue} SELECT * WHERE {pattern}".encode()
    try:
        response = outgoing.fetch(
            url,
            deadline,
            accept=RESULTS_JSON,
            body=query,
            content_type="application/sparql-query",
        )
        rows: Any = ox.parse_query_results(response.body, format=ox.QueryResultsFormat.JSON)
        return values([v.value for v in rows.variables], rows, url)
    except ForbiddenError:
        raise
    except (RtaskError, SyntaxError, ValueError, AttributeError) as error:
        if silent:
            return "{}"
        reason = error if isinstance(error, RtaskError) else "its answer is not SPARQL results"
        raise RefusedError(502, "service-failed", f"SERVICE {url}: {reason}") from None


def values(names: list[str], rows: Iterable[Any], url: str) -> str:
    """Write solutions as a VALUES block.

    Raises
    ------
    TooLargeError
        There are more than 10,000 solutions.
    """
    lines = []
    for number, row in enumerate(rows):
        if number >= MAX_ROWS:
            raise TooLargeError(f"more than {MAX_ROWS} solutions; add a LIMIT in a sub-select")
        lines.append("(" + " ".join(_term(row[name], url) for name in names) + ")")
    heads = " ".join(f"?{name}" for name in names)
    return f"{{ VALUES ({heads}) {{ {' '.join(lines)} }} }}"


def _term(term: Any, url: str) -> str:
    if term is None:
        return "UNDEF"
    # Its label means something to the other server alone; VALUES takes none (SPARQL 1.1 Query,
    # 10.2).
    if isinstance(term, ox.BlankNode):
        node = hashlib.sha256(f"{url} {term.value}".encode()).hexdigest()[:24]
        return f"<urn:rtask:elsewhere:{node}>"
    if isinstance(term, ox.Triple):
        raise TooLargeError("a triple as a term cannot be taken over from another server")
    return str(term)


def update_with_loads(
    kb: KnowledgeBase,
    update: UpdateRequest,
    text: str,
    caller: Caller,
    note: str,
    outgoing: Outgoing,
    deadline: float,
    run_bounded: Callable[[str], Commit | None],
) -> Commit | None:
    """Run an update with permitted LOADs, as one commit.

    Where other operations read the store, the documents become INSERT DATA of the same request, so
    that a reader can evaluate the whole of it within the limits.

    The documents are fetched before anything is changed, so that no lock is held meanwhile.

    Parameters
    ----------
    run_bounded
        Carries out an update without LOAD, within the limits of updates.

    Raises
    ------
    ForbiddenError
        The address is not allowed, or the graph is not the caller's.
    RefusedError
        502 if a document could not be fetched and the LOAD was not SILENT.
    """
    steps = _steps(text)
    # All are fetched before the writer's lock is taken: another server may answer slowly.
    documents = {
        number: _document(operation, outgoing, deadline, update.base)
        for number, (operation, _) in enumerate(steps)
        if operation.kind == "LOAD"
    }
    # What reads runs bounded, in a reader process: documents go along as data.
    if any(operation.kind != "LOAD" and needs_reader(source) for operation, source in steps):
        whole = " ;\n".join(
            _as_data(operation, documents[number], update.base)
            if operation.kind == "LOAD"
            else source
            for number, (operation, source) in enumerate(steps)
        )
        return run_bounded(whole)

    def run(tx: Transaction) -> None:
        for number, (operation, source) in enumerate(steps):
            if operation.kind == "LOAD":
                _store(tx, operation, documents[number], update.base)
            else:
                tx.update(source, update.using, update.using_named, update.base or None)

    return kb.commit_work(run, note, access=caller.access)


def _steps(text: str) -> list[tuple[Operation, str]]:
    """Return the operations of an update, each as a text of its own."""
    outline = read_update(text)
    sources, depth, start = [], 0, 0
    for token in outline.tokens:
        depth += token.is_mark("{") - token.is_mark("}")
        if token.kind == "end" or (depth == 0 and token.is_mark(";")):
            piece = outline.body[start : token.start]
            if piece.strip():
                sources.append(piece)
            start = token.end
    return [
        (operation, f"{operation.prologue}{source}")
        for operation, source in zip(outline.operations, sources, strict=True)
    ]


Document = list[ox.Quad] | None


def _document(operation: Operation, outgoing: Outgoing, deadline: float, base: str) -> Document:
    assert operation.source is not None
    url = resolve(operation.source.name, operation.prologue, base or None).value
    outgoing.check(url)
    try:
        response = outgoing.fetch(url, deadline, accept=_RDF)
        format_ = ox.RdfFormat.from_media_type(response.media_type)
        name = format_.file_extension if format_ else _by_suffix(url)
        if not name:
            raise RemoteUnavailableError(f"{url} is not RDF: {response.media_type or 'no type'}")
        return read_document(response.body, name, url)
    except ForbiddenError:
        raise
    except RtaskError as error:
        if operation.silent:
            return None
        raise RefusedError(502, "load-failed", f"LOAD {url}: {error}") from None


def _by_suffix(url: str) -> str:
    return next((name for end, name in _SUFFIXES.items() if url.endswith(end)), "")


def _as_data(operation: Operation, document: Document, base: str) -> str:
    """Return an INSERT DATA equivalent to a LOAD."""
    if document is None:
        return "INSERT DATA {}"
    into = ""
    target = operation.target
    if target is not None and target.scope == "GRAPH":
        into = str(resolve(target.name, operation.prologue, base or None))
    blocks: dict[str, list[ox.Triple]] = {}
    for quad in document:
        named = isinstance(quad.graph_name, ox.NamedNode)
        graph = str(quad.graph_name) if named else into
        blocks.setdefault(graph, []).append(quad.triple)
    texts = []
    for graph, triples in blocks.items():
        data = (ox.serialize(triples, format=ox.RdfFormat.N_TRIPLES) or b"").decode()
        texts.append(f"GRAPH {graph} {{ {data} }}" if graph else data)
    return f"INSERT DATA {{ {' '.join(texts)} }}"


def _store(tx: Transaction, operation: Operation, document: Document, base: str) -> None:
    if document is None:
        return
    target = operation.target
    graph = None
    if target is not None and target.scope == "GRAPH":
        graph = resolve(target.name, operation.prologue, base or None)
    tx.add_quads(document, graph)
