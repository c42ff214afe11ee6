"""Annotations of single statements, such as confidence and validity (RDF 1.2 reifiers)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import ontology
from rtask.errors import UsageError
from rtask.model.codec import decode
from rtask.model.instance import Annotation, Item, Model, Property, field_of
from rtask.model.instance import term as item_term
from rtask.model.query.plan import short
from rtask.model.view import View
from rtask.rdf.namespaces import mint
from rtask.rdf.terms import Literal, NamedNode, Term, Triple, stored

if TYPE_CHECKING:
    from rtask.model.backing import Writes

__all__ = ["Note", "read_annotations"]

REIFIES = NamedNode(ontology.PREFIXES["rdf"] + "reifies")


def read_annotations(view: View, instance: Model, about: Property) -> list[Annotation]:
    """Return the annotations of a field's statements, by value and reifier."""
    text = (
        f"SELECT ?o ?r ?p ?v WHERE {{ ?r rdf:reifies <<( {NamedNode(instance.iri)}"
        f" {short(about.iri)} ?o )>> ; ?p ?v FILTER(?p != rdf:reifies) }}"
    )
    annotations: dict[tuple[str, str], Annotation] = {}
    for value, reifier, predicate, noted in view.select(text):
        assert isinstance(predicate, NamedNode)
        field = type(instance).__by_iri__.get(predicate.value)
        shown = str(getattr(reifier, "value", reifier))
        made = annotations.setdefault((str(value), shown), Annotation(_plain(value), shown, {}))
        made.notes.setdefault(  # type: ignore[attr-defined]
            field.name if field else predicate.value, []
        ).append(_plain(noted))
    return [annotations[key] for key in sorted(annotations)]


def _plain(term: Term | None) -> object:
    return term.value if isinstance(term, NamedNode) else decode(term) if term else None


@dataclass(frozen=True)
class Note:
    """An annotation to be written at the next flush."""

    instance: Model
    field: Property
    value: Item
    notes: tuple[tuple[Property, Item], ...]

    @classmethod
    def of(cls, instance: Model, name: str, value: object, notes: Mapping[str, object]) -> Note:
        """Check the names and values; ``value`` may be left out if the field has only one.

        Raises
        ------
        FieldError
            If a note does not fit its field.
        UsageError
            If the value is not one of the field's, or there is no such field.
        """
        about = field_of(instance, name)
        items = about.items(instance)
        if value is None and len(items) != 1:
            raise UsageError(
                f"{about.describe()} of {instance!r} has {len(items)} values; say which"
            )
        item = items[0] if value is None else about.item(value, instance)
        values_noted = [(field_of(instance, key), noted) for key, noted in notes.items()]
        return cls(instance, about, item, tuple((f, f.item(v, instance)) for f, v in values_noted))

    def write(self, base: str, tx: Writes, home: NamedNode | None) -> None:
        """Write a reifier for the statement, minted below an IRI, with the notes on it."""
        reifier = mint(base, "Statement")
        value = stored(item_term(self.value))
        subject, predicate = NamedNode(self.instance.iri), NamedNode(self.field.iri)
        tx.add(reifier, REIFIES, Triple(subject, predicate, value), home)
        for about, noted in self.notes:
            term = item_term(noted)
            tx.add(reifier, about.iri, stored(term) if isinstance(term, Literal) else term, home)
