"""Graph patterns over the parameters of actions, and the predicates that they stand for.

Two patterns that differ in the names of their variables alone are one predicate: its name is the
pattern with its parameters numbered, so that ``?thing rt:locatedOn ?place`` of one action and
``?thing rt:locatedOn ?hand`` of another speak of the same facts.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass

import ontology
from rtask.errors import DataError
from rtask.rdf.terms import NamedNode

__all__ = ["MAX_CHARS", "Pattern", "expanded", "parameters_of", "parse_pattern"]

MAX_CHARS = 2000
_TOKEN = re.compile(
    r"(?P<space>\s+)|(?P<variable>\?\w+)|(?P<iri><[^<>\s\"{}|^`\\]*>)"
    r"|(?P<name>[A-Za-z][\w-]*:[\w%.\-]*[\w%\-]|\ba\b)"
    r"|(?P<string>\"[^\"\\\n]*\"(?:@[a-zA-Z-]+|\^\^[A-Za-z]+:\w+)?)"
    r"|(?P<number>[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)|(?P<word>FILTER|NOT|EXISTS|true|false)"
    r"|(?P<sign>[{}.;,/^*+|()])"
)


@dataclass(frozen=True)
class Pattern:
    """A graph pattern as a predicate over parameters.

    Parameters
    ----------
    predicate
        The pattern with its parameters as ``?1``, ``?2`` and other variables as ``?a``, ``?b``.
    arguments
        Names of the parameters, in that order.
    """

    predicate: str
    arguments: tuple[str, ...]

    @property
    def sparql(self) -> str:
        """The pattern with its parameters as ``?p1``, ``?p2``."""
        return re.sub(r"\?(\d+)", r"?p\1", self.predicate)

    @property
    def is_negative(self) -> bool:
        """Whether it only excludes, so that something else must bind its parameters."""
        return self.predicate.startswith("FILTER")

    @property
    def properties(self) -> frozenset[str]:
        """IRIs in the pattern."""
        return frozenset(re.findall(r"<([^<>]*)>", self.predicate))

    def triple(self, arguments: tuple[str, ...]) -> tuple[str, str, str] | None:
        """Return the statement of a fact; None if the pattern is no single triple of IRIs."""
        parts = self.predicate.split()
        if len(parts) != 3 or not parts[1].startswith("<"):
            return None
        values = {f"?{n}": value for n, value in enumerate(arguments, 1)}
        subject, value = (values.get(part, part.strip("<>")) for part in (parts[0], parts[2]))
        if any(part.startswith(("?", '"')) for part in (subject, value)):
            return None
        return subject, parts[1].strip("<>"), value


def parse_pattern(text: str, parameters: Collection[str]) -> Pattern:
    """Return the predicate of a graph pattern.

    Parameters
    ----------
    text
        Triple patterns with ``.`` between them, or one ``FILTER NOT EXISTS { ... }``; prefixes as
        in :data:`ontology.PREFIXES`, else IRIs.
    parameters
        Names of the variables that are parameters.

    Raises
    ------
    DataError
        The text is no such pattern.

    Examples
    --------
    >>> parse_pattern("?cup rt:locatedOn ?place", {"cup", "place"}).arguments
    ('cup', 'place')
    """
    arguments: list[str] = []
    others: dict[str, str] = {}
    words = []
    for kind, word in _tokens(text):
        if kind != "variable":
            words.append(_expanded(word) if kind == "name" else word)
        elif word[1:] in parameters:
            if word[1:] not in arguments:
                arguments.append(word[1:])
            words.append(f"?{arguments.index(word[1:]) + 1}")
        else:
            words.append(others.setdefault(word, f"?{chr(ord('a') + len(others))}"))
    while words and words[-1] == ".":
        words.pop()
    if not arguments:
        raise DataError(f"the pattern {text!r} names no parameter")
    return Pattern(" ".join(words), tuple(arguments))


def parameters_of(text: str) -> tuple[tuple[str, str], ...]:
    """Return the variables of a pattern ``?name a class``, and the IRIs of their classes.

    >>> parameters_of("?cup a <urn:Cup> . ?robot a cora:Robot")[0]
    ('cup', 'urn:Cup')

    Raises
    ------
    DataError
        The text is no such pattern.
    """
    tokens = [word for _, word in _tokens(text) if word != "."]
    rows = [tokens[at : at + 3] for at in range(0, len(tokens), 3)]
    for row in rows:
        if len(row) != 3 or not row[0].startswith("?") or row[1] not in ("a", "rdf:type"):
            raise DataError(f"{' '.join(row)!r} declares no parameter; write ?name a class")
    return tuple((row[0][1:], _expanded(row[2]).strip("<>")) for row in rows)


def expanded(text: str) -> str:
    """Return a pattern with full IRIs in place of prefixed names.

    Raises
    ------
    DataError
        The text is no pattern.
    """
    return " ".join(_expanded(word) if kind == "name" else word for kind, word in _tokens(text))


def _tokens(text: str) -> list[tuple[str, str]]:
    if len(text) > MAX_CHARS:
        raise DataError(f"a pattern has at most {MAX_CHARS} characters, not {len(text)}")
    tokens, at = [], 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise DataError(f"{text[at : at + 40]!r} in the pattern {text[:200]!r} cannot be read")
        if match.lastgroup != "space":
            tokens.append((str(match.lastgroup), match[0]))
        at = match.end()
    return tokens


def _expanded(word: str) -> str:
    if word.startswith("<"):
        return word
    if word == "a":
        return f"<{ontology.PREFIXES['rdf']}type>"
    prefix, _, local = word.partition(":")
    namespace = ontology.PREFIXES.get(prefix)
    if namespace is None:
        raise DataError(
            f"the prefix {prefix}: is not known; write <IRI> or one of "
            f"{', '.join(ontology.PREFIXES)}"
        )
    return str(NamedNode(namespace + local))
