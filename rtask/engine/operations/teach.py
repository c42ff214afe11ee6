"""People teach: look something up by words, name an object, say whether a grasp was good."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rtask.engine.curation.naming import name_object
from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import recall
from rtask.engine.operations.curate import author_of, object_meant
from rtask.engine.operations.feedback import give_feedback
from rtask.engine.operations.insert import insert_object
from rtask.engine.operations.messages import Field, read
from rtask.engine.operations.search import look_alikes, search_object
from rtask.engine.records.prepared import ITEM, SIGHT

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["SEARCH_OBJECT", "TEACH_OBJECT", "teach_object"]

SEARCH_OBJECT = (
    *SIGHT,
    Field("class_description", "string", "only objects of the kinds that these words mean"),
    Field("max_results", "integer", "length of the answer's list", default=10, low=1, high=50),
    Field("min_confidence", "number", "least confidence of an entry", low=0.0, high=1.0),
)

_SAID = ("class_description", "name", "task_id")
_OPTIONAL_SIGHT = tuple(Field(f.name, f.kind, f.summary, aliases=f.aliases) for f in SIGHT)

TEACH_OBJECT = (
    Field("operation", "string", "what the person wants", required=True,
          choices=("search", "teach", "confirm", "reject")),
    Field("class_description", "string", "what the person called it"),
    *_OPTIONAL_SIGHT,
    Field("name", "string", "what the person calls this one object"),
    Field("task_id", "string", "of the attempt that is judged; of what is taught, stored once"),
    Field("object", "string", "IRI of the object, in place of data; or whose last attempt counts"),
    Field("grasp", "string", "IRI of the grasp whose last attempt is meant"),
    Field("operator", "string", "who says so"),
    Field("comment", "string", "in the person's words"),
)  # fmt: skip


def teach_object(context: Context, request: dict[str, Any], access: Access) -> dict[str, Any]:
    """Carry out what a person wants; all but ``search`` write, and need the scope ``teach``."""
    operation = request["operation"]
    if operation == "search":
        return _search(context, request, access)
    context.require(access, "teach")
    if operation == "teach":
        return _teach(context, request, access)
    return _judge(context, request, access, held=operation == "confirm")


def _search(context: Context, request: dict[str, Any], access: Access) -> dict[str, Any]:
    if request["data"] is None and request["object"]:
        thing = object_meant(context, request["object"], "object")
        return look_alikes(context, thing, request["class_description"])
    _wanted(request, "class_description", "data")
    names = [field.name for field in SEARCH_OBJECT]
    # The values were read already; reading bytes and poses again leaves them as they are.
    return search_object(
        context,
        {**{name: request.get(name) for name in names}, "max_results": 10},
        access,
    )


def _teach(context: Context, request: dict[str, Any], access: Access) -> dict[str, Any]:
    if request["data"] is None and request["object"]:
        return _name(context, request, access)
    _wanted(request, "class_description", "data")
    item: dict[str, Any] = {field.name: field.default for field in ITEM}
    for field in (*SIGHT, *(f for f in ITEM if f.name in _SAID)):
        item[field.name] = request.get(field.name)
    author = context.author(access, request["operator"], "teacher")
    stored = insert_object(context, {"objects": [item]}, author)
    return {"similar_objects": [], "suggestions": [], **stored}


def _name(context: Context, request: dict[str, Any], access: Access) -> dict[str, Any]:
    """Say what an object is that is stored already."""
    author = author_of(context, request["operator"], access)
    with context.writing:
        thing = object_meant(context, request["object"], "object")
        done = name_object(context, thing, request["class_description"], request["name"], author)
    commit = context.commit_id(done) if done.added or done.removed else ""
    known = recall(context.kb, Question(objects=(thing.value,))).objects[thing.value]
    entry = {
        "object": thing.value,
        "class": known.short_id,
        "class_iri": known.class_iri,
        "label": known.label,
        "grasp": "",
        "view": "",
        "new": False,
        "features": 0,
        "commit": commit,
    }
    return {
        "similar_objects": [],
        "suggestions": [],
        "stored": int(bool(commit)),
        "commit": commit,
        "objects": [entry],
    }


def _judge(context: Context, request: dict[str, Any], access: Access, held: bool) -> dict[str, Any]:
    """Store a person's verdict that a grasp was good, or not, whatever the robot reported."""
    names = ("task_id", "object", "grasp", "operator", "comment")
    said = {name: request[name] for name in names}
    told = give_feedback(
        context, {**said, "verdict": "correct", "held": held, "reason": None}, access
    )
    return {
        "similar_objects": [],
        "suggestions": [],
        "objects": [],
        **{name: told[name] for name in ("stored", "commit", "grasp", "statistics")},
    }


def _wanted(request: dict[str, Any], *names: str) -> None:
    for name in names:
        if request[name] is None:
            read((Field(name, "string", f"{request['operation']} needs it", required=True),), {})
