"""Grammar of conditions on the world as it is: "there is a cup on the table"."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from rtask.tasks.language.grammar.phrases import Phrases
from rtask.tasks.language.items import Items
from rtask.tasks.language.meaning import Condition, Quantity

__all__ = ["Conditions"]


class Conditions:
    """Rules for conditions in the words of one goal."""

    def __init__(self, items: Items) -> None:
        self.items, self.phrases = items, Phrases(items)

    def conditions(self, at: int) -> Iterator[tuple[Condition, int]]:
        """Yield conditions on the world as it is: "there is a cup on the table"."""
        ends = self.items.ends
        for start in ends(at, "there is|are"):
            for phrase, end in self.phrases.phrases(start):
                yield Condition(phrase), end
        for start in ends(at, "there is|are not any?"):
            for phrase, end in self.phrases.phrases(start):
                if phrase.quantity is None or phrase.quantity == Quantity("some", 1):
                    yield Condition(replace(phrase, quantity=Quantity("no"))), end
        for start in ends(at, "AT"):  # "if on the table a can stands"
            for place, end in self.phrases.places(start):
                for begin in ends(end, "is|are?"):
                    for phrase, last in self.phrases.phrases(begin):
                        there = replace(phrase, places=(*phrase.places, (place, False)))
                        if begin > end:
                            yield Condition(there), last
                        else:
                            yield from ((Condition(there), x) for x in ends(last, "LIE|is|are"))
        for place, end in self.phrases.places(at):  # "if the shelf contains a ball"
            for start in ends(end, "contains|holds|has"):
                for phrase, last in self.phrases.phrases(start):
                    there = replace(phrase, places=(*phrase.places, (place, False)))
                    for after in (last, *ends(last, "on|in it")):
                        yield Condition(there), after
        for phrase, end in self.phrases.phrases(at):
            for start in ends(end, "is|are still|already|currently?"):
                is_not = False
                for begin in (start, *ends(start, "not")):
                    is_not = begin > start
                    for quality, after in self.phrases.qualities(begin):
                        yield Condition(phrase, quality=quality, is_not=is_not), after
        for place, end in self.phrases.places(at):
            for after in ends(end, "is|are still|already? EMPTY already|still|now?"):
                yield Condition(None, place, is_empty=True), after
            for after in ends(end, "is|are not EMPTY"):
                yield Condition(None, place, is_empty=True, is_not=True), after
