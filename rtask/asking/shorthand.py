"""Queries as people and agents write them: known prefixes undeclared, ``kb:`` names with slashes.

Commands and tools print ``kb:object/7``, which SPARQL cannot read: a slash in a name must be
escaped there. Such a name is written as its IRI before the query is parsed, and places in the
query are given in the text as it was written.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass

from rtask.errors import QuerySyntaxError
from rtask.rdf.terms import prologue
from rtask.sparql.tokens import line_and_column

__all__ = ["Expansion", "expand"]

# Strings, IRIs and comments are passed over.
_NAMES = re.compile(
    r'"""(?:[^\\]|\\.)*?"""|\'\'\'(?:[^\\]|\\.)*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'(?:[^\'\\\n]|\\.)*\''
    r"|<[^<>\s\"{}|^`\\]*>|#[^\n]*|(?<![\w:?$-])kb:(?P<local>[\w\-]+(?:\.[\w\-]+)*"
    r"(?:/[\w\-~%]+(?:\.[\w\-~%]+)*)+)",
    re.S,
)


@dataclass(frozen=True)
class Expansion:
    """A query as it is evaluated, and where its parts stand in the text as it was given.

    Parameters
    ----------
    given, text
        Before and after.
    shifts
        Places in ``text`` from which on it is longer than ``given`` by a number of characters.
    """

    given: str
    text: str
    shifts: tuple[tuple[int, int], ...]

    def original(self, at: int) -> int:
        """Return the place in the given text of a character of the expanded text."""
        index = bisect_right(self.shifts, (at, len(self.text))) - 1
        return max(at - self.shifts[index][1], 0)

    def place(self, at: int) -> tuple[int, int]:
        """Return line and column, from 1, in the given text."""
        return line_and_column(self.given, self.original(at))

    def error(self, error: QuerySyntaxError) -> QuerySyntaxError:
        """Return a syntax error with the place in the given text."""
        line, column = error.details.get("line"), error.details.get("column")
        if not (isinstance(line, int) and isinstance(column, int)):
            return error
        lines = self.text.splitlines(keepends=True)
        before = sum(map(len, lines[: line - 1]))
        own_line, own_column = self.place(before + column - 1)
        words = str(error).replace(f"{line}:{column}:", f"{own_line}:{own_column}:", 1)
        return QuerySyntaxError(words, line=own_line, column=own_column)


def expand(given: str, prefixes: Mapping[str, str]) -> Expansion:
    """Return a query with the prefixes that it uses and does not declare, in its first line.

    Parameters
    ----------
    prefixes
        Those that need no declaration; ``kb`` is the base of the graph, where it is known.

    Examples
    --------
    >>> expand("ASK { kb:object/7 rt:mass ?m }", {"rt": "urn:rt#", "kb": "urn:lab/"}).text
    'PREFIX rt: <urn:rt#> ASK { <urn:lab/object/7> rt:mass ?m }'
    """
    lowered = " ".join(given.lower().split())
    declared = {name for name in prefixes if f"prefix {name}:" in lowered}
    base = "" if "kb" in declared else prefixes.get("kb", "")
    body, shifts = _without_slashes(given, base) if base else (given, [])
    missing = {
        name: namespace
        for name, namespace in prefixes.items()
        if f"{name}:" in body and name not in declared
    }
    before = prologue(missing).replace("\n", " ")
    moved = tuple((at + len(before), by + len(before)) for at, by in shifts)
    return Expansion(given, before + body, ((0, len(before)), *moved))


def _without_slashes(text: str, base: str) -> tuple[str, list[tuple[int, int]]]:
    pieces: list[str] = []
    shifts: list[tuple[int, int]] = []
    done = length = 0
    for match in _NAMES.finditer(text):
        if match["local"] is None:
            continue
        written = f"<{base}{match['local']}>"
        pieces += [text[done : match.start()], written]
        length += match.start() - done + len(written)
        done = match.end()
        shifts.append((length, length - done))
    return "".join([*pieces, text[done:]]), shifts
