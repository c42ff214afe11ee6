"""Base class of objects, the state of one, and the interfaces of its fields and its session.

The ground of the package: a field (:mod:`rtask.model.fields`) is a :class:`Property` that reads and
changes instances, and a session (:mod:`rtask.model.session`) is the :class:`UnitOfWork` of its
objects.
"""

from __future__ import annotations

import datetime as dt
import json
from abc import ABC, abstractmethod
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    NoReturn,
    Protocol,
    TypeAlias,
    cast,
    dataclass_transform,
    overload,
)

from rtask.errors import FieldError, UsageError
from rtask.model.codec import THING
from rtask.model.limits import Limits
from rtask.model.missing import missing_field, refuse_attribute
from rtask.model.registry import ClassRegistry, ModelType, count_class, generation
from rtask.rdf.terms import NamedNode, Term, iri

__all__ = [
    "Annotation",
    "Identity",
    "Model",
    "Pending",
    "Property",
    "Reads",
    "Registry",
    "State",
    "UnitOfWork",
]


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


class Reads(Protocol):
    """Reading of objects and of fields that were not read yet."""

    def load(self, instance: Model, field: Property) -> None:
        """Read one field of one object."""

    def members(self, instance: Model, field: Property, head: Term) -> tuple[Term, ...]:
        """Return the members of an RDF list."""

    def reference(self, name: str, model: type[Model], source: Model) -> Model:
        """Return the object of an IRI, which may not have been read yet."""

    def references(self, names: list[str], model: type[Model], source: Model) -> dict[str, Model]:
        """Return the objects of several IRIs that one object refers to."""


class UnitOfWork(Protocol):
    """A session as its objects see it (the unit of work of Fowler 2002)."""

    @property
    def reader(self) -> Reads:
        """What reads its objects."""

    def known(self, name: str) -> Model | None:
        """Return the object of an IRI if there is one; nothing is read."""

    def add(self, instance: Model) -> None:
        """Add a new object."""

    def mark(self, instance: Model) -> None:
        """Note that an object has changes."""

    def annotations(self, instance: Model, field: Property) -> list[Annotation]:
        """Return the annotations of a field's statements."""


@dataclass(frozen=True)
class Annotation:
    """One agent's annotation of a statement.

    Attributes
    ----------
    value
        The value of the statement; an IRI for an object.
    reifier
        IRI, or blank node label, of the resource that carries the notes.
    notes
        Field name, or property IRI if there is no such field, to values.
    """

    value: object
    reifier: str
    notes: Mapping[str, list[Any]] = field(default_factory=dict)

    @property
    def confidence(self) -> float | None:
        """The confidence in the statement, in [0, 1], if it is stated."""
        values = self.notes.get("confidence", ())
        return values[0] if values else None


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

    session: UnitOfWork | None = None
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


@dataclass_transform(kw_only_default=True, eq_default=False)
class Model(metaclass=ModelType):
    """Base of all classes bound to an OWL class.

    Keyword arguments are fields; without ``iri=``, the session mints an IRI for the individual.
    """

    __iri__: ClassVar[str] = ""
    __registry__: ClassVar[Registry]
    __required__: ClassVar[tuple[str, ...]] = ()
    __combined__: ClassVar[bool] = False
    __fields__: ClassVar[dict[str, Property]] = {}
    __by_iri__: ClassVar[dict[str, Property]] = {}

    __state__: State
    iri: Identity = Identity()

    def __init__(self, **values: Any) -> None:
        object.__setattr__(self, "__state__", State())
        for name, value in values.items():
            setattr(self, name, value)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        fields: dict[str, Property] = {}
        # The class itself last, so that its own fields replace those that it inherits.
        for base in reversed(cls.__mro__):
            fields.update(base.__dict__.get("__own_fields__", {}))
        cls.__fields__ = fields
        cls.__by_iri__ = {field.iri: field for field in fields.values()}
        count_class()
        if "__iri__" in cls.__dict__ and cls.__iri__:
            cls.__registry__.models[cls.__iri__] = cls

    def annotations(self, name: str) -> list[Annotation]:
        """Return the annotations of each statement of a field, such as its confidence."""
        about, session = field_of(self, name), self.__state__.session
        return [] if session is None or self.__state__.new else session.annotations(self, about)

    def to_dict(self) -> dict[str, Any]:
        """Return the values of the object: its IRI, its class and its fields by name.

        Other objects appear as their IRIs, several values as a list; fields without a value are
        left out. Fields stored with other objects (inverses) are included if they have been read.
        """
        state, eager_iris = self.__state__, eager(type(self))
        document: dict[str, Any] = {"iri": state.iri, "class": type(self).__name__}
        for name, about in sorted(type(self).__fields__.items()):
            # What was never read is left out, rather than asked for, one query for each object.
            here = state.new or about.iri in state.pending or state.knows(about.iri)
            if here or about.iri in eager_iris:
                value = about.plain(self)
                if value not in (None, []):
                    document[name] = value
        return document

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
        # A misspelt field would otherwise be set on the object, and stored nowhere.
        if name != "iri" and name not in type(self).__fields__:
            raise FieldError(missing_field(type(self), name), field=name)
        object.__setattr__(self, name, value)

    if not TYPE_CHECKING:
        __getattr__ = refuse_attribute

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        """Refuse to be copied or pickled: an object is a view of the graph, one in each session.

        Raises
        ------
        UsageError
            Always; says what to pass on instead.
        """
        raise UsageError(
            f"{self!r} belongs to a session and is neither pickled nor copied; pass on its iri and "
            f"use session.get({type(self).__name__}, iri) there, or its values: to_dict()"
        )

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.__state__.iri or 'new'}>"


def _json_text(value: object) -> str:
    return value.isoformat() if isinstance(value, dt.date) else str(value)


Registry: TypeAlias = ClassRegistry[Model]
"""The Python classes of one vocabulary."""


def absent(what: str, name: str, elsewhere: Mapping[str, str]) -> AttributeError:
    """Return the error for an attribute that is not there, with what to use instead if known."""
    hint = f"; use {elsewhere[name]}" if name in elsewhere else ""
    return AttributeError(f"a {what} has no {name!r}{hint}")


def term(item: Item) -> Term:
    """Return the RDF term of an item whose IRI is known."""
    return NamedNode(item.iri) if isinstance(item, Model) else item


class Property(ABC):
    """A property as an attribute of a class: its declaration, and its values on an instance.

    Parameters
    ----------
    iri
        The property.
    value
        IRI of the datatype, or of the class of the objects.
    functional
        Whether a second value is an error, whichever agent states it.
    inverse
        IRI of the inverse property.
    stored
        Whether this property is written; if not, its inverse is.
    unit
        Local name of the QUDT unit of the numbers.
    limits
        Constraints that values must satisfy.
    """

    single = True
    is_link = False
    is_list = False

    def __init__(
        self,
        iri: str,
        value: str,
        *,
        functional: bool = False,
        inverse: str | None = None,
        stored: bool = True,
        unit: str | None = None,
        limits: Limits | None = None,
    ) -> None:
        self.iri = iri
        self.value = value
        self.functional = functional
        self.inverse = inverse
        self.stored = stored
        self.unit = unit
        self.limits = limits or Limits()
        self.name = ""
        self.owner: type[Model] = Model

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self.name = name
        self.owner = owner
        if "__own_fields__" not in owner.__dict__:
            owner.__own_fields__ = {}
        owner.__own_fields__[name] = self

    def target(self) -> type[Model] | None:
        """Return the class of the objects, ``None`` for plain values."""
        if not self.is_link:
            return None
        registry = self.owner.__registry__
        return registry.find(self.value) or registry.find(THING) or Model

    def describe(self) -> str:
        """Return the field's name in messages, with its unit."""
        return f"{self.owner.__name__}.{self.name}" + (f" ({self.unit})" if self.unit else "")

    def refuse(self, value: object, expected: str, subject: Model | None) -> FieldError:
        """Return the error for a value."""
        where = f" of {subject!r}" if subject is not None else ""
        return FieldError(
            f"{self.describe()}{where} takes {expected}, not {value!r}  <{self.iri}>",
            field=self.name,
            iri=self.iri,
            expected=expected,
        )

    @abstractmethod
    def item(self, value: object, subject: Model | None = None) -> Item:
        """Return the item to store for a value.

        Raises
        ------
        FieldError
            With class, field, IRI, value and the expected kind of value.
        """

    @abstractmethod
    def items(self, instance: Model) -> list[Item]:
        """Return the values of the graph with the unwritten changes applied."""

    @abstractmethod
    def python(self, instance: Model, items: Sequence[Item]) -> list[Any]:
        """Return items as Python values; objects that were not read yet are read in one query."""

    @abstractmethod
    def plain(self, instance: Model) -> Any:
        """Return the value, or the list of several, with objects as their IRIs."""

    @abstractmethod
    def note(self, instance: Model, item: Item, add: bool) -> None:
        """Record one change on one side."""


def field_of(instance: Model, name: str) -> Property:
    """Return a field of an object by its name.

    Raises
    ------
    UsageError
        If its class has no such field.
    """
    field = type(instance).__fields__.get(name)
    if field is None:
        raise UsageError(f"{type(instance).__name__} has no field {name!r}")
    return field


def eager(model: type[Model], more: Sequence[Property] = ()) -> frozenset[str]:
    """Return the properties that are read with every object of a class or its subclasses.

    Fields stored with other objects (inverses) may be unbounded, and links that any individual may
    have are rarely needed: both are read on request.

    Parameters
    ----------
    more
        Additional fields to read.
    """
    return _eager(model, tuple(more), generation())


@lru_cache(maxsize=512)
def _eager(model: type[Model], more: tuple[Property, ...], at: int) -> frozenset[str]:
    fields = {field.iri: field for kind in family(model) for field in kind.__fields__.values()}
    along = {iri for iri, field in fields.items() if _comes_along(field)}
    return frozenset(along | {field.iri for field in more})


def _comes_along(field: Property) -> bool:
    return field.stored and not (field.is_link and field.owner.__iri__ == THING)


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
    models, open_ = {model}, [model]
    while open_:
        below = set(open_.pop().__subclasses__()) - models
        models |= below
        open_ += below
    return models
