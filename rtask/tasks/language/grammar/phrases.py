"""Grammar of phrases: how many of what, what they are like, where they are, and places.

Each rule yields every way in which it can read on from a word, with the word after it: what a
sentence can mean is decided where all of it is read.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from rtask.tasks.language.grammar.relations import Relations
from rtask.tasks.language.items import Items
from rtask.tasks.language.lexicon import ADJECTIVES, CLASSES, STAYING
from rtask.tasks.language.meaning import Name, Phrase, Place, Quantity

__all__ = ["Phrases"]

_NOUN_ROLES = ("kind", "object", "thing")
_ALL = Quantity("all")
_GOING = frozenset(("go", "be", "live", "stay", "remain"))
_EXCEPT = ("except for", "apart from", "other than", "excluding", "but not", "save for", "but",
           "aside from", "with the exception of", "except", "bar", "excepting", "not", "and not",
           "but|and leave|keep", "while leaving", "leaving")  # fmt: skip


@dataclass(frozen=True)
class _Read:
    """A phrase that was read, without and with what follows its noun, and the word after it."""

    core: Phrase
    phrase: Phrase
    end: int
    is_bare: bool
    is_from: bool = False


class Phrases(Relations):
    """Rules for phrases in the words of one goal."""

    def __init__(self, items: Items) -> None:
        super().__init__(items)
        self._read: dict[int, list[_Read]] = {}

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
                for place, last in self.at_places(after, "AT"):
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
                if pattern == "not" and start == at:  # "the cups, not the pens"
                    continue
                for begin in self.items.ends(start, pattern):
                    for left_out, end in self._coordinated(begin):
                        named = [self._with_head(item, of) for item in left_out]
                        # "all but two cups": which two are left out, nobody has said.
                        if not all(
                            item is not None and not item.others and not item.anaphor
                            and (item.quantity in (None, _ALL)
                                 or (written.is_elided and item.superlative is not None))
                            for written, item in zip(left_out, named, strict=True)
                        ):  # fmt: skip
                            continue
                        out = tuple(item for item in named if item is not None)
                        yield out, end
                        if start > at:
                            yield from ((out, after) for after in self.items.ends(end, ","))
                        if "leav" in pattern:
                            yield from ((out, after) for tail in STAYING
                                        for after in self.items.ends(end, tail))  # fmt: skip

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
            matches = [*self._nominal(at), *self._pronouns(at), *self._whichever(at),
                       *self._only(at), *self._all_but_most(at)]  # fmt: skip
            self._read[at] = list(dict.fromkeys(matches))
        return self._read[at]

    def _nominal(self, at: int) -> Iterator[_Read]:
        for start, end in self.quantified(at):
            for described, after in self._described(start, end):
                for core, last in self._noun(described, after):
                    if self.items.word(at) == "any" and core.is_plural and end == at + 1 and (
                        not core.is_elided
                    ):  # "any cups on the table"  # fmt: skip
                        core = replace(core, quantity=_ALL)
                    if not _is_sound(core):
                        continue
                    is_bare = end == at and not described.is_described
                    for phrase, stop in self._modified(core, last):
                        is_from = "from" in self.items.words[last:stop]
                        yield _Read(core, phrase, stop, is_bare, is_from)

    def _only(self, at: int) -> Iterator[_Read]:
        """Yield "only the red cups"."""
        for start in self.items.ends(at, "only|just|exclusively|solely"):
            for item in self._phrases(start):
                quantity = item.phrase.quantity
                # "only two cups" may be two of them, or two there in the end.
                if quantity in (None, _ALL) and not (item.phrase.anaphor or item.phrase.others):
                    core, phrase = (replace(p, is_only=True) for p in (item.core, item.phrase))
                    yield replace(item, core=core, phrase=phrase)

    def _all_but_most(self, at: int) -> Iterator[_Read]:
        """Yield "all but the two heaviest cups"."""
        for start in self.items.ends(at, "all|everything but|except|bar"):
            for item in self._phrases(start):
                most = item.phrase
                if most.superlative is not None and (most.heads or most.is_generic):
                    whole = replace(most, superlative=None, quantity=_ALL, is_plural=True,
                                    is_definite=False)  # fmt: skip
                    phrase = replace(whole, left_out=(most,))
                    yield _Read(phrase, phrase, item.end, False)

    def _whichever(self, at: int) -> Iterator[_Read]:
        """Yield "whichever bottle is the heaviest"."""
        for start in self.whichever(at):
            for described, end in self._described(Phrase(), start):
                for core, after in self._noun(described, end):
                    for single, last in self.chosen(core, after):
                        yield _Read(single, single, last, False)

    def _described(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with the adjectives that stand here."""
        yield phrase, at
        if phrase.superlative is None and phrase.is_definite:
            for superlative, after in self.comparatives(at):  # "the heavier can" of two
                of_two = replace(phrase, superlative=superlative, quantity=Quantity("some", 1, 2))
                yield from self._described(of_two, after)
        for superlative, after in self.superlatives(at) if phrase.superlative is None else ():
            most = replace(phrase, superlative=superlative)
            yield from self._described(most, after)
            for number, end in self.numbers(after):  # "the heaviest two cups"
                if phrase.quantity is None and phrase.is_definite:
                    so_many = replace(most, quantity=Quantity("definite", number))
                    yield from self._described(replace(so_many, is_definite=False), end)
            for end in self.items.ends(after, "of DET"):
                single = most.quantity or Quantity("some", 1)
                yield from self._described(replace(most, quantity=single), end)
        for described, end in self._quality(phrase, at, is_not=False):
            yield from self._described(described, end)
        for theirs, end in self.owned(phrase, at):
            yield from self._described(theirs, end)
            for number, after in self.numbers(end):  # "Anna's two cups"
                if theirs.quantity is None:
                    counted = replace(theirs, quantity=Quantity("definite", number))
                    yield from self._described(replace(counted, is_definite=False), after)
        use = self.items.name(at, "use")
        if use is not None and not phrase.heads:  # "drinking cups"
            yield from self._described(replace(phrase, heads=(use,)), use.mentions[0].end)

    def _quality(self, phrase: Phrase, at: int, is_not: bool) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with the colour, material or trait that stands here."""
        for names, end in self._alternatives(at, "colour"):
            single = replace(phrase, colours=(*phrase.colours, (names, is_not)))
            yield single, end
            yield from ((single, after) for after in self.items.ends(end, "coloured|colored"))
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
            yield replace(phrase, heads=(*phrase.heads, name), is_plural=name.is_plural), end
            for either, after in self._either(phrase, name):
                single = phrase.quantity or Quantity("some", 1)
                yield replace(phrase, heads=(either,), quantity=single, is_definite=False,
                              is_plural=name.is_plural), after  # fmt: skip
            second = self.items.name(end, *_NOUN_ROLES)
            if second is not None and not self._is_modal(end):
                heads, last = (*phrase.heads, name, second), second.mentions[0].end
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
            is_most = phrase.superlative is not None and phrase.quantity is None
            yield replace(phrase, is_elided=True, is_plural=not is_most), at

    def _is_modal(self, at: int) -> bool:
        """Return whether "can" is a verb: "the jug can go", not "the beer can"."""
        return self.items.word(at) == "can" and self.items.word(at + 1) in _GOING

    def _either(self, phrase: Phrase, name: Name) -> Iterator[tuple[Name, int]]:
        """Yield "(two) cups or cans", "(a) cup or a can", "(the) jug or the ball" as one name.

        "Cups or pens" without a number may be all of either: that is for whoever says it to decide.
        """
        is_single = phrase.quantity == Quantity("some", 1)
        is_named = phrase.quantity is None and name.role("kind") is None
        if is_single or is_named:
            pattern = "or a|an|one" if is_single else "or the?"
        elif _is_counted(phrase.quantity) or phrase.quantity == _ALL:
            pattern = "or"
        else:
            return
        end = name.mentions[0].end
        for start in (*self.items.ends(end, pattern), *self.items.ends(end, "or" * is_single)):
            other = self.items.name(start, *_NOUN_ROLES)
            if other is None or (is_named and other.role("kind") is not None) or start == end:
                continue
            text = f"{name.text} or {other.text}"
            both = tuple(replace(m, text=text) for m in (*name.mentions, *other.mentions))
            yield Name(both), other.mentions[0].end

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
        for pattern in ("everything", "the? contents of", "DET whole? lot", "any and all things"):
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
        matches += [(described, after) for core, end in matches if core.is_generic
                    for described, after in self._quality(core, end, is_not=False)]  # fmt: skip
        for end in ends(at, "anything"):  # "anything lighter than 100 g", but any one thing alone
            matches += [(phrase, after) for phrase, after in self._modified(everything, end)
                        if after > end]  # fmt: skip
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
                for place, after in self.at_places(end, "AT"):
                    yield _Read(phrase, replace(phrase, places=((place, False),)), after, False)
        for end in ends(at, "what|whatever is|are"):  # "whatever is red"
            for start in (*self._predicate(everything, end, is_not=False),
                          *self.within_reach(everything, end)):  # fmt: skip
                for phrase, after in self._modified(*start):
                    yield _Read(everything, phrase, after, False)
        for end in ends(at, "what|whatever|all|everything|anything"):  # "whatever nao-1 can reach"
            for reached, last in self.related(everything, end):
                for phrase, after in self._modified(reached, last):
                    yield _Read(everything, phrase, after, False)
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
        for start in (at, *ends(at, "LIE around|about?"),
                      *ends(at, "currently|now|still|presently LIE?")):  # fmt: skip
            for place, end in self.at_places(start, "AT"):
                yield replace(phrase, places=(*phrase.places, (place, False))), end
        for place, end in self.at_places(at, "from|of"):
            yield replace(phrase, places=(*phrase.places, (place, False))), end
            for start in ends(end, "and|or from?"):  # "from the table and from the left box"
                for other, after in self.places(start):
                    both = _any_of(place, other)
                    if both is not None:
                        yield replace(phrase, places=(*phrase.places, (both, False))), after
        for start in ends(at, ",? and? that|which|who BE|LIE"):
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
        yield from self.compared(phrase, at)
        for start in ends(at, ",? that|which is|are"):
            yield from self.compared(phrase, start)
        yield from self.related(phrase, at)
        yield from self.superlative_after(phrase, at)
        if phrase.quantity == _ALL:  # "all cups but one"
            for start in ends(at, ",? but|except|bar|minus"):
                for number, end in self.numbers(start):
                    yield replace(phrase, quantity=Quantity("all_but", number)), end
        if phrase.heads and not phrase.colours:  # "the cup red", as in many languages
            for names, end in self._alternatives(at, "colour"):
                yield replace(phrase, colours=((names, False),)), end

    def _predicate(self, phrase: Phrase, at: int, is_not: bool) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase of which a relative clause says what its things are, or are not."""
        for place, end in self.at_places(at, "AT"):
            yield replace(phrase, places=(*phrase.places, (place, is_not))), end
        yield from self._quality(phrase, at, is_not)
        if not is_not:
            for start in self.items.ends(at, "neither"):
                yield from self._neither(phrase, start)
        for start in self.items.ends(at, "made? of|from"):
            for names, end in self._alternatives(start, "material"):
                yield replace(phrase, materials=(*phrase.materials, (names, is_not))), end
        if not is_not:
            yield from self.compared(phrase, at)
            yield from self.owner_predicate(phrase, at)
            return
        for start in self.items.ends(at, "a|an?"):
            name = self.items.name(start, "kind")
            if name is not None:
                end = name.mentions[0].end
                without = replace(phrase, kinds_not=(*phrase.kinds_not, name))
                yield without, end
                for after in self.items.ends(end, "or|nor a|an?"):  # "is not a cup or a can"
                    other = self.items.name(after, "kind")
                    if other is not None:
                        kinds = (*without.kinds_not, other)
                        yield replace(phrase, kinds_not=kinds), other.mentions[0].end

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


def _any_of(place: Place, other: Place) -> Place | None:
    """Return a place that is either of two; None where one of them is no place by name."""
    names = (*place.names, *other.names)
    is_plain = place.owner is None and other.owner is None and place.names and other.names
    return Place(names) if is_plain and all(name.role("place") for name in names) else None


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
