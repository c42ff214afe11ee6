"""Teaching by people: search by words, name an object, confirm or reject a grasp."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from rtask.engine.curation.naming import name_object
from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import recall
from rtask.engine.memory.statistics import GraspStatistics
from rtask.engine.operations.curate import author_of, object_meant
from rtask.engine.operations.feedback import GiveFeedback, give_feedback
from rtask.engine.operations.insert import InsertedObject, InsertObject, insert_object
from rtask.engine.operations.operation import operation
from rtask.engine.operations.search import SearchObject, SimilarObjects, look_alikes, search_object
from rtask.engine.perception.observation import Look, OptionalLook
from rtask.engine.records.prepared import NewObject
from rtask.errors import UsageError
from rtask.wire.message import Message, read
from rtask.wire.request_id import StoredOnce
from rtask.wire.types import Iri, Text

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["Taught", "TeachObject", "teach_object"]


class _Wish(Message):
    """Kind of request; a base class so that these fields come first."""

    operation: Literal["search", "teach", "confirm", "reject"]
    """the kind of request"""
    class_description: Text | None = None
    """kind of object in words; default: no kind"""


class TeachObject(OptionalLook, _Wish):
    """A request of a person about an object or a grasp."""

    name: Text | None = None
    """name of the object; default: made of kind and number"""
    task_id: Annotated[Text | None, StoredOnce(where=("operation", "teach"))] = None
    """of the attempt to judge, or of what is taught; default: found by grasp or object"""
    object: Text | None = None
    """IRI of the object, in place of data or of task_id; default: given by data"""
    grasp: Iri | None = None
    """IRI of the grasp whose last attempt is meant; default: found by task_id or object"""
    operator: Text | None = None
    """name of the person; default: the caller"""
    comment: Text | None = None
    """remark of the person; default: none"""


class Taught(SimilarObjects):
    """The objects found or stored; its own fields are there only if something was stored."""

    stored: int = 0
    commit: str = ""
    objects: list[InsertedObject] = Field(default_factory=list)
    grasp: str = ""
    statistics: GraspStatistics | None = None


@operation("read", "writes", "search by words, name an object, confirm or reject a grasp")
def teach_object(context: Context, request: TeachObject, access: Access) -> Taught:
    """Carry out a request; all but ``search`` write and need the scope ``teach``."""
    operation = request.operation
    if operation == "search":
        return _search(context, request, access)
    context.require(access, "teach")
    if operation == "teach":
        return _teach(context, request, access)
    return _judge(context, request, access, held=operation == "confirm")


def _search(context: Context, request: TeachObject, access: Access) -> Taught:
    if request.data is None and request.image is None and request.object:
        object_iri = object_meant(context, request.object, "object")
        return Taught(**look_alikes(context, object_iri, request.class_description))
    _require(request, "class_description", *_look_fields(request))
    names = (*Look.model_fields, "class_description")
    asked = read(SearchObject, {name: getattr(request, name) for name in names})
    return Taught(**search_object(context, asked, access))


def _teach(context: Context, request: TeachObject, access: Access) -> Taught:
    if request.data is None and request.image is None and request.object:
        return _name(context, request, access)
    _require(request, "class_description", *_look_fields(request))
    names = (*Look.model_fields, "class_description", "name", "task_id")
    item = read(NewObject, {name: getattr(request, name) for name in names})
    author = author_of(context, request.operator, access)
    stored = insert_object(context, InsertObject(objects=[item]), author)
    return Taught(similar_objects=[], suggestions=[], **stored)


def _name(context: Context, request: TeachObject, access: Access) -> Taught:
    """Name a stored object."""
    author = author_of(context, request.operator, access)
    with context.writing:
        object_iri = object_meant(context, request.object, "object")
        done = name_object(context, object_iri, request.class_description, request.name, author)
    commit = context.commit_id(done) if done.added or done.removed else ""
    remembered = recall(context.kb, Question(objects=(object_iri.value,))).objects[object_iri.value]
    entry = InsertedObject(
        object=object_iri.value,
        class_=remembered.short_id,
        class_iri=remembered.class_iri,
        label=remembered.label,
        grasp="",
        view="",
        new=False,
        features=0,
        commit=commit,
    )
    return Taught(
        similar_objects=[],
        suggestions=[],
        stored=int(bool(commit)),
        commit=commit,
        objects=[entry],
    )


def _judge(context: Context, request: TeachObject, access: Access, held: bool) -> Taught:
    """Store a person's verdict on a grasp, whatever the robot reported."""
    names = ("task_id", "object", "grasp", "operator", "comment")
    fields = {name: getattr(request, name) for name in names}
    feedback = give_feedback(
        context, read(GiveFeedback, {**fields, "verdict": "correct", "held": held}), access
    )
    return Taught(
        similar_objects=[],
        suggestions=[],
        objects=[],
        stored=feedback.stored,
        commit=feedback.commit,
        grasp=feedback.grasp,
        statistics=feedback.statistics,
    )


def _look_fields(request: TeachObject) -> tuple[str, ...]:
    """Return the fields of a look that are still wanted: none beside an image."""
    return () if request.image is not None else ("data",)


def _require(request: TeachObject, *names: str) -> None:
    for name in names:
        if getattr(request, name) is None:
            reason = f"{name} is missing: {request.operation} needs it"
            raise UsageError(reason, field=name)
