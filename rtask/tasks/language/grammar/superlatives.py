"""Grammar of which of several: the heaviest, the nearest to something, those above 300 g."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from rtask.tasks.language.grammar.places import Places
from rtask.tasks.language.lexicon import ADJECTIVES, UNITS
from rtask.tasks.language.meaning import Comparison, Phrase, Place, Quantity, Superlative

__all__ = ["Superlatives"]

_ABOVE = (
    ("above|over", True),
    ("more than", True),
    ("greater than", True),
    ("lower|smaller than", False),
    ("below|under", False),
    ("less than", False),
)
_NEAR = (("nearest|closest", False), ("farthest|furthest", True))
_SEEN = (
    ("last|latest seen|spotted|sighted", True), ("most recently seen|spotted|sighted", True),
    ("seen|spotted|sighted last|latest", True), ("seen|spotted|sighted most recently", True),
    ("longest not seen", False), ("not seen for the? longest time?", False),
)  # fmt: skip


class Superlatives(Places):
    """Rules for superlatives in the words of one goal."""

    def superlatives(self, at: int) -> Iterator[tuple[Superlative, int]]:
        """Yield what stands before a noun or behind "is the": "heaviest", "last seen"."""
        word = self.items.word(at)
        if word.endswith("est") and word in ADJECTIVES:
            yield Superlative(*ADJECTIVES[word]), at + 1
        for pattern, is_most in _SEEN:
            for end in self.items.ends(at, pattern):
                yield Superlative("seen", is_most), end
        for pattern, is_most in _NEAR:
            for end in self.items.ends(at, pattern):
                yield Superlative("distance", is_most), end
                for start in (end, *self.items.ends(end, "to|from")):
                    for place, after in self._references(start):
                        yield Superlative("distance", is_most, place), after

    def comparatives(self, at: int) -> Iterator[tuple[Superlative, int]]:
        """Yield "heavier" and "heavier of the two", which choose one of two things."""
        word = self.items.word(at)
        if word.endswith("er") and word in ADJECTIVES and self.items.word(at + 1) != "than":
            yield Superlative(*ADJECTIVES[word]), at + 1
            yield from ((Superlative(*ADJECTIVES[word]), end)
                        for end in self.items.ends(at + 1, "of DET two?"))  # fmt: skip

    def _references(self, at: int) -> Iterator[tuple[Place, int]]:
        """Yield what a distance can count from: one thing, robot or place."""
        for place, end in self.places(at):
            if len(place.names) == 1 and place.owner is None:
                yield place, end
        for phrase, end in self.phrases(at):  # "closest to the ball": one thing of a kind
            is_single = phrase.is_definite and phrase.quantity is None and not phrase.is_plural
            if is_single and any(name.role("kind") for name in phrase.heads):
                yield Place(holds=phrase), end

    def superlative_after(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with what stands behind its noun: "(the cup) nearest to the jug"."""
        stated = phrase.superlative
        if stated is not None:
            if stated.measure == "distance" and stated.to is None:  # "the nearest cup to the jug"
                for start in self.items.ends(at, "to|from"):
                    for place, end in self._references(start):
                        yield replace(phrase, superlative=replace(stated, to=place)), end
            return
        starts = (at, *self.items.ends(at, ",? that|which is|are|lies|stands the?"),
                  *self.items.ends(at, ",? that|which was|were"),
                  *self.items.ends(at, ",? that|which has|have been"))  # fmt: skip
        for start in starts:
            for superlative, end in self.superlatives(start):
                # Without a verb, "the cup heaviest" is nobody's English.
                if start > at or superlative.measure in ("distance", "seen"):
                    yield replace(phrase, superlative=superlative), end
        for word, is_most in (("most", True), ("least", False)):
            for end in self.items.ends(at, f",? that|which weighs|weigh the? {word}"):
                yield replace(phrase, superlative=Superlative("mass", is_most)), end
        for end in self.items.ends(at, ",? that|which? you|I|we saw|spotted last|latest"):
            yield replace(phrase, superlative=Superlative("seen", True)), end

    def whichever(self, at: int) -> Iterator[int]:
        """Yield the words where the noun of "whichever (of the) cups is the heaviest" begins."""
        yield from self.items.ends(at, "whichever|whatever")
        for end in self.items.ends(at, "whichever of DET"):
            yield end
            yield from (after for _, after in self.numbers(end))

    def chosen(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with "is the heaviest" behind it, which chooses one of its things."""
        for start in self.items.ends(at, "is|was|lies|stands the?"):
            for superlative, end in self.superlatives(start):
                single = replace(phrase, superlative=superlative, quantity=Quantity("some", 1))
                yield single, end
                yield from ((single, after) for after in self.items.ends(end, "one"))
            for superlative, end in self.comparatives(start):
                of_two = Quantity("some", 1, 2)
                yield replace(phrase, superlative=superlative, quantity=of_two), end

    def compared(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with a bound on a measure: "heavier than 300 g", "weighing over 1 kg"."""
        for pattern in ("that weigh|weighs", "which weigh|weighs", "weighing",
                        "with a? mass|weight of?"):  # fmt: skip
            for start in self.items.ends(at, pattern):
                for above, is_above in _ABOVE:
                    for end in self.items.ends(start, above):
                        yield from self._value(phrase, end, "mass", is_above)
        word = self.items.word(at)
        if word in ADJECTIVES and word.endswith("er"):
            measure, is_above = ADJECTIVES[word]
            for end in self.items.ends(at + 1, "than"):
                yield from self._value(phrase, end, measure, is_above)
        for pattern, is_above in _ABOVE:
            for end in self.items.ends(at, pattern):
                # Without an adjective only a mass is clear: 5 cm may be any of three sides.
                yield from self._value(phrase, end, "mass", is_above)

    def _value(
        self, phrase: Phrase, at: int, measure: str, is_above: bool
    ) -> Iterator[tuple[Phrase, int]]:
        yield from self._than_reference(phrase, at, measure, is_above)
        word, unit = self.items.word(at), UNITS.get(self.items.word(at + 1))
        number = word.replace(",", ".")
        if unit is None or not number.replace(".", "", 1).isdecimal():
            return
        dimension, factor = unit
        if dimension == ("mass" if measure == "mass" else "length") and measure != "size":
            comparison = Comparison(measure, is_above, float(number) * factor)
            yield replace(phrase, comparisons=(*phrase.comparisons, comparison)), at + 2

    def _than_reference(
        self, phrase: Phrase, at: int, measure: str, is_above: bool
    ) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with the measure of one thing as its bound: "heavier than the jug"."""
        if self.items.word(at - 1) != "than":
            return
        for than, end in self.phrases(at):
            is_single = than.quantity is None and than.heads and not (than.is_plural or than.others)
            if is_single and not than.comparisons:
                comparison = Comparison(measure, is_above, 0.0, than)
                yield replace(phrase, comparisons=(*phrase.comparisons, comparison)), end
