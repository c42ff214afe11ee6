"""Grammar of phrases: how many of what, what they are like, where they are, and places.

Each rule yields every way in which it can read on from a word, with the word after it: what a
sentence can mean is decided where all of it is read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from rtask.tasks.language.items import Items
from rtask.tasks.language.lexicon import ADJECTIVES, CLASSES, UNITS
from rtask.tasks.language.meaning import Comparison, Name, Phrase, Place, Quantity, Superlative
from rtask.tasks.language.quantities import Quantities

__all__ = ["Phrases"]

_NOUN_ROLES = ("kind", "object", "thing")
_ALL = Quantity("all")
_EXCEPT = ("except for", "apart from", "other than", "excluding", "but not", "save for", "but",
           "aside from", "with the exception of", "except", "bar", "excepting")  # fmt: skip
_ABOVE = (("above|over", True), ("more than", True), ("below|under", False), ("less than", False))


@dataclass(frozen=True)
class _Read:
    """A phrase that was read, without and with what follows its noun, and the word after it."""

    core: Phrase
    phrase: Phrase
    end: int
    is_bare: bool
    is_from: bool = False


class Phrases(Quantities):
    """Rules for phrases in the words of one goal."""

    def __init__(self, items: Items) -> None:
        super().__init__(items)
        self._read: dict[int, list[_Read]] = {}
        self._places: dict[int, list[tuple[Place, int]]] = {}

    def qualities(self, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield what things can be said to be: in or on a place, or what they are like."""
        yield from self._predicate(Phrase(), at, is_not=False)

    # Lists

    def lists(self, at: int) -> Iterator[tuple[tuple[Phrase, ...], int]]:
        """Yield phrases with "and" and commas between them, and what is left out of them."""
        for phrases, end in self._coordinated(at):
            yield phrases, end
            for left_out, after in self.exceptions(end, phrases):
                less = tuple(replace(item, left_out=left_out) for item in phrases)
                yield less, after
                # "everything except the cups on the table": the cups there, or what is there?
                for place, last in self._at(after, "AT"):
                    yield tuple(replace(p, places=(*p.places, (place, False))) for p in less), last

    def _coordinated(self, at: int) -> Iterator[tuple[tuple[Phrase, ...], int]]:
        for members in self._members(at):
            phrases, end = tuple(item.phrase for item in members), members[-1].end
            # "the cups and the pens from the table": what they are taken from is of all.
            is_from_there = members[-1].is_from and not any(p.places for p in phrases[:-1])
            if len(members) == 1 or not is_from_there:
                yield phrases, end
            if len(members) > 1:
                yield from self._shared(members)

    def _members(self, at: int) -> Iterator[tuple[_Read, ...]]:
        for first in self._phrases(at):
            yield (first,)
            for between in self._between(first.end):
                for rest in self._members(between):
                    yield (first, *rest)

    def _between(self, at: int) -> Iterator[int]:
        yield from self.items.ends(at, "and")
        for end in self.items.ends(at, ","):
            yield end
            yield from self.items.ends(end, "and")

    def _shared(self, members: tuple[_Read, ...]) -> Iterator[tuple[tuple[Phrase, ...], int]]:
        """Yield the ways in which a list can share what one of its members says."""
        first, last = members[0], members[-1]
        if first.core.is_described and all(item.is_bare for item in members[1:]):
            described = [
                replace(item.phrase, colours=first.core.colours, materials=first.core.materials,
                        traits=first.core.traits) for item in members
            ]  # fmt: skip
            yield tuple(described), last.end
        if last.phrase != last.core and all(m.phrase == m.core for m in members[:-1]):
            after = last.phrase
            yield tuple(
                replace(
                    item.phrase, places=item.core.places + after.places[len(last.core.places):],
                    colours=item.core.colours + after.colours[len(last.core.colours):],
                    materials=item.core.materials + after.materials[len(last.core.materials):],
                    traits=item.core.traits + after.traits[len(last.core.traits):],
                    comparisons=after.comparisons, kinds_not=after.kinds_not,
                ) for item in members
            ), last.end  # fmt: skip

    def exceptions(
        self, at: int, of: tuple[Phrase, ...]
    ) -> Iterator[tuple[tuple[Phrase, ...], int]]:
        """Yield what is left out of some phrases, if an exception begins here."""
        is_all = all(phrase.quantity in (None, _ALL) for phrase in of)
        for start in self.items.ends(at, ",?"):
            for pattern in _EXCEPT:
                if pattern == "but" and not is_all:
                    continue
                for begin in self.items.ends(start, pattern):
                    for left_out, end in self._coordinated(begin):
                        named = [self._with_head(item, of) for item in left_out]
                        # "all but two cups": which two are left out, nobody has said.
                        if not all(
                            item is not None and item.quantity in (None, _ALL) and not item.others
                            and not item.anaphor for item in named
                        ):  # fmt: skip
                            continue
                        out = tuple(item for item in named if item is not None)
                        yield out, end
                        if start > at:
                            yield from ((out, after) for after in self.items.ends(end, ","))

    def _with_head(self, phrase: Phrase, of: tuple[Phrase, ...]) -> Phrase | None:
        """Return "the red one" with the noun that it stands for; None where that is not known."""
        if not phrase.is_elided:
            return phrase
        if len(of) != 1 or not (phrase.is_described or phrase.places):
            return None
        return replace(phrase, heads=of[0].heads, is_elided=False)

    # Phrases

    def phrases(self, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield phrases that begin here."""
        for item in self._phrases(at):
            yield item.phrase, item.end

    def _phrases(self, at: int) -> list[_Read]:
        if at not in self._read:
            self._read[at] = []  # what would begin with itself is no phrase
            matches = [*self._nominal(at), *self._pronouns(at)]
            self._read[at] = list(dict.fromkeys(matches))
        return self._read[at]

    def _nominal(self, at: int) -> Iterator[_Read]:
        for start, end in self.quantified(at):
            for described, after in self._described(start, end):
                for core, last in self._noun(described, after):
                    if not _is_sound(core):
                        continue
                    is_bare = end == at and not described.is_described
                    for phrase, stop in self._modified(core, last):
                        is_from = "from" in self.items.words[last:stop]
                        yield _Read(core, phrase, stop, is_bare, is_from)

    def _described(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with the adjectives that stand here."""
        yield phrase, at
        word = self.items.word(at)
        if word.endswith("est") and word in ADJECTIVES and phrase.superlative is None:
            superlative = Superlative(*ADJECTIVES[word])
            most = replace(phrase, superlative=superlative)
            yield from self._described(most, at + 1)
            for end in self.items.ends(at + 1, "of DET"):
                single = most.quantity or Quantity("some", 1)
                yield from self._described(replace(most, quantity=single), end)
        for described, end in self._quality(phrase, at, is_not=False):
            yield from self._described(described, end)

    def _quality(self, phrase: Phrase, at: int, is_not: bool) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with the colour, material or trait that stands here."""
        for names, end in self._alternatives(at, "colour"):
            single = replace(phrase, colours=(*phrase.colours, (names, is_not)))
            yield single, end
            for after in self.items.ends(end, "and"):  # what is red and blue at once
                second = self.items.name(after, "colour")
                if second is not None:
                    both = (*single.colours, ((second,), is_not))
                    yield replace(single, colours=both), second.mentions[0].end
        for names, end in self._alternatives(at, "material"):
            yield replace(phrase, materials=(*phrase.materials, (names, is_not))), end
        if self.items.word(at) not in ADJECTIVES:
            for names, end in self._alternatives(at, "trait"):
                yield replace(phrase, traits=(*phrase.traits, (names, is_not))), end

    def _alternatives(self, at: int, role: str) -> Iterator[tuple[tuple[Name, ...], int]]:
        """Yield names of a role with "or" between them."""
        for start in (at, *self.items.ends(at, "either")):
            name = self.items.name(start, role)
            if name is None:
                continue
            end = name.mentions[0].end
            if start == at:
                yield (name,), end
            for after in self.items.ends(end, "or"):
                other = self.items.name(after, role)
                if other is not None:
                    yield (name, other), other.mentions[0].end

    def _noun(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        name = self.items.name(at, *_NOUN_ROLES)
        if name is not None:
            end = name.mentions[0].end
            yield replace(phrase, heads=(name,), is_plural=name.is_plural), end
            second = self.items.name(end, *_NOUN_ROLES)
            if second is not None:
                heads, last = (name, second), second.mentions[0].end
                yield replace(phrase, heads=heads, is_plural=second.is_plural), last
        word = self.items.word(at)
        if word in CLASSES["THING"]:
            plural = word.endswith("s") or word == "stuff"
            generic = replace(phrase, is_generic=True, is_plural=plural)
            yield generic, at + 1
            yield from self._useful(generic, at + 1)
        if word in ("one", "ones"):
            yield replace(phrase, is_elided=True, is_plural=word == "ones"), at + 1
        elif phrase.is_described or phrase.others or _is_counted(phrase.quantity):
            # "the red and the blue cups", "two into the left box": the noun is elsewhere.
            yield replace(phrase, is_elided=True, is_plural=True), at

    def _useful(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with what its things are for: "something to drink from"."""
        for pattern in ("to", "that|which? one|you|we|i|people can|could|may", "that|which to"):
            for end in self.items.ends(at, pattern):
                name = self.items.name(end, "use")
                if name is not None:
                    yield replace(phrase, heads=(name,)), name.mentions[0].end

    def _pronouns(self, at: int) -> Iterator[_Read]:
        """Yield phrases without a noun."""
        ends = self.items.ends
        matches: list[tuple[Phrase, int]] = []
        everything = Phrase(is_generic=True, is_plural=True, quantity=_ALL)
        for pattern in ("everything", "the? contents of"):
            for end in ends(at, pattern):
                matches += [(everything, end), *self._useful(everything, end)]
        # "all" is everything, or all that was named just before.
        matches += [(replace(everything, anaphor="all"), end) for end in ends(at, "all")]
        matches += [(replace(everything, others=True), end)
                  for pattern in ("everything else", "DET rest", "the remainder")
                  for end in ends(at, pattern)]  # fmt: skip
        elided = replace(everything, is_generic=False, is_elided=True, others=True)
        matches += [(elided, end) for end in ends(at, "DET|all others")]
        for end in ends(at, "something"):
            single = Phrase(is_generic=True, quantity=Quantity("some", 1))
            matches += [(single, end), *self._useful(single, end)]
        for end in ends(at, "nothing"):
            matches.append((Phrase(is_generic=True, is_plural=True, quantity=Quantity("no")), end))
        for core, end in matches:
            if self.items.word(end - 1) == "of":
                yield from (_Read(core, replace(core, places=((place, False),)), after, False)
                            for place, after in self.places(end))  # fmt: skip
                continue
            for phrase, after in self._modified(core, end):
                yield _Read(core, phrase, after, False)
        for pattern in ("what|whatever BE|LIE there?", "DET? rest of what BE|LIE",
                        "all that BE|LIE", "everything there is"):  # fmt: skip
            for end in ends(at, pattern):
                phrase = replace(everything, others="rest" in self.items.text(at, end))
                for place, after in self._at(end, "AT"):
                    yield _Read(phrase, replace(phrase, places=((place, False),)), after, False)
        for end in ends(at, "it|them|they|these|those"):
            phrase = Phrase(anaphor=self.items.word(at))
            yield _Read(phrase, phrase, end, False)

    # What follows the noun

    def _modified(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with what follows its noun and describes it."""
        yield phrase, at
        for modified, end in self._modifier(phrase, at):
            if _is_sound(modified):
                yield from self._modified(modified, end)

    def _modifier(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        ends = self.items.ends
        for start in (at, *ends(at, "LIE")):
            for place, end in self._at(start, "AT"):
                yield replace(phrase, places=(*phrase.places, (place, False))), end
        for place, end in self._at(at, "from|of"):
            yield replace(phrase, places=(*phrase.places, (place, False))), end
        for start in ends(at, ",? that|which|who BE|LIE"):
            for end in ends(start, "still|currently|now?"):
                resolved = [*self._predicate(phrase, end, is_not=False)]
                for after in ends(end, "not"):
                    resolved += self._predicate(phrase, after, is_not=True)
                for described, last in resolved:
                    yield described, last
                    if self.items.word(at) == ",":  # a clause that begins with a comma ends so
                        yield from ((described, stop) for stop in ends(last, ","))
        for pattern in ("made? of|from", "made out of"):
            for start in ends(at, pattern):
                for names, end in self._alternatives(start, "material"):
                    yield replace(phrase, materials=(*phrase.materials, (names, False))), end
        yield from self._measured(phrase, at)
        for pattern in ("that weigh|weighs", "which weigh|weighs", "weighing",
                        "with a mass|weight of?"):  # fmt: skip
            for start in ends(at, pattern):
                for above, is_above in _ABOVE:
                    for end in ends(start, above):
                        yield from self._value(phrase, end, "mass", is_above)
        if phrase.heads and not phrase.colours:  # "the cup red", as in many languages
            for names, end in self._alternatives(at, "colour"):
                yield replace(phrase, colours=((names, False),)), end

    def _predicate(self, phrase: Phrase, at: int, is_not: bool) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase of which a relative clause says what its things are, or are not."""
        for place, end in self._at(at, "AT"):
            yield replace(phrase, places=(*phrase.places, (place, is_not))), end
        yield from self._quality(phrase, at, is_not)
        if not is_not:
            for start in self.items.ends(at, "neither"):
                yield from self._neither(phrase, start)
        for start in self.items.ends(at, "made? of|from"):
            for names, end in self._alternatives(start, "material"):
                yield replace(phrase, materials=(*phrase.materials, (names, is_not))), end
        if not is_not:
            yield from self._measured(phrase, at)
            return
        for start in self.items.ends(at, "a|an?"):
            name = self.items.name(start, "kind")
            if name is not None:
                end = name.mentions[0].end
                yield replace(phrase, kinds_not=(*phrase.kinds_not, name)), end

    def _neither(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase whose things are "(neither) red nor blue", "(neither) cups nor cans"."""
        for role in ("colour", "material", "kind"):
            names: tuple[Name, ...] = ()
            start = at
            while (name := self.items.name(start, role)) is not None:
                names, end = (*names, name), name.mentions[0].end
                start = next(self.items.ends(end, "nor"), -1)
                if len(names) > 1:
                    yield _without(phrase, role, names), end

    def _measured(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
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
        word, unit = self.items.word(at), UNITS.get(self.items.word(at + 1))
        number = word.replace(",", ".")
        if unit is None or not number.replace(".", "", 1).isdecimal():
            return
        dimension, factor = unit
        if dimension == ("mass" if measure == "mass" else "length") and measure != "size":
            comparison = Comparison(measure, is_above, float(number) * factor)
            yield replace(phrase, comparisons=(*phrase.comparisons, comparison)), at + 2

    # Places

    def _at(self, at: int, preposition: str) -> Iterator[tuple[Place, int]]:
        for start in self.items.ends(at, preposition):
            yield from self.places(start)
        if preposition == "AT":
            for pattern in ("on top of", "inside of"):
                for start in self.items.ends(at, pattern):
                    yield from self.places(start)

    def destinations(self, at: int) -> Iterator[tuple[Place, int]]:
        """Yield places that are said to be where to."""
        for start in self.items.ends(at, "POLITE? away|together|over|all|both?"):
            for preposition in ("INTO", "AT"):
                yield from self._at(start, preposition)
        for start in self.items.ends(at, ":"):
            yield from self.places(start)
        yield from self._relative_places(at)

    def _relative_places(self, at: int) -> Iterator[tuple[Place, int]]:
        for end in self.items.ends(at, "there"):
            yield Place(anaphor="there"), end
        for start in self.items.ends(at, "to? where|wherever"):
            for phrase, end in self.phrases(start):
                for after in self.items.ends(end, "BE|LIE now?"):
                    yield Place(holds=phrase), after

    def places(self, at: int) -> Iterator[tuple[Place, int]]:
        """Yield places that begin here, without a preposition."""
        if at not in self._places:
            self._places[at] = []
            self._places[at] = list(dict.fromkeys(self._read_places(at)))
        yield from self._places[at]

    def _read_places(self, at: int) -> Iterator[tuple[Place, int]]:
        ends = self.items.ends
        for start in ends(at, "DET|my|a|an|any|either?"):
            name = self.items.name(start, "place", "robot", "thing", "object")
            # "on the trays" would be one tray for all, or one for each.
            if name is not None and not name.is_plural:
                end = name.mentions[0].end
                yield Place((name,)), end
                yield from self._owned(name, end)
                for after in ends(end, "or DET?"):
                    other = self.items.name(after, "place")
                    if other is not None and name.role("place") and not other.is_plural:
                        yield Place((name, other)), other.mentions[0].end
        for end in ends(at, "it|there"):
            yield Place(anaphor=self.items.word(at)), end
        for pattern in ("the same place as", "the place of"):
            for start in ends(at, pattern):
                yield from ((Place(holds=p), end) for p, end in self.phrases(start))
        for start in ends(at, "the"):
            kind = self.items.name(start, "kind", "place")
            is_place = self.items.word(start) in ("place", "one", "box", "container")
            after_noun = kind.mentions[0].end if kind is not None else start + is_place
            if after_noun > start:
                for begin in ends(after_noun, "that|which CONTAIN"):
                    yield from ((Place(holds=p), end) for p, end in self.phrases(begin))
                for begin in ends(after_noun, "with"):
                    yield from ((Place(holds=p), end) for p, end in self.phrases(begin))

    def _owned(self, name: Name, at: int) -> Iterator[tuple[Place, int]]:
        for start in self.items.ends(at, "of the?"):
            robot = self.items.name(start, "robot")
            if robot is not None:
                yield Place((name,), robot), robot.mentions[0].end


def _without(phrase: Phrase, role: str, names: tuple[Name, ...]) -> Phrase:
    """Return a phrase whose things have none of some qualities."""
    if role == "colour":
        return replace(phrase, colours=(*phrase.colours, (names, True)))
    if role == "material":
        return replace(phrase, materials=(*phrase.materials, (names, True)))
    return replace(phrase, kinds_not=(*phrase.kinds_not, *names))


def _is_counted(quantity: Quantity | None) -> bool:
    return quantity is not None and quantity.kind in ("some", "definite", "exactly")


def _is_sound(phrase: Phrase) -> bool:
    """Return whether a phrase can be counted as it says."""
    quantity = phrase.quantity
    if phrase.superlative is not None:
        # "the heaviest cups" are so many as nobody has said.
        if quantity is None:
            return not phrase.is_plural
        return quantity.kind in ("definite", "some")
    return True
