"""Base class of objects, its metaclass, and the state of one instance."""

from __future__ import annotations

import datetime as dt
import difflib
import json
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, cast, dataclass_transform, overload
from weakref import WeakKeyDictionary

from rtask.errors import FieldError, UsageError
from rtask.rdf.terms import NamedNode, Term, iri

if TYPE_CHECKING:
    from rtask.model.annotations import Annotation
    from rtask.model.fields import Field
    from rtask.model.session import Session

__all__ = ["Identity", "Model", "Pending", "Registry", "State"]


class Registry:
    """The Python classes of one vocabulary, by the IRIs of their OWL classes.

    Parameters
    ----------
    parent
        The vocabulary that this one extends.
    """

    def __init__(self, parent: Registry | None = None) -> None:
        self.models: dict[str, type[Model]] = {}
        self.parent = parent
        self._combined: dict[tuple[type[Model], ...], type[Model]] = {}

        self._specific: dict[object, type[Model]] = {}
        self._others: dict[object, type[Model] | None] = {}

    def find(self, iri: str) -> type[Model] | None:
        """Return the class of an IRI, if there is one."""
        found = self.models.get(iri)
        return found or (self.parent.find(iri) if self.parent else None)

    def __iter__(self) -> Iterator[type[Model]]:
        if self.parent:
            yield from self.parent
        yield from self.models.values()

    def most_specific(
        self, types: frozenset[str], asked: type[Model], others: Iterable[Registry] = ()
    ) -> type[Model]:
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

    def other_class(self, types: frozenset[str], asked: type[Model]) -> type[Model] | None:
        """Return the known class of an individual of these types, unless it is the given one."""
        key = ("other", asked, types, generation())
        if key not in self._others:
            kinds = [kind for kind in map(self.find, types) if kind is not None]
            fits = not kinds or any(issubclass(kind, asked) for kind in kinds)
            self._others[key] = None if fits else max(kinds, key=lambda kind: len(kind.__mro__))
        return self._others[key]

    def _find_most_specific(
        self, types: Iterable[str], asked: type[Model], vocabularies: list[Registry]
    ) -> type[Model]:
        found = (vocabulary.find(name) for name in types for vocabulary in vocabularies)
        known = {model for model in found if model} | {asked}
        lowest = [m for m in known if not any(o is not m and issubclass(o, m) for o in known)]
        if len(lowest) == 1:
            return lowest[0]
        bases = tuple(sorted(lowest, key=rank))
        if bases not in self._combined:
            name = "And".join(sorted(model.__name__ for model in bases))
            self._combined[bases] = make_class(name, bases, {"__combined__": True})
        return self._combined[bases]


def generation() -> int:
    """Return a number that rises with each new class, for caches keyed by class."""
    return len(_born)


_born: list[None] = []
_loaded: WeakKeyDictionary[object, dict[str, Registry]] = WeakKeyDictionary()


def vocabularies_of(kb: object) -> dict[str, Registry]:
    """Return the vocabularies created for a knowledge base, by the ontology's IRI."""
    return _loaded.setdefault(kb, {})


class Identity:
    """The attribute ``iri`` of every instance."""

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> Identity: ...
    @overload
    def __get__(self, instance: Model, owner: type[Any]) -> str: ...
    def __get__(self, instance: Model | None, owner: type[Any]) -> Identity | str:
        if instance is None:
            return self
        state = instance.__state__
        if state.iri is None:
            name = type(instance).__name__
            raise UsageError(f"a new {name} has no IRI before a session knows it: session.add()")
        return state.iri

    def __set__(self, instance: Model, value: str | NamedNode | None) -> None:
        if instance.__state__.iri is not None:
            raise UsageError(f"{instance!r} keeps its IRI; make another instance")
        if value is not None:
            instance.__state__.iri = iri(value).value


Item: TypeAlias = "Term | Model"


@dataclass
class Pending:
    """Unwritten changes of one field."""

    added: list[Item] = field(default_factory=list)
    removed: list[Item] = field(default_factory=list)
    replace: bool = False


class _Everything:
    def __contains__(self, item: object) -> bool:
        return True


EVERYTHING: Container[str] = _Everything()
"""All properties."""


@dataclass(slots=True)
class State:
    """State of one instance: what was read and what was changed.

    Parameters
    ----------
    session
        The session that reads and writes it; ``None`` before it is added to one.
    iri
        ``None`` before it has one.
    new
        Whether it is not yet in the graph.
    loaded
        Property IRI to values in the graph.
    asked
        The properties that were requested: one without values in ``loaded`` has none.
    lists
        Property IRI to the members of an RDF list that was read.
    pending
        Property IRI to the changes.
    origin
        The class that was queried, if the instance is one of several results: reading a missing
        property would then take one query per instance.
    companions
        Objects prefetched with it, kept alive as long as it is.
    """

    session: Session | None = None
    iri: str | None = None
    new: bool = True
    deleted: bool = False
    loaded: dict[str, tuple[Term, ...] | list[Term]] = field(default_factory=dict)
    asked: Container[str] = frozenset()
    lists: dict[str, tuple[Term, ...]] = field(default_factory=dict)
    pending: dict[str, Pending] = field(default_factory=dict)
    origin: str | None = None
    companions: list[Model] = field(default_factory=list)

    @property
    def is_read(self) -> bool:
        """Whether anything about the instance was read."""
        return bool(self.loaded) or self.asked is EVERYTHING or bool(self.asked)

    def knows(self, predicate: str) -> bool:
        """Whether the values of a property were read."""
        return predicate in self.loaded or predicate in self.asked

    def note(self, asked: Container[str]) -> None:
        """Record what was read, in addition to earlier reads."""
        if isinstance(self.asked, frozenset) and isinstance(asked, frozenset):
            self.asked = self.asked | asked if self.asked else asked
        else:
            self.asked = EVERYTHING

    def forget(self) -> None:
        """Discard what was read, but keep changes."""
        self.loaded, self.lists = {}, {}
        self.asked = frozenset()
        self.origin = None


class ModelType(type):
    """Metaclass with a linearisation that any two classes of an ontology can share.

    Python's own order of bases (C3) cannot combine every two classes. Here the ancestors of a class
    are always visited in the same order: a class before its superclasses, otherwise by IRI.
    """

    def mro(cls) -> list[type]:
        above = {model for base in cls.__bases__ for model in base.__mro__} - {object}
        return [cls, *sorted(above, key=rank), object]


def rank(model: type) -> tuple[int, str]:
    """Return a sort key that puts classes with more ancestors first."""
    return (-len(model.__mro__), str(getattr(model, "__iri__", "")))


@dataclass_transform(kw_only_default=True, eq_default=False)
class Model(metaclass=ModelType):
    """Base of all classes bound to an OWL class.

    Keyword arguments are fields; without ``iri=``, the session mints an IRI for the individual.
    """

    __iri__: ClassVar[str] = ""
    __registry__: ClassVar[Registry]
    __required__: ClassVar[tuple[str, ...]] = ()
    __combined__: ClassVar[bool] = False
    __fields__: ClassVar[dict[str, Field]] = {}
    __by_iri__: ClassVar[dict[str, Field]] = {}

    __state__: State
    iri: Identity = Identity()

    def __init__(self, **values: Any) -> None:
        object.__setattr__(self, "__state__", State())
        for name, value in values.items():
            setattr(self, name, value)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        fields: dict[str, Field] = {}
        for base in reversed(cls.__mro__):
            fields.update(base.__dict__.get("__own_fields__", {}))
        cls.__fields__ = fields
        cls.__by_iri__ = {field.iri: field for field in fields.values()}
        _born.append(None)
        if "__iri__" in cls.__dict__ and cls.__iri__:
            cls.__registry__.models[cls.__iri__] = cls

    def annotations(self, name: str) -> list[Annotation]:
        """Return the annotations of each statement of a field, such as its confidence."""
        from rtask.model.annotations import read_annotations

        return read_annotations(self, name)

    def to_dict(self) -> dict[str, Any]:
        """Return the values of the object: its IRI, its class and its fields by name.

        Other objects appear as their IRIs, several values as a list; fields without a value are
        left out. Fields stored with other objects (inverses) are included if they have been read.
        """
        from rtask.model.query.plan import eager

        state, wanted = self.__state__, eager(type(self))
        found: dict[str, Any] = {"iri": state.iri, "class": type(self).__name__}
        for name, about in sorted(type(self).__fields__.items()):
            here = state.new or about.iri in state.pending or state.knows(about.iri)
            if here or about.iri in wanted:
                value = about.plain(self)
                if value not in (None, []):
                    found[name] = value
        return found

    def to_json(self, **options: Any) -> str:
        """Return :meth:`to_dict` as JSON text.

        Dates and times are in ISO 8601, decimals become strings, and language tags are dropped.

        Parameters
        ----------
        **options
            Passed on to :func:`json.dumps`, such as ``indent=2``.
        """
        return json.dumps(self.to_dict(), default=_json_text, **options)

    def __setattr__(self, name: str, value: object) -> None:
        if name != "iri" and name not in type(self).__fields__:
            near = difflib.get_close_matches(name, type(self).__fields__, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise FieldError(f"{type(self).__name__} has no field {name!r}{hint}", field=name)
        object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.__state__.iri or 'new'}>"


def _json_text(value: object) -> str:
    return value.isoformat() if isinstance(value, dt.date) else str(value)


def make_class(name: str, bases: tuple[type[Model], ...], body: dict[str, Any]) -> type[Model]:
    """Create a class at run time."""
    return cast(type[Model], ModelType(name, bases, body))


def class_iris(model: type[Model]) -> list[str]:
    """Return the IRIs of the OWL classes that a Python class stands for."""
    if not model.__combined__:
        return [model.__iri__]
    return [base.__iri__ for base in model.__bases__ if issubclass(base, Model)]


def required(model: type[Model]) -> set[str]:
    """Return the names of the fields that an instance must have."""
    return {name for base in model.__mro__ for name in getattr(base, "__required__", ())}


def family(model: type[Model]) -> set[type[Model]]:
    """Return a class with all its subclasses."""
    found, open_ = {model}, [model]
    while open_:
        below = set(open_.pop().__subclasses__()) - found
        found |= below
        open_ += below
    return found
