"""Fields whose values have an order: RDF lists (RDF Schema, 5.2)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Generic, TypeVar, overload

from rtask.model.codec import RDFS_LITERAL, THING
from rtask.model.fields import Field, plain_item
from rtask.model.instance import Item, Model
from rtask.model.query.expressions import Path
from rtask.rdf.terms import NamedNode, Term

__all__ = ["Ordered"]

T = TypeVar("T")


class Ordered(Field, Generic[T]):
    """An RDF list; a tuple, replaced as a whole.

    In a query the path stands for each member: ``Plan.steps == first`` holds if any member is
    ``first``.
    """

    single = False
    is_list = True

    def __init__(self, iri: str, value: str = RDFS_LITERAL, **options: Any) -> None:
        super().__init__(iri, value, **options)

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> Path[T]: ...
    @overload
    def __get__(self, instance: Model, owner: type[Any]) -> tuple[T, ...]: ...
    def __get__(self, instance: Model | None, owner: type[Any]) -> Any:
        if instance is None:
            return Path(owner, (self,))
        return tuple(self.python(instance, self.members(instance)))

    def __set__(self, instance: Model, value: Iterable[T]) -> None:
        self.put(instance, value)

    def item(self, value: object, subject: Model | None = None) -> Item:
        """Return what is stored for a member: an object, an IRI, or a literal."""
        if isinstance(value, Model | NamedNode):
            return value
        return self._literal(value, subject)

    def put(self, instance: Model, values: Iterable[object]) -> None:
        """Replace the list."""
        if isinstance(values, str | bytes):
            raise self.refuse(values, "a list", instance)
        items = [self.item(value, instance) for value in values]
        pending = self._change(instance)
        pending.replace, pending.added = True, items
        self._adopt(instance, items)

    def members(self, instance: Model) -> list[Item]:
        """Return the members in order, with the program's own changes."""
        state = instance.__state__
        if self.iri in state.pending:
            return list(state.pending[self.iri].added)
        heads = [head for head in self.items(instance) if not isinstance(head, Model)]
        if not heads or state.session is None:
            return []
        if self.iri not in state.lists:
            state.lists[self.iri] = state.session.reader.members(instance, self, heads[0])
        return list(state.lists[self.iri])

    def python(self, instance: Model, items: Iterable[Item]) -> list[Any]:
        """Return members as Python objects and values."""
        items = list(items)
        session = instance.__state__.session
        names = [item.value for item in items if isinstance(item, NamedNode)]
        referenced = session.reader.references(names, self.root(), instance) if session else {}
        plain = iter(super().python(instance, [i for i in items if not _is_object(i)]))
        return [
            referenced.get(item.value, item)
            if isinstance(item, NamedNode)
            else item
            if isinstance(item, Model)
            else next(plain)
            for item in items
        ]

    def plain(self, instance: Model) -> list[Any]:
        """Return the members in order, with objects as their IRIs."""
        return [plain_item(item) for item in self.members(instance)]

    def root(self) -> type[Model]:
        """Return the class of all individuals."""
        return self.owner.__registry__.find(THING) or Model


def _is_object(item: Item | Term) -> bool:
    return isinstance(item, Model | NamedNode)
