"""Registries of classes: the Python classes of a vocabulary by the IRIs of their OWL classes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, Generic, TypeVar
from weakref import WeakKeyDictionary

from rtask.model.missing import refuse_path

__all__ = ["ClassRegistry", "ModelType", "count_class", "generation", "rank", "vocabularies_of"]

K = TypeVar("K")


class ClassRegistry(Generic[K]):
    """The Python classes of one vocabulary, by the IRIs of their OWL classes.

    Parameters
    ----------
    parent
        The vocabulary that this one extends.
    """

    def __init__(self, parent: ClassRegistry[K] | None = None) -> None:
        self.models: dict[str, type[K]] = {}
        self.parent = parent
        self._combined: dict[tuple[type[K], ...], type[K]] = {}

        self._specific: dict[object, type[K]] = {}
        self._others: dict[object, type[K] | None] = {}

    def find(self, iri: str) -> type[K] | None:
        """Return the class of an IRI, if there is one."""
        model = self.models.get(iri)
        return model or (self.parent.find(iri) if self.parent else None)

    def __iter__(self) -> Iterator[type[K]]:
        if self.parent:
            yield from self.parent
        yield from self.models.values()

    def most_specific(
        self, types: frozenset[str], asked: type[K], others: Iterable[ClassRegistry[K]] = ()
    ) -> type[K]:
        """Return the most specific class for an individual of these types.

        An individual of several unrelated classes gets a class that inherits from all of them.

        Parameters
        ----------
        others
            Further vocabularies to look in.
        """
        vocabularies = [self, *others]
        key = (asked, types, generation(), *map(id, vocabularies))
        if key not in self._specific:
            self._specific[key] = self._find_most_specific(types, asked, vocabularies)
        return self._specific[key]

    def other_class(self, types: frozenset[str], asked: type[K]) -> type[K] | None:
        """Return the known class of an individual of these types, unless it is the given one."""
        key = ("other", asked, types, generation())
        if key not in self._others:
            kinds = [kind for kind in map(self.find, types) if kind is not None]
            fits = not kinds or any(issubclass(kind, asked) for kind in kinds)
            self._others[key] = None if fits else max(kinds, key=lambda kind: len(kind.__mro__))
        return self._others[key]

    def _find_most_specific(
        self, types: Iterable[str], asked: type[K], vocabularies: list[ClassRegistry[K]]
    ) -> type[K]:
        models = (vocabulary.find(name) for name in types for vocabulary in vocabularies)
        candidates = {model for model in models if model} | {asked}
        lowest = [
            m for m in candidates if not any(o is not m and issubclass(o, m) for o in candidates)
        ]
        if len(lowest) == 1:
            return lowest[0]
        bases = tuple(sorted(lowest, key=rank))
        if bases not in self._combined:
            name = "And".join(sorted(model.__name__ for model in bases))
            metaclass: Any = type(bases[0])
            self._combined[bases] = metaclass(name, bases, {"__combined__": True})
        return self._combined[bases]


class ModelType(type):
    """Metaclass with a linearisation that any two classes of an ontology can share.

    Python's own order of bases (C3) cannot combine every two classes. Here the ancestors of a class
    are always visited in the same order: a class before its superclasses, otherwise by IRI.
    """

    def mro(cls) -> list[type]:
        above = {model for base in cls.__bases__ for model in base.__mro__} - {object}
        return [cls, *sorted(above, key=rank), object]

    if not TYPE_CHECKING:
        __getattr__ = refuse_path


def rank(model: type) -> tuple[int, str]:
    """Return a sort key that puts classes with more ancestors first."""
    return (-len(model.__mro__), str(getattr(model, "__iri__", "")))


def generation() -> int:
    """Return a number that rises with each new class, for caches keyed by class."""
    return len(_born)


def count_class() -> None:
    """Note that there is a new class."""
    _born.append(None)


_born: list[None] = []
_loaded: WeakKeyDictionary[object, dict[str, ClassRegistry[Any]]] = WeakKeyDictionary()


def vocabularies_of(kb: object) -> dict[str, ClassRegistry[Any]]:
    """Return the vocabularies created for a knowledge base, by the ontology's IRI."""
    return _loaded.setdefault(kb, {})
