"""People teach: look something up by words, name an object, say whether a grasp was good."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING, Any

from rtask.engine.attempts import state_verdict
from rtask.engine.facts import Facts
from rtask.engine.insert import ITEM, insert_object
from rtask.engine.messages import Field, read
from rtask.engine.recognise import SIGHT
from rtask.engine.search import search_object
from rtask.engine.statistics import over_all_robots
from rtask.engine.vocabulary import PREFIXES
from rtask.errors import UnknownTermError, UsageError
from rtask.kb.terms import NamedNode, iri, literal

if TYPE_CHECKING:
    from rtask.engine.engine import Engine
    from rtask.kb.access import Access

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
    Field("object", "string", "IRI of the object whose last attempt is meant"),
    Field("grasp", "string", "IRI of the grasp whose last attempt is meant"),
    Field("operator", "string", "who says so"),
    Field("comment", "string", "in the person's words"),
)  # fmt: skip


def teach_object(engine: Engine, request: dict[str, Any], access: Access) -> dict[str, Any]:
    """Carry out what a person wants; all but ``search`` write, and need the scope ``teach``."""
    operation = request["operation"]
    if operation == "search":
        return _search(engine, request, access)
    engine.require(access, "teach")
    if operation == "teach":
        return _teach(engine, request, access)
    return _judge(engine, request, access, held=operation == "confirm")


def _search(engine: Engine, request: dict[str, Any], access: Access) -> dict[str, Any]:
    _wanted(request, "class_description", "data")
    names = [field.name for field in SEARCH_OBJECT]
    # The values were read already; reading bytes and poses again leaves them as they are.
    return search_object(
        engine,
        {**{name: request.get(name) for name in names}, "max_results": 10},
        access,
    )


def _teach(engine: Engine, request: dict[str, Any], access: Access) -> dict[str, Any]:
    _wanted(request, "class_description", "data")
    item: dict[str, Any] = {field.name: field.default for field in ITEM}
    for field in (*SIGHT, *(f for f in ITEM if f.name in _SAID)):
        item[field.name] = request.get(field.name)
    author = engine.author(access, request["operator"], "teacher")
    stored = insert_object(engine, {"objects": [item]}, author)
    return {"similar_objects": [], "suggestions": [], **stored}


def _judge(engine: Engine, request: dict[str, Any], access: Access, held: bool) -> dict[str, Any]:
    """Store a person's verdict about the latest attempt that the request means."""
    outcome, grasp = _attempt(engine, request)
    operator = request["operator"] or access.agent or "operator"
    with engine.writing:
        facts = Facts()
        now = dt.datetime.now(dt.UTC)
        state_verdict(engine, facts, outcome, held, operator, now, request["comment"])
        author = engine.author(access, operator, "teacher")
        with engine.kb.transaction(access=author, note="a person's verdict") as tx:
            facts.write(tx)
    return {
        "similar_objects": [],
        "suggestions": [],
        "stored": 1,
        "commit": engine.commit_id(tx.commit),
        "objects": [],
        "grasp": grasp.value,
        "statistics": over_all_robots(engine, grasp),
    }


def _attempt(engine: Engine, request: dict[str, Any]) -> tuple[NamedNode, NamedNode]:
    """Return outcome and grasp of the latest attempt that fits."""
    patterns = []
    if request["task_id"]:
        patterns.append(f"?attempt rt:requestId ?id FILTER(?id = {literal(request['task_id'])})")
    if request["grasp"]:
        patterns.append(f"?attempt rt:executesGrasp {iri(request['grasp'])} .")
    if request["object"]:
        patterns.append(f"?task rt:through ?attempt ; rt:handles {iri(request['object'])} .")
    if not patterns:
        raise UsageError("task_id is missing: or name the object and the grasp")
    rows = engine.kb.select(f"""{PREFIXES}
SELECT ?outcome ?grasp WHERE {{ {" ".join(patterns)}
  ?attempt rt:executesGrasp ?grasp ; rt:hasOutcome ?outcome ; prov:endedAtTime ?ended
}} ORDER BY DESC(?ended) DESC(?outcome) LIMIT 1""")
    for row in rows:
        outcome, grasp = row["outcome"], row["grasp"]
        if isinstance(outcome, NamedNode) and isinstance(grasp, NamedNode):
            return outcome, grasp
    raise UnknownTermError("no attempt fits task_id, object and grasp: nothing to judge")


def _wanted(request: dict[str, Any], *names: str) -> None:
    for name in names:
        if request[name] is None:
            read((Field(name, "string", f"{request['operation']} needs it", required=True),), {})
