"""Grammar of places: by name, by what is there, or as "there"."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

from rtask.tasks.language.grammar.quantities import Quantities
from rtask.tasks.language.items import Items
from rtask.tasks.language.meaning import Name, Phrase, Place

__all__ = ["Places"]


class Places(Quantities, ABC):
    """Rules for places in the words of one goal."""

    def __init__(self, items: Items) -> None:
        super().__init__(items)
        self._places: dict[int, list[tuple[Place, int]]] = {}

    @abstractmethod
    def phrases(self, at: int) -> Iterator[tuple[Phrase, int]]:
        """Yield phrases that begin here: a place may be where they are, and they be at a place."""

    def at_places(self, at: int, preposition: str) -> Iterator[tuple[Place, int]]:
        """Yield places behind a preposition."""
        for start in self.items.ends(at, preposition):
            yield from self.places(start)
        if preposition == "AT":
            for pattern in ("on top of", "inside of"):
                for start in self.items.ends(at, pattern):
                    yield from self.places(start)

    def destinations(self, at: int) -> Iterator[tuple[Place, int]]:
        """Yield places that are said to be where to."""
        aside = "POLITE? away|together|over|all|both|up|down|back|straight?"
        for start in self.items.ends(at, aside):
            for preposition in ("INTO", "AT"):
                yield from self.at_places(start, preposition)
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
