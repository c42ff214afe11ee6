"""Messages of the addresses of the reasoner and of proposals."""

from __future__ import annotations

from typing import Final

from endpoint.routes.messages import (
    CHANGING,
    READING,
    TEXT,
    Answer,
    Body,
    JsonObject,
    Messages,
    parameter,
)
from rtask.kb.proposals.proposal import STATES

BUDGET: Final = 20_000
MAX_BUDGET: Final = 200_000
"""Steps of one answer, and how many a request may ask for: writers wait meanwhile."""

SPARQL_TYPE: Final = "application/sparql-query"

_FLAG: JsonObject = {"type": "boolean"}
_RULE: JsonObject = {
    "type": "object",
    "properties": {
        "label": {"type": "string", "minLength": 1},
        "text": {"type": "string", "description": "SPARQL CONSTRUCT query"},
        "comment": TEXT,
    },
    "required": ["label", "text"],
}
_ONE_RULE = {**_RULE, "properties": {**_RULE["properties"], "replace": _FLAG}}
_SEVERAL_RULES: JsonObject = {
    "type": "object",
    "properties": {"rules": {"type": "array", "items": _RULE, "minItems": 1}, "replace": _FLAG},
    "required": ["rules"],
    "additionalProperties": False,
}
_DOCUMENT: JsonObject = {
    "type": "object",
    "properties": {"text": {"type": "string", "description": "the statements, as Turtle"}},
    "required": ["text"],
    "additionalProperties": False,
}
_STATEMENT = (
    *(
        parameter(name, "query", f"{meaning}: an IRI, a name or a literal", TEXT, required=True)
        for name, meaning in (("s", "subject"), ("p", "predicate"), ("o", "object"))
    ),
    parameter(
        "budget",
        "query",
        "steps of the reasoner",
        {"type": "integer", "minimum": 1, "maximum": MAX_BUDGET, "default": BUDGET},
    ),
)
_NAME = parameter("name", "path", "label of the rule, or the last part of its IRI", TEXT)
_LABELS = parameter(
    "label", "query", "label or IRI of a rule; may be repeated", TEXT, required=True
)
_REMOVED = Answer(words="removed")

EXPLAIN = Messages("Why does a statement hold?", _STATEMENT, problems=(*READING, 422, 501))
ENTAILS = Messages("Does a statement follow?", _STATEMENT, problems=(*READING, 413, 422, 501))
ENTAILS_ALL = Messages(
    "Does everything that a document says follow?",
    body=Body(_DOCUMENT),
    problems=(*CHANGING, 501),
    description="The body may also be the document itself, as `text/turtle` or "
    "`application/n-triples`.",
)
CONTRADICTIONS = Messages("What the graph contradicts, with the causes", problems=(*READING, 501))
RULES = Messages("Rules of the user")
RULE = Messages("One rule of the user", (_NAME,), problems=(*READING, 422))
RULES_ADDED = Messages(
    "Add rules",
    body=Body({"anyOf": [_ONE_RULE, _SEVERAL_RULES]}),
    answer=Answer(201, "added"),
    problems=CHANGING,
    description="Needs the right `{right}`. The body is a rule, or several under `rules`, which "
    f"are added as one commit; it may also be the query itself, as `{SPARQL_TYPE}` with `?label=`.",
)
RULES_REMOVED = Messages(
    "Remove rules",
    (_LABELS,),
    answer=_REMOVED,
    problems=CHANGING,
    description="Needs the right `{right}`. All are removed as one commit.",
)
RULE_REMOVED = Messages(
    "Remove a rule",
    (_NAME,),
    answer=_REMOVED,
    problems=CHANGING,
    description="Needs the right `{right}`.",
)

_LINES: JsonObject = {
    "type": "array",
    "items": TEXT,
    "description": "statements, each a line of N-Quads; without a graph, of the caller's own",
}
_PROPOSED: JsonObject = {
    "type": "object",
    "properties": {
        "added": _LINES,
        "removed": _LINES,
        "reason": TEXT,
        "rests_on": {"type": "integer", "description": "the last commit that the author has seen"},
    },
    "additionalProperties": False,
}
_REMARK: JsonObject = {
    "type": "object",
    "properties": {"remark": TEXT},
    "additionalProperties": False,
}
_NUMBER = parameter("number", "path", "number of the proposal", {"type": "integer"})
_PROPOSAL = Answer(words="the proposal")

PROPOSALS = Messages(
    "Proposals: all for who may decide, else one's own",
    (
        parameter("state", "query", "only those in this state", {"enum": list(STATES)}),
        parameter("author", "query", "only those of this robot or person", TEXT),
    ),
    problems=(*READING, 501),
)
PROPOSAL = Messages("One proposal", (_NUMBER,), problems=(*READING, 501))
PROPOSED = Messages(
    "Propose a change, which has no effect until it is adopted",
    body=Body(_PROPOSED, is_required=False),
    answer=Answer(201, "the proposal"),
    problems=(*CHANGING, 501),
)
ADOPTED = Messages(
    "Carry a proposal out. Needs the right `{right}`.",
    (_NUMBER,),
    answer=_PROPOSAL,
    problems=(*CHANGING, 501),
)
REFUSED = Messages(
    "Decide against a proposal. Needs the right `{right}`.",
    (_NUMBER,),
    body=Body(_REMARK, is_required=False),
    answer=_PROPOSAL,
    problems=(*CHANGING, 501),
)
