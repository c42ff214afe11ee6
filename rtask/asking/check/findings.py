"""Findings of a check: what is wrong where, how sure that is, and an edit that repairs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias
from typing import Literal as Choice

from rtask.sparql.tokens import line_and_column

__all__ = ["Edit", "Finding", "Repair", "Severity", "in_order", "place_of"]

Severity: TypeAlias = Choice["certain", "likely"]


@dataclass(frozen=True)
class Edit:
    """A stretch of the text to replace.

    Parameters
    ----------
    start, end
        Characters, from 0; the end is not replaced.
    text
        What goes there.
    """

    start: int
    end: int
    text: str


@dataclass(frozen=True)
class Repair:
    """A change of the query that removes a finding.

    Parameters
    ----------
    words
        What it does.
    edits
        Where, in the order of the text.
    """

    words: str
    edits: tuple[Edit, ...]

    def apply(self, text: str) -> str:
        """Return the repaired text.

        >>> Repair("write rt:Mug", (Edit(5, 11, "rt:Mug"),)).apply("?s a rt:Mgu")
        '?s a rt:Mug'
        """
        for edit in sorted(self.edits, key=lambda finding: -finding.start):
            text = text[: edit.start] + edit.text + text[edit.end :]
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return the repair as plain data."""
        edits = [
            {"start": finding.start, "end": finding.end, "text": finding.text}
            for finding in self.edits
        ]
        return {"words": self.words, "edits": edits}


@dataclass(frozen=True)
class Finding:
    """A fault of a query.

    Parameters
    ----------
    rule
        Short name of its kind.
    severity
        ``certain``: the pattern cannot match anything. ``likely``: it can, but only if something
        is of a type that nothing in the graph has, or matches what was hardly meant.
    start, end
        Place in the text, characters from 0.
    words
        What is wrong, in a sentence.
    repairs
        Edits that remove it, the most plausible first.
    """

    rule: str
    severity: Severity
    start: int
    end: int
    words: str
    repairs: tuple[Repair, ...] = ()

    def to_dict(self, text: str) -> dict[str, Any]:
        """Return the finding as plain data, with line and column in a text."""
        line, column = line_and_column(text, self.start)
        return {
            "rule": self.rule,
            "severity": self.severity,
            "line": line,
            "column": column,
            "start": self.start,
            "end": self.end,
            "detail": self.words,
            "repairs": [repair.to_dict() for repair in self.repairs],
        }


def place_of(text: str, at: int) -> tuple[int, int]:
    """Return line and column, from 1, of a character of a text."""
    return line_and_column(text, max(at, 0))


def in_order(findings: Sequence[Finding]) -> list[Finding]:
    """Return findings by place, certain ones first, each kind once at a place."""
    kinds: dict[tuple[str, int, int], Finding] = {}
    for finding in findings:
        kinds.setdefault((finding.rule, finding.start, finding.end), finding)
    return sorted(
        kinds.values(),
        key=lambda finding: (finding.severity != "certain", finding.start, finding.rule),
    )
