"""Sentences: clauses in order, on conditions, with what one of them leaves to the others.

A sentence is read in every way that the grammar has. Where two ways come to different goals in the
world as it is, the sentence is refused with both: what is taken for another goal is carried out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

from rtask.errors import UsageError
from rtask.tasks.language.grammar.clause import Clause
from rtask.tasks.language.grammar.clauses import Clauses
from rtask.tasks.language.grammar.frames import courtesies
from rtask.tasks.language.grammar.units import Unit, Units, is_separate, resolved_deeds
from rtask.tasks.language.items import Items
from rtask.tasks.language.lexicon import CLASSES
from rtask.tasks.language.meaning import Condition, Deed, Phrase, Quantity

__all__ = ["Reading", "Unclear", "readings"]

_MAX_READINGS = 2000
_STOPS = (";", ".", "!", "?")


class Unclear(UsageError):
    """A sentence can be read in too many ways."""


@dataclass(frozen=True)
class Reading:
    """One way in which a sentence can be read: deeds, each with the conditions on it."""

    deeds: tuple[tuple[Deed, tuple[tuple[Condition, bool], ...]], ...]


def readings(items: Items) -> list[Reading]:
    """Return every way in which the words of a goal can be read; empty for none.

    Raises
    ------
    Unclear
        There are too many.
    """
    matches: dict[Reading, None] = {}
    for units in _Program(items).units(0, frozenset()):
        deeds = resolved_deeds(units)
        if deeds is not None:
            matches.setdefault(Reading(deeds))
    return list(matches)


class _Program:
    """Rules for whole texts."""

    def __init__(self, items: Items) -> None:
        self.items, self.clauses = items, Clauses(items)
        self._read: dict[tuple[int, frozenset[tuple[Condition, bool]]], list[Units]] = {}

    def units(self, at: int, conditions: frozenset[tuple[Condition, bool]]) -> list[Units]:
        """Return every way to read the clauses of the rest of a text.

        Raises
        ------
        Unclear
            There are too many.
        """
        # Kept, as each way to read what stands before goes on with all of these.
        if (at, conditions) not in self._read:
            ways = list(islice(self._units(at, conditions), _MAX_READINGS))
            if len(ways) == _MAX_READINGS:
                raise Unclear("it can be read in too many ways: say it in shorter sentences")
            self._read[at, conditions] = ways
        return self._read[at, conditions]

    def _units(self, at: int, conditions: frozenset[tuple[Condition, bool]]) -> Iterator[Units]:
        for start in courtesies(self.items, at):
            if start == len(self.items):
                continue
            for units, end in self._unit(start, tuple(conditions)):
                inherited = units[0].conditions if units else ()
                yield from self._rest(units, end, inherited)

    def _rest(
        self, units: Units, at: int, conditions: tuple[tuple[Condition, bool], ...]
    ) -> Iterator[Units]:
        items = self.items
        if all(word in (*_STOPS, ",", "?") for word in items.words[at:]):
            yield units
            return
        begin = next((n for n in range(at, len(items)) if items.word(n) not in (*_STOPS, ",")), at)
        if len(items) in courtesies(items, begin):  # "...? Thanks"
            yield units
            return
        limits = units[-1].is_limit
        for end, is_stop in (
            *self._separators(at),
            *((at + 1, False),) * (limits and items.word(at) == ":"),
        ):
            going_on = frozenset() if is_stop else frozenset(conditions)
            for rest in self.units(end, going_on):
                if is_separate((units[-1], rest[0])):
                    yield units + rest
            for begin in items.ends(end, "otherwise|else ,?"):
                if len(conditions) == 1:
                    ((condition, is_due),) = conditions
                    for rest in self.units(begin, frozenset([(condition, not is_due)])):
                        yield units + rest

    def _separators(self, at: int) -> Iterator[tuple[int, bool]]:
        """Yield where the next clause begins, and whether a sentence ends before it."""
        word = self.items.word(at)
        if word in _STOPS:
            for end in (at + 1, *self.items.ends(at + 1, "and")):
                yield end, True
        if word == ",":
            for end in (at + 1, *self.items.ends(at + 1, "and|but")):
                yield end, False
        if word in ("and", "but"):
            yield at + 1, False
        if word in CLASSES["LATER"]:
            yield at, False

    def _unit(
        self, at: int, conditions: tuple[tuple[Condition, bool], ...]
    ) -> Iterator[tuple[Units, int]]:
        yield from self._limited(at, conditions)
        yield from self._conditional(at, conditions)
        yield from self._in_order(at, conditions)
        yield from self._given(at, conditions)
        for clause, end in self.clauses.clauses(at):
            unit = Unit(clause, clause.order == "then", conditions)
            yield (unit,), end
            yield from self._trailing(unit, end)
        for start in self.items.ends(
            at, "sort|put|move|place"
        ):  # "sort the cups: the red ones ..."
            for phrases, end in self.clauses.phrases.lists(start):
                topics = tuple(Deed("put", phrase) for phrase in phrases)
                for begin in self.items.ends(end, ":"):
                    topic = Clause(topics, has_verb=True, is_topic=True)
                    for clause, after in self.clauses.clauses(begin):
                        yield (Unit(topic), Unit(clause, False, conditions)), after
        for start in self.items.ends(at, "for each|every|all"):  # "for each red cup: put it ..."
            for phrase, end in self.clauses.phrases.phrases(start - 1):
                if self.items.word(end) in (",", ":"):
                    topic = Clause((Deed("put", phrase),), is_open=True)
                    for clause, after in self.clauses.clauses(end + 1):
                        yield (Unit(topic), Unit(clause, False, conditions)), after

    def _limited(
        self, at: int, conditions: tuple[tuple[Condition, bool], ...]
    ) -> Iterator[tuple[Units, int]]:
        """Yield what may not be done, by itself or right before what is to be done."""
        for clause, end in self.clauses.limits(at):
            limit = Unit(clause, False, conditions)
            yield (limit,), end
            for order, after in self.clauses.clauses(end):
                if order.has_verb and self.items.word(end) not in CLASSES["LATER"]:
                    yield (limit, Unit(order, order.order == "then", conditions)), after
        for deeds, end in self.clauses.ordered(at):
            limit = Unit(Clause(deeds, has_verb=True), False, conditions)
            for order, after in self.clauses.clauses(end):
                if all(word in _STOPS for word in self.items.words[after:]):
                    yield (limit, Unit(order, False, conditions)), after

    def _given(
        self, at: int, conditions: tuple[tuple[Condition, bool], ...]
    ) -> Iterator[tuple[Units, int]]:
        """Yield "there is a can on the table: put it ...": what is told says only which is meant.

        If nothing is so, nothing fits, and the goal is refused.
        """
        for phrase, end in self._facts(at):
            topic = Unit(Clause((Deed("put", phrase),), is_open=True))
            for begin in self.items.ends(end, ",|;|:|.? and|so?"):
                for clause, after in self.clauses.clauses(begin) if begin > end else ():
                    words = [deed.phrase.anaphor for deed in clause.deeds]
                    if len(words) == 1 and words[0] not in ("", "all"):
                        yield (topic, Unit(clause, False, conditions)), after

    def _facts(self, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield things of which it is told where they are."""
        phrases, ends = self.clauses.phrases, self.items.ends
        for start in ends(at, "there is|are"):
            yield from ((p, end) for p, end in phrases.phrases(start) if p.places)
        for start in ends(at, "somebody|someone|I|we have? left"):
            yield from ((p, end) for p, end in phrases.phrases(start) if p.places)
        for phrase, end in phrases.phrases(at):
            for start in ends(end, "is|are currently|now|still? LIE?"):
                for place, after in phrases.at_places(start, "AT"):
                    yield replace(phrase, places=(*phrase.places, (place, False))), after

    def _conditional(
        self, at: int, conditions: tuple[tuple[Condition, bool], ...]
    ) -> Iterator[tuple[Units, int]]:
        """Yield "if there is a cup on the table, put it in the box"."""
        for pattern, is_due in (("if|provided that?", True), ("unless", False)):
            for start in self.items.ends(at, pattern):
                for condition, end in self.clauses.conditions(start):
                    if any(p is not None and p.is_elided for p in (condition.phrase,)):
                        continue
                    both = (*conditions, (condition, is_due))
                    for clause, after in self._consequences(end):
                        yield (Unit(clause, clause.order == "then", both),), after

    def _consequences(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield clauses after a subordinate one: behind a mark, or beginning with a verb."""
        for begin in self.items.ends(at, ",? then?"):
            for clause, end in self.clauses.clauses(begin):
                if begin > at or clause.has_verb:
                    yield clause, end

    def _trailing(self, unit: Unit, at: int) -> Iterator[tuple[Units, int]]:
        """Yield a clause with what is said after it: a condition, an order, what comes first."""
        ends = self.items.ends
        for start in (at, *ends(at, "but|and")):
            for clause, end in self.clauses.limits(start):
                yield (unit, Unit(clause, False, unit.conditions)), end
        for pattern, is_due in ((",? if|provided that?", True), (",? unless", False)):
            for start in ends(at, pattern):
                for condition, end in self.clauses.conditions(start):
                    # Of several deeds, which hang on it is not said.
                    if self._is_last(end):
                        both = (*unit.conditions, (condition, is_due))
                        yield (replace(unit, conditions=both),), end
        for start in ends(at, ",? before you?"):
            for clause, end in self._finished(start):
                yield (unit, Unit(clause, True, unit.conditions)), end
        for start in (*ends(at, ",? after|once|when"), *ends(at, ",? as soon as")):
            for clause, end in self._reached(start):
                yield (Unit(clause, False, unit.conditions), replace(unit, is_later=True)), end
        for start in ends(at, ",? starting|beginning with"):
            for phrases, end in self.clauses.phrases.lists(start):
                yield (replace(unit, firsts=phrases),), end
        for start in ends(at, ","):
            for phrases, end in self.clauses.phrases.lists(start):
                for after in ends(end, "first"):
                    yield (replace(unit, firsts=phrases),), after

    def _is_last(self, at: int) -> bool:
        """Return whether a sentence ends here, which began with one clause."""
        return self.items.word(at) in ("", *_STOPS)

    def _in_order(
        self, at: int, conditions: tuple[tuple[Condition, bool], ...]
    ) -> Iterator[tuple[Units, int]]:
        """Yield "before you clear the table, put the jug away" and its like."""
        ends = self.items.ends
        for pattern, is_before in (
            ("before you?", True),
            ("after|once|when you?", False),
            ("as soon as you?", False),
        ):
            for start in ends(at, pattern):
                for clause, end in self._finished(start):
                    for other, after in self._consequences(end):
                        first, second = (other, clause) if is_before else (clause, other)
                        yield (Unit(first, False, conditions),
                               Unit(second, True, conditions)), after  # fmt: skip
        for start in ends(at, "start|begin|starting|beginning with"):
            for phrases, end in self.clauses.phrases.lists(start):
                for begin in ends(end, ":|,|and"):
                    for clause, after in self.clauses.clauses(begin):
                        yield (Unit(clause, False, conditions, phrases),), after

    def _finished(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield a deed, or the state that is there once it is done: "the cans are in the box"."""
        yield from self.clauses.clauses(at)
        yield from self._reached(at)

    def _reached(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield a state that is to be reached: "the cans are in the box", "the table is clear"."""
        for phrases, end in self.clauses.phrases.lists(at):
            for start in self.items.ends(end, "is|are PLACED?"):
                for place, after in self.clauses.phrases.destinations(start):
                    deeds = tuple(Deed("put", phrase, place) for phrase in phrases)
                    yield Clause(deeds, has_verb=True), after
        for place, end in self.clauses.phrases.places(at):
            for after in self.items.ends(end, "is|has been? EMPTY"):
                everything = Phrase(is_generic=True, is_plural=True, quantity=Quantity("all"))
                yield Clause((Deed("away", everything, source=place),), has_verb=True), after
