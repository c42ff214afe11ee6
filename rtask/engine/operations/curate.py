"""People put objects right: two that are one, one that is two, what shall be forgotten.

One person at a time: what a request names is looked up when its turn has come, so that of two who
merge the same objects, or each into the other, the second one hears what the first one did.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import MaxLen
from pydantic import Field

from rtask.engine.curation.merging import merge_objects, present_name
from rtask.engine.curation.splitting import forget_object, forget_views, split_object
from rtask.engine.curation.undoing import undo
from rtask.engine.operations.operation import operation
from rtask.errors import ForbiddenError, UnknownTermError, UsageError, nearest
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
    """What a person puts right about objects."""

    operation: Literal["merge", "split", "forget", "undo"]
    """what the person wants"""
    object: Text | None = None
    """IRI of the object, or its name; default: none, as for undo"""
    into: Text | None = None
    """merge: IRI or name of the object that it turned out to be; default: none"""
    views: Annotated[Texts, MaxLen(1000)] = Field(default_factory=list)
    """split: IRIs of the views that show another object; forget: only these views"""
    name: Text | None = None
    """split: what people call the new object; default: made of kind and number"""
    purge: Flag = False
    """forget: with all that was tried on it, and the bytes at once"""
    commit: Text | None = None
    """undo: the commit to take back, as answered; default: none"""
    operator: Text | None = None
    """who says so; default: the caller"""


class Curated(Answer):
    """The object that there is now, and the commit that undo takes back."""

    object: str
    commit: str
    added: int
    removed: int


@operation("teach", "merge two objects, split one, forget one, take it back")
def curate_object(context: Context, request: CurateObject, access: Access) -> Curated:
    """Carry out what a person wants; robots have no right to it."""
    author = author_of(context, request.operator, access)
    with context.writing:
        return _curate(context, request, author)


def author_of(context: Context, operator: str | None, access: Access) -> Access:
    """Return in whose name a person's change is made; nobody changes in another person's name.

    Raises
    ------
    ForbiddenError
        The token is another person's.
    """
    if access.role == "teacher" and access.agent and operator and operator != access.agent:
        raise ForbiddenError(
            f"the token belongs to {access.agent!r}: it cannot change in the name of {operator!r}"
        )
    return context.author(access, operator, "teacher")


def _curate(context: Context, request: CurateObject, author: Access) -> Curated:
    operation = request.operation
    if operation == "undo":
        if not request.commit:
            raise UsageError("commit is missing: which one is taken back?", field="commit")
        return _answer(context, undo(context, request.commit, author), "")
    thing = object_meant(context, request.object, "object")
    if operation == "merge":
        kept = object_meant(context, request.into, "into")
        return _answer(context, merge_objects(context, kept, thing, author), kept.value)
    if operation == "split":
        new, commit = split_object(context, thing, request.views, request.name, author)
        return _answer(context, commit, new.value)
    if request.views:
        done = forget_views(context, thing, request.views, request.purge, author)
        return _answer(context, done, thing.value)
    return _answer(context, forget_object(context, thing, request.purge, author), "")


def object_meant(context: Context, name: str | None, field: str) -> NamedNode:
    """Return the object that a field of a request means: by IRI, former IRI, objectId or name.

    Raises
    ------
    UsageError
        The field is empty, or several objects are called so.
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
    things = [row["object"] for row in rows]
    if len(things) > 1:
        raise UsageError(f"{field}: several objects are called {name!r}; give the IRI", field=field)
    if things:
        assert isinstance(things[0], NamedNode)
        return things[0]
    if kb.select(f"{PREFIXES}SELECT * {{ ?o prov:invalidatedAtTime ?t FILTER(STR(?o) = {text}) }}"):
        raise UnknownTermError(f"{field}: the object {name} was forgotten", field=field)
    known = kb.select(f"{PREFIXES}SELECT DISTINCT ?n {{ ?o rt:objectId ?id ; rt:name ?n }}")
    hint = nearest(name, [str(row.value("n")) for row in known])
    raise UnknownTermError(f"{field}: the graph knows no object {name}{hint}", field=field)


def _answer(context: Context, commit: Commit, thing: str) -> Curated:
    return Curated(
        object=thing,
        commit=context.commit_id(commit),
        added=commit.added,
        removed=commit.removed,
    )
