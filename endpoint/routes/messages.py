"""Declaration of the messages of an address: parameters, body, answer and problems."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from endpoint.http.messages import JSON_TYPE
from endpoint.http.problems import PROBLEM_TYPE

__all__ = [
    "CHANGING", "PROBLEMS", "READING", "TEXT", "Answer", "Body", "JsonObject", "Messages",
    "parameter",
]  # fmt: skip

JsonObject = dict[str, Any]
TEXT: Final[JsonObject] = {"type": "string"}

PROBLEMS: Final = {
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
"""Meaning of each status of a problem."""

READING: Final = (400, 401, 403, 404, 405, 406, 410, 416, 429, 503, 504)
"""Problems of requests that read."""

CHANGING: Final = (400, 401, 403, 404, 405, 409, 413, 415, 422, 429, 503)
"""Problems of requests that change something."""


@dataclass(frozen=True)
class Body:
    """Body of a request.

    Parameters
    ----------
    schema
        JSON Schema.
    """

    schema: JsonObject
    media_type: str = JSON_TYPE
    is_required: bool = True


@dataclass(frozen=True)
class Answer:
    """Answer to a request that succeeded.

    Parameters
    ----------
    schema
        JSON Schema of the answer as JSON; None where it is not declared.
    """

    status: int = 200
    words: str = "the answer"
    types: tuple[str, ...] = (JSON_TYPE,)
    schema: JsonObject | None = None

    def described(self) -> JsonObject:
        """Return the response, as OpenAPI describes it."""
        described: JsonObject = {"description": self.words}
        if self.types:
            described["content"] = {media_type: {} for media_type in self.types}
        if self.schema is not None:
            described["content"][JSON_TYPE] = {"schema": self.schema}
        return described


@dataclass(frozen=True)
class Messages:
    """What a request and its answers carry.

    Parameters
    ----------
    summary
        What the request does, in a few words.
    description
        The rest; ``{right}`` stands for the right that the table of addresses names.
    problems
        Statuses of the problems that may be answered.
    others
        Further answers by status, as OpenAPI describes them.
    id, tags
        Name of the request in generated clients, and what it is grouped by there.
    """

    summary: str
    parameters: tuple[JsonObject, ...] = ()
    body: Body | None = None
    answer: Answer = Answer()
    problems: tuple[int, ...] = READING
    description: str = ""
    others: Mapping[int, JsonObject] = field(default_factory=dict)
    id: str = ""
    tags: tuple[str, ...] = ()

    def described(self, right: str) -> JsonObject:
        """Return the request, as OpenAPI describes it.

        Parameters
        ----------
        right
            What a caller needs.
        """
        described: JsonObject = {"operationId": self.id} if self.id else {}
        described["summary"] = self.summary.replace("{right}", right)
        if self.description:
            described["description"] = self.description.replace("{right}", right)
        if self.tags:
            described["tags"] = list(self.tags)
        if self.parameters:
            described["parameters"] = list(self.parameters)
        if self.body is not None:
            content = {self.body.media_type: {"schema": self.body.schema}}
            need = {"required": True} if self.body.is_required else {}
            described["requestBody"] = {**need, "content": content}
        described["responses"] = {
            str(self.answer.status): self.answer.described(),
            **{str(status): _problem(status) for status in self.problems},
            **{str(status): other for status, other in self.others.items()},
        }
        return described


def _problem(status: int) -> JsonObject:
    content = {PROBLEM_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {"description": PROBLEMS[status], "content": content}


def parameter(
    name: str, where: str, description: str, schema: JsonObject, *, required: bool = False
) -> JsonObject:
    """Return the description of a parameter, which is always needed in a path."""
    return {
        "name": name, "in": where, "required": required or where == "path",
        "description": description, "schema": schema,
    }  # fmt: skip
