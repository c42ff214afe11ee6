"""``SERVICE <urn:rtask:text>`` in a query: words that are looked up before it is evaluated.

The block becomes a ``VALUES`` of what was found::

    SERVICE <urn:rtask:text> { ?s rt:matches "red cup" ; rt:score ?score ; rt:limit 10 }
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pyoxigraph import Literal

import ontology
from rtask.errors import QuerySyntaxError
from rtask.kb.search.text import TextHit
from rtask.rdf.terms import Term, written
from rtask.sparql.lexer import body_start, find_block_end, line_and_column, tokenise
from rtask.sparql.templates import resolve
from rtask.sparql.tokens import Token

__all__ = ["ADDRESS", "with_found_texts"]

ADDRESS = "urn:rtask:text"
_MOST = 1_000
_STRING_MARKS = ('"""', "'''", '"', "'")
Search = Callable[..., Sequence[TextHit]]


@dataclass(frozen=True)
class _Block:
    """What a block asks for; values are tokens."""

    subject: Token
    given: dict[str, Token]


def with_found_texts(text: str, search: Search) -> str:
    """Return a query in which each text service is replaced by what it finds.

    Parameters
    ----------
    search
        As :meth:`KnowledgeBase.search`.

    Raises
    ------
    QuerySyntaxError
        At a block that asks for something else.
    """
    if ADDRESS not in text:
        return text
    tokens = tokenise(text)
    prologue = text[: tokens[body_start(tokens)].start]
    pieces, done, at = [], 0, 0
    while tokens[at].kind != "end":
        start = at
        at += 1
        if not tokens[start].is_word("SERVICE"):
            continue
        name = at + tokens[at].is_word("SILENT")
        if tokens[name].text != f"<{ADDRESS}>" or not tokens[name + 1].is_mark("{"):
            continue
        end = find_block_end(tokens, name + 1)
        block = _read(text, prologue, tokens[name + 2 : end - 1])
        pieces += [text[done : tokens[start].start], _values(text, prologue, block, search)]
        done, at = tokens[end - 1].end, end
    return "".join([*pieces, text[done:]])


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
        wanted = {"matches": "string", "score": "variable", "text": "variable", "limit": "number"}
        wanted |= {"lang": "string"}
        if wanted.get(local) != value.kind:
            raise _refusal(text, [name], f"expected one of {', '.join(wanted)} with its value")
        given[local] = value
    if "matches" not in given:
        raise _refusal(text, tokens, "rt:matches is missing")
    return _Block(tokens[0], given)


def _refusal(text: str, tokens: list[Token], message: str) -> QuerySyntaxError:
    line, column = line_and_column(text, tokens[0].start if tokens else 0)
    return QuerySyntaxError(
        f"{line}:{column}: in SERVICE <{ADDRESS}>: {message}", line=line, column=column
    )


def _string(token: Token) -> str:
    """Return what a string token says."""
    mark = next(mark for mark in _STRING_MARKS if token.text.startswith(mark))
    inner = token.text[len(mark) : -len(mark)]
    pairs = {"n": "\n", "t": "\t", "r": "\r", "b": "\b", "f": "\f"}
    out, at = [], 0
    while at < len(inner):
        if inner[at] == "\\" and at + 1 < len(inner):
            out.append(pairs.get(inner[at + 1], inner[at + 1]))
            at += 2
        else:
            out.append(inner[at])
            at += 1
    return "".join(out)


def _values(text: str, prologue: str, block: _Block, search: Search) -> str:
    given = block.given
    options = {"limit": min(_MOST, int(given["limit"].text)) if "limit" in given else _MOST}
    language = _string(given["lang"]) if "lang" in given else None
    hits = search(_string(given["matches"]), lang=language, **options)
    variables: list[str] = []
    if block.subject.kind == "variable":
        variables.append("subject")
    elif block.subject.kind in ("iri", "name"):
        wanted = resolve(block.subject.text, prologue, None)
        hits = [hit for hit in hits if hit.subject == wanted]
    else:
        raise _refusal(text, [block.subject], "the subject is a variable or an IRI")
    variables += [name for name in ("score", "text") if name in given]
    if not variables:
        return "{}" if hits else "FILTER(false)"
    names = [block.subject.text if v == "subject" else given[v].text for v in variables]
    rows = " ".join("(" + " ".join(written(_term(hit, v)) for v in variables) + ")" for hit in hits)
    return f"VALUES ({' '.join(names)}) {{ {rows} }}"


def _term(hit: TextHit, what: str) -> Term:
    found: dict[str, Term] = {
        "subject": hit.subject,
        "score": Literal(hit.score),
        "text": Literal(hit.text, language=hit.language) if hit.language else Literal(hit.text),
    }
    return found[what]
