"""Parts that all sections of the description of the HTTP interface are made of."""

from __future__ import annotations

from typing import Any

from endpoint.http.problems import PROBLEM_TYPE

__all__ = ["JsonObject", "get", "parameter", "problems"]

JsonObject = dict[str, Any]

_PROBLEMS = {
    400: "the request cannot be read, or a field is wrong",
    401: "the token is missing or not valid",
    403: "the caller may not do this",
    404: "there is nothing here",
    405: "the method is not allowed here",
    406: "none of the accepted media types is available",
    408: "the body did not arrive",
    409: "the state does not allow it",
    410: "it is no longer kept",
    412: "the resource changed in the meantime",
    413: "it is too large",
    415: "the media type is not supported",
    416: "the range lies beyond the end",
    422: "the request contradicts what is known",
    429: "too many requests; see Retry-After",
    501: "not with this kind of store",
    503: "too busy; see Retry-After",
    504: "no answer in time",
    507: "the disk is full",
}
_READ_PROBLEMS = (400, 401, 403, 404, 405, 406, 410, 416, 429, 503, 504)


def problems(statuses: tuple[int, ...]) -> JsonObject:
    """Return the responses of some statuses, which are problem details."""
    content = {PROBLEM_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {
        str(status): {"description": _PROBLEMS[status], "content": content} for status in statuses
    }


def get(
    summary: str, media_types: tuple[str, ...], parameters: list[JsonObject] | None = None
) -> JsonObject:
    """Return the description of a GET."""
    described: JsonObject = {
        "summary": summary,
        "responses": {
            "200": {
                "description": "the answer",
                "content": {media_type: {} for media_type in media_types},
            },
            **problems(_READ_PROBLEMS),
        },
    }
    if parameters:
        described["parameters"] = parameters
    return described


def parameter(name: str, where: str, description: str, schema: JsonObject) -> JsonObject:
    """Return the description of a parameter, which is needed in a path and nowhere else."""
    return {
        "name": name, "in": where, "required": where == "path", "description": description,
        "schema": schema,
    }  # fmt: skip
