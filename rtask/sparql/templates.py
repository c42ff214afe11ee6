"""Quad templates of updates: parsed by the store's TriG parser, instantiated by solutions.

Each variable is replaced by the IRI ``urn:rtask-var:NAME`` for the parser; lists, ``[ ]`` and
annotations are expanded to quads (SPARQL 1.1 Update, 3.1.3).
"""

from __future__ import annotations

import itertools
import secrets
from collections.abc import Iterable, Iterator, Mapping, Sequence

from pyoxigraph import BlankNode, DefaultGraph, NamedNode, Quad, RdfFormat, Triple, parse

from rtask.errors import QuerySyntaxError
from rtask.rdf.terms import GraphName, Term
from rtask.sparql.tokens import Token
from rtask.sparql.update_outline import Block, Update

__all__ = ["fill", "read_template", "resolve", "variables"]

_VARIABLE = "urn:rtask-var:"
_PROBE = "<urn:x>"


def read_template(
    update: Update, block: Block, prologue: str, base: str | None = None
) -> list[Quad]:
    """Return the quads of a template or DATA block, with marker IRIs for variables."""
    text = prologue + "\n".join(_as_trig(update, block))
    try:
        return list(parse(text, format=RdfFormat.TRIG, base_iri=base))
    except (SyntaxError, ValueError) as error:
        raise QuerySyntaxError(f"in a template: {error}") from error


def _as_trig(update: Update, block: Block) -> Iterator[str]:
    """Wrap triples outside GRAPH in braces, since TriG requires a dot where SPARQL does not."""
    tokens, at, end = update.tokens, block.start + 1, block.end - 1
    loose: list[Token] = []
    while at < end:
        token = tokens[at]
        if not token.is_word("GRAPH"):
            loose.append(token)
            at += 1
            continue
        if loose:
            yield f"{{ {_text(loose)} }}"
            loose = []
        close = next(i for i in range(at, end) if tokens[i].is_mark("}"))
        name = tokens[at + 1]
        yield f"GRAPH {_text([name])} {{ {_text(tokens[at + 3 : close])} }}"
        at = close + 1
        if at < end and tokens[at].is_mark("."):
            at += 1
    if loose:
        yield f"{{ {_text(loose)} }}"


def _text(tokens: Sequence[Token]) -> str:
    """Join tokens with the spaces between them, since ``- 1`` is not a number."""
    pieces: list[str] = []
    for before, token in itertools.pairwise([None, *tokens]):
        assert token is not None
        if before is not None and before.end != token.start:
            pieces.append(" ")
        pieces.append(_token_text(token.kind, token.text))
    return "".join(pieces)


def _token_text(kind: str, text: str) -> str:
    if kind == "variable":
        return f"<{_VARIABLE}{text[1:]}>"
    if kind == "word" and text.lower() in ("true", "false"):
        return text.lower()
    return text


def resolve(name: str, prologue: str, base: str | None = None) -> NamedNode:
    """Return the IRI of a token under a prologue.

    >>> resolve("x:cup", "PREFIX x: <urn:>")
    <NamedNode value=urn:cup>
    """
    try:
        quad = next(
            parse(f"{prologue}\n{name} {_PROBE} {_PROBE} .", format=RdfFormat.TURTLE, base_iri=base)
        )
    except (SyntaxError, ValueError) as error:
        raise QuerySyntaxError(f"{name} is not an IRI: {error}") from error
    assert isinstance(quad.subject, NamedNode)
    return quad.subject


def _variable(term: object) -> str | None:
    if isinstance(term, NamedNode) and term.value.startswith(_VARIABLE):
        return term.value[len(_VARIABLE) :]
    return None


def variables(template: Iterable[Quad]) -> list[str]:
    """Return the names of all variables of a template, sorted."""
    names: set[str] = set()

    def visit(term: object) -> None:
        if isinstance(term, Triple):
            for part in (term.subject, term.predicate, term.object):
                visit(part)
        elif (name := _variable(term)) is not None:
            names.add(name)

    for quad in template:
        for term in (quad.subject, quad.predicate, quad.object, quad.graph_name):
            visit(term)
    return sorted(names)


def constant_graphs(template: Iterable[Quad], home: GraphName) -> set[GraphName]:
    """Return the graphs that a template names without a variable."""
    return {
        home if isinstance(quad.graph_name, DefaultGraph) else quad.graph_name
        for quad in template
        if _variable(quad.graph_name) is None
    }


def _new_blank() -> BlankNode:
    """Return a new blank node; pyoxigraph's labels would repeat in processes forked from one."""
    return BlankNode(secrets.token_hex(16))


def fill(
    template: Iterable[Quad], solution: Mapping[str, Term], home: GraphName, fresh: bool
) -> Iterator[Quad]:
    """Yield the template's quads for one solution, leaving out illegal ones.

    Parameters
    ----------
    home
        Graph of the triples outside ``GRAPH``.
    fresh
        Whether to replace blank nodes by new ones, one set for each solution.
    """
    blanks: dict[str, BlankNode] = {}

    def term_of(term: object) -> object:
        if isinstance(term, Triple):
            return Triple(*(term_of(t) for t in (term.subject, term.predicate, term.object)))  # type: ignore[arg-type]
        if isinstance(term, BlankNode) and fresh:
            return blanks.setdefault(term.value, _new_blank())
        name = _variable(term)
        return term if name is None else solution[name]

    for quad in template:
        try:
            graph = quad.graph_name
            yield Quad(
                term_of(quad.subject),  # type: ignore[arg-type]
                term_of(quad.predicate),  # type: ignore[arg-type]
                term_of(quad.object),  # type: ignore[arg-type]
                home if isinstance(graph, DefaultGraph) else term_of(graph),  # type: ignore[arg-type]
            )
        except (KeyError, TypeError, ValueError):
            continue
