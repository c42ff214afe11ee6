"""Tokens of SPARQL texts, read without a parser (SPARQL 1.1 Query Language, 19.8)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

from rtask.errors import QuerySyntaxError

__all__ = ["Token", "line_and_column", "scan", "shape"]

# Runs of plain characters are matched as one: a choice for each took .1 us a character, during
# which nothing else in the process moves.
_TOKEN = re.compile(
    r"""
    (?P<space>(?:[\x20\t\r\n]|\#[^\n\r]*)+)
  | (?P<iri><[^<>"{}|^`\\\x00-\x20]*
      (?:\\(?:u[0-9A-Fa-f]{4}|U[0-9A-Fa-f]{8})[^<>"{}|^`\\\x00-\x20]*)*>)
  | (?P<string>\"\"\"[^"\\]*(?:(?:\\.|"(?!""))[^"\\]*)*\"\"\"
      |'''[^'\\]*(?:(?:\\.|'(?!''))[^'\\]*)*'''
      |"[^"\\\n\r]*(?:\\.[^"\\\n\r]*)*"|'[^'\\\n\r]*(?:\\.[^'\\\n\r]*)*')
  | (?P<variable>[?$][\w\u00b7]+)
  | (?P<blank>_:\w(?:[\w.\-\u00b7]*[\w\-\u00b7])?)
  | (?P<language>@[A-Za-z]+(?:-[A-Za-z0-9]+)*(?:--[a-z]+)?)
  | (?P<number>(?:\d+\.\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?)
  | (?P<name>(?:[^\W\d_](?:[\w.\-\u00b7]*[\w\-\u00b7])?)?:
      (?:(?![.\-\u00b7])
         (?:[\w:\-\u00b7]++|\.++(?=[\w:\-\u00b7]|%[0-9A-Fa-f]{2}|\\.)|%[0-9A-Fa-f]{2}|\\.)+)?)
  | (?P<word>[A-Za-z_][A-Za-z_0-9]*)
  | (?P<mark><<\(|\)>>|<<|>>|\{\||\|\}|\^\^|&&|\|\||!=|<=|>=|[{}()\[\].;,*/|^+\-?!=<>~$])
    """,
    re.X | re.S,
)


_MAX_SHAPE = 2_000
_RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"
_IRI = re.compile(rf'<(?!{re.escape(_RDF_TYPE)}>)[^<>"{{}}|^`\\\x00-\x20]*>')


class Token(NamedTuple):
    """One token: its kind, its text and its position."""

    kind: str
    text: str
    start: int
    end: int

    def is_word(self, *words: str) -> bool:
        """Whether this is one of these keywords, in any letter case."""
        return self.kind == "word" and self.text.upper() in words

    def is_mark(self, mark: str) -> bool:
        """Whether this is a given punctuation mark."""
        return self.kind == "mark" and self.text == mark


def scan(text: str) -> Iterator[Token]:
    """Yield the tokens of a text; spaces and comments are left out.

    Raises
    ------
    QuerySyntaxError
        If some characters do not start a token.
    """
    position, match = 0, _TOKEN.match
    while position < len(text):
        token = match(text, position)
        if token is None:
            line, column = line_and_column(text, position)
            near = text[position : position + 20]
            raise QuerySyntaxError(
                f"{line}:{column}: cannot read {near!r}", line=line, column=column
            )
        if token.lastgroup != "space":
            assert token.lastgroup is not None
            yield Token(token.lastgroup, token.group(), position, token.end())
        position = token.end()


@lru_cache(maxsize=16)
def shape(text: str) -> str:
    """Return a text with its IRIs masked; texts of one shape have the same tokens but for IRIs.

    Programs ask the same query about one thing after the other, so what depends on the tokens only
    can be remembered by shape. ``rdf:type`` stays, because estimates of cost know it. Texts in
    which a masked stretch might not be a token, or be long, are their own shape.

    Examples
    --------
    >>> shape("ASK { <urn:mug> ?p <urn:table> }")
    'ASK { <> ?p <> }'
    >>> shape("ASK { 'a<b'&&?x>'c' }")
    "ASK { 'a<b'&&?x>'c' }"
    """
    if len(text) > _MAX_SHAPE or "<<" in text or "\\" in text or "'" in text:
        return text
    return _IRI.sub("<>", text)


def line_and_column(text: str, position: int) -> tuple[int, int]:
    """Return the 1-based line and column of a position."""
    start = text.rfind("\n", 0, position) + 1
    return text.count("\n", 0, position) + 1, position - start + 1
