"""Messages of the addresses of services, jobs and datasets."""

from __future__ import annotations

from endpoint.http.messages import JSON_TYPE
from endpoint.routes.messages import (
    CHANGING,
    TEXT,
    Answer,
    Body,
    JsonObject,
    Messages,
    parameter,
)

_SERVICE = (
    parameter("namespace", "path", "of the service", TEXT),
    parameter("name", "path", "of the service, perhaps with @version", TEXT),
)
_JOB = parameter("id", "path", "of the job", TEXT)

SERVICES = Messages("List the services")
SERVICE = Messages("Describe a service", _SERVICE)
JOBS = Messages("List the caller's jobs")
JOB = Messages(
    "Read a job, or follow its progress and its end as server-sent events",
    (
        _JOB,
        parameter("wait", "query", "wait for the end, s", {"type": "number", "minimum": 0}),
        parameter(
            "after", "query", "list, or follow, the events after this number", {"type": "integer"}
        ),
    ),
    answer=Answer(types=(JSON_TYPE, "text/event-stream")),
)
JOB_CANCELLED = Messages(
    "Cancel a job",
    (_JOB,),
    answer=Answer(words="the job"),
    problems=(400, 401, 403, 404, 405, 429, 503),
)

_DATASET = (
    parameter("namespace", "path", "of the dataset", TEXT),
    parameter("name", "path", "of the dataset, perhaps with @version", TEXT),
)
_PATH = parameter("path", "path", "of the file", TEXT)
_MATCH = parameter("If-Match", "header", "SHA-256 that the file has now", TEXT)
_TEXTS: JsonObject = {"type": "array", "items": TEXT}
_PROBLEMS = (*CHANGING, 412)
_DONE, _WRITTEN = Answer(words="done"), Answer(204, "done", types=())


def _fields(**properties: JsonObject) -> Body:
    schema = {"type": "object", "properties": properties, "additionalProperties": False}
    return Body(schema, is_required=False)


DATASETS = Messages("List the datasets")
DATASET = Messages("Read a version of a dataset", _DATASET)
DATASET_CREATED = Messages(
    "Create or fork a dataset",
    _DATASET,
    _fields(fork_of=TEXT, readers=_TEXTS, key=TEXT),
    Answer(201, "done", types=()),
    _PROBLEMS,
)
DATASET_DIFF = Messages(
    "Compare two versions",
    (*_DATASET, *(parameter(side, "query", "a version, or head", TEXT) for side in ("from", "to"))),
)
DATASET_SNAPSHOT = Messages(
    "Make the head a version", _DATASET, _fields(message=TEXT), _DONE, _PROBLEMS
)
DATASET_PRUNED = Messages(
    "Make a version without some files and records",
    _DATASET,
    _fields(paths=_TEXTS, where={"type": "object"}, message=TEXT),
    _DONE,
    _PROBLEMS,
)
DATASET_MERGED = Messages(
    "Merge a version into the head",
    _DATASET,
    _fields(
        source=TEXT,
        rules={"type": "object", "additionalProperties": {"enum": ["fail", "ours", "theirs"]}},
        message=TEXT,
    ),
    _DONE,
    _PROBLEMS,
)
FILE = Messages(
    "Read a file", (*_DATASET, _PATH), answer=Answer(types=("application/octet-stream",))
)
FILE_WRITTEN = Messages(
    "Write a file",
    (*_DATASET, _PATH, _MATCH),
    Body({"type": "string", "format": "binary"}, "application/octet-stream", is_required=False),
    _WRITTEN,
    _PROBLEMS,
)
FILE_REMOVED = Messages(
    "Remove a file or a folder", (*_DATASET, _PATH), answer=_WRITTEN, problems=_PROBLEMS
)
