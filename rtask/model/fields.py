"""Fields: properties as attributes, checked when they are set.

On a class a field is a :class:`~rtask.model.query.expressions.Path` for queries, on an instance its
value or a :class:`Values` collection.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any, Generic, TypeVar, overload

from rtask.errors import FieldError
from rtask.model.codec import decode, encode
from rtask.model.instance import Item, Model, Pending, Property
from rtask.model.query.expressions import Path
from rtask.rdf.terms import Literal, NamedNode

__all__ = ["Field", "Link", "Links", "Many", "One", "Values"]

T = TypeVar("T")
M = TypeVar("M", bound=Model)


class Field(Property):
    """A property as a descriptor, which checks what is set and reads what is not yet there."""

    # Checking

    def item(self, value: object, subject: Model | None = None) -> Item:
        """Return the item to store for a value.

        Raises
        ------
        FieldError
            With class, field, IRI, value and the expected kind of value.
        """
        return self._link(value, subject) if self.is_link else self._literal(value, subject)

    def _literal(self, value: object, subject: Model | None) -> Literal:
        try:
            made = encode(value, self.value)
        except ValueError as error:
            raise self.refuse(value, str(error), subject) from None
        complaint = self.limits.complaint(decode(made))
        if complaint:
            raise self.refuse(value, complaint, subject)
        return made

    def _link(self, value: object, subject: Model | None) -> Item:
        target = self.target() or Model
        if isinstance(value, Model):
            # an object of a broader class may still turn out to be of the expected one
            if not (isinstance(value, target) or issubclass(target, type(value))):
                raise self.refuse(value, f"a {target.__name__}", subject)
            name = value.__state__.iri
        elif isinstance(value, NamedNode):
            name = value.value
        else:
            raise self.refuse(value, f"a {target.__name__} or its NamedNode", subject)
        if self.limits.one_of and name not in self.limits.one_of:
            near = difflib.get_close_matches(str(name), self.limits.one_of, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise self.refuse(value, f"one of the list of {target.__name__}{hint}", subject)
        return value

    # Reading and changing

    def items(self, instance: Model) -> list[Item]:
        """Return the values of the graph with the unwritten changes applied."""
        state = instance.__state__
        pending = state.pending.get(self.iri)
        if pending is not None and pending.replace:
            return list(pending.added)
        if not state.new and state.session is not None and not state.knows(self.iri):
            state.session.reader.load(instance, self)
        if pending is None:
            return list(state.loaded.get(self.iri, ()))
        removed = {key(item) for item in pending.removed}
        seen: dict[object, Item] = {}
        for item in (*state.loaded.get(self.iri, ()), *pending.added):
            if key(item) not in removed:
                seen.setdefault(key(item), item)
        return list(seen.values())

    def python(self, instance: Model, items: Sequence[Item]) -> list[Any]:
        """Return items as Python values; objects that were not read yet are read in one query."""
        session = instance.__state__.session
        if not self.is_link:
            return [decode(item) if not isinstance(item, Model) else item for item in items]
        if session is None:
            return list(items)
        names = [item.value for item in items if isinstance(item, NamedNode)]
        referenced = session.reader.references(names, self.target() or Model, instance)
        return [referenced[item.value] if isinstance(item, NamedNode) else item for item in items]

    def plain(self, instance: Model) -> Any:
        """Return the value, or the list of several, with objects as their IRIs."""
        items = self.items(instance)
        if self.single:
            return plain_item(items[0]) if items else None
        return [plain_item(item) for item in sorted(items, key=lambda item: str(key(item)))]

    def put(self, instance: Model, values: Iterable[object]) -> None:
        """Replace all values."""
        items = [self.item(value, instance) for value in values]
        if self.single and len(items) > 1:
            raise self.refuse(values, "one value", instance)
        if self.inverse is not None:
            new_keys = {key(item) for item in items}
            for old in self.items(instance):
                if key(old) not in new_keys:
                    self._couple(instance, old, add=False)
            old_keys = {key(item) for item in self.items(instance)}
            for item in items:
                if key(item) not in old_keys:
                    self._couple(instance, item, add=True)
        if self.stored:
            pending = self._change(instance)
            pending.replace, pending.added, pending.removed = True, items, []
        self._adopt(instance, items)

    def __delete__(self, instance: Model) -> None:
        """Remove all values."""
        self.put(instance, ())

    def add(self, instance: Model, value: object) -> None:
        """Add one value."""
        item = self.item(value, instance)
        if self.inverse is not None:
            self._couple(instance, item, add=True)
        else:
            self.note(instance, item, add=True)
        self._adopt(instance, [item])

    def discard(self, instance: Model, value: object) -> None:
        """Remove one value."""
        item = self.item(value, instance)
        if self.inverse is not None:
            self._couple(instance, item, add=False)
        else:
            self.note(instance, item, add=False)

    def _adopt(self, instance: Model, items: Iterable[Item]) -> None:
        """Add new objects to the session of the object that now refers to them."""
        session = instance.__state__.session
        for item in items:
            if session is not None and isinstance(item, Model) and item.__state__.session is None:
                session.add(item)

    def _couple(self, instance: Model, item: Item, add: bool) -> None:
        """Change both sides of a pair of inverse properties; one of them is stored."""
        other = item
        session = instance.__state__.session
        if isinstance(other, NamedNode) and session is not None:
            other = session.reader.reference(other.value, self.target() or Model, instance)
        back = type(other).__by_iri__.get(self.inverse or "") if isinstance(other, Model) else None
        if back is None and not self.stored:
            raise self.refuse(
                item,
                "an object, because the statement is stored with the object's own field",
                instance,
            )
        if back is not None and isinstance(other, Model):
            if add and back.single:
                self._leave(other, back, instance)
            back.note(other, instance, add=add)
        self.note(instance, other, add=add)

    def _leave(self, other: Model, back: Property, instance: Model) -> None:
        """Remove ``other`` from this field of the object that it referred to before."""
        state = other.__state__
        if back.iri not in state.pending and not state.knows(back.iri):
            return
        for old in back.items(other):
            if isinstance(old, NamedNode) and state.session is not None:
                old = state.session.known(old.value) or old
            if isinstance(old, Model) and old is not instance:
                self.note(old, other, add=False)

    def note(self, instance: Model, item: Item, add: bool) -> None:
        """Record one change on one side."""
        pending = self._change(instance)
        if self.single:
            pending.replace, pending.added = True, [item] if add else []
            return
        gains, losses = pending.added, pending.removed
        if not add:
            gains, losses = losses, gains
        losses[:] = [other for other in losses if key(other) != key(item)]
        if key(item) not in map(key, gains) and not (pending.replace and not add):
            gains.append(item)

    def _change(self, instance: Model) -> Pending:
        state = instance.__state__
        if state.session is not None and self.stored:
            state.session.mark(instance)
        return state.pending.setdefault(self.iri, Pending())


def key(item: Item) -> object:
    """Return the key by which two items are equal."""
    if isinstance(item, Model):
        return item.__state__.iri or id(item)
    return item.value if isinstance(item, NamedNode) else item


def plain_item(item: Item) -> Any:
    """Return a decoded literal, or the IRI of an object (``None`` before it has one)."""
    if isinstance(item, Model):
        return item.__state__.iri
    return item.value if isinstance(item, NamedNode) else decode(item)


class One(Field, Generic[T]):
    """At most one plain value."""

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> Path[T]: ...
    @overload
    def __get__(self, instance: Model, owner: type[Any]) -> T | None: ...
    def __get__(self, instance: Model | None, owner: type[Any]) -> Any:
        if instance is None:
            return Path(owner, (self,))
        values = self.python(instance, self.items(instance)[:1])
        return values[0] if values else None

    def __set__(self, instance: Model, value: T | None) -> None:
        self.put(instance, () if value is None else (value,))


class Many(Field, Generic[T]):
    """Any number of plain values."""

    single = False

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> Path[T]: ...
    @overload
    def __get__(self, instance: Model, owner: type[Any]) -> Values[T]: ...
    def __get__(self, instance: Model | None, owner: type[Any]) -> Any:
        return Path(owner, (self,)) if instance is None else Values(instance, self)

    def __set__(self, instance: Model, value: Iterable[T] | T) -> None:
        if isinstance(value, Iterable) and not isinstance(value, str):
            self.put(instance, value)
        else:
            self.put(instance, (value,))


class Link(Field, Generic[M]):
    """At most one other object."""

    is_link = True

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> Path[str]: ...
    @overload
    def __get__(self, instance: Model, owner: type[Any]) -> M | None: ...
    def __get__(self, instance: Model | None, owner: type[Any]) -> Any:
        if instance is None:
            return Path(owner, (self,))
        values = self.python(instance, self.items(instance)[:1])
        return values[0] if values else None

    def __set__(self, instance: Model, value: M | NamedNode | None) -> None:
        self.put(instance, () if value is None else (value,))


class Links(Field, Generic[M]):
    """Any number of other objects."""

    is_link = True
    single = False

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> Path[str]: ...
    @overload
    def __get__(self, instance: Model, owner: type[Any]) -> Values[M]: ...
    def __get__(self, instance: Model | None, owner: type[Any]) -> Any:
        return Path(owner, (self,)) if instance is None else Values(instance, self)

    def __set__(self, instance: Model, value: Iterable[M | NamedNode] | M | NamedNode) -> None:
        self.put(instance, value if isinstance(value, Iterable) else (value,))


class Values(Collection[T]):
    """Mutable view of a field's values on one instance."""

    def __init__(self, instance: Model, field: Field) -> None:
        self._instance = instance
        self._field = field

    def __iter__(self) -> Iterator[T]:
        items = self._field.items(self._instance)
        if len(items) > 1:
            items.sort(key=lambda item: str(key(item)))
        return iter(self._field.python(self._instance, items))

    def __len__(self) -> int:
        return len(self._field.items(self._instance))

    def __contains__(self, value: object) -> bool:
        try:
            member = key(self._field.item(value))
        except FieldError:
            return False
        return member in map(key, self._field.items(self._instance))

    def add(self, value: T | NamedNode) -> None:
        """Add a value if absent."""
        self._field.add(self._instance, value)

    def discard(self, value: T | NamedNode) -> None:
        """Remove a value if present."""
        self._field.discard(self._instance, value)

    def update(self, values: Iterable[T | NamedNode]) -> None:
        """Add several values."""
        for value in values:
            self.add(value)

    def clear(self) -> None:
        """Remove all values."""
        self._field.put(self._instance, ())

    def __repr__(self) -> str:
        return f"{{{', '.join(map(repr, self))}}}"
