"""Grammar of deeds: what is to be done with what, or how things are to be.

A clause that does not say where to, or what with, can have that of its neighbours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from rtask.asking.questions.words import stem
from rtask.tasks.language.frames import courtesies, requests, wishes
from rtask.tasks.language.items import Items
from rtask.tasks.language.lexicon import AWAY, CLASSES, GRASP, PUT, TAKE
from rtask.tasks.language.meaning import Condition, Deed, Phrase, Place, Quantity
from rtask.tasks.language.phrases import Phrases

__all__ = ["Clause", "Clauses"]

_PUT = PUT | {"keep"}
_CLEAR = frozenset(("clear", "empty", "tidy", "unload"))
_SWAP = frozenset(("swap", "exchange", "switch", "interchange"))
_EVERYTHING = Phrase(is_generic=True, is_plural=True, quantity=Quantity("all"))


@dataclass(frozen=True)
class Clause:
    """Deeds of one verb; open where they have neither a place nor another end yet.

    Parameters
    ----------
    is_open
        It says of things, but not what is to become of them.
    has_verb
        It begins with a verb of its own, so that its place is not that of the clause before.
    order
        "first" or "then" where it says so itself.
    takes
        It only says what to take: "take the can (and put it ...)".
    """

    deeds: tuple[Deed, ...]
    is_open: bool = False
    has_verb: bool = False
    order: str = ""
    takes: bool = False
    is_topic: bool = False


class Clauses:
    """Rules for the clauses in the words of one goal."""

    def __init__(self, items: Items) -> None:
        self.items, self.phrases = items, Phrases(items)
        self._read: dict[int, list[tuple[Clause, int]]] = {}

    def clauses(self, at: int) -> list[tuple[Clause, int]]:
        """Return every clause that can begin here, with the word after it."""
        if at not in self._read:
            matches: dict[tuple[Clause, int], None] = {}
            for clause, end in self._ordered(at):
                for after in courtesies(self.items, end):
                    matches.setdefault((clause, after))
            self._read[at] = list(matches)
        return self._read[at]

    def _ordered(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield clauses that say whether they are first or later, and those that do not."""
        ends = self.items.ends
        for clause, end in self._clause(at):
            yield clause, end
            for after in ends(end, "first"):
                yield replace(clause, order="first"), after
            for after in ends(end, "LATER"):
                yield replace(clause, order="then"), after
        for start in courtesies(self.items, at):
            for begin in ends(start, "first ,? MUST?"):
                for clause, end in self._clause(begin):
                    yield replace(clause, order="first"), end
            for begin in ends(start, "start|begin by"):
                for clause, end in self._commanded(begin):
                    yield replace(clause, order="first"), end
            for pattern in ("LATER ,?", "and? after that|this ,?", "and? after|before which"):
                for begin in ends(start, pattern):
                    for clause, end in self._clause(begin):
                        yield replace(clause, order="then"), end

    def _clause(self, at: int) -> Iterator[tuple[Clause, int]]:
        for start in requests(self.items, at):
            yield from self._commanded(start)
        for start in wishes(self.items, at):
            yield from self._wished(start)
        for start in courtesies(self.items, at):
            yield from self._stated(start)

    # Commands

    def _commanded(self, at: int) -> Iterator[tuple[Clause, int]]:
        items = self.items
        # "put me the bottles on the shelf", but "give me the ball" is to hand it to a person.
        is_giving = items.is_verb(at, frozenset(("give", "hand", "pass")))
        verb_end = next(items.ends(at + 1, "me"), at + 1) if not is_giving else at + 1
        verb_end = next(items.ends(verb_end, "POLITE"), verb_end)
        if items.is_verb(at, _PUT):
            for end in (verb_end, *items.ends(verb_end, "back|up|down|together|away")):
                yield from self._put(end, stem(items.word(at)), items.text(at, end))
        if items.is_verb(at, GRASP):
            for start in (at + 1, *items.ends(at + 1, "up")):
                for phrases, end in self.phrases.lists(start):
                    for after in (end, *items.ends(end, "up")):
                        yield _clause("hold", phrases), after
            yield from self._put(at + 1, "pick", "")
        if items.is_verb(at, _CLEAR):
            yield from self._cleared(at + 1)
        if items.is_verb(at, _SWAP):
            yield from self._swapped(at + 1)
        if items.is_verb(at, frozenset(("remove",))):
            yield from self._taken_away(at + 1)
        if items.is_verb(at, AWAY):
            for start in (at + 1, *items.ends(at + 1, "out|away")):
                yield from self._taken_away(start)
        for start in items.ends(at, "leave|let|keep"):  # "leave nothing on the table"
            for phrase, end in self.phrases.phrases(start):
                if phrase.quantity is not None and phrase.quantity.kind == "no":
                    for after in items.ends(end, "be? left?"):
                        yield from self._there_at(phrase, after)
        if items.is_verb(at, frozenset(("return",))):
            yield from self._put_back(at + 1)
        if items.is_verb(at, frozenset(("give", "hand", "pass", "bring", "fetch"))):
            robot = items.name(at + 1, "robot")  # "hand nao-1 the pen"
            if robot is not None:
                for phrases, end in self.phrases.lists(robot.mentions[0].end):
                    yield _clause("put", phrases, Place((robot,))), end
        if items.is_verb(at, frozenset(("fill", "load", "stock"))):
            for place, end in self.phrases.places(at + 1):
                for start in items.ends(end, "with"):
                    for phrases, after in self.phrases.lists(start):
                        yield _clause("put", phrases, place), after
        yield from self._verb_last(at)

    def _put(self, at: int, verb: str, words: str) -> Iterator[tuple[Clause, int]]:
        """Yield "(put) the cups into the box", and "(put) into the box the cups"."""
        lists, places = self.phrases.lists, self.phrases.destinations
        for phrases, end in lists(at):
            for clause, after in self._put_there(phrases, end):
                yield replace(clause, has_verb=True), after
            for start in self.items.ends(end, "anywhere|somewhere else? but|except|than AT?"):
                for place, after in self.phrases.places(start):
                    yield _away(phrases, place), after
            takes = verb in TAKE
            yield Clause(_deeds("put", phrases), is_open=True, has_verb=True, takes=takes), end
            if verb != "pick":
                yield from self._back(phrases, end, "back" in words.split())
        for place, end in places(at):
            for phrases, after in lists(end):
                yield _clause("put", phrases, place), after

    def _put_there(self, phrases: tuple[Phrase, ...], at: int) -> Iterator[tuple[Clause, int]]:
        """Yield a list with where to, and with what is left out after that."""
        # "two cups on the shelf and one in the box" are two clauses, and no list.
        is_parallel = any(p.places for p in phrases[:-1]) and not phrases[-1].places
        if is_parallel and self.items.word(at) in CLASSES["AT"]:
            return
        for place, end in self._placed(at):
            yield Clause(_deeds("put", phrases, place)), end
            for left_out, after in self.phrases.exceptions(end, phrases):
                but = tuple(replace(item, left_out=left_out) for item in phrases)
                yield Clause(_deeds("put", but, place)), after

    def _placed(self, at: int) -> Iterator[tuple[Place, int]]:
        """Yield where to, with the little words that may follow it."""
        for place, end in self.phrases.destinations(at):
            yield place, end
            for after in self.items.ends(end, "too|only|in"):
                yield place, after
            for start in self.items.ends(end, ",? and? not"):
                yield from ((place, last) for _, last in self.phrases.destinations(start))
            for start in self.items.ends(end, "instead of AT?"):
                yield from ((place, last) for _, last in self.phrases.places(start))
        for start in self.items.ends(at, "not"):  # "not into the left box but into the right one"
            for _, end in self.phrases.destinations(start):
                for begin in self.items.ends(end, ",? but"):
                    yield from self.phrases.destinations(begin)

    def _back(
        self, phrases: tuple[Phrase, ...], at: int, is_back: bool
    ) -> Iterator[tuple[Clause, int]]:
        """Yield "(put the can) back where it was"."""
        starts = [at] * is_back + list(self.items.ends(at, "back"))
        for start in starts:
            yield _clause("back", phrases), start
            for end in self.items.ends(start, "to? where it|they was|were before|earlier?"):
                yield _clause("back", phrases), end

    def _put_back(self, at: int) -> Iterator[tuple[Clause, int]]:
        for phrases, end in self.phrases.lists(at):
            yield _clause("back", phrases), end
            yield from self._back(phrases, end, is_back=True)

    def _cleared(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(clear) the table of pens except the red one"."""
        items = self.items
        for start in (at, *items.ends(at, "up|out")):
            for place, end in self.phrases.places(start):
                for last in (end, *items.ends(end, "up|out|off|completely")):
                    yield _away((_EVERYTHING,), place), last
                    for left_out, after in self.phrases.exceptions(last, (_EVERYTHING,)):
                        everything = replace(_EVERYTHING, left_out=left_out)
                        yield _away((everything,), place), after
                yield from self._rid(place, end)
                emptied = replace(_EVERYTHING, places=((place, False),))
                for target, last in self._placed(end):  # "empty the tray into the box"
                    yield _clause("put", (emptied,), target), last
        for phrases, end in self.phrases.lists(at):  # "clear the cups from the table"
            for begin in items.ends(end, "from|off"):
                for place, after in self.phrases.places(begin):
                    yield from self._away_but(phrases, place, after)

    def _rid(self, place: Place, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(clear the table) of pens"."""
        for begin in self.items.ends(at, "of|from"):
            for phrases, after in self.phrases.lists(begin):
                if all(phrase.quantity in (None, Quantity("all")) for phrase in phrases):
                    every = tuple(replace(item, quantity=Quantity("all")) for item in phrases)
                    yield _away(every, place), after

    def _away_but(
        self, phrases: tuple[Phrase, ...], place: Place, at: int
    ) -> Iterator[tuple[Clause, int]]:
        """Yield things that are to be elsewhere, with what is left out after that."""
        yield _away(phrases, place), at
        for left_out, after in self.phrases.exceptions(at, phrases):
            yield _away(tuple(replace(item, left_out=left_out) for item in phrases), place), after

    def _swapped(self, at: int) -> Iterator[tuple[Clause, int]]:
        for phrase, end in self.phrases.phrases(at):
            for start in self.items.ends(end, "and|with|for"):
                for partner, after in self.phrases.phrases(start):
                    deed = Deed("swap", phrase, partner=partner)
                    for last in (after, *self.items.ends(after, "around|over|places")):
                        yield Clause((deed,), has_verb=True), last
        for start in self.items.ends(at, "the? places|positions of"):
            yield from self._swapped(start)

    def _taken_away(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(take) the cups off the table"."""
        for phrases, end in self.phrases.lists(at):
            for place, after in self._off(end):
                yield from self._away_but(phrases, place, after)
            if self.items.word(at - 1) == "remove" or self.items.word(at - 1) in ("out", "away"):
                sources = {source for p in phrases for source, is_not in p.places if not is_not}
                if len(sources) == 1 and all(phrase.places for phrase in phrases):
                    bare = tuple(replace(phrase, places=()) for phrase in phrases)
                    yield _away(bare, next(iter(sources))), end

    def _off(self, at: int) -> Iterator[tuple[Place, int]]:
        for pattern in ("off of?", "out of", "out? from"):
            for start in self.items.ends(at, pattern):
                if pattern == "out? from" and not self._is_removing(at):
                    continue
                yield from self.phrases.places(start)

    def _is_removing(self, at: int) -> bool:
        """Return whether "from" ends a removal: "remove the cups from", "take out ... from"."""
        before = self.items.words[:at]
        return "remove" in before or "out" in before or "away" in before or "clear" in before

    def _verb_last(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "the pens in the left box put", as speakers of other languages say it."""
        for phrases, end in self.phrases.lists(at):
            for place, after in self._placed(end):
                if self.items.is_verb(after, _PUT):
                    yield _clause("put", phrases, place), after + 1

    # States

    def _wished(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield what a wish is about: "that all cups are in the box", "the cups gone"."""
        for phrases, end in self.phrases.lists(at):
            for start in (end, *self.items.ends(end, "MUST|BE")):
                yield from self._state(phrases, start)
            for place, after in self._placed(end):
                for last in self.items.ends(after, "BE|LIE|go|goes|PLACED?"):
                    yield _clause("put", phrases, place), last
        for start in self.items.ends(at, "there BE"):
            yield from self._there(start)
        for place, end in self.phrases.places(at):
            for last in self.items.ends(end, "MUST|BE? be? EMPTY"):
                yield _away((_EVERYTHING,), place), last
                yield from self._rid(place, last)
        yield from self._none(at)

    def _stated(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield how things are to be, or just which things and where."""
        items = self.items
        for phrases, end in self.phrases.lists(at):
            yield Clause(_deeds("put", phrases), is_open=True), end
            yield from self._put_there(phrases, end)
            for start in self._duty(end):
                yield from self._state(phrases, start)
            for place, after in self._off(end):
                yield _away(phrases, place), after
        for place, end in self.phrases.destinations(at):  # "in the left box goes the ball"
            for start in items.ends(end, "go|goes|belong|belongs?"):
                for phrases, after in self.phrases.lists(start):
                    yield Clause(_deeds("put", phrases, place)), after
        for start in items.ends(at, "there MUST be"):
            yield from self._there(start)
        for start in items.ends(at, "from|off"):  # "from the table should all away"
            for place, end in self.phrases.places(start):
                for begin in items.ends(end, "MUST"):
                    for phrases, after in self.phrases.lists(begin):
                        for last in items.ends(after, "be? away|gone|removed|off"):
                            yield _away(phrases, place), last
        for place, end in self.phrases.places(at):
            yield from self._containing(place, end)
        for start in items.ends(at, "can|could"):  # "could the cups go into the box?"
            for phrases, end in self.phrases.lists(start):
                for begin in (*items.ends(end, "go"), *items.ends(end, "be PLACED")):
                    for place, after in self._placed(begin):
                        yield _clause("put", phrases, place), after
        for start in items.ends(at, "there MUST not be any?"):
            for phrase, end in self.phrases.phrases(start):
                if phrase.quantity is None:
                    yield from self._there_at(replace(phrase, quantity=Quantity("no")), end)
        for start in items.ends(at, "I do not WANT|want"):
            for phrase, end in self.phrases.phrases(start):
                if phrase.quantity is None or phrase.quantity == Quantity("some", 1):
                    yield from self._there_at(replace(phrase, quantity=Quantity("no")), end)
        yield from self._none(at)

    def _containing(self, place: Place, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(the table should) be empty", "be free of cans", "hold all cups"."""
        for start in self._duty(at):
            for end in self.items.ends(start, "be EMPTY"):
                yield _away((_EVERYTHING,), place), end
                yield from self._rid(place, end)
            for end in self.items.ends(start, "contain|hold"):
                for phrases, after in self.phrases.lists(end):
                    yield _clause("put", phrases, place), after

    def _duty(self, at: int) -> Iterator[int]:
        """Yield the words after what says that something is to be."""
        for pattern in ("MUST", "have|has|need|needs|ought to", "is|are to", "belong|belongs",
                        "go|goes"):  # fmt: skip
            yield from self.items.ends(at, pattern)

    def _state(self, phrases: tuple[Phrase, ...], at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(all cups should) be in the left box", "in the left box be", "be gone"."""
        items = self.items
        for start in items.ends(at, "be|go|STAY? PLACED?"):
            for place, end in self._placed(start):
                for last in items.ends(end, "be|LIE|PLACED?"):
                    yield _clause("put", phrases, place), last
                for left_out, after in self.phrases.exceptions(end, phrases):
                    but = tuple(replace(item, left_out=left_out) for item in phrases)
                    yield _clause("put", but, place), after
            for end in items.ends(start, "away|gone|removed|taken|cleared|off|out"):
                for begin in (end, *items.ends(end, "of|from|off")):
                    for place, after in self.phrases.places(begin):
                        yield _away(phrases, place), after
            for begin in items.ends(start, "off|from"):
                for place, after in self.phrases.places(begin):
                    yield _away(phrases, place), after

    def _there(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(there should be) exactly two cups on the table"."""
        for phrase, end in self.phrases.phrases(at):
            yield from self._there_at(phrase, end)

    def _there_at(self, phrase: Phrase, at: int) -> Iterator[tuple[Clause, int]]:
        is_no = phrase.quantity is not None and phrase.quantity.kind == "no"
        bare = replace(phrase, quantity=Quantity("all")) if is_no else phrase
        for place, end in self.phrases.destinations(at):
            yield (_away((bare,), place) if is_no else _clause("put", (bare,), place)), end
        if phrase.places and not phrase.places[-1][1]:
            whole = replace(bare, places=phrase.places[:-1])
            place = phrase.places[-1][0]
            yield (_away((whole,), place) if is_no else _clause("put", (whole,), place)), at

    def _none(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "no cup may stay on the table"."""
        for phrase, end in self.phrases.phrases(at):
            if phrase.quantity is None or phrase.quantity.kind not in ("no", "at_most"):
                continue
            for start in self.items.ends(end, "MODAL|BE? STAY? STAY?"):
                yield from self._there_at(phrase, start)
            for start in self.items.ends(end, "rests|stays|remains"):
                yield from self._there_at(phrase, start)

    # Conditions

    def conditions(self, at: int) -> Iterator[tuple[Condition, int]]:
        """Yield conditions on the world as it is: "there is a cup on the table"."""
        ends = self.items.ends
        for start in ends(at, "there is|are"):
            for phrase, end in self.phrases.phrases(start):
                yield Condition(phrase), end
        for start in ends(at, "AT"):  # "if on the table a can stands"
            for place, end in self.phrases.places(start):
                for begin in ends(end, "is|are?"):
                    for phrase, last in self.phrases.phrases(begin):
                        there = replace(phrase, places=(*phrase.places, (place, False)))
                        if begin > end:
                            yield Condition(there), last
                        else:
                            yield from ((Condition(there), x) for x in ends(last, "LIE|is|are"))
        for phrase, end in self.phrases.phrases(at):
            for start in ends(end, "is|are still|already|currently?"):
                is_not = False
                for begin in (start, *ends(start, "not")):
                    is_not = begin > start
                    for quality, after in self.phrases.qualities(begin):
                        yield Condition(phrase, quality=quality, is_not=is_not), after
        for place, end in self.phrases.places(at):
            for after in ends(end, "is|are still|already? EMPTY"):
                yield Condition(None, place, is_empty=True), after
            for after in ends(end, "is|are not EMPTY"):
                yield Condition(None, place, is_empty=True, is_not=True), after


def _deeds(kind: str, phrases: tuple[Phrase, ...], target: Place | None = None) -> tuple[Deed, ...]:
    return tuple(Deed(kind, phrase, target) for phrase in phrases)


def _clause(kind: str, phrases: tuple[Phrase, ...], target: Place | None = None) -> Clause:
    return Clause(_deeds(kind, phrases, target), has_verb=True)


def _away(phrases: tuple[Phrase, ...], source: Place) -> Clause:
    return Clause(tuple(Deed("away", phrase, source=source) for phrase in phrases), has_verb=True)
