"""``SERVICE`` in queries: text search in this store; calls to other servers are refused.

``SERVICE <urn:rtask:text>`` is replaced by a ``VALUES`` clause with the hits of the text search::

    SERVICE <urn:rtask:text> { ?s rt:matches "red cup" ; rt:score ?score ; rt:limit 10 }

Without ``rt:limit`` the clause has all hits, so that counts and joins over it are right; words with
too many hits for that are refused.

Other services are switched off, because the store would call them without a time limit:
``SERVICE SILENT`` becomes one empty solution, as the standard requires for a failed call
(SPARQL 1.1 Federated Query, 2.4), and ``SERVICE`` without ``SILENT`` is refused before evaluation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from pyoxigraph import Literal, NamedNode

import ontology
from rtask.errors import ForbiddenError, QuerySyntaxError, TooLargeError
from rtask.rdf.terms import Term, written
from rtask.sparql.lexer import find_block_end, tokenise
from rtask.sparql.service_blocks import block_refusal, replace_blocks, string_value
from rtask.sparql.templates import resolve
from rtask.sparql.tokens import Token, line_and_column

__all__ = ["TEXT_SERVICE", "with_text_matches", "without_services"]

TEXT_SERVICE = "urn:rtask:text"
MAX_HITS = 10_000
"""Hits that a clause of values holds; more are refused, never left out."""


class Hit(Protocol):
    """A hit of the text search."""

    @property
    def subject(self) -> NamedNode:
        """Subject that the text describes."""

    @property
    def text(self) -> str:
        """Best matching text."""

    @property
    def language(self) -> str | None:
        """Its language tag."""

    @property
    def score(self) -> float:
        """Relevance; larger is better."""


Search = Callable[..., Sequence[Hit]]


def without_services(text: str) -> str:
    """Return a query or pattern without calls to other servers.

    >>> without_services("ASK { SERVICE SILENT <urn:x> { ?s ?p ?o } }")
    'ASK { {} }'

    Raises
    ------
    ForbiddenError
        If the text uses ``SERVICE`` without ``SILENT``.
    """
    if "service" not in text.lower():
        return text
    tokens = tokenise(text)
    pieces, done, at = [], 0, 0
    while tokens[at].kind != "end":
        if not tokens[at].is_word("SERVICE"):
            at += 1
            continue
        if not tokens[at + 1].is_word("SILENT"):
            line, column = line_and_column(text, tokens[at].start)
            raise ForbiddenError(
                f"{line}:{column}: SERVICE is switched off; send that query to the server itself",
                operation="SERVICE",
                line=line,
                column=column,
            )
        end = find_block_end(tokens, at + 3)
        pieces += [text[done : tokens[at].start], "{}"]
        done, at = tokens[end - 1].end, end
    return "".join([*pieces, text[done:]])


@dataclass(frozen=True)
class _Block:
    """Request of a text service block, as tokens."""

    subject: Token
    given: dict[str, Token]


def with_text_matches(text: str, search: Search) -> str:
    """Return a query with each text service replaced by its hits.

    Parameters
    ----------
    search
        Function with the interface of :meth:`KnowledgeBase.search`.

    Raises
    ------
    QuerySyntaxError
        If a text service block contains anything else.
    TooLargeError
        The words have more hits than a query can hold, and it does not say how many it wants.
    """
    return replace_blocks(
        text,
        TEXT_SERVICE,
        lambda prologue, tokens: _values(text, prologue, _read(text, prologue, tokens), search),
    )


def _read(text: str, prologue: str, tokens: list[Token]) -> _Block:
    """Read ``subject predicate object ; predicate object .``"""
    if tokens and tokens[-1].is_mark("."):
        tokens = tokens[:-1]
    if not tokens or len(tokens) % 3 != 0:
        raise _refusal(text, tokens, 'expected ?s rt:matches "words" ; rt:score ?score')
    given: dict[str, Token] = {}
    for at in range(1, len(tokens), 3):
        name, value = tokens[at], tokens[at + 1]
        if at + 2 < len(tokens) and not tokens[at + 2].is_mark(";"):
            raise _refusal(text, tokens[at + 2 :], "expected ';'")
        iri = resolve(name.text, prologue, None).value if name.kind in ("iri", "name") else ""
        local = iri.removeprefix(ontology.NS)
        kinds = {"matches": "string", "score": "variable", "text": "variable", "limit": "number"}
        kinds |= {"lang": "string"}
        if kinds.get(local) != value.kind:
            raise _refusal(text, [name], f"expected one of {', '.join(kinds)} with its value")
        given[local] = value
    if "matches" not in given:
        raise _refusal(text, tokens, "rt:matches is missing")
    return _Block(tokens[0], given)


def _refusal(text: str, tokens: list[Token], message: str) -> QuerySyntaxError:
    return block_refusal(text, TEXT_SERVICE, tokens, message)


def _values(text: str, prologue: str, block: _Block, search: Search) -> str:
    given = block.given
    variables: list[str] = []
    among: set[str] | None = None
    if block.subject.kind == "variable":
        variables.append("subject")
    elif block.subject.kind in ("iri", "name"):
        # Looked for by itself: it may come behind as many better hits as anybody asks for.
        among = {resolve(block.subject.text, prologue, None).value}
    else:
        raise _refusal(text, [block.subject], "the subject is a variable or an IRI")
    hits = _hits(text, given, search, among)
    variables += [name for name in ("score", "text") if name in given]
    if not variables:
        return "{}" if hits else "FILTER(false)"
    names = [block.subject.text if v == "subject" else given[v].text for v in variables]
    rows = " ".join("(" + " ".join(written(_term(hit, v)) for v in variables) + ")" for hit in hits)
    return f"VALUES ({' '.join(names)}) {{ {rows} }}"


def _hits(
    text: str, given: dict[str, Token], search: Search, among: set[str] | None
) -> Sequence[Hit]:
    """Return the hits that a block asks for: as many as it says, or all."""
    words = string_value(given["matches"])
    language = string_value(given["lang"]) if "lang" in given else None
    asked = int(given["limit"].text) if "limit" in given else None
    if asked is not None and asked > MAX_HITS:
        raise _refusal(text, [given["limit"]], f"rt:limit is at most {MAX_HITS}")
    most = MAX_HITS + 1 if asked is None else asked
    hits = search(words, lang=language, limit=most, among=among)
    if len(hits) > MAX_HITS:
        line, column = line_and_column(text, given["matches"].start)
        raise TooLargeError(
            f"{line}:{column}: {words!r} has more than {MAX_HITS} hits; add words, or say with "
            "rt:limit how many of the best are wanted",
            line=line,
            column=column,
            limit="hits",
            allowed=MAX_HITS,
        )
    return hits


def _term(hit: Hit, what: str) -> Term:
    terms: dict[str, Term] = {
        "subject": hit.subject,
        "score": Literal(hit.score),
        "text": Literal(hit.text, language=hit.language) if hit.language else Literal(hit.text),
    }
    return terms[what]
