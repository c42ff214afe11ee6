"""Messages of the addresses of branches."""

from __future__ import annotations

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

_MADE: JsonObject = {
    "type": "object",
    "properties": {
        "name": {"type": "string", "pattern": "^[a-z0-9][a-z0-9._-]{0,63}$"},
        "at": {"description": "number of a commit, or a time", "type": ["integer", "string"]},
        "hours": {"type": "number", "exclusiveMinimum": 0, "maximum": 24},
        "note": TEXT,
    },
    "required": ["name"],
    "additionalProperties": False,
}
_NOTE: JsonObject = {
    "type": "object",
    "properties": {"note": TEXT},
    "additionalProperties": False,
}
_NAME = parameter("name", "path", "name of the branch", TEXT)

BRANCHES = Messages("Branches that are open, the oldest first", problems=(*READING, 501))
MADE = Messages(
    "Make a branch, which is queried and changed at `/sparql?branch=NAME`",
    body=Body(_MADE),
    answer=Answer(201, "the branch"),
    problems=(*CHANGING, 410, 501, 507),
)
BRANCH = Messages(
    "A branch compared with its trunk: statements and conflicts",
    (_NAME,),
    problems=(*READING, 413, 501),
)
MERGED = Messages(
    "Merge a branch as one commit, and drop it",
    (_NAME,),
    body=Body(_NOTE, is_required=False),
    answer=Answer(words="numbers of statements, and of the commit"),
    problems=(*CHANGING, 501),
)
DROPPED = Messages(
    "Drop a branch: its author or an admin",
    (_NAME,),
    answer=Answer(words="the branch that was dropped"),
    problems=(*CHANGING, 501),
)
