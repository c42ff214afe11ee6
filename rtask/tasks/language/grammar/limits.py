"""Grammar of limits: what may not be touched, and who may not, or alone may, do anything."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from rtask.tasks.language.grammar.clause import Clause
from rtask.tasks.language.grammar.phrases import Phrases
from rtask.tasks.language.items import Items
from rtask.tasks.language.meaning import Deed, Name, Phrase, Quantity

__all__ = ["Limitations"]

_FORBID = (
    "do not", "never", "you MUST|may|can not", "you MUST never", "please? do not ever", "not",
    "nobody|none may|MUST|can", "no one|robot may|MUST|can", "make sure you? not to",
    "make sure you do not", "be careful not to", "take care not to", "you are not to",
    "you are not allowed to",
)  # fmt: skip
"""What stands before a verb that is forbidden."""
_HANDS_OFF = (
    "without TOUCHING", "while not TOUCHING", "not TOUCHING", "avoid TOUCHING", "hands off",
    "hands away from", "keep|stay? away|off|clear from|of?", "steer clear of",
    "keep your? hands off|away from?", "refrain from TOUCHING", "without ever TOUCHING",
)  # fmt: skip
_MAY_NOT = (
    "MUST|may|can not be TOUCHED", "MUST never be TOUCHED", "is|are not to be TOUCHED",
    "is|are off limits", "is|are taboo", "MUST|may|can not TOUCHED",
)  # fmt: skip
_TASK = "it|this|that|anything|any? TASK? of? it|this|that? himself|itself|here?"
"""What a robot may not do: all of it."""
_BAR_BEFORE = (
    "do not|never let|have|allow|ask|make|get|tell", "I|we do not WANT", "do not want",
    "you MUST not let|ask",
)  # fmt: skip
_BAR_AFTER = (
    "to? do|touch|handle|move|carry|take|use", "to? help|participate|interfere|work|join",
    "to? be involved|used", "to? take part", "near it|this|that|anything",
)  # fmt: skip
_WITHOUT = (
    "without", "without using", "without any? help|assistance from|of", "not by|with|using",
    "but not by|with", "do not use", "never use", "avoid using", "leave out", "excluding",
    "without involving", "do not involve", "do not ask", "you may|MUST|can not use",
)  # fmt: skip


class Limitations:
    """Rules for limits in the words of one goal."""

    def __init__(self, items: Items, phrases: Phrases) -> None:
        self.items, self.phrases = items, phrases

    def limits(self, at: int) -> Iterator[tuple[Clause, int]]:
        """Yield what limits a goal, as a sentence of its own or beside it."""
        for deeds, end in self._limits(at):
            for after in (end, *self.items.ends(end, "either|though|please"),
                          *self.items.ends(end, "at all"),
                          *self.items.ends(end, "for|in|with|on this|that|it TASK?"),
                          *self.items.ends(end, "under any circumstances")):  # fmt: skip
                yield Clause(deeds, has_verb=True), after

    def _limits(self, at: int) -> Iterator[tuple[tuple[Deed, ...], int]]:
        yield from self._untouched(at)
        yield from self._barred(at)
        yield from self._alone(at)

    # Things

    def _untouched(self, at: int) -> Iterator[tuple[tuple[Deed, ...], int]]:
        items = self.items
        starts = [end for pattern in _HANDS_OFF for end in items.ends(at, pattern)]
        for pattern in _FORBID:
            for begin in items.ends(at, pattern):
                starts += items.ends(begin, "even? TOUCH up?")
                starts += items.ends(begin, "mess|fiddle|interfere with")
        for start in dict.fromkeys(starts):
            for phrases, end in self.phrases.lists(start):
                yield from ((deeds, end) for deeds in _spared(phrases))
            for end in items.ends(start, "anything|something|any else|other thing|things?"):
                if "anything" in items.words[start:end] or end > start + 2:
                    yield _ELSE, end
        for start in items.ends(at, "TOUCH"):  # "touch nothing else"
            yield from ((_ELSE, end) for end in items.ends(start, "nothing else"))
        for start in items.ends(at, "leave|keep|let"):
            for end in items.ends(start, "everything|all|anything else"):
                for tail in _AS_IS:
                    yield from ((_ELSE, after) for after in items.ends(end, tail))
        for start in items.ends(at, "nothing else may|MUST|is"):
            yield from ((_ELSE, end) for end in items.ends(start, "to? be? TOUCHED"))
        for end in items.ends(at, "everything|all else MUST? stays|remains|stay|remain"):
            yield _ELSE, end
            for tail in _AS_IS:
                yield from ((_ELSE, after) for after in items.ends(end, tail))
        for end in (*items.ends(at, "and? nothing else"), *items.ends(at, "and? no other|others")):
            yield _ELSE, end
        for phrases, end in self.phrases.lists(at):
            for pattern in _MAY_NOT:
                for after in items.ends(end, pattern):
                    yield from ((deeds, after) for deeds in _spared(phrases))

    # Robots

    def robots(self, at: int) -> Iterator[tuple[tuple[Name, ...], int]]:
        """Yield robots by name, with "and" or "or" between them."""
        for start in self.items.ends(at, "either? DET? robot?"):
            name = self.items.name(start, "robot")
            if name is None:
                continue
            end = name.mentions[0].end
            yield (name,), end
            for begin in self.items.ends(end, "and|or|nor"):
                for others, after in self.robots(begin):
                    yield (name, *others), after

    def _barred(self, at: int) -> Iterator[tuple[tuple[Deed, ...], int]]:
        items = self.items
        for pattern in _BAR_BEFORE:
            for start in items.ends(at, pattern):
                for robots, end in self.robots(start):
                    yield from ((_barring(robots), last) for last in self._doing(end))
        for pattern in _WITHOUT:
            for start in items.ends(at, pattern):
                yield from ((_barring(robots), end) for robots, end in self.robots(start))
        for start in items.ends(at, "keep|leave"):
            for robots, end in self.robots(start):
                yield from ((_barring(robots), last) for last in
                            items.ends(end, "out of it|this|that"))  # fmt: skip
        for robots, end in self.robots(at):
            for start in (*items.ends(end, "MUST|may|can not"), *items.ends(end, "is|are not to"),
                          *items.ends(end, "MUST never")):  # fmt: skip
                yield from ((_barring(robots), last) for last in self._doing(start))
            for pattern in ("MUST|may not be used|involved|asked", "is|are not to be used|involved",
                            "is|are not allowed|permitted to help|do", "is|are off duty",
                            "is|are not available", "is|are busy", "does|do not"):  # fmt: skip
                for start in items.ends(end, pattern):
                    yield _barring(robots), start
                    yield from ((_barring(robots), last) for last in items.ends(start, _TASK))

    def _doing(self, at: int) -> Iterator[int]:
        """Yield where "(not) do it" ends, which leaves nothing that a robot may do."""
        for pattern in _BAR_AFTER:
            for end in self.items.ends(at, pattern):
                # A verb alone may have an object of its own that is not read: "touch the cups".
                if self.items.word(end - 1) in ("help", "participate", "interfere", "work", "join",
                                                "involved", "used", "part", "it", "this", "that",
                                                "anything"):  # fmt: skip
                    yield end
                yield from self.items.ends(end, "it|this|that|anything|any|the TASK?")

    def _alone(self, at: int) -> Iterator[tuple[tuple[Deed, ...], int]]:
        items = self.items
        for start in items.ends(at, "only|just? by|with|using"):
            for robots, end in self.robots(start):
                yield _only(robots), end
                yield from ((_only(robots), last) for last in
                            items.ends(end, "alone|only|exclusively|solely"))  # fmt: skip
        for start in items.ends(at, "use|take only|just?"):
            for robots, end in self.robots(start):
                for last in (*items.ends(end, "alone|only?"),
                             *items.ends(end, "alone|only? for this|it|that")):  # fmt: skip
                    yield _only(robots), last
        for robots, end in self.robots(at):
            yield from ((_only(robots), last) for last in items.ends(end, "only|alone"))
            for pattern in ("MUST|shall|is|has to? do", "does", "alone MUST|may|can do|handle",
                            "is the only|one to do"):  # fmt: skip
                for start in items.ends(end, pattern):
                    yield from ((_only(robots), last) for last in items.ends(start, "it|this|that"))
        for pattern in ("only", "no|no other robot|one but|except|other than"):
            for start in items.ends(at, pattern):
                for robots, end in self.robots(start):
                    for begin in items.ends(end, "may|MUST|can|is|has allowed|permitted? to?"):
                        yield from ((_only(robots), last) for last in self._doing(begin))
        for start in items.ends(at, "let|have|make"):
            for robots, end in self.robots(start):
                yield from ((_only(robots), last) for last in items.ends(end, "do it|this|that"))

    # Robots before an order

    def ordered(self, at: int) -> Iterator[tuple[tuple[Deed, ...], int]]:
        """Yield who is to do what is said next: "use panda-1, not nao-1, to", "let nao-1".

        It is said of one clause: whose a second one would be is not clear.
        """
        items = self.items
        for pattern, tail in (("use only|just?", "to"), ("let|have|make", ""), ("only let", ""),
                              ("get|ask|tell only?", "to"), ("I|we WANT only?", "to"),
                              ("with only?", "alone|only|exclusively? ,|:?")):  # fmt: skip
            for start in items.ends(at, pattern):
                for robots, end in self.robots(start):
                    for barred, after in self._instead_of(end):
                        for last in items.ends(after, tail):
                            yield (*_only(robots), *barred), last
        for robots, end in self.robots(at):
            for barred, after in self._instead_of(end):
                for last in (*items.ends(after, "alone|only? MUST|shall"),
                             *items.ends(after, "alone|only? has|is|needs to"),
                             *items.ends(after, "alone|only? :")):  # fmt: skip
                    yield (*_only(robots), *barred), last

    def _instead_of(self, at: int) -> Iterator[tuple[tuple[Deed, ...], int]]:
        """Yield ", not nao-1," and "instead of nao-1", or nothing."""
        yield (), at
        for pattern in (",? and? not", "instead of", "rather than"):
            for start in self.items.ends(at, pattern):
                for robots, end in self.robots(start):
                    for last in self.items.ends(end, ",?"):
                        yield _barring(robots), last


_AS_IS = ("where|as it|they? is|are", "alone|untouched|unmoved|there", "in its? place",
          "the same", "the way it is", "where it stands|lies", "as is")  # fmt: skip
_ELSE = (Deed("else", Phrase(is_generic=True, is_plural=True)),)


def _spared(phrases: tuple[Phrase, ...]) -> Iterator[tuple[Deed, ...]]:
    """Yield the limit that some things are not touched, where it is said of all of them."""
    deeds = []
    for phrase in phrases:
        if phrase.others or phrase.is_elided or phrase.anaphor or phrase.quantity not in _WHOLE:
            return
        # Of "the pen" where there are two, both are safe: nobody minds that, and no one is asked.
        whole = replace(phrase, quantity=Quantity("all"), is_definite=False)
        deeds.append(Deed("untouched", whole))
    yield tuple(deeds)


_WHOLE = (None, Quantity("all"), Quantity("some", 1))


def _barring(robots: tuple[Name, ...]) -> tuple[Deed, ...]:
    return (Deed("barred", Phrase(), robots=robots),)


def _only(robots: tuple[Name, ...]) -> tuple[Deed, ...]:
    return (Deed("alone", Phrase(), robots=robots),)
