"""Name stored objects: a person gives the name, and describes the class in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.engine.curation.edit import Edit
from rtask.engine.names import slug, tail
from rtask.engine.records.prepared import classes_named
from rtask.engine.triples import Triples
from rtask.errors import UsageError
from rtask.rdf.namespaces import RDF, RDFS, RT
from rtask.rdf.terms import Literal, NamedNode, Triple, iri

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit

__all__ = ["described_class", "name_object", "short_id_of"]

_OWL_CLASS = iri("http://www.w3.org/2002/07/owl#Class")


def name_object(
    context: Context,
    object_iri: NamedNode,
    description: str | None,
    name: str | None,
    author: Access,
) -> Commit:
    """Set the name or class of a stored object, replacing earlier names and guesses.

    Parameters
    ----------
    description
        Kind of object in words; None leaves it unchanged.
    name
        Name of this object; None leaves it unchanged.

    Raises
    ------
    UsageError
        Neither is given.
    InconsistentError
        The kind contradicts other knowledge.
    """
    if not description and not name:
        raise UsageError("name is missing: a name, a class_description or both", field="name")
    with context.writing:
        edit, triples = Edit(context.kb), Triples()
        if name:
            edit.remove(edit.match(object_iri, RT.name))
            triples.add(object_iri, RT.name, " ".join(name.split()))
        if description:
            kind = described_class(context, triples, description)
            short_id_of(context, triples, kind)
            _withdraw_kinds(context, edit, object_iri)
            triples.add(object_iri, RDF.type, kind)
        edit.state(triples, context.home_graph(author))
        return edit.commit(context, f"name {tail(object_iri)}", author)


def described_class(context: Context, triples: Triples, description: str) -> NamedNode:
    """Return the class that a description names, a new one if there is none yet."""
    classes = classes_named(context, description)
    if classes:
        return classes[0]
    made = context.names.named("class", slug(description))
    triples.node(made, [_OWL_CLASS], {RDFS.subClassOf: RT.ManipulableObject, RT.taught: True})
    triples.add(made, RDFS.label, Literal(" ".join(description.split()), language="en"))
    return made


def short_id_of(context: Context, triples: Triples, kind: NamedNode) -> str:
    """Return the short id of a class in messages, assigning one where it is missing."""
    short_name = context.classes.get(kind.value).short_id
    stated = [str(v) for s, p, v in triples if s == kind and p == RT.shortId]
    if short_name or stated:
        return short_name or stated[0]
    others = sum(1 for _, p, _ in triples if p == RT.shortId)
    short_id = str(int(context.classes.next_short_id()) + others)
    triples.add(kind, RT.shortId, short_id)
    return short_id


def _withdraw_kinds(context: Context, edit: Edit, object_iri: NamedNode) -> None:
    """Withdraw the stated classes of an object, with the annotations on those statements."""
    kinds = {q.object for q in edit.match(object_iri, RDF.type)} - {RT.ManipulableObject}
    kinds = {k for k in kinds if isinstance(k, NamedNode) and k.value in context.classes.all()}
    edit.remove(quad for quad in edit.match(object_iri, RDF.type) if quad.object in kinds)
    for quad in edit.match(None, RDF.reifies, None):
        statement = quad.object
        if (
            isinstance(statement, Triple)
            and statement.subject == object_iri
            and statement.object in kinds
        ):
            assert isinstance(quad.subject, NamedNode)
            edit.remove(edit.match(quad.subject))
