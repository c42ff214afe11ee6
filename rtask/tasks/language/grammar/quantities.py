"""Grammar of how many: numbers, shares, and whether all or the rest are meant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from rtask.tasks.language.items import Items
from rtask.tasks.language.lexicon import NUMBERS, SHARES
from rtask.tasks.language.meaning import Phrase, Quantity

__all__ = ["Quantities"]

_ALL = Quantity("all")
_COUNTED = (
    ("exactly|precisely", "exactly"), ("at least", "some"), ("a minimum of", "some"),
    ("no fewer|less than", "some"), ("a maximum of", "at_most"), ("at most", "at_most"),
    ("no more than", "at_most"), ("not more than", "at_most"),
)  # fmt: skip


class Quantities:
    """Rules for quantities in the words of one goal."""

    def __init__(self, items: Items) -> None:
        self.items = items

    def quantified(self, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield an empty phrase with its quantity, and the word after that."""
        ends = self.items.ends
        yield Phrase(), at
        for end in ends(at, "DET"):
            yield Phrase(is_definite=True), end
            for number, after in self.numbers(end):
                yield Phrase(quantity=Quantity("definite", number)), after
        for end in ends(at, "all|every|each|both of?"):
            yield Phrase(quantity=_ALL), end
            yield from ((Phrase(quantity=_ALL), last) for last in ends(end, "single|last"))
            for after in ends(end, "DET"):
                yield Phrase(quantity=_ALL), after
        for end in ends(at, "each|any and every|all"):
            yield Phrase(quantity=_ALL), end
        for end in ends(at, "all the?"):
            for number, after in self.numbers(end):
                yield Phrase(quantity=Quantity("definite", number)), after
        for end in ends(at, "any|a|an"):
            yield Phrase(quantity=Quantity("some", 1)), end
        for end in (*ends(at, "any of DET"), *ends(at, "either of DET"), *ends(at, "either")):
            yield Phrase(quantity=Quantity("some", 1)), end
        yield from self._counted(at)
        for pattern in ("all but", "all|everything except|bar"):
            for start in ends(at, pattern):
                for number, end in self.numbers(start):
                    for after in (end, *ends(end, "of DET"), *ends(end, "of all|our DET?")):
                        yield Phrase(quantity=Quantity("all_but", number)), after
        for pattern in ("no", "none|neither of DET", "not one|any of DET"):
            for end in ends(at, pattern):
                yield Phrase(quantity=Quantity("no")), end
        for pattern in ("DET other|remaining", "all the? other|remaining", "DET rest of DET?",
                        "DET other half of? DET?"):  # fmt: skip
            for end in ends(at, pattern):
                yield Phrase(quantity=_ALL, others=True), end

    def _counted(self, at: int) -> Iterator[tuple[Phrase, int]]:
        ends = self.items.ends
        for number, end in (
            (n, e) for start in ends(at, "more than") for n, e in self.numbers(start)
        ):
            yield from self._of_some(Quantity("some", number + 1), end)
        for number, end in (
            (n, e) for start in ends(at, "less|fewer than") for n, e in self.numbers(start)
        ):
            yield from self._of_some(Quantity("at_most", number - 1), end)
        for end in ends(at, "every|each one? of DET"):
            yield Phrase(quantity=_ALL), end
        for end in ends(at, "a couple|pair of"):
            yield Phrase(quantity=Quantity("some", 2)), end
        for end in ends(at, "any?"):
            for number, after in self.numbers(end):
                yield from self._of_some(Quantity("some", number), after)
        for pattern, kind in _COUNTED:
            for end in ends(at, pattern):
                for number, after in self.numbers(end):
                    yield from self._of_some(Quantity(kind, number), after)
        for end in ends(at, "a?"):
            share = SHARES.get(self.items.word(end))
            if share is not None:
                yield from self._of_some(Quantity("share", share), end + 1)
        for number, end in self.numbers(at):
            for after in ends(end, "percent of"):
                for last in (after, *ends(after, "DET")):
                    yield Phrase(quantity=Quantity("share", number / 100)), last

    def _of_some(self, quantity: Quantity, at: int) -> Iterator[tuple[Phrase, int]]:
        yield Phrase(quantity=quantity), at
        for end in self.items.ends(at, "of? DET"):
            yield Phrase(quantity=quantity), end
            for total, after in self.numbers(end):  # "one of the two cups"
                yield Phrase(quantity=replace(quantity, total=total)), after

    def numbers(self, at: int) -> Iterator[tuple[int, int]]:
        """Yield the whole number that stands here."""
        word = self.items.word(at)
        number = int(word) if word.isdecimal() and len(word) < 6 else NUMBERS.get(word, 0)
        if number:
            yield number, at + 1
