"""Read statements and turn them into objects."""

from __future__ import annotations

import warnings
from collections.abc import Container, Iterable, Sequence
from typing import Literal, TypeAlias, TypeVar

from rtask.errors import LazyLoadError, UnknownTermError
from rtask.model.codec import RDF_TYPE
from rtask.model.identity import IdentityMap
from rtask.model.instance import EVERYTHING, Model, Property, Registry, UnitOfWork, eager
from rtask.model.query.compile import fetch_filter
from rtask.model.query.plan import short
from rtask.model.registry import generation, vocabularies_of
from rtask.model.view import View
from rtask.rdf.terms import NamedNode, Term

__all__ = ["Facts", "Lazy", "Reader", "collect"]

M = TypeVar("M", bound=Model)
Lazy = Literal["raise", "warn", "allow"]
Facts: TypeAlias = "dict[str, tuple[Term, ...] | list[Term]]"
"""Property IRI to values."""

_WHOLE = 500
"""Of an object with more statements than this, only the required properties are read."""


class Reader:
    """Reads objects for one session.

    Parameters
    ----------
    session
        The session that the objects belong to.
    view
        What it reads from.
    identities
        Its objects.
    lazy
        How to handle access, in a loop over results, to what the query did not read.
    """

    def __init__(
        self, session: UnitOfWork, view: View, identities: IdentityMap, lazy: Lazy
    ) -> None:
        self._session = session
        self._view = view
        self._identities = identities
        self._lazy = lazy
        self._classes: dict[object, type[Model]] = {}

    # Statements

    def fetch(self, model: type[M], name: str) -> M | None:
        """Return the object of an IRI, freshly read, or ``None`` if nothing is stated about it.

        Raises
        ------
        UnknownTermError
            If it belongs to another class.
        """
        facts, asked = self._everything(name)
        if facts is None:
            facts, asked = self._facts([name], model)[name], eager(model)
        if not facts:
            return None
        registry = getattr(model, "__registry__", None) or Registry()
        other = registry.other_class(_iris(facts.get(RDF_TYPE, ())), model)
        if other is not None:
            raise UnknownTermError(f"{name} is a {other.__name__}, not a {model.__name__}")
        made = self.materialise(name, model, facts, asked, None)
        assert isinstance(made, model)
        return made

    def _everything(self, name: str) -> tuple[Facts | None, Container[str]]:
        """Return all statements about an individual from the store, unless there are too many."""
        self._view.check_open()
        if not self._view.inferred:
            return None, ()
        facts: Facts = {}
        count = 0
        for predicate, value in self._view.backing.about(NamedNode(name), _WHOLE + 1):
            collect(facts, predicate, value)
            count += 1
        return (facts, EVERYTHING) if count <= _WHOLE else (None, ())

    def _facts(self, names: Iterable[str], model: type[Model]) -> dict[str, Facts]:
        """Read the eager properties of objects: property IRI to values, for each IRI."""
        subjects = " ".join(str(NamedNode(name)) for name in names)
        pattern = f"VALUES ?s {{ {subjects} }} ?s ?p ?o FILTER(?p IN ({fetch_filter(model)}))"
        return self._gather(names, pattern)

    def _gather(self, names: Iterable[str], pattern: str) -> dict[str, Facts]:
        facts: dict[str, Facts] = {name: {} for name in names}
        for row in self._view.select(f"SELECT DISTINCT ?s ?p ?o WHERE {{ {pattern} }}"):
            subject, predicate, value = row
            assert isinstance(subject, NamedNode)
            assert isinstance(predicate, NamedNode)
            assert value is not None
            collect(facts[subject.value], predicate.value, value)
        return facts

    # Objects

    def reference(self, name: str, model: type[Model], source: Model) -> Model:
        """Return the object of an IRI, which may not have been read yet."""
        existing = self._identities.find(name)
        return existing or self._blank(model, name, source.__state__.origin)

    def references(self, names: list[str], model: type[Model], source: Model) -> dict[str, Model]:
        """Return the objects of several IRIs that one object refers to.

        They are read with one query, unless ``source`` is one of many results: then only
        prefetched objects are available.
        """
        referenced = {name: self.reference(name, model, source) for name in names}
        if source.__state__.origin is None or self._lazy == "allow":
            unread = [
                n for n, o in referenced.items() if not (o.__state__.is_read or o.__state__.new)
            ]
            for name, facts in (self._facts(unread, model) if unread else {}).items():
                self.materialise(name, model, facts, eager(model), None)
        return referenced

    def _blank(self, model: type[M], name: str, origin: str | None) -> M:
        made = model()
        state = made.__state__
        state.session, state.iri, state.new, state.origin = self._session, name, False, origin
        self._identities.add(name, made)
        return made

    def materialise(
        self,
        name: str,
        asked: type[Model],
        facts: Facts,
        fetched: Container[str],
        origin: str | None,
    ) -> Model:
        """Return the object of an IRI, with what was read about it filled in.

        Parameters
        ----------
        facts
            Property IRI to values; the object keeps it.
        fetched
            The properties that were requested; those that are absent from ``facts`` have no value.
        """
        instance = self._identities.find(name)
        kinds = tuple(facts.get(RDF_TYPE, ()))
        if instance is None:
            instance = self._blank(self._best(asked, kinds), name, origin)
        else:
            wider = type(instance) if issubclass(type(instance), asked) else asked
            best = self._best(wider, kinds)
            if best is not type(instance):
                object.__setattr__(instance, "__class__", best)
        state, fields = instance.__state__, type(instance).__by_iri__
        if state.loaded:
            state.loaded.update(facts)
        else:
            state.loaded = facts
        for predicate, values in facts.items():
            if len(values) > 1 and predicate in fields and fields[predicate].single:
                state.loaded[predicate] = self._own_first(name, predicate, values)
        state.note(fetched)
        state.origin = origin
        return instance

    def _best(self, asked: type[Model], kinds: tuple[Term, ...]) -> type[Model]:
        """Return the most specific known class of an individual of these types."""
        key = (asked, kinds, generation())
        if key not in self._classes:
            registry = getattr(asked, "__registry__", None)
            others = vocabularies_of(self._view.kb).values()
            self._classes[key] = (
                registry.most_specific(_iris(kinds), asked, others) if registry else asked
            )
        return self._classes[key]

    def _own_first(self, name: str, predicate: str, values: Sequence[Term]) -> list[Term]:
        """Return values with the agent's own first; a single-valued field shows the first."""
        view = self._view
        own = view.kb.match(NamedNode(name), NamedNode(predicate), None, view.home)
        mine = {quad.object for quad in own}
        return sorted(values, key=lambda value: (value not in mine, str(value)))

    # Fields that were not read

    def load(self, instance: Model, field: Property) -> None:
        """Read one field of one object; fields call it.

        Raises
        ------
        LazyLoadError
            If the object is one of several results.
        """
        state = instance.__state__
        self._refuse_loops(instance, field)
        name = str(state.iri)
        if state.origin is None:
            facts, asked = self._everything(name)
            if facts is not None:
                self.materialise(name, type(instance), facts, asked, None)
                return
        fetched = frozenset({field.iri})
        if field.stored and state.origin is None:
            fetched |= {iri for iri in eager(type(instance)) if not state.knows(iri)}
        listed = ", ".join(map(short, sorted({RDF_TYPE, *fetched})))
        here = f"VALUES ?s {{ {NamedNode(name)} }}"
        pattern = f"{here} ?s ?p ?o FILTER(?p IN ({listed}))"
        if not self._view.inferred and not field.stored and field.inverse:
            back = f"{here} ?o {short(field.inverse)} ?s BIND({short(field.iri)} AS ?p)"
            pattern = f"{{ {pattern} }} UNION {{ {back} }}"
        gathered = self._gather([name], pattern)[name]
        self.materialise(name, type(instance), gathered, fetched, state.origin)

    def _refuse_loops(self, instance: Model, field: Property) -> None:
        state = instance.__state__
        if state.origin is None or self._lazy == "allow":
            return
        message = (
            f"{type(instance).__name__}.{field.name} of {instance!r} was not read by the"
            f" query for {state.origin}, and one query per object is slow: add"
            f" {_prefetch_of(instance, field)}, or use .values()"
        )
        if self._lazy == "raise":
            raise LazyLoadError(message, field=field.name)
        warnings.warn(message, stacklevel=6)

    def members(self, instance: Model, field: Property, head: Term) -> tuple[Term, ...]:
        """Return the members of an RDF list; of a malformed list, those before the defect."""
        self._refuse_loops(instance, field)
        cells = self._cells(str(instance.__state__.iri), field)
        members, seen = list[Term](), set[Term]()
        while head in cells and head not in seen:
            seen.add(head)
            first, head = cells[head]
            members.append(first)
        return tuple(members)

    def _cells(self, name: str, field: Property) -> dict[Term, tuple[Term, Term]]:
        """Return the cells of the lists that a field has: first and rest of each."""
        path = f"{NamedNode(name)} {short(field.iri)}/rdf:rest* ?cell"
        cell = "?cell rdf:first ?first ; rdf:rest ?rest"
        text = f"SELECT ?cell ?first ?rest WHERE {{ {path} . {cell} }}"
        return {
            cell: (first, rest)
            for cell, first, rest in self._view.select(text)
            if cell is not None and first is not None and rest is not None
        }


def collect(facts: Facts, predicate: str, value: Term | None) -> None:
    """Add a value; a single one is kept as a tuple, which the garbage collector does not track."""
    assert value is not None
    values = facts.get(predicate)
    if values is None:
        facts[predicate] = (value,)
    elif isinstance(values, tuple):
        facts[predicate] = [*values, value]
    else:
        values.append(value)


def _iris(terms: Iterable[Term]) -> frozenset[str]:
    return frozenset(term.value for term in terms if isinstance(term, NamedNode))


def _prefetch_of(instance: Model, field: Property) -> str:
    """Return the call that has a query read a field, as far as its path is known."""
    origin = instance.__state__.origin
    if any(base.__name__ == origin for base in type(instance).__mro__):
        return f".prefetch({origin}.{field.name})"
    if not field.is_link:
        return f".prefetch() of the path to it, {origin}. ... up to this {type(instance).__name__}"
    return f".prefetch() of the path to it, {origin}. ... .{field.name}"
