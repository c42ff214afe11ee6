"""Which queries are surely short, so that they need not wait behind long ones."""

from __future__ import annotations

from functools import lru_cache

from rtask.errors import RtaskError
from rtask.sparql.lexer import body_start, tokenise
from rtask.sparql.tokens import Token

__all__ = ["is_point_query"]

_MOST_PATTERNS = 8
_LONGEST = 4_000
_PLAIN_WORDS = {"SELECT", "ASK", "WHERE", "LIMIT", "OFFSET", "A", "TRUE", "FALSE"}
_TERMS = {"iri", "name", "variable", "string", "number", "blank"}
_RDF_TYPE = "<http://www.w3.org/1999/02/22-rdf-syntax-ns#type>"


@lru_cache(maxsize=1024)
def is_point_query(text: str) -> bool:
    """Whether a query looks up what stands beside a few named things.

    At most eight patterns in one block, without paths, filters, aggregates or sub-queries; and each
    group of patterns that share variables holds a constant subject, or a constant object of a
    predicate that is not ``rdf:type``. What is not understood is none: a wrong guess costs time
    only.

    >>> is_point_query("SELECT ?o { <urn:mug> ?p ?o }"), is_point_query("ASK { ?s ?p ?o }")
    (True, False)
    """
    if len(text) > _LONGEST:
        return False
    try:
        tokens = tokenise(text)
        tokens = tokens[body_start(tokens) : -1]
    except (RtaskError, IndexError):
        return False
    if any(t.kind == "word" and t.text.upper() not in _PLAIN_WORDS for t in tokens):
        return False
    marks = [t.text for t in tokens if t.kind == "mark"]
    if marks.count("{") != 1 or not set(marks) <= {"{", "}", ".", ";", ",", "*"}:
        return False
    start = next(at for at, token in enumerate(tokens) if token.is_mark("{"))
    end = next((at for at, token in enumerate(tokens) if token.is_mark("}")), start)
    patterns = _patterns(tokens[start + 1 : end])
    return patterns is not None and _are_anchored(patterns)


_Pattern = tuple[Token, Token, Token]


def _patterns(tokens: list[Token]) -> list[_Pattern] | None:
    """Return the triple patterns of a block; ``None`` if it holds anything else."""
    found: list[_Pattern] = []
    given: list[Token] = []
    for token in tokens:
        if token.kind in _TERMS or token.kind == "word":
            given.append(token)
            if len(given) == 3:
                found.append((given[0], given[1], given[2]))
            elif len(given) > 3:
                return None
        elif token.is_mark("."):
            if len(given) != 3:
                return None
            given = []
        elif token.is_mark(";") and len(given) == 3:
            given = given[:1]
        elif token.is_mark(",") and len(given) == 3:
            given = given[:2]
        else:
            return None
    return found if len(given) in (0, 1, 3) and 0 < len(found) <= _MOST_PATTERNS else None


def _are_anchored(patterns: list[_Pattern]) -> bool:
    """Whether every group of patterns that share variables starts at something constant."""
    groups: list[tuple[set[str], bool]] = []
    for subject, predicate, value in patterns:
        names = {t.text[1:] for t in (subject, predicate, value) if t.kind == "variable"}
        names |= {t.text for t in (subject, value) if t.kind == "blank"}
        is_type = predicate.text in ("a", _RDF_TYPE) or predicate.kind == "variable"
        is_type = is_type or predicate.text.endswith(":type")
        anchored = subject.kind in ("iri", "name") or (
            value.kind not in ("variable", "blank") and not is_type
        )
        apart = []
        for known, known_anchored in groups:
            if known & names:
                names, anchored = names | known, anchored or known_anchored
            else:
                apart.append((known, known_anchored))
        groups = [*apart, (names, anchored)]
    return all(anchored for _, anchored in groups)
