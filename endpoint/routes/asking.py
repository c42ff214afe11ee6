"""Messages of the addresses that answer from the graph, or about the server."""

from __future__ import annotations

from endpoint.http.messages import JSON_TYPE
from endpoint.http.problems import PROBLEM_TYPE
from endpoint.routes.messages import (
    PROBLEMS,
    READING,
    TEXT,
    Answer,
    JsonObject,
    Messages,
    parameter,
)

_GRAPHS: JsonObject = {"type": "array", "items": {"type": "string", "format": "uri"}}
_RESULTS = (
    "application/sparql-results+json", "text/csv", "text/turtle", "application/n-triples",
    "text/html", "application/sparql-results+xml", "text/tab-separated-values",
    "application/n-quads", "application/trig", "application/rdf+xml", "application/ld+json",
)  # fmt: skip
_PAGE = Answer(types=(JSON_TYPE, "text/html"))

# POST with SPARQL as the body is the SPARQL protocol's own, which generators do not know.
SPARQL = Messages(
    "Ask in SPARQL 1.1",
    (
        parameter("query", "query", "SELECT, ASK, CONSTRUCT or DESCRIBE", TEXT),
        parameter("default-graph-uri", "query", "graphs of the default graph", _GRAPHS),
        parameter("named-graph-uri", "query", "graphs for GRAPH", _GRAPHS),
        parameter("inferred", "query", "0 leaves derived statements out",
                  {"type": "string", "enum": ["0", "1", "false", "true"]}),
        parameter("timeout", "query", "time limit in seconds",
                  {"type": "number", "exclusiveMinimum": 0}),
        parameter("as_of", "query", "earlier state: the number of its last commit, EPOCH:NUMBER, "
                  "or a time with its zone", TEXT),
        parameter("branch", "query", "name of a branch", TEXT),
    ),
    answer=Answer(types=_RESULTS),
    problems=(*READING, 413, 501, 507),  # of earlier states
)  # fmt: skip

ASK = Messages(
    "Answer a question in words",
    (parameter("text", "query", "a question in words", TEXT, required=True),),
    answer=_PAGE,
)

TERMS = Messages(
    "Describe a class or property, or list those that have all words",
    (
        parameter("term", "query", "IRI, prefixed name, name or label", TEXT),
        parameter("words", "query", "words to look for", TEXT),
    ),
    answer=_PAGE,
)

CONTEXT = Messages("JSON-LD context of the items", answer=Answer(types=("application/ld+json",)))

BLOB = Messages(
    "Read an image, a cloud or descriptors",
    (parameter("sha256", "path", "64 lower-case hex digits",
               {"type": "string", "pattern": "^[0-9a-f]{64}$"}),),
    answer=Answer(types=("application/octet-stream", "image/png", "image/jpeg", "application/ply")),
)  # fmt: skip

CHANGES = Messages(
    "Follow every commit, as server-sent events",
    (
        *(
            parameter(name, "query", f"{meaning}; an IRI, or a term as N-Triples", TEXT)
            for name, meaning in (
                ("s", "subject"), ("p", "predicate"), ("o", "object"), ("graph", "named graph"),
            )
        ),
        parameter("since", "query", "version to go on from, `<epoch>:<seq>`", TEXT),
        parameter("Last-Event-ID", "header", "the same, as browsers send it", TEXT),
    ),
    answer=Answer(types=("text/event-stream",)),
)  # fmt: skip

TICKET = Messages(
    "Get a value for the ?token= of one websocket; expires_in is in s",
    answer=Answer(
        201,
        "made",
        schema={
            "type": "object",
            "properties": {"ticket": TEXT, "expires_in": {"type": "integer"}},
            "required": ["ticket", "expires_in"],
        },
    ),
    problems=(400, 401, 403, 405, 413, 415, 429, 503),
)

_UNHEALTHY = {503: {"description": PROBLEMS[503], "content": {JSON_TYPE: {}, PROBLEM_TYPE: {}}}}
HEALTH = Messages("Whether the server is healthy", others=_UNHEALTHY)
READY = Messages("Whether the server takes requests", others=_UNHEALTHY)
LIVE = Messages("Whether the server is alive")
OPENAPI = Messages("This description")
