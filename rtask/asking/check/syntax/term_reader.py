"""Reads terms and property paths from the tokens of a query."""

from __future__ import annotations

import re
from urllib.parse import urljoin

from rtask.asking.check.syntax.outline import Node
from rtask.asking.check.syntax.paths import Path
from rtask.errors import QuerySyntaxError
from rtask.rdf.terms import RDF_TYPE, XSD
from rtask.sparql.lexer import tokenise
from rtask.sparql.tokens import Token

__all__ = ["TermReader"]

_ESCAPED = re.compile(r"\\([_~.\-!$&'()*+,;=/?#@%])")
_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"


class TermReader:
    """A place in the tokens of a query, and the terms and paths that start there."""

    def __init__(self, text: str, base: str) -> None:
        self._tokens = tokenise(text)
        self._at = 0
        self._base = base
        self._prefixes: dict[str, str] = {}
        self.iris: list[Node] = []
        self._fresh = 0

    @property
    def _now(self) -> Token:
        return self._tokens[self._at]

    def _next(self) -> Token:
        token = self._tokens[self._at]
        self._at = min(self._at + 1, len(self._tokens) - 1)
        return token

    def _is(self, mark: str) -> bool:
        return self._now.is_mark(mark)

    def _skip(self, mark: str) -> bool:
        if self._is(mark):
            self._next()
            return True
        return False

    def _fail(self) -> QuerySyntaxError:
        return QuerySyntaxError(f"{self._now.text!r} at {self._now.start} was not expected")

    def _term(self) -> Node:
        token = self._next()
        if token.kind == "variable":
            return self._variable(token)
        if token.kind in ("iri", "name"):
            return self._iri(token)
        if token.kind == "blank":
            return Node("variable", token.text, token.start, token.end)
        if token.kind == "string":
            return self._string(token)
        if token.is_word("TRUE", "FALSE"):
            return Node("literal", token.text, token.start, token.end, XSD + "boolean")
        start = token.start
        if token.kind == "mark" and token.text in "+-":
            token = self._next()
        if token.kind != "number":
            raise QuerySyntaxError(f"{token.text!r} at {token.start} was not expected")
        kind = (
            "double" if "e" in token.text.lower() else "decimal" if "." in token.text else "integer"
        )
        return Node("literal", token.text, start, token.end, XSD + kind)

    def _string(self, token: Token) -> Node:
        quotes = 3 if token.text[:3] in ('"""', "'''") else 1
        node = Node("literal", token.text[quotes:-quotes], token.start, token.end, XSD + "string")
        if self._now.kind == "language":
            node.datatype, node.end = _RDF + "langString", self._next().end
        elif self._skip("^^"):
            kind = self._next()
            node.datatype, node.end = self._iri(kind).value, kind.end
        return node

    def _variable(self, token: Token) -> Node:
        if token.kind != "variable":
            raise QuerySyntaxError(f"{token.text!r} at {token.start} was not expected")
        return Node("variable", token.text[1:], token.start, token.end)

    def _iri(self, token: Token) -> Node:
        if token.kind == "iri":
            return Node("iri", self._resolved(token.text[1:-1]), token.start, token.end)
        prefix, _, local = token.text.partition(":")
        value = self._prefixes.get(prefix, "") + _ESCAPED.sub(r"\1", local)
        return Node("iri", value, token.start, token.end)

    def _resolved(self, value: str) -> str:
        return urljoin(self._base, value) if self._base and ":" not in value else value

    def fresh(self, start: int) -> Node:
        """Return a variable that the text does not name."""
        self._fresh += 1
        return Node("variable", f" {self._fresh}", start, start)

    def _path(self) -> Path:
        if self._now.kind == "variable":
            token = self._next()
            return Path("variable", node=self._variable(token), start=token.start, end=token.end)
        return self._alternative()

    def _alternative(self) -> Path:
        start = self._now.start
        parts = [self._sequence()]
        while self._skip("|"):
            parts.append(self._sequence())
        return (
            parts[0] if len(parts) == 1 else Path("alternative", parts, None, start, self._before())
        )

    def _sequence(self) -> Path:
        start = self._now.start
        parts = [self._step()]
        while self._skip("/"):
            parts.append(self._step())
        return parts[0] if len(parts) == 1 else Path("sequence", parts, None, start, self._before())

    def _step(self) -> Path:
        start = self._now.start
        if self._skip("^"):
            inner = self._step()
            return Path("inverse", [inner], None, start, inner.end)
        if self._skip("!"):
            inner = self._step()
            return Path("negated", [inner], None, start, inner.end)
        if self._skip("("):
            inner = self._alternative() if not self._is(")") else Path("negated")
            self._skip(")")
        else:
            token = self._next()
            if token.is_word("A") and token.text == "a":
                node = Node("iri", RDF_TYPE.value, token.start, token.end)
            else:
                node = self._iri(token) if token.kind in ("iri", "name") else self._bad(token)
            inner = Path("link", [], node, token.start, token.end)
        for mark in "*+?":
            if self._is(mark):
                end = self._next().end
                kind = {"+": "repeated", "*": "loose", "?": "optional"}[mark]
                return Path(kind, [inner], None, start, end)
        return inner

    def _bad(self, token: Token) -> Node:
        raise QuerySyntaxError(f"{token.text!r} at {token.start} was not expected")

    def _before(self) -> int:
        return self._tokens[self._at - 1].end
