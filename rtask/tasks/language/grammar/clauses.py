"""Grammar of deeds: what is to be done with what, or how things are to be.

A clause that does not say where to, or what with, can have that of its neighbours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from rtask.asking.questions.words import stem
from rtask.tasks.language.grammar.clause import EVERYTHING, Clause, away_from, clause_of, deeds_of
from rtask.tasks.language.grammar.frames import courtesies, requests, wishes
from rtask.tasks.language.grammar.limits import Limitations
from rtask.tasks.language.grammar.removals import Removals
from rtask.tasks.language.items import Items
from rtask.tasks.language.lexicon import AWAY, CLASSES, GRASP, PUT, STAYING, TAKE
from rtask.tasks.language.meaning import Deed, Phrase, Place, Quantity

__all__ = ["Clauses"]

_PUT = PUT | {"keep"}
_CLEAR = frozenset(("clear", "empty", "tidy", "unload"))
_FILL = frozenset(("fill", "load", "stock", "restock", "refill", "replenish"))
_SWAP = frozenset(("swap", "exchange", "switch", "interchange"))


class Clauses(Removals):
    """Rules for the clauses in the words of one goal."""

    def __init__(self, items: Items) -> None:
        super().__init__(items)
        self._limitations = Limitations(items, self.phrases)
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

    def limits(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield what may not be done, or who alone may do it."""
        for start in courtesies(self.items, at):
            for clause, end in self._limitations.limits(start):
                yield from ((clause, after) for after in courtesies(self.items, end))

    def ordered(self, at: int) -> Iterator[tuple[tuple[Deed, ...], int]]:
        """Yield who is to do what is said next."""
        for start in courtesies(self.items, at):
            yield from self._limitations.ordered(start)

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
            for end in self._numbered(start):  # "step 2: the cups onto the shelf"
                for clause, after in self._clause(end):
                    yield replace(clause, order="then"), after
            for pattern in ("LATER ,?", "followed by", "when|once you are|have done|finished ,?",
                            "when|once|after that|this is? done|finished ,?",
                            "and? after that|this ,?", "and? after|before which"):  # fmt: skip
                for begin in ends(start, pattern):
                    for clause, end in self._clause(begin):
                        yield replace(clause, order="then"), end

    def _numbered(self, at: int) -> Iterator[int]:
        """Yield the words after the number of a step."""
        for start in self.items.ends(at, "step|stage|phase"):
            for _, end in self.phrases.numbers(start):
                yield from self.items.ends(end, ":|,|.?")

    def _clause(self, at: int) -> Iterator[tuple[Clause, int]]:
        yield from self._plain_clause(at)
        if self.items.word(at - 1) not in ("", ".", ";", "!", "?"):
            return  # what is left out behind a comma is of the clause before
        for start in courtesies(self.items, at):  # "apart from the jug, put everything ..."
            for left_out, end in self.phrases.exceptions(start, (EVERYTHING,)):
                for begin in self.items.ends(end, ",?"):
                    for clause, after in self._plain_clause(begin):
                        if all(_can_stay(deed.phrase) for deed in clause.deeds):
                            yield _without(clause, left_out), after

    def _plain_clause(self, at: int) -> Iterator[tuple[Clause, int]]:
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
                        yield clause_of("hold", phrases), after
            yield from self._put(at + 1, "pick", "")
        if items.is_verb(at, _CLEAR):
            yield from self.cleared(at + 1)
        for start in items.ends(at, "clean up"):  # "clean the table" may be wiping it
            yield from self.cleared(start)
        if items.is_verb(at, _SWAP):
            yield from self._swapped(at + 1)
        for start in (*items.ends(at, "remove|removing|removes|lose"),
                      *items.ends(at, "get rid of"),
                      *items.ends(at, "get out of? the? way")):  # fmt: skip
            yield from self.taken_away(start)
        for start in items.ends(at, "make|get|have|leave|keep"):  # "make the shelf empty"
            for place, end in self.phrases.places(start):
                for last in items.ends(end, "completely|totally|all? EMPTY up|out?"):
                    yield away_from((EVERYTHING,), place), last
                    yield from self.rid(place, last)
        if items.is_verb(at, AWAY):
            for start in (at + 1, *items.ends(at + 1, "out|away")):
                yield from self.taken_away(start)
        for start in items.ends(at, "leave|let|keep"):  # "leave nothing on the table"
            for phrase, end in self.phrases.phrases(start):
                if phrase.quantity is not None and phrase.quantity.kind == "no":
                    for after in items.ends(end, "be? left?"):
                        yield from self._there_at(phrase, after)
            for phrases, end in self.phrases.lists(start):
                if all(_can_stay(phrase) for phrase in phrases):
                    if items.word(at) == "leave":
                        yield clause_of("stay", phrases), end
                    for tail in STAYING:
                        yield from ((clause_of("stay", phrases), x) for x in items.ends(end, tail))
        for start in items.ends(at, "do not leave|let|keep any?"):
            for phrase, end in self.phrases.phrases(start):
                if phrase.quantity in (None, Quantity("some", 1)):
                    yield from self._there_at(replace(phrase, quantity=Quantity("no")), end)
        if items.is_verb(at, frozenset(("return",))):
            yield from self._put_back(at + 1)
        if items.is_verb(at, frozenset(("give", "hand", "pass", "bring", "fetch"))):
            robot = items.name(at + 1, "robot")  # "hand nao-1 the pen"
            if robot is not None:
                for phrases, end in self.phrases.lists(robot.mentions[0].end):
                    yield clause_of("put", phrases, Place((robot,))), end
        if items.is_verb(at, _FILL):
            for place, end in self.phrases.places(at + 1):
                for start in items.ends(end, "with"):
                    for phrases, after in self.phrases.lists(start):
                        yield clause_of("put", phrases, place), after
        for start in items.ends(at, "use"):
            yield from self._used(start)
        yield from self._verb_last(at)
        for start in items.ends(at, "do not"):  # "do not put it into the left box but ..."
            for phrases, end in self.phrases.lists(start + 1) if items.is_verb(start, _PUT) else ():
                for _, after in self.phrases.destinations(end):
                    for begin in items.ends(after, ",? but rather?"):
                        for place, last in self.phrases.destinations(begin):
                            yield clause_of("put", phrases, place), last

    def _put(self, at: int, verb: str, words: str) -> Iterator[tuple[Clause, int]]:
        """Yield "(put) the cups into the box", and "(put) into the box the cups"."""
        lists, places = self.phrases.lists, self.phrases.destinations
        for phrases, end in lists(at):
            for clause, after in self._put_there(phrases, end):
                yield replace(clause, has_verb=True), after
            yield from self._other_than(phrases, end)
            for source, after in self.off(end):  # "everything off the shelf and into the box"
                there = tuple(replace(p, places=(*p.places, (source, False))) for p in phrases)
                for start in self.items.ends(after, ",? and?"):
                    for target, last in self.placed(start):
                        yield clause_of("put", there, target), last
            takes = verb in TAKE
            yield Clause(deeds_of("put", phrases), is_open=True, has_verb=True, takes=takes), end
            if verb != "pick":
                yield from self._back(phrases, end, "back" in words.split())
        for place, end in places(at):
            for phrases, after in lists(end):
                yield clause_of("put", phrases, place), after

    def _other_than(self, phrases: tuple[Phrase, ...], at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(put the cups) anywhere but on the table"."""
        for pattern in ("anywhere|somewhere else? but|except|than AT?",
                        "anywhere|somewhere else? other than AT?"):  # fmt: skip
            for start in self.items.ends(at, pattern):
                for place, after in self.phrases.places(start):
                    yield away_from(phrases, place), after

    def _put_there(self, phrases: tuple[Phrase, ...], at: int) -> Iterator[tuple[Clause, int]]:
        """Yield a list with where to, and with what is left out after that."""
        if self._is_parallel(phrases, at):
            return
        for place, end in self.placed(at):
            yield Clause(deeds_of("put", phrases, place)), end
            for left_out, after in self.phrases.exceptions(end, phrases):
                but = tuple(replace(item, left_out=left_out) for item in phrases)
                yield Clause(deeds_of("put", but, place)), after

    def _is_parallel(self, phrases: tuple[Phrase, ...], at: int) -> bool:
        """Return whether phrases are two clauses: "two cups on the shelf and one in the box"."""
        is_between = any(p.places for p in phrases[:-1]) and not phrases[-1].places
        return is_between and self.items.word(at) in CLASSES["AT"]

    def _back(
        self, phrases: tuple[Phrase, ...], at: int, is_back: bool
    ) -> Iterator[tuple[Clause, int]]:
        """Yield "(put the can) back where it was"."""
        starts = [at] * is_back + list(self.items.ends(at, "back"))
        for end in self.items.ends(at, "back? to? where it|they came from"):
            yield clause_of("back", phrases), end
        for start in starts:
            yield clause_of("back", phrases), start
            for end in self.items.ends(
                start,
                "to? where it|they was|were|stood|lay|sat before|earlier|originally|previously?",
            ):
                yield clause_of("back", phrases), end

    def _used(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(use) the left box for the pens and the right one for the cups"."""
        for place, end in self.phrases.places(at):
            if not all(name.role("place") for name in place.names):
                continue  # "use the panda for the pens" may be who, or where to
            for start in self.items.ends(end, "for"):
                for phrases, after in self.phrases.lists(start):
                    clause = clause_of("put", phrases, place)
                    yield clause, after
                    for begin in (
                        *self.items.ends(after, "and"),
                        *self.items.ends(after, ", and?"),
                    ):
                        for rest, last in self._used(begin):
                            yield replace(clause, deeds=clause.deeds + rest.deeds), last

    def _put_back(self, at: int) -> Iterator[tuple[Clause, int]]:
        for phrases, end in self.phrases.lists(at):
            yield clause_of("back", phrases), end
            yield from self._back(phrases, end, is_back=True)

    def _swapped(self, at: int) -> Iterator[tuple[Clause, int]]:
        for phrase, end in self.phrases.phrases(at):
            for start in self.items.ends(end, "and|with|for"):
                for partner, after in self.phrases.phrases(start):
                    deed = Deed("swap", phrase, partner=partner)
                    for last in (after, *self.items.ends(after, "around|over|places")):
                        yield Clause((deed,), has_verb=True), last
        for start in self.items.ends(at, "the? contents of"):
            for place, end in self.phrases.places(start):
                for begin in self.items.ends(end, "and|with"):
                    for other, after in self.phrases.places(begin):
                        here, there = (replace(EVERYTHING, places=((p, False),))
                                       for p in (place, other))  # fmt: skip
                        yield Clause((Deed("swap", here, partner=there),), has_verb=True), after
        for start in self.items.ends(at, "the? places|positions of"):
            yield from self._swapped(start)

    def _changed(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "the jug and the ball (should) change places"."""
        for phrase, end in self.phrases.phrases(at):
            for start in self.items.ends(end, "and|with"):
                for partner, after in self.phrases.phrases(start):
                    deed = Deed("swap", phrase, partner=partner)
                    for begin in (after, *self._duty(after)):
                        for last in self.items.ends(
                            begin, "change|swap|switch|exchange|trade DET? places|positions|spots"
                        ):
                            yield Clause((deed,), has_verb=True), last

    def _verb_last(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "the pens in the left box put", as speakers of other languages say it."""
        for phrases, end in self.phrases.lists(at):
            for place, after in self.placed(end):
                if self.items.is_verb(after, _PUT):
                    yield clause_of("put", phrases, place), after + 1

    # States

    def _wished(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield what a wish is about: "that all cups are in the box", "the cups gone"."""
        for phrases, end in self.phrases.lists(at):
            for start in (end, *self.items.ends(end, "MUST|BE|can|could|would|might")):
                yield from self._state(phrases, start)
            if self._is_parallel(phrases, end):
                continue
            for place, after in self.placed(end):
                for last in self.items.ends(after, "BE|LIE|go|goes|PLACED?"):
                    yield clause_of("put", phrases, place), last
            for start in self.items.ends(end, "to be|go"):
                yield from self._state(phrases, start - 1)
        for start in self.items.ends(at, "there BE"):
            yield from self._there(start)
        for place, end in self.phrases.places(at):
            for start in self.items.ends(end, "contains|holds|has nothing but|except"):
                for left_out, last in self.phrases.lists(start):
                    yield away_from((replace(EVERYTHING, left_out=left_out),), place), last
            for last in (*self.items.ends(end, "MUST|BE? be? EMPTY"),
                         *self.items.ends(end, "to be EMPTY")):  # fmt: skip
                yield away_from((EVERYTHING,), place), last
                yield from self.rid(place, last)
        yield from self._none(at)

    def _stated(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield how things are to be, or just which things and where."""
        items = self.items
        for phrases, end in self.phrases.lists(at):
            yield Clause(deeds_of("put", phrases), is_open=True), end
            yield from self._put_there(phrases, end)
            for start in self._duty(end):
                yield from self._state(phrases, start)
            for place, after in self.off(end):
                yield away_from(phrases, place), after
        for place, end in self.phrases.destinations(at):  # "in the left box goes the ball"
            for start in (*items.ends(end, "go|goes|belong|belongs?"),
                          *items.ends(end, "I|we would? WANT to? have|see?")):  # fmt: skip
                for phrases, after in self.phrases.lists(start):
                    yield Clause(deeds_of("put", phrases, place)), after
            for start in items.ends(end, "with"):  # "onto the shelf with the cups"
                for phrases, after in self.phrases.lists(start):
                    yield clause_of("put", phrases, place), after
        for place, end in self.off(at):  # "off the table with the cups"
            for start in items.ends(end, "with"):
                for phrases, after in self.phrases.lists(start):
                    yield away_from(phrases, place), after
        for place, end in self.phrases.places(at):  # "left box: cups"
            for start in items.ends(end, ":"):
                for phrases, after in self.phrases.lists(start):
                    yield clause_of("put", phrases, place), after
        for phrases, end in self.phrases.lists(at):
            for start in items.ends(end, "can|could|may"):  # but what can stay need not
                if items.word(start) in ("go", "be", "live"):
                    yield from self._state(phrases, start)
            for start in items.ends(end, "do|does not belong AT"):
                for place, after in self.phrases.places(start):
                    yield away_from(phrases, place), after
        for start in items.ends(at, "there MUST be"):
            yield from self._there(start)
        for start in items.ends(at, "from|off"):  # "from the table should all away"
            for place, end in self.phrases.places(start):
                for begin in items.ends(end, "MUST"):
                    for phrases, after in self.phrases.lists(begin):
                        for last in items.ends(after, "be? away|gone|removed|off"):
                            yield away_from(phrases, place), last
        for place, end in self.phrases.places(at):
            yield from self._containing(place, end)
        for start in items.ends(at, "can|could"):  # "could the cups go into the box?"
            for phrases, end in self.phrases.lists(start):
                for begin in items.ends(end, "POLITE* be POLITE? PLACED|go"):
                    yield from self._other_than(phrases, begin)
                for begin in (*items.ends(end, "POLITE* go"),
                              *items.ends(end, "POLITE* be POLITE? PLACED")):  # fmt: skip
                    for place, after in self.placed(begin):
                        yield clause_of("put", phrases, place), after
        for start in items.ends(at, "there MUST not be any?"):
            for phrase, end in self.phrases.phrases(start):
                if phrase.quantity is None:
                    yield from self._there_at(replace(phrase, quantity=Quantity("no")), end)
        for start in items.ends(at, "I do not WANT|want to? see|have|find?"):
            for phrase, end in self.phrases.phrases(start):
                is_any = items.word(start) == "any"
                if phrase.quantity is None or phrase.quantity == Quantity("some", 1) or is_any:
                    none = replace(phrase, quantity=Quantity("no"))
                    for last in (end, *items.ends(end, "left|lying|standing")):
                        yield from self._there_at(none, last)
        yield from self._none(at)
        yield from self._changed(at)

    def _containing(self, place: Place, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(the table should) be empty", "be free of cans", "hold all cups"."""
        for start in self.items.ends(at, "is for"):  # "the left box is for cups"
            for phrases, after in self.phrases.lists(start):
                yield clause_of("put", phrases, place), after
        for start in self._duty(at):
            for end in self.items.ends(start, "be EMPTY"):
                yield away_from((EVERYTHING,), place), end
                yield from self.rid(place, end)
            for end in self.items.ends(start, "contain|hold|have"):
                for phrases, after in self.phrases.lists(end):
                    if any(item.quantity == Quantity("no") for item in phrases):
                        every = tuple(replace(p, quantity=Quantity("all")) for p in phrases)
                        for last in (after, *self.items.ends(after, "on|in it"),
                                     *self.items.ends(after, "left? AT? it?")):  # fmt: skip
                            yield away_from(every, place), last
                    else:
                        yield clause_of("put", phrases, place), after

    def _duty(self, at: int) -> Iterator[int]:
        """Yield the words after what says that something is to be."""
        for pattern in ("MUST", "have|has|need|needs|ought to", "is|are to", "belong|belongs",
                        "go|goes", "live|lives", "would",
                        "need|needs|want|wants moving|putting|placing",
                        "is|are going", "is|are supposed|meant|due to"):  # fmt: skip
            yield from self.items.ends(at, pattern)

    def _state(self, phrases: tuple[Phrase, ...], at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(all cups should) be in the left box", "in the left box be", "be gone"."""
        items = self.items
        if self._is_parallel(phrases, at):
            return
        for begin in (*items.ends(at, "no longer|more be|stay|remain?"),
                      *items.ends(at, "not be|stay|remain")):  # fmt: skip
            for place, after in self.phrases.at_places(begin, "AT"):
                yield away_from(phrases, place), after
        for start in items.ends(at, "be? STAY"):
            for tail in (*STAYING, "where|as it|they is|are"):
                for end in items.ends(start, tail):
                    if all(_can_stay(phrase) for phrase in phrases):
                        yield clause_of("stay", phrases), end
        for start in (*items.ends(at, "be|go|get|STAY? POLITE? PLACED?"),
                      *items.ends(at, "end|ends up"), *items.ends(at, "be better off|suited"),
                      *items.ends(at, "both|all|each be PLACED?")):  # fmt: skip
            yield from self._other_than(phrases, start)
            for place, end in self.placed(start):
                for last in items.ends(end, "be|LIE|PLACED?"):
                    yield clause_of("put", phrases, place), last
                for left_out, after in self.phrases.exceptions(end, phrases):
                    but = tuple(replace(item, left_out=left_out) for item in phrases)
                    yield clause_of("put", but, place), after
            for end in items.ends(start, "away|gone|removed|taken|cleared|off|out"):
                for begin in (end, *items.ends(end, "of|from|off")):
                    for place, after in self.phrases.places(begin):
                        yield away_from(phrases, place), after
            for begin in items.ends(start, "off|from"):
                for place, after in self.phrases.places(begin):
                    yield away_from(phrases, place), after

    def _there(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "(there should be) exactly two cups on the table"."""
        for phrase, end in self.phrases.phrases(at):
            yield from self._there_at(phrase, end)
        for phrases, end in self.phrases.lists(at):  # "a can and two cups on the table"
            if len(phrases) > 1 and all(p.quantity != Quantity("no") for p in phrases):
                for place, after in self.phrases.destinations(end):
                    yield clause_of("put", phrases, place), after

    def _there_at(self, phrase: Phrase, at: int) -> Iterator[tuple[Clause, int]]:
        is_no = phrase.quantity is not None and phrase.quantity.kind == "no"
        bare = replace(phrase, quantity=Quantity("all")) if is_no else phrase
        for place, end in self.phrases.destinations(at):
            yield (away_from((bare,), place) if is_no else clause_of("put", (bare,), place)), end
            if is_no:  # "nothing on the table except the jug"
                for left_out, after in self.phrases.exceptions(end, (bare,)):
                    yield away_from((replace(bare, left_out=left_out),), place), after
        if phrase.places and not phrase.places[-1][1]:
            whole = replace(bare, places=phrase.places[:-1])
            place = phrase.places[-1][0]
            yield (away_from((whole,), place) if is_no else clause_of("put", (whole,), place)), at

    def _none(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield "no cup may stay on the table", "nothing but cups may be left on it"."""
        for start in self.items.ends(at, "no more"):  # "(see) no more pens on the table"
            for phrase, end in self.phrases.phrases(start):
                if phrase.quantity is None:
                    yield from self._there_at(replace(phrase, quantity=Quantity("no")), end)
        for start in self.items.ends(at, "nothing but|except|besides"):
            for left_out, end in self.phrases.lists(start):
                for begin in self.items.ends(end, "MODAL|is to? BE? STAY|belongs|goes STAY?"):
                    for place, after in self.phrases.destinations(begin):
                        yield away_from((replace(EVERYTHING, left_out=left_out),), place), after
        for phrase, end in self.phrases.phrases(at):
            if phrase.quantity is None or phrase.quantity.kind not in ("no", "at_most"):
                continue
            for start in self.items.ends(end, "MODAL|BE? STAY? STAY?"):
                yield from self._there_at(phrase, start)
            for start in self.items.ends(end, "rests|stays|remains"):
                yield from self._there_at(phrase, start)


def _without(clause: Clause, left_out: tuple[Phrase, ...]) -> Clause:
    """Return a clause of whose things some are left out."""
    deeds = (
        replace(deed, phrase=replace(deed.phrase, left_out=(*deed.phrase.left_out, *left_out)))
        for deed in clause.deeds
    )
    return replace(clause, deeds=tuple(deeds))


def _can_stay(phrase: Phrase) -> bool:
    """Return whether things can be left as they are: all that is named, and no number of it."""
    return phrase.quantity in (None, Quantity("all")) and not phrase.anaphor
