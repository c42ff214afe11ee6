"""The description of the addresses of proposals."""

from __future__ import annotations

from endpoint.api.openapi_parts import JsonObject, get, parameter, problems
from endpoint.api.proposals import ADDRESS
from endpoint.http.messages import JSON_TYPE
from rtask.kb.proposals.proposal import STATES

_TEXT: JsonObject = {"type": "string"}
_LINES: JsonObject = {
    "type": "array",
    "items": _TEXT,
    "description": "statements, each a line of N-Quads; without a graph, of the caller's own",
}
_PROPOSED: JsonObject = {
    "type": "object",
    "properties": {
        "added": _LINES,
        "removed": _LINES,
        "reason": _TEXT,
        "rests_on": {"type": "integer", "description": "the last commit that the author has seen"},
    },
    "additionalProperties": False,
}
_REMARK: JsonObject = {
    "type": "object",
    "properties": {"remark": _TEXT},
    "additionalProperties": False,
}
_PROBLEMS = (400, 401, 403, 404, 405, 409, 413, 415, 422, 429, 503)


def proposal_paths() -> JsonObject:
    """Return the paths of proposals."""
    state = parameter("state", "query", "only those in this state", {"enum": list(STATES)})
    author = parameter("author", "query", "only those of this robot or person", _TEXT)
    number = parameter("number", "path", "number of the proposal", {"type": "integer"})
    listed = get("Proposals: all for who may decide, else one's own", (JSON_TYPE,), [state, author])
    single = get("One proposal", (JSON_TYPE,), [number])
    for described in (listed, single):
        described["responses"] |= problems((400, 401, 404, 501))
    propose = _post("Propose a change, which has no effect until it is adopted", _PROPOSED, "201")
    adopt = _post("Carry a proposal out. Needs the right `schema`.", None, "200")
    refuse = _post("Decide against a proposal. Needs the right `schema`.", _REMARK, "200")
    for decision in (adopt, refuse):
        decision["parameters"] = [number]
    return {
        ADDRESS: {"get": listed, "post": propose},
        f"{ADDRESS}/{{number}}": {"get": single},
        f"{ADDRESS}/{{number}}/adopt": {"post": adopt},
        f"{ADDRESS}/{{number}}/refuse": {"post": refuse},
    }


def _post(summary: str, body: JsonObject | None, status: str) -> JsonObject:
    described: JsonObject = {
        "summary": summary,
        "responses": {
            status: {"description": "the proposal", "content": {JSON_TYPE: {}}},
            **problems((*_PROBLEMS, 501)),
        },
    }
    if body is not None:
        described["requestBody"] = {"content": {JSON_TYPE: {"schema": body}}}
    return described
