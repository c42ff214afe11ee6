"""Estimate from its text whether a query is quick.

Some readers are reserved for quick queries, so that a robot's look-up does not wait behind a long
report. The estimate concerns how much of the store is read before the first solution, not the
length of the answer; so callers may use it to bound the time to the first piece only. A wrong
estimate costs time but does no other harm.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import NamedTuple

from rtask.errors import RtaskError
from rtask.sparql.lexer import body_start, tokenise
from rtask.sparql.tokens import Token, shape

__all__ = ["is_lookup", "is_quick"]

MAX_PATTERNS = 8
_MAX_LENGTH = 4_000
_MAX_LOOKUP = 2_000
_IRI = r"<[^<>\"{}|^`\\\x00-\x20]*>"
_NAME = r"(?:[A-Za-z][\w-]*)?:[A-Za-z_][\w-]*"
_TERM = rf"(?:{_IRI}|{_NAME}|\?\w+)"
_LOOKUP = re.compile(
    rf"""\s*(?:PREFIX\s+(?:[A-Za-z][\w-]*)?:\s*{_IRI}\s*)*
    SELECT\s*(?:\*|(?:\s\?\w+)+)\s*(?:WHERE\s*)?
    \{{\s*(?:{_IRI}|{_NAME})\s+(?:{_TERM}|a)\s+{_TERM}\s*\.?\s*\}}\s*(?:LIMIT\s+\d{{1,9}}\s*)?""",
    re.X | re.I | re.A,
)
_AROUND = {
    *("SELECT", "ASK", "WHERE", "LIMIT", "OFFSET", "DISTINCT", "REDUCED", "GROUP", "ORDER", "BY"),
    *("ASC", "DESC", "HAVING", "AS", "COUNT", "SUM", "AVG", "MIN", "MAX", "SAMPLE"),
    *("GROUP_CONCAT", "SEPARATOR"),
}
_AROUND_MARKS = frozenset(("!=", "<=", ">=", "&&", "||", *"*();=<>!+-/"))
_IN_BLOCK = {"A", "TRUE", "FALSE"}
_NESTED = {"EXISTS", "SELECT"}
_TERMS = {"iri", "name", "variable", "string", "number", "blank", "word"}
_REPEATS = ("*", "+", "?")
_RDF_TYPE = "<http://www.w3.org/1999/02/22-rdf-syntax-ns#type>"


class _Verb(NamedTuple):
    """Predicate or path of a pattern.

    Attributes
    ----------
    variable
        Its name, if it is a variable; else empty.
    is_common
        Whether it may be ``rdf:type``, so that a constant object names very many subjects.
    steps
        Number of predicates.
    is_wide
        Whether it repeats or has alternatives. The store looks for a sequence of steps as for so
        many patterns, but for such a path as a whole.
    """

    variable: str
    is_common: bool
    steps: int
    is_wide: bool


class _Pattern(NamedTuple):
    subject: Token
    verb: _Verb
    value: Token

    @property
    def is_anchored(self) -> bool:
        """Whether it has a constant that leads to few statements."""
        return self.subject.kind in ("iri", "name") or (
            self.value.kind not in ("variable", "blank") and not self.verb.is_common
        )


def is_lookup(text: str) -> bool:
    """Whether a query only asks for the statements about one resource.

    Its cost is at most the number of these statements, so this form is matched strictly.

    Examples
    --------
    >>> is_lookup("SELECT ?p ?o WHERE { <urn:mug> ?p ?o }")
    True
    >>> is_lookup("SELECT * { ?s ?p ?o }"), is_lookup("SELECT * { <urn:a> ?p ?o . ?o ?q ?r }")
    (False, False)
    """
    return len(text) <= _MAX_LOOKUP and _LOOKUP.fullmatch(text) is not None


def is_quick(text: str) -> bool:
    """Whether a query reads only data connected with a few named resources.

    It has at most eight triple patterns and steps of paths, in one block with ``OPTIONAL``,
    ``FILTER`` and ``GRAPH``. Patterns that share variables form a group, and each group has a
    constant subject, or a constant object of a predicate other than ``rdf:type``; so has each path
    that repeats or has alternatives. Few solutions are also counted, sorted and grouped quickly. A
    query with ``UNION``, sub-queries or other constructs is not quick.

    Examples
    --------
    >>> is_quick("SELECT ?name { ?mug <urn:on> <urn:table> ; <urn:name> ?name }")
    True
    >>> is_quick("SELECT * { ?s ?p ?o }"), is_quick("SELECT * { ?s a <urn:Mug> }")
    (False, False)
    >>> is_quick("SELECT (COUNT(*) AS ?n) { <urn:mug> <urn:on>+ ?o }")
    True
    >>> is_quick("SELECT (COUNT(*) AS ?n) { ?mug <urn:on>+ ?o }")
    False
    """
    # Cached by shape: robots ask the same query with other constants.
    return len(text) <= _MAX_LENGTH and _is_quick(shape(text))


@lru_cache(maxsize=2_048)
def _is_quick(text: str) -> bool:
    try:
        tokens = tokenise(text)
        # The prologue costs nothing, and the last token marks the end.
        tokens = tokens[body_start(tokens) : -1]
    except (RtaskError, IndexError):
        return False
    start = next((at for at, token in enumerate(tokens) if token.is_mark("{")), None)
    if start is None:
        return False
    block = _Block(tokens, start)
    if not block.is_understood:
        return False
    # What is not known to be cheap counts as slow: a slow query among the quick ones holds up all
    # others.
    around = [*tokens[:start], *tokens[block.end :]]
    if any(token.kind == "word" and token.text.upper() not in _AROUND for token in around):
        return False
    if any(token.kind == "mark" and token.text not in _AROUND_MARKS for token in around):
        return False
    patterns = [*block.required, *block.optional]
    return (
        0 < sum(pattern.verb.steps for pattern in patterns) <= MAX_PATTERNS
        and all(pattern.is_anchored for pattern in patterns if pattern.verb.is_wide)
        # Both: an OPTIONAL anchors nothing for the patterns that must match, but may itself be
        # unanchored.
        and _are_anchored(block.required)
        and _are_anchored(patterns)
    )


class _Block:
    """The triple patterns of the outermost block.

    Attributes
    ----------
    required, optional
        Patterns outside and inside ``OPTIONAL``.
    is_understood
        Whether the block contains nothing else.
    end
        Index of the token after the block.
    """

    def __init__(self, tokens: list[Token], start: int) -> None:
        self.required: list[_Pattern] = []
        self.optional: list[_Pattern] = []
        self._tokens = tokens
        self._given: list[Token] = []
        self._verb: _Verb | None = None
        self._optional_depth = 0
        self.end = start + 1
        self.is_understood = self._read()

    def _read(self) -> bool:
        depth = 1
        while self.end < len(self._tokens):
            token = self._tokens[self.end]
            self.end += 1
            if token.is_mark("}"):
                if not self._ends_pattern():
                    return False
                depth -= 1
                if depth < self._optional_depth:
                    self._optional_depth = 0
                if depth == 0:
                    return True
            elif token.is_word("OPTIONAL", "GRAPH"):
                depth += 1
                if not self._opens_block(token, depth):
                    return False
            elif token.is_word("FILTER"):
                if not self._skips_filter():
                    return False
            elif not self._takes(token):
                return False
        return False

    def _opens_block(self, token: Token, depth: int) -> bool:
        if not self._ends_pattern():
            return False
        if token.is_word("GRAPH"):
            name = self._next()
            if name is None or name.kind not in ("iri", "name", "variable"):
                return False
        elif not self.required:
            return False  # evaluated first, without any bound variable
        elif not self._optional_depth:
            self._optional_depth = depth
        brace = self._next()
        return brace is not None and brace.is_mark("{")

    def _skips_filter(self) -> bool:
        """Step over a filter: its expression in parentheses, or a call of one function."""
        if not self._ends_pattern():
            return False
        opening = self._next()
        if opening is not None and opening.kind in ("word", "iri", "name"):
            if opening.text.upper() in ("EXISTS", "NOT"):
                return False
            opening = self._next()
        if opening is None or not opening.is_mark("("):
            return False
        depth = 1
        while depth:
            token = self._next()
            if token is None or token.is_word(*_NESTED):
                return False
            depth += token.is_mark("(") - token.is_mark(")")
        return True

    def _next(self) -> Token | None:
        if self.end >= len(self._tokens):
            return None
        self.end += 1
        return self._tokens[self.end - 1]

    def _takes(self, token: Token) -> bool:
        """Take the next token of a triple pattern."""
        given = self._given
        if len(given) == 1 and not token.is_mark("."):
            self._verb = self._reads_verb(token)
            given.append(token)
            return self._verb is not None
        if token.kind in _TERMS:
            if token.kind == "word" and token.text.upper() not in _IN_BLOCK:
                return False
            given.append(token)
            if len(given) == 3:
                patterns = self.optional if self._optional_depth else self.required
                assert self._verb is not None
                patterns.append(_Pattern(given[0], self._verb, given[2]))
            return len(given) <= 3
        if token.is_mark("."):
            return self._ends_pattern()
        if len(given) == 3 and (token.is_mark(";") or token.is_mark(",")):
            del given[1 if token.is_mark(";") else 2 :]
            return True
        return False

    def _reads_verb(self, token: Token | None) -> _Verb | None:
        """Read a predicate or path from its first token on; None if it is neither."""
        if token is not None and token.kind == "variable":
            return _Verb(token.text[1:], True, 1, False)
        depth, steps, is_common, is_wide = 0, 0, False, False
        while token is not None:
            if token.is_mark("("):
                depth += 1
            elif token.kind in ("iri", "name") or token.text == "a":
                steps += 1
                is_common = is_common or token.text in ("a", _RDF_TYPE)
                is_common = is_common or token.text.endswith(":type")
                # Marks behind a step belong to it or to the group that it ends: (^p/q)* is wide as
                # well.
                while (after := self._peek()) in _REPEATS or (after == ")" and depth):
                    self.end += 1
                    is_wide = is_wide or after in _REPEATS
                    depth -= after == ")"
                if after not in ("/", "|"):
                    return None if depth else _Verb("", is_common, steps, is_wide)
                self.end += 1
                is_wide = is_wide or after == "|"
            elif not token.is_mark("^"):
                return None
            token = self._next()
        return None

    def _peek(self) -> str:
        """Return the next token, if it is a mark."""
        token = self._tokens[self.end] if self.end < len(self._tokens) else None
        return token.text if token is not None and token.kind == "mark" else ""

    def _ends_pattern(self) -> bool:
        """Whether a pattern may end here; the subject may remain after a trailing ``;``."""
        # One: the subject that is left behind a trailing semicolon.
        is_whole = len(self._given) in (0, 1, 3)
        self._given = []
        return is_whole


def _are_anchored(patterns: list[_Pattern]) -> bool:
    """Whether every group of patterns that share variables has a constant to start from."""
    groups: list[tuple[set[str], bool]] = []
    for pattern in patterns:
        subject, verb, value = pattern
        names = {token.text[1:] for token in (subject, value) if token.kind == "variable"}
        names |= {token.text for token in (subject, value) if token.kind == "blank"}
        names |= {verb.variable} if verb.variable else set()
        anchored = pattern.is_anchored
        others = []
        for group_names, group_anchored in groups:
            if group_names & names:
                names, anchored = names | group_names, anchored or group_anchored
            else:
                others.append((group_names, group_anchored))
        groups = [*others, (names, anchored)]
    return all(anchored for _, anchored in groups)
