"""Mistyped words of a goal: those for which one word alone can have been meant.

A word is corrected only where the sentence says nothing as it stands, and the reader is told so.
One letter in place of another is no slip here: a pan is no can.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from rtask.tasks.language.items import Items

__all__ = ["MAX_SLIPS", "Slip", "mistyped"]

MAX_SLIPS = 3
"""Most words of a goal that are corrected."""
_MIN_SWAPPED = 3
_MIN_NAME = 5
"""Letters of the shortest name for which another word is taken: short ones are like many words."""
_MIN_WORD = 4


@dataclass(frozen=True)
class Slip:
    """A word, and the only one that can have been meant by it."""

    word: str
    meant: str

    @property
    def remark(self) -> str:
        """What was done, for people."""
        return f"{self.word!r} is read as {self.meant!r}"

    def corrected(self, text: str) -> str:
        """Return a text with what was meant.

        >>> Slip("teh", "the").corrected("put teh cup")
        'put the cup'
        """
        return re.sub(rf"(?<![\w-]){re.escape(self.word)}(?![\w-])", self.meant, text, flags=re.I)


def mistyped(items: Items, names: Iterable[str]) -> Slip | None:
    """Return the word at which reading has stopped, if it is one word with a slip; else None.

    Parameters
    ----------
    names
        Of what there is in the graph.
    """
    at = items.stopped
    word = items.word(at)
    if not word.isalpha() or at in items.names:
        return None
    lower = {word.lower() for name in names for word in name.split() if word.isalpha()}
    nouns = {form for name in lower for form in (name, f"{name}s")}
    meant = {
        expected for expected in items.expected.get(at, ()) if _is_slip(word, expected, _MIN_WORD)
    } | {noun for noun in nouns if _is_slip(word, noun, _MIN_NAME)}
    return Slip(word, meant.pop()) if len(meant) == 1 else None


def _is_slip(word: str, meant: str, shortest: int) -> bool:
    """Return whether two letters have changed places, or one is missing or too many.

    >>> [_is_slip("tabel", meant, 4) for meant in ("table", "label", "cable")]
    [True, False, False]
    """
    if not meant.isalpha() or word == meant:
        return False
    if len(word) == len(meant):
        pairs = [at for at in range(len(word)) if word[at] != meant[at]]
        return (
            len(word) >= (_MIN_SWAPPED if shortest == _MIN_WORD else shortest)
            and len(pairs) == 2
            and pairs[1] == pairs[0] + 1
            and word[pairs[0]] == meant[pairs[1]]
            and word[pairs[1]] == meant[pairs[0]]
        )
    short, long = sorted((word, meant), key=len)
    return (
        len(long) == len(short) + 1
        and len(short) >= shortest
        and any(long[:at] + long[at + 1 :] == short for at in range(len(long)))
    )
