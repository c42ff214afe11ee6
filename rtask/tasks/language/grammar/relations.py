"""Grammar of what things are to others: whose they are, and who reaches where they stand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from rtask.tasks.language.grammar.superlatives import Superlatives
from rtask.tasks.language.meaning import Name, Phrase

__all__ = ["Relations"]

_REACH = ("can|could reach|access", "reach|reaches|accesses", "can|could get|gets to|at",
          "is|are able to reach", "get|gets to", "has|have access to")  # fmt: skip
_NO_REACH = ("can|could not reach|access", "do|does not reach", "can|could not get to|at",
             "is|are unable to reach", "is|are not able to reach")  # fmt: skip


class Relations(Superlatives):
    """Rules for relations in the words of one goal."""

    def owned(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase behind "Anna's", which stands for an article as well."""
        name = self.items.name(at, "owner")
        if name is not None and not phrase.owners and self._is_possessive(name):
            end = name.mentions[0].end
            # Of "Anna's cup" there has to be one, as of "the cup".
            is_definite = phrase.is_definite or phrase.quantity is None
            yield replace(phrase, owners=(name,), is_definite=is_definite), end

    def owner_predicate(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield "(that is) Anna's" and "owned by Anna"."""
        name = self.items.name(at, "owner")
        if name is not None and self._is_possessive(name):
            yield replace(phrase, owners=(name,)), name.mentions[0].end
        for start in self.items.ends(at, "owned by"):
            yield from self._belonging(phrase, start)

    def related(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield a phrase with whose its things are, or who reaches them, behind its noun."""
        ends = self.items.ends
        if not phrase.owners:
            for pattern in (",? that|which belong|belongs to", "belonging to", "owned by", "of"):
                for start in ends(at, pattern):
                    yield from self._belonging(phrase, start)
            for start in ends(at, "that|which?"):
                for with_owner, end in self._belonging(phrase, start):
                    yield from ((with_owner, last) for last in ends(end, "owns|has|possesses"))
        for start in ends(at, ",? that|which|what?"):
            for robot, end in self.single_robot(start):
                for patterns, is_not in ((_REACH, False), (_NO_REACH, True)):
                    for pattern in patterns:
                        for last in ends(end, pattern):
                            yield _reached(phrase, robot, is_not), last
        for start in (at, *ends(at, ",? that|which BE")):
            yield from self.within_reach(phrase, start)

    def within_reach(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield "within reach of nao-1", "reachable by nao-1" and their opposites."""
        for pattern, is_not in (("within|in the? reach of", False), ("reachable by|for", False),
                                ("in|within range of", False), ("accessible to|for", False),
                                ("out of reach of|for", True), ("beyond the? reach of", True),
                                ("not reachable by|for", True)):  # fmt: skip
            for start in self.items.ends(at, pattern):
                yield from ((_reached(phrase, robot, is_not), end)
                            for robot, end in self.single_robot(start))  # fmt: skip

    def single_robot(self, at: int) -> Iterator[tuple[Name, int]]:
        """Yield a robot by name."""
        for start in self.items.ends(at, "DET? robot?"):
            name = self.items.name(start, "robot")
            if name is not None:
                yield name, name.mentions[0].end

    def _belonging(self, phrase: Phrase, at: int) -> Iterator[tuple[Phrase, int]]:
        name = self.items.name(at, "owner")
        if name is not None and not self._is_possessive(name):
            yield replace(phrase, owners=(name,)), name.mentions[0].end

    def _is_possessive(self, name: Name) -> bool:
        word = self.items.word(name.mentions[0].end - 1)
        return word.endswith(("'s", "\u2019s", "s'", "s\u2019"))


def _reached(phrase: Phrase, robot: Name, is_not: bool) -> Phrase:
    return replace(phrase, reached_by=(*phrase.reached_by, (robot, is_not)))
