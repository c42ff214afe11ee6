"""Write the changed objects of a session in one transaction."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING

import ontology
from rtask.errors import FieldError, OwnershipError, VersionConflictError
from rtask.model.codec import RDF_TYPE
from rtask.model.instance import Model, Pending, Property, class_iris, required, term
from rtask.model.view import View
from rtask.rdf.namespaces import mint
from rtask.rdf.terms import DEFAULT, BlankNode, GraphName, NamedNode, Subject, Term, stored

if TYPE_CHECKING:
    from rtask.model.backing import Statements, Writes

__all__ = ["Flush", "named"]

_OBJECT_ID = ontology.NS + "objectId"
_FIRST, _REST, _NIL = (NamedNode(ontology.PREFIXES["rdf"] + n) for n in ("first", "rest", "nil"))


class Flush:
    """Changes of a session that are about to be written.

    Only the agent's own statements are withdrawn; those of others stay.
    """

    def __init__(
        self,
        view: View,
        new: Iterable[Model],
        dirty: Iterable[Model],
        deleted: Collection[Model],
    ) -> None:
        self._view = view
        self._new = list(new)
        self._dirty = [item for item in dirty if item not in deleted]
        self._deleted = list(deleted)
        self.stays: list[Model] = []
        """Deleted objects of which others state something, once they were written."""

    def __bool__(self) -> bool:
        return bool(self._new or self._dirty or self._deleted)

    def check_required(self) -> None:
        """Refuse new objects that lack values required by their shapes.

        Raises
        ------
        FieldError
            Naming all missing values of the first such object.
        """
        for instance in self._new:
            fields = type(instance).__fields__
            missing = [
                name
                for name in sorted(required(type(instance)))
                if name in fields and not fields[name].items(instance)
            ]
            if missing:
                raise FieldError(
                    f"{instance!r} lacks {', '.join(missing)}; set it, or open the session with"
                    " check_required=False",
                    field=missing[0],
                    missing=missing,
                )

    def subjects(self) -> set[str]:
        """Return the IRIs of the objects to be written."""
        return {item.iri for item in (*self._new, *self._dirty, *self._deleted)}

    def write(self, tx: Writes, statements: Statements) -> None:
        """Put all changes into a transaction, given the statements that hold before it."""
        writer = _Writer(self._view, tx, statements)
        self.stays = [item for item in self._deleted if writer.withdraw(item)]
        for instance in self._new:
            for name in class_iris(type(instance)):
                tx.add(instance.iri, RDF_TYPE, NamedNode(name), named(self._view.home))
        for instance in (*self._new, *self._dirty):
            for name, pending in instance.__state__.pending.items():
                field = type(instance).__by_iri__[name]
                if name == _OBJECT_ID:
                    writer.check_unused(instance, field, pending)
                if field.is_list:
                    writer.replace_list(instance, field, pending)
                elif field.stored:
                    writer.change(instance, field, pending)

    def settle(self) -> None:
        """Mark written objects as known, to be read again on access."""
        for instance in (*self._new, *self._dirty, *self._deleted):
            state = instance.__state__
            for pending in state.pending.values():
                for item in (*pending.added, *pending.removed):
                    # the other side of an inverse, unless it belongs to no session
                    if isinstance(item, Model) and item.__state__.session is state.session:
                        item.__state__.pending.clear()
                        item.__state__.forget()
            state.pending.clear()
            state.forget()
            state.new = False


class _Writer:
    """Writes the changes of one agent in one transaction."""

    def __init__(self, view: View, tx: Writes, statements: Statements) -> None:
        self._kb = view.kb
        self._tx = tx
        self._statements = statements
        self._home = view.home
        self._inferred = view.inferred
        self._keys: dict[Term, str] = {}

    def check_unused(self, instance: Model, field: Property, pending: Pending) -> None:
        """Refuse the key of another object: both would silently become one.

        Raises
        ------
        FieldError
            Naming the other object.
        """
        for value in (stored(term(item)) for item in pending.added):
            quads = self._kb.match(None, NamedNode(field.iri), value)
            asserted = (q for q in quads if q.graph_name != self._kb.graphs.inferred)
            others = {self._keys.setdefault(value, instance.iri)}
            others |= {str(getattr(quad.subject, "value", "")) for quad in asserted}
            if others - {instance.iri}:
                raise FieldError(
                    f"{field.describe()} of {instance!r}: {value} is that of "
                    f"{min(others - {instance.iri})} already; objects with the same one are the "
                    "same, so get that one, or choose another",
                    field=field.name,
                )

    def withdraw(self, instance: Model) -> bool:
        """Withdraw all own statements from and to an object; return whether others' stay.

        Raises
        ------
        OwnershipError
            If all that is stated about it is stated by others.
        """
        subject = NamedNode(instance.iri)
        about = self._statements.match(subject)
        own = [quad for quad in about if quad.graph_name == self._home]
        own += self._statements.match(value=subject, graph=self._home)
        inferred = self._kb.graphs.inferred
        others = {q.graph_name for q in about} - {self._home, inferred, DEFAULT}
        if others and not own:
            shown = ", ".join(sorted(str(graph) for graph in others))
            raise OwnershipError(
                f"{instance!r}: nothing of it is stated in your graph, but in {shown}, and only"
                " those who stated it may withdraw it"
            )
        for quad in own:
            self._tx.remove(quad.subject, quad.predicate, quad.object, named(self._home))
        return bool(others)

    def change(self, instance: Model, field: Property, pending: Pending) -> None:
        """Write the changes of one field of one object."""
        subject, predicate = NamedNode(instance.iri), NamedNode(field.iri)
        added = [stored(term(item)) for item in pending.added]
        quads = self._statements.match(subject, predicate)
        own = {quad.object for quad in quads if quad.graph_name == self._home}
        asserted = {q.object for q in quads if q.graph_name != self._kb.graphs.inferred}
        others = asserted - own
        if pending.replace:
            current = {quad.object for quad in quads} if self._inferred else asserted
            self._check_version(instance, field, current)
            removed = own - set(added)
            if field.functional and others - set(added):
                raise self._not_ours(instance, field, others - set(added))
        else:
            lost = {stored(term(item)) for item in pending.removed}
            if lost & others:
                raise self._not_ours(instance, field, lost & others)
            removed = lost & own
        for value in removed:
            self._tx.remove(subject, predicate, value, named(self._home))
        for value in added:
            if value not in own:
                self._tx.add(subject, predicate, value, named(self._home))

    def replace_list(self, instance: Model, field: Property, pending: Pending) -> None:
        """Replace a list; its cells get IRIs instead of blank nodes."""
        subject, predicate = NamedNode(instance.iri), NamedNode(field.iri)
        quads = self._statements.match(subject, predicate)
        self._check_version(instance, field, {quad.object for quad in quads})
        home = named(self._home)
        for quad in quads:
            if quad.graph_name == self._home:
                self._tx.remove(subject, predicate, quad.object, home)
                for cell in own_cells(self._statements, quad.object, self._home):
                    self._tx.remove(*cell, home)
            elif field.functional and quad.graph_name != self._kb.graphs.inferred:
                raise self._not_ours(instance, field, {quad.object})
        heads = [NamedNode(mint(self._kb.base, "ListCell")) for _ in pending.added]
        for head, rest, item in zip(heads, [*heads[1:], _NIL], pending.added, strict=False):
            self._tx.add(head, _FIRST, stored(term(item)), home)
            self._tx.add(head, _REST, rest, home)
        self._tx.add(subject, predicate, heads[0] if heads else _NIL, home)

    def _check_version(self, instance: Model, field: Property, current: set[Term]) -> None:
        state = instance.__state__
        if state.knows(field.iri) and set(state.loaded.get(field.iri, ())) != current:
            raise VersionConflictError(
                f"{field.describe()} of {instance!r} was changed by somebody else since it was"
                " read; refresh() it and decide again",
                field=field.name,
            )

    def _not_ours(self, instance: Model, field: Property, values: set[Term]) -> OwnershipError:
        shown = ", ".join(sorted(map(str, values)))
        return OwnershipError(
            f"{field.describe()} of {instance!r}: another agent states {shown}, and only it may"
            " withdraw that",
            field=field.name,
        )


def own_cells(
    statements: Statements, head: Term, home: GraphName
) -> list[tuple[Subject, NamedNode, Term]]:
    """Return the statements of an RDF list that one graph holds."""
    cells: list[tuple[Subject, NamedNode, Term]] = []
    seen: set[Term] = set()
    while isinstance(head, NamedNode | BlankNode) and head not in seen:
        seen.add(head)
        quads = [q for q in statements.match(head, graph=home) if q.predicate in (_FIRST, _REST)]
        cells += [(quad.subject, quad.predicate, quad.object) for quad in quads]
        head = next((quad.object for quad in quads if quad.predicate == _REST), _NIL)
    return cells


def named(graph: GraphName) -> NamedNode | None:
    """Return the name of a graph, ``None`` for the default graph."""
    return graph if isinstance(graph, NamedNode) else None
