"""Sentences: clauses in order, on conditions, with what one of them leaves to the others.

A sentence is read in every way that the grammar has. Where two ways come to different goals in the
world as it is, the sentence is refused with both: what is taken for another goal is carried out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from rtask.errors import UsageError
from rtask.tasks.language.clauses import Clause, Clauses
from rtask.tasks.language.frames import courtesies
from rtask.tasks.language.items import Items
from rtask.tasks.language.lexicon import CLASSES
from rtask.tasks.language.meaning import Condition, Deed, Phrase, Place, Quantity

__all__ = ["Reading", "Unclear", "readings"]

_MAX_READINGS = 3000
_STOPS = (";", ".", "!")


class Unclear(UsageError):
    """A sentence can be read in too many ways."""


@dataclass(frozen=True)
class _Unit:
    """A clause in its place: after which separator, under which conditions.

    Parameters
    ----------
    is_later
        What it says is begun after what stands before it.
    conditions
        Each with whether the goal is to be reached if it holds.
    """

    clause: Clause
    is_later: bool = False
    conditions: tuple[tuple[Condition, bool], ...] = ()
    firsts: tuple[Phrase, ...] = ()


@dataclass(frozen=True)
class Reading:
    """One way in which a sentence can be read: deeds, each with the conditions on it."""

    deeds: tuple[tuple[Deed, tuple[tuple[Condition, bool], ...]], ...]


_Units = tuple[_Unit, ...]


def readings(items: Items) -> list[Reading]:
    """Return every way in which the words of a goal can be read; empty for none.

    Raises
    ------
    Unclear
        There are too many.
    """
    matches: dict[Reading, None] = {}
    for number, units in enumerate(_Program(items).units(0, frozenset())):
        if number >= _MAX_READINGS:
            raise Unclear("it can be read in too many ways: say it in shorter sentences")
        deeds = _resolved(units)
        if deeds is not None:
            matches.setdefault(Reading(deeds))
    return list(matches)


class _Program:
    """Rules for whole texts."""

    def __init__(self, items: Items) -> None:
        self.items, self.clauses = items, Clauses(items)

    def units(self, at: int, conditions: frozenset[tuple[Condition, bool]]) -> Iterator[_Units]:
        """Yield the clauses of the rest of a text."""
        for start in courtesies(self.items, at):
            if start == len(self.items):
                continue
            for units, end in self._unit(start, tuple(conditions)):
                inherited = units[0].conditions if units else ()
                yield from self._rest(units, end, inherited)

    def _rest(
        self, units: _Units, at: int, conditions: tuple[tuple[Condition, bool], ...]
    ) -> Iterator[_Units]:
        items = self.items
        if all(word in (*_STOPS, ",", "?") for word in items.words[at:]):
            yield units
            return
        for end, is_stop in self._separators(at):
            going_on = frozenset() if is_stop else frozenset(conditions)
            for rest in self.units(end, going_on):
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
        if word == "and":
            yield at + 1, False
        if word in CLASSES["LATER"]:
            yield at, False

    def _unit(
        self, at: int, conditions: tuple[tuple[Condition, bool], ...]
    ) -> Iterator[tuple[_Units, int]]:
        yield from self._conditional(at, conditions)
        yield from self._in_order(at, conditions)
        for clause, end in self.clauses.clauses(at):
            unit = _Unit(clause, clause.order == "then", conditions)
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
                        yield (_Unit(topic), _Unit(clause, False, conditions)), after
        for start in self.items.ends(at, "for each|every|all"):  # "for each red cup: put it ..."
            for phrase, end in self.clauses.phrases.phrases(start - 1):
                if self.items.word(end) in (",", ":"):
                    topic = Clause((Deed("put", phrase),), is_open=True)
                    for clause, after in self.clauses.clauses(end + 1):
                        yield (_Unit(topic), _Unit(clause, False, conditions)), after

    def _conditional(
        self, at: int, conditions: tuple[tuple[Condition, bool], ...]
    ) -> Iterator[tuple[_Units, int]]:
        """Yield "if there is a cup on the table, put it in the box"."""
        for pattern, is_due in (("if|provided that?", True), ("unless", False)):
            for start in self.items.ends(at, pattern):
                for condition, end in self.clauses.conditions(start):
                    if any(p is not None and p.is_elided for p in (condition.phrase,)):
                        continue
                    both = (*conditions, (condition, is_due))
                    for clause, after in self._consequences(end):
                        yield (_Unit(clause, clause.order == "then", both),), after

    def _consequences(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield clauses after a subordinate one: behind a mark, or beginning with a verb."""
        for begin in self.items.ends(at, ",? then?"):
            for clause, end in self.clauses.clauses(begin):
                if begin > at or clause.has_verb:
                    yield clause, end

    def _trailing(self, unit: _Unit, at: int) -> Iterator[tuple[_Units, int]]:
        """Yield a clause with what is said after it: a condition, an order, what comes first."""
        ends = self.items.ends
        for pattern, is_due in ((",? if|provided that?", True), (",? unless", False)):
            for start in ends(at, pattern):
                for condition, end in self.clauses.conditions(start):
                    # Of several deeds, which hang on it is not said.
                    if self._is_last(end):
                        both = (*unit.conditions, (condition, is_due))
                        yield (replace(unit, conditions=both),), end
        for start in ends(at, ",? before you?"):
            for clause, end in self.clauses.clauses(start):
                yield (unit, _Unit(clause, True, unit.conditions)), end
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
    ) -> Iterator[tuple[_Units, int]]:
        """Yield "before you clear the table, put the jug away" and its like."""
        ends = self.items.ends
        for pattern, is_before in (("before you?", True), ("after|once you?", False)):
            for start in ends(at, pattern):
                for clause, end in self._finished(start, is_before):
                    for other, after in self._consequences(end):
                        first, second = (other, clause) if is_before else (clause, other)
                        yield (_Unit(first, False, conditions),
                               _Unit(second, True, conditions)), after  # fmt: skip
        for start in ends(at, "start|begin|starting|beginning with"):
            for phrases, end in self.clauses.phrases.lists(start):
                for begin in ends(end, ":|,|and"):
                    for clause, after in self.clauses.clauses(begin):
                        yield (_Unit(clause, False, conditions, phrases),), after

    def _finished(self, at: int, is_before: bool) -> Iterator[tuple[Clause, int]]:
        """Yield a deed, or the state that is there once it is done: "the cans are in the box"."""
        yield from self.clauses.clauses(at)
        if not is_before:
            for phrases, end in self.clauses.phrases.lists(at):
                for start in self.items.ends(end, "is|are"):
                    for place, after in self.clauses.phrases.destinations(start):
                        deeds = tuple(Deed("put", phrase, place) for phrase in phrases)
                        yield Clause(deeds, has_verb=True), after
            for place, end in self.clauses.phrases.places(at):
                for after in self.items.ends(end, "is|has been? EMPTY"):
                    everything = Phrase(is_generic=True, is_plural=True, quantity=Quantity("all"))
                    yield Clause((Deed("away", everything, source=place),), has_verb=True), after


_Resolved = tuple[tuple[Deed, tuple[tuple[Condition, bool], ...]], ...]


def _resolved(units: _Units) -> _Resolved | None:
    """Return the deeds of a text of which each says all by itself; None where that cannot be."""
    units = _without_topics(units) or ()
    if not units or not _is_separate(units):
        return None
    filled = _with_ends(list(units))
    if filled is None:
        return None
    resolved: list[tuple[Deed, tuple[tuple[Condition, bool], ...]]] = []
    topics: list[Deed] = []
    stage = 0
    for number, unit in enumerate(filled):
        if unit.clause.is_topic:
            topics += unit.clause.deeds
            continue
        is_later = unit.is_later and bool(number)
        was_first = bool(number) and filled[number - 1].clause.order == "first"
        stage += is_later or was_first
        conditions = unit.conditions
        for deed in unit.clause.deeds:
            own = replace(deed.phrase, anaphor="") if deed.phrase.anaphor == "all" else deed.phrase
            phrase = _with_heads(own, unit, topics, [done for done, _ in resolved])
            if phrase is not None and topics and not _is_within(phrase, topics):
                return None
            done = _in_place(replace(deed, phrase=phrase), unit, resolved) if phrase else None
            if done is None or not _is_sensible(done):
                return None
            done, conditions = _each(done, unit.conditions)
            for first in _first_ones(done, unit.firsts) or ():
                resolved.append((replace(first, stage=stage), conditions))
            stage += bool(unit.firsts)
            resolved.append((replace(done, stage=stage), conditions))
    return tuple(resolved)


def _first_ones(deed: Deed, firsts: tuple[Phrase, ...]) -> list[Deed]:
    """Return the deeds for those things of a deed that come first."""
    result = []
    for phrase in firsts:
        both = replace(
            deed.phrase, colours=deed.phrase.colours + phrase.colours,
            traits=deed.phrase.traits + phrase.traits,
            materials=deed.phrase.materials + phrase.materials,
            kinds_not=deed.phrase.kinds_not,
            heads=deed.phrase.heads if phrase.is_elided else deed.phrase.heads + phrase.heads,
        )  # fmt: skip
        result.append(replace(deed, phrase=both))
    return result


def _is_separate(units: _Units) -> bool:
    """Return whether clauses that only name things are no list, which is read as one."""
    for before, after in pairwise(units):
        is_bare = before.clause.is_open and not before.clause.order
        if is_bare and not after.is_later and not after.clause.has_verb:
            return False
        # What follows what is left out is left out as well: "except the cups, pens and the jug".
        leaves_out = any(deed.phrase.left_out for deed in before.clause.deeds)
        if leaves_out and after.clause.is_open and not (after.clause.has_verb or after.is_later):
            return False
    return True


def _without_topics(units: _Units) -> _Units | None:
    """Return clauses in which "it" and "them" are what the clause before, or a condition, names.

    "take the can and put it into the box" is one deed.
    """
    result: list[_Unit] = []
    for unit in units:
        anaphors = [d for d in unit.clause.deeds if d.phrase.anaphor not in ("", "all")]
        if not anaphors:
            result.append(unit)
            continue
        if len(anaphors) != 1 or len(unit.clause.deeds) != 1:
            return None
        before = result[-1] if result else None
        is_taken = before is not None and (
            before.clause.takes
            or (before.clause.is_open and not before.clause.has_verb)
            or all(deed.kind in ("hold", "away") for deed in before.clause.deeds)
        )
        if is_taken and before is not None:
            phrases = tuple(_from(deed) for deed in before.clause.deeds)
            deeds = tuple(replace(anaphors[0], phrase=phrase) for phrase in phrases)
            result[-1] = replace(
                unit,
                clause=replace(unit.clause, deeds=deeds),
                is_later=before.is_later,
                conditions=before.conditions or unit.conditions,
            )
            continue
        if before is not None and _are_opposite(before.conditions, unit.conditions):
            deeds = tuple(replace(anaphors[0], phrase=d.phrase) for d in before.clause.deeds)
            result.append(replace(unit, clause=replace(unit.clause, deeds=deeds)))
            continue
        asked = [item.phrase for item, _ in unit.conditions if item.phrase is not None]
        if len(asked) != 1 or (before is not None and before.conditions == unit.conditions):
            return None
        quality = next(item.quality for item, _ in unit.conditions if item.phrase is not None)
        phrase = asked[0]
        if quality is not None and phrase.quantity == Quantity("some", 1):
            # "if a cup is on the table, put it away" is about the one that is there.
            phrase = replace(phrase, places=phrase.places + quality.places)
        deed = replace(anaphors[0], phrase=phrase)
        result.append(replace(unit, clause=replace(unit.clause, deeds=(deed,))))
    return tuple(result)


_Conditions = tuple[tuple[Condition, bool], ...]


def _are_opposite(conditions: _Conditions, others: _Conditions) -> bool:
    """Return whether one of two holds exactly where the other does not: "otherwise"."""
    return bool(conditions) and tuple((c, not is_due) for c, is_due in conditions) == others


def _from(deed: Deed) -> Phrase:
    """Return the phrase of a deed, with the place that its things are taken away from."""
    if deed.kind != "away" or deed.source is None:
        return deed.phrase
    return replace(deed.phrase, places=(*deed.phrase.places, (deed.source, False)))


def _with_ends(units: list[_Unit]) -> list[_Unit] | None:
    """Return clauses of which those without a place of their own have that of their neighbours."""
    is_lent = False
    for at in range(len(units) - 2, -1, -1):
        unit, after = units[at], units[at + 1]
        # "two cups on the shelf, then one in the box" says where to twice.
        is_bare = not any(deed.phrase.places for deed in unit.clause.deeds) or any(
            deed.phrase.places for deed in after.clause.deeds
        )
        is_ended = not after.clause.is_open and not after.clause.has_verb
        if unit.clause.is_open and is_bare and is_ended:
            units[at] = _ending(unit, after.clause)
            is_lent |= at == len(units) - 2
    for at in range(1, len(units)):
        unit, before = units[at], units[at - 1]
        is_bare = not unit.clause.has_verb and not any(d.phrase.places for d in unit.clause.deeds)
        if unit.clause.is_open and is_bare and not before.clause.is_open:
            units[at] = _ending(unit, before.clause)
    if is_lent and [deed.phrase.anaphor for deed in units[-1].clause.deeds] == ["all"]:
        units.pop()  # "the cups first, the pens afterwards, all into the right box"
    return (
        None if any(unit.clause.is_open and not unit.clause.is_topic for unit in units) else units
    )


def _ending(unit: _Unit, clause: Clause) -> _Unit:
    """Return a clause that ends as another does."""
    model = clause.deeds[0]
    if model.kind != "put":
        return unit
    deeds = tuple(replace(deed, kind="put", target=model.target) for deed in unit.clause.deeds)
    return replace(unit, clause=replace(unit.clause, deeds=deeds, is_open=False))


def _is_within(phrase: Phrase, topics: list[Deed]) -> bool:
    """Return whether a phrase is about what a sentence was said to be about."""
    return any(phrase.heads == deed.phrase.heads for deed in topics)


def _with_heads(
    phrase: Phrase, unit: _Unit, topics: list[Deed], resolved: list[Deed]
) -> Phrase | None:
    """Return a phrase with the noun, and the others, that it leaves to its neighbours."""
    before = topics + resolved
    if phrase.others:
        return _other(phrase, before) if resolved else None
    if not phrase.is_elided:
        return phrase
    phrases = [deed.phrase for deed in unit.clause.deeds]
    following = phrases[phrases.index(phrase) + 1 :] if phrase in phrases else []
    preceding = phrases[: phrases.index(phrase)] if phrase in phrases else []
    whole = next((item for item in reversed(preceding) if not item.is_elided), None)
    if whole is not None:  # "one red cup and two blue ones"
        return replace(phrase, heads=whole.heads, is_generic=whole.is_generic, is_elided=False)
    model = next((item for item in following if not item.is_elided), None)
    if model is not None and phrase.is_described:
        return replace(phrase, heads=model.heads, is_generic=model.is_generic, is_elided=False,
                       is_plural=model.is_plural)  # fmt: skip
    if model is not None:
        return None
    if before and (phrase.quantity is not None or phrase.is_described):
        last = before[-1].phrase
        return replace(phrase, heads=last.heads, is_generic=last.is_generic, is_elided=False)
    if phrase.quantity == Quantity("all") and phrase.is_described:
        return replace(phrase, is_generic=True, is_elided=False)
    return None


def _other(phrase: Phrase, before: list[Deed]) -> Phrase | None:
    """Return "the rest" and "the other cups" with what they are the rest of."""
    if not (phrase.is_elided or (phrase.is_generic and not phrase.places)):
        return phrase
    last = before[-1].phrase
    is_part = last.quantity is not None and last.quantity.kind in ("some", "exactly", "share")
    if is_part or (phrase.is_elided and len({deed.phrase.heads for deed in before}) == 1):
        return replace(phrase, heads=last.heads, places=last.places, is_elided=False,
                       is_generic=last.is_generic, is_plural=True)  # fmt: skip
    if phrase.is_elided or any(deed.phrase.places for deed in before):
        return None  # the rest of those, or of all?
    return phrase


def _in_place(deed: Deed, unit: _Unit, resolved: Sequence[tuple[Deed, object]]) -> Deed | None:
    """Return a deed with the place that "there" and "it" stand for."""
    if deed.target is None or not deed.target.anaphor:
        return deed
    asked: set[Place] = set()
    for condition, _ in unit.conditions:
        places = [condition.place] if condition.place is not None else []
        for phrase in (condition.phrase, condition.quality):
            places += [place for place, _ in phrase.places] if phrase is not None else []
        asked.update(places)
    if not asked:
        done = [item.target or item.source for item, _ in resolved]
        asked = {place for place in done[-1:] if place is not None}
    return replace(deed, target=next(iter(asked))) if len(asked) == 1 else None


def _each(
    deed: Deed, conditions: tuple[tuple[Condition, bool], ...]
) -> tuple[Deed, tuple[tuple[Condition, bool], ...]]:
    """Return a deed on conditions that are about each of its things: "unless they are red"."""
    left = []
    for condition, is_due in conditions:
        phrase, quality = condition.phrase, condition.quality
        if phrase is None or not phrase.anaphor or quality is None:
            left.append((condition, is_due))
            continue
        is_not = is_due == condition.is_not
        own = deed.phrase
        own = replace(
            own, colours=own.colours + tuple((n, is_not) for n, _ in quality.colours),
            traits=own.traits + tuple((n, is_not) for n, _ in quality.traits),
            materials=own.materials + tuple((n, is_not) for n, _ in quality.materials),
            places=own.places + tuple((place, is_not) for place, _ in quality.places),
        )  # fmt: skip
        deed = replace(deed, phrase=own)
    return deed, tuple(left)


def _is_sensible(deed: Deed) -> bool:
    """Return whether a deed is one that can be asked for."""
    phrases = [deed.phrase] + ([deed.partner] if deed.partner is not None else [])
    for phrase in phrases:
        if phrase.anaphor or phrase.is_elided:
            return False
        if not (phrase.heads or phrase.is_generic):
            return False
        inner = [place for place, _ in phrase.places]
        if any(place.anaphor or place.holds is not None for place in inner):
            return False
        # What things are in or on now is a place, not a robot or another thing.
        if any(name.role("place") is None for place in inner for name in place.names):
            return False
    kind = deed.phrase.quantity.kind if deed.phrase.quantity is not None else ""
    if kind == "no" or (kind == "at_most" and deed.kind != "put"):
        return False
    if deed.kind == "put" and deed.target is None:
        return False
    if deed.target is not None and deed.target.names and not deed.target.names[0].role("place"):
        # "cup-1 on the can": neither of them is a place.
        return deed.target.names[0].role("robot") is not None or _carries(deed.target)
    return not (deed.source is not None and not all(
        name.role("place") for name in deed.source.names))  # fmt: skip


def _carries(place: Place) -> bool:
    return place.names[0].role("thing", "object") is not None
