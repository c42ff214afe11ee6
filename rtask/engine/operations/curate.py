"""Corrections by people: merge, split or forget objects, and undo a commit.

Requests are carried out one at a time, and their objects are looked up under the lock. When two
people merge the same objects, or each into the other, the second sees what the first did.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import MaxLen
from pydantic import Field

from rtask.engine.curation.merging import merge_objects, present_name
from rtask.engine.curation.splitting import forget_object, forget_views, split_object
from rtask.engine.curation.undoing import undo
from rtask.engine.operations.operation import operation
from rtask.engine.records.identity import check_agent
from rtask.engine.records.objects import is_forgotten, no_object
from rtask.errors import UnknownTermError, UsageError, nearest
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode, literal
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Text, Texts

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit

__all__ = ["CurateObject", "Curated", "author_of", "curate_object", "object_meant"]


class CurateObject(Message):
    """A correction of objects by a person."""

    operation: Literal["merge", "split", "forget", "undo"]
    """the kind of correction"""
    object: Text | None = None
    """IRI of the object, or its name; default: none, as for undo"""
    into: Text | None = None
    """merge: IRI or name of the object that is kept; default: none"""
    views: Annotated[Texts, MaxLen(1000)] = Field(default_factory=list)
    """split: IRIs of the views that show another object; forget: only these views"""
    name: Text | None = None
    """split: name of the new object; default: made of kind and number"""
    purge: Flag = False
    """forget: also delete its attempts, and its bytes at once"""
    commit: Text | None = None
    """undo: the commit to undo, as answered; default: none"""
    operator: Text | None = None
    """name of the person; default: the caller"""


class Curated(Answer):
    """The resulting object, and the commit, which can be undone."""

    object: str
    commit: str
    added: int
    removed: int


@operation("teach", "writes", "merge two objects, split one, forget one, or undo such a change")
def curate_object(context: Context, request: CurateObject, access: Access) -> Curated:
    """Carry out a correction; robots may not."""
    author = author_of(context, request.operator, access)
    with context.writing:
        return _curate(context, request, author)


def author_of(context: Context, operator: str | None, access: Access) -> Access:
    """Return the author of a person's change, who is the owner of the token if there is one.

    Raises
    ------
    ForbiddenError
        The token belongs to another person.
    """
    check_agent(operator, access, "operator")
    return context.author(access, operator, "teacher")


def _curate(context: Context, request: CurateObject, author: Access) -> Curated:
    operation = request.operation
    if operation == "undo":
        if not request.commit:
            raise UsageError("commit is missing: the commit to undo", field="commit")
        return _answer(context, undo(context, request.commit, author), "")
    object_iri = object_meant(context, request.object, "object")
    if operation == "merge":
        target = object_meant(context, request.into, "into")
        return _answer(context, merge_objects(context, target, object_iri, author), target.value)
    if operation == "split":
        new, commit = split_object(context, object_iri, request.views, request.name, author)
        return _answer(context, commit, new.value)
    if request.views:
        done = forget_views(context, object_iri, request.views, request.purge, author)
        return _answer(context, done, object_iri.value)
    return _answer(context, forget_object(context, object_iri, request.purge, author), "")


def object_meant(context: Context, name: str | None, field: str) -> NamedNode:
    """Return the object that a field names by IRI, former IRI, objectId or name.

    Raises
    ------
    UsageError
        The field is empty, or several objects have the name.
    UnknownTermError
        There is no such object, or it was forgotten.
    """
    if not name:
        raise UsageError(f"{field} is missing: IRI of the object", field=field)
    kb = context.kb
    text = literal(present_name(kb, name))
    rows = kb.select(f"""{PREFIXES}
SELECT DISTINCT ?object WHERE {{ ?object rt:objectId ?id OPTIONAL {{ ?object rt:name ?name }}
  FILTER(STR(?object) = {text} || STR(?id) = {text} || STR(?name) = {text}) }} LIMIT 2""")
    matches = [row["object"] for row in rows]
    if len(matches) > 1:
        raise UsageError(f"{field}: several objects are named {name!r}; give the IRI", field=field)
    if matches:
        assert isinstance(matches[0], NamedNode)
        return matches[0]
    if is_forgotten(context, name):
        raise no_object(context, name, field)
    named = kb.select(f"{PREFIXES}SELECT DISTINCT ?n {{ ?o rt:objectId ?id ; rt:name ?n }}")
    hint = nearest(name, [str(row.value("n")) for row in named])
    raise UnknownTermError(f"{field}: the graph has no object {name}{hint}", field=field)


def _answer(context: Context, commit: Commit, object_iri: str) -> Curated:
    return Curated(
        object=object_iri,
        commit=context.commit_id(commit),
        added=commit.added,
        removed=commit.removed,
    )
