"""Grammar of what takes things away from a place: clear, empty, remove, take off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from rtask.tasks.language.grammar.clause import EVERYTHING, Clause, away_from, clause_of
from rtask.tasks.language.grammar.conditions import Conditions
from rtask.tasks.language.meaning import Phrase, Place, Quantity

__all__ = ["Removals"]


class Removals(Conditions):
    """Rules for removals in the words of one goal."""

    def placed(self, at: int) -> Iterator[tuple[Place, int]]:
        """Yield where to, with the little words that may follow it."""
        for place, end in self.phrases.destinations(at):
            yield place, end
            for after in self.items.ends(end, "too|only|in"):
                yield place, after
            for start in self.items.ends(end, ",? and? not"):
                yield from ((place, last) for _, last in self.phrases.destinations(start))
            for start in (*self.items.ends(end, ",? instead of AT?"),
                          *self.items.ends(end, ",? rather than AT?")):  # fmt: skip
                yield from ((place, last) for _, last in self.phrases.places(start))
        for start in self.items.ends(at, "not"):  # "not into the left box but into the right one"
            for _, end in self.phrases.destinations(start):
                for begin in self.items.ends(end, ",? but"):
                    yield from self.phrases.destinations(begin)

    def cleared(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(clear) the table of pens except the red one"."""
        items = self.items
        for start in (at, *items.ends(at, "up|out|off|away")):
            for place, end in self.phrases.places(start):
                for last in (end, *items.ends(end, "up|out|off|completely")):
                    yield away_from((EVERYTHING,), place), last
                    for left_out, after in self.phrases.exceptions(last, (EVERYTHING,)):
                        everything = replace(EVERYTHING, left_out=left_out)
                        yield away_from((everything,), place), after
                yield from self.rid(place, end)
                emptied = replace(EVERYTHING, places=((place, False),))
                for target, last in self.placed(end):  # "empty the tray into the box"
                    yield clause_of("put", (emptied,), target), last
                    for left_out, after in self.phrases.exceptions(last, (emptied,)):
                        less = replace(emptied, left_out=left_out)
                        yield clause_of("put", (less,), target), after
        # "Empty cups into the box" may be cups that are empty.
        is_tidying = not self.items.is_verb(at - 1, frozenset(("empty", "unload")))
        for begin in (at, *items.ends(at, "up|away")) if is_tidying else ():
            for phrases, end in self.phrases.lists(begin):  # "tidy up the pens into the left box"
                for last in (end, *items.ends(end, "up|away")):
                    for start in items.ends(last, "INTO"):
                        for target, after in self.phrases.places(start):
                            yield clause_of("put", phrases, target), after
        for first in (at, *items.ends(at, "away|out")):  # "clear the cups from the table"
            for phrases, end in self.phrases.lists(first):
                for begin in (*items.ends(end, "from|off"), *items.ends(end, "out of")):
                    for place, after in self.phrases.places(begin):
                        yield from self._away_but(phrases, place, after)

    def rid(self, place: Place, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(clear the table) of pens"."""
        for begin in self.items.ends(at, "of|from"):
            for phrases, after in self.phrases.lists(begin):
                if all(phrase.quantity in (None, Quantity("all")) for phrase in phrases):
                    every = tuple(replace(item, quantity=Quantity("all")) for item in phrases)
                    yield away_from(every, place), after

    def _away_but(
        self, phrases: tuple[Phrase, ...], place: Place, at: int
    ) -> Iterator[tuple[Clause, int]]:
        """Yield things that are to be elsewhere, with what is left out after that."""
        yield away_from(phrases, place), at
        for left_out, after in self.phrases.exceptions(at, phrases):
            less = tuple(replace(item, left_out=left_out) for item in phrases)
            yield away_from(less, place), after

    def taken_away(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(take) the cups off the table"."""
        for phrases, end in self.phrases.lists(at):
            for place, after in self.off(end):
                yield from self._away_but(phrases, place, after)
            if self.items.word(at - 1) in ("remove", "removing", "out", "away", "of", "lose"):
                sources = {source for p in phrases for source, is_not in p.places if not is_not}
                if len(sources) == 1 and all(phrase.places for phrase in phrases):
                    bare = tuple(replace(phrase, places=()) for phrase in phrases)
                    yield away_from(bare, next(iter(sources))), end

    def off(self, at: int) -> Iterator[tuple[Place, int]]:
        for pattern in ("off of?", "out of", "out? from"):
            for start in self.items.ends(at, pattern):
                if pattern == "out? from" and not self._is_removing(at):
                    continue
                yield from self.phrases.places(start)

    def _is_removing(self, at: int) -> bool:
        """Return whether "from" ends a removal: "remove the cups from", "take out ... from"."""
        before = self.items.words[:at]
        return not {"remove", "removing", "out", "away", "clear", "rid"}.isdisjoint(before)
