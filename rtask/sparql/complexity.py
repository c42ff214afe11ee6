"""Complexity limits of SPARQL texts, checked before the store's planner sees them.

The planner is recursive and tries orders of joins: a hundred patterns take half a second, a
thousand take minutes, twenty thousand crash the process. Texts are therefore measured by their
tokens, not counting data (VALUES, INSERT DATA, templates).
"""

from __future__ import annotations

from collections.abc import Sequence

from rtask.errors import TooLargeError
from rtask.sparql.tokens import Token

__all__ = ["LIMITS", "check_complexity", "limit"]

LIMITS = {
    "patterns joined with each other": 128,
    "patterns": 4_000,
    "UNION": 256,
    "OPTIONAL": 64,
    "BIND, MINUS, EXISTS and sub-SELECT": 500,
    "steps of a path": 100,
    "projected expressions": 1_000,
    "terms in a row": 1_000,
    "operations": 1_000,
}
_TERMS = {"iri", "string", "variable", "blank", "number", "name"}
_CLAUSES = {"BIND", "MINUS", "EXISTS", "SELECT"}


def limit(name: str, value: int, allowed: int) -> None:
    """Raise if a value exceeds its limit."""
    if value > allowed:
        raise TooLargeError(
            f"too complex: {name} {value}, allowed {allowed}",
            limit=name,
            value=value,
            allowed=allowed,
        )


def check_complexity(tokens: Sequence[Token]) -> None:
    """Raise if the store would take very long to plan this query or update, or crash.

    Raises
    ------
    TooLargeError
        A limit is exceeded; the error gives its name, the value found and the value allowed.
    """
    _Meter(tokens).measure()


class _Meter:
    """Counts the measures of a text in one pass.

    ``_joined`` holds for each open block the number of patterns joined in it. The branches of a
    UNION are not joined with each other, so a whole UNION counts as one pattern.
    """

    def __init__(self, tokens: Sequence[Token]) -> None:
        self._tokens = tokens
        self._joined = [0]
        self._is_branch: list[bool] = []
        self._counts = dict.fromkeys(LIMITS, 0)
        self._parens = 0

    def measure(self) -> None:
        at, before = 0, ""
        while at < len(self._tokens):
            kind, text, _, _ = self._tokens[at]
            if kind == "mark":
                if text == "{" and self._is_data(at):
                    at = self._behind(at)
                    before = ""
                    continue
                self._mark(text, at)
            elif kind == "word":
                self._word(text.upper())
            elif kind in _TERMS and before in _TERMS:
                self._adjacent()
            before = kind
            at += 1

    def _adjacent(self) -> None:
        """Count a term right behind another, where that is no pattern of three terms."""
        if self._parens:
            self._pattern()  # the next element of a list
        elif len(self._joined) == 1:
            self._add("terms in a row")

    def _mark(self, text: str, at: int) -> None:
        if text == "{":
            self._is_branch.append(self._follows(at, "UNION"))
            self._joined.append(0)
        elif text == "}":
            self._close(at)
        elif text in "([":
            self._parens += text == "("
            if text == "[":
                self._pattern()
        elif text == ")":
            self._parens = max(0, self._parens - 1)
        elif text in ".;" or (text == "," and not self._parens):
            self._counts["steps of a path"] = 0
            self._pattern()
        elif text == "/":
            self._add("steps of a path")
        if text == ";" and len(self._joined) == 1:
            self._add("operations")

    def _close(self, at: int) -> None:
        self._counts["steps of a path"] = 0
        before = self._tokens[at - 1]
        # the last pattern of a block needs no final dot
        if not before.is_mark(".") and not before.is_mark("{") and not before.is_mark("}"):
            self._pattern()
        if not self._is_branch:
            return
        inner = self._joined.pop()
        if self._is_branch.pop():
            inner = 0
        elif self._precedes(at, "UNION"):
            inner = min(inner, 1)
        self._joined[-1] += inner
        self._check_joined()

    def _word(self, word: str) -> None:
        if word in ("UNION", "OPTIONAL"):
            self._add(word)
        elif word in _CLAUSES:
            self._add("BIND, MINUS, EXISTS and sub-SELECT")
        elif word == "AS":
            self._add("projected expressions")

    def _pattern(self) -> None:
        self._add("patterns")
        self._joined[-1] += 1
        self._check_joined()

    def _check_joined(self) -> None:
        name = "patterns joined with each other"
        if len(self._joined) > 1:
            limit(name, self._joined[-1], LIMITS[name])

    def _add(self, name: str) -> None:
        self._counts[name] += 1
        limit(name, self._counts[name], LIMITS[name])

    def _follows(self, at: int, word: str) -> bool:
        return at > 0 and self._tokens[at - 1].is_word(word)

    def _precedes(self, at: int, word: str) -> bool:
        return at + 1 < len(self._tokens) and self._tokens[at + 1].is_word(word)

    def _is_data(self, at: int) -> bool:
        """Whether a block holds terms or a template instead of patterns."""
        if self._parens:
            return False
        before = self._tokens[at - 1] if at else None
        if before is None:
            return False
        if before.is_word("DATA", "INSERT", "DELETE", "CONSTRUCT"):
            return True
        if before.kind == "variable":
            return at > 1 and self._tokens[at - 2].is_word("VALUES")
        if before.is_mark(")"):
            back = at - 1
            while back > 0 and not self._tokens[back].is_mark("("):
                back -= 1
            return self._tokens[back - 1].is_word("VALUES")
        return False

    def _behind(self, at: int) -> int:
        depth = 0
        for index in range(at, len(self._tokens)):
            text = self._tokens[index].text
            if self._tokens[index].kind != "mark":
                continue
            depth += (text == "{") - (text == "}")
            if depth == 0:
                return index + 1
        return len(self._tokens)
