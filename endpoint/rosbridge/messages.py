"""JSON of rosbridge messages: parsed within bounds, written strictly."""

from __future__ import annotations

import json
import logging
import re
import sys
from collections.abc import Sequence
from typing import Any

from rtask.errors import RtaskError, UsageError
from rtask.wire.message import strict_json

JsonObject = dict[str, Any]

MAX_DEPTH = 64
MAX_FAILURE_TEXT = 500
# Only a text with one of these can hold a number that is beyond a float, or is none.
_UNUSUAL = re.compile(r"NaN|Infinity|[eE]\+?\d{3}|\d{309}")
_log = logging.getLogger(__name__)


def encode(message: JsonObject) -> str:
    """Write strict JSON; NaN in an answer would break every browser that reads it.

    Raises
    ------
    ValueError
        A number is not finite.
    """
    return strict_json(message).decode()


def parse(text: str) -> JsonObject:
    """Parse one message.

    Raises
    ------
    UsageError
        The text is not JSON, nested too deeply, or not an object.
    """
    try:
        message = json.loads(text)
    except json.JSONDecodeError as error:
        raise UsageError(
            f"not JSON: {error.msg} at line {error.lineno}, column {error.colno}"
        ) from None
    except (ValueError, RecursionError) as error:
        raise UsageError(f"invalid JSON: {str(error)[:100]}") from None
    if text.count("[") + text.count("{") > MAX_DEPTH and _is_deeper(message, MAX_DEPTH):
        raise UsageError(f"JSON nested deeper than {MAX_DEPTH}")
    if not isinstance(message, dict):
        raise UsageError("a message is a JSON object with a field `op`")
    return message


def _is_deeper(value: Any, allowed: int) -> bool:
    level = [value]
    for _ in range(allowed + 1):
        level = [
            child
            for node in level
            if isinstance(node, dict | list)
            for child in (node.values() if isinstance(node, dict) else node)
        ]
        if not level:
            return False
    return True


def refuse_unwritable_numbers(text: str, message: JsonObject) -> None:
    """Refuse a message with a number that could not be passed on to other robots.

    Parameters
    ----------
    text, message
        The message as it came, and parsed.

    Raises
    ------
    UsageError
        A number is NaN, infinite or beyond the range of a float.
    """
    if _UNUSUAL.search(text) and _has_unwritable_number(message):
        raise UsageError("JSON has no NaN or infinity, and no number may exceed 1.8e308")


def _has_unwritable_number(value: Any) -> bool:
    todo = [value]
    while todo:
        one = todo.pop()
        if isinstance(one, dict | list):
            todo += one.values() if isinstance(one, dict) else one
        elif isinstance(one, int | float) and not abs(one) <= sys.float_info.max:
            return True
    return False


def arguments(args: Any, parameters: Sequence[str] = ()) -> JsonObject:
    """Return the arguments of a call as an object.

    Clients send an object; the protocol describes a list of positional values. A list with a single
    object stands for that object.

    Parameters
    ----------
    parameters
        Names of the positional values, in order.

    Raises
    ------
    UsageError
        Neither was sent, or more values than there are names.

    Examples
    --------
    >>> arguments([2, 40], ("a", "b"))
    {'a': 2, 'b': 40}
    """
    if args is None or args == []:
        return {}
    if isinstance(args, list) and len(args) == 1 and isinstance(args[0], dict):
        args = args[0]
    if isinstance(args, list) and len(args) <= len(parameters):
        return dict(zip(parameters, args, strict=False))
    if not isinstance(args, dict):
        raise UsageError("args: expected an object, or a list holding one")
    return args


def name_of(message: JsonObject, field: str) -> str:
    """Return the name of a topic, service or action with its leading slash.

    Raises
    ------
    UsageError
        The name is missing, or holds half of a surrogate pair, which no page could show.
    """
    name = message.get(field)
    if not isinstance(name, str) or not name.strip("/ ") or not _is_unicode(name):
        raise UsageError(f"{field}: expected a name")
    return "/" + name.lstrip("/")


def _is_unicode(text: str) -> bool:
    return text.encode("utf-8", "replace").decode() == text


def text_of(message: JsonObject, field: str) -> str:
    """Return a field that must be a string.

    Raises
    ------
    UsageError
        It is not a string.
    """
    value = message.get(field)
    if not isinstance(value, str):
        raise UsageError(f"{field}: expected a string")
    return value


def service_response(
    message: JsonObject, result: bool, values: Any, status: int | None = None
) -> JsonObject:
    """Return the answer to a call, naming the service as the caller spelled it.

    Parameters
    ----------
    status
        HTTP status of a failure, which tells clients whether to try again.
    """
    answer: JsonObject = {
        "op": "service_response",
        "service": message.get("service"),
        "values": values,
        "result": result,
    }
    if status is not None:
        answer["status"] = status
    return with_id(answer, message)


def with_id(answer: JsonObject, message: Any) -> JsonObject:
    """Add the caller's id exactly as it was sent; none if none was sent that JSON can carry."""
    id_ = message.get("id") if isinstance(message, dict) else None
    return answer if id_ is None or _has_unwritable_number(id_) else {**answer, "id": id_}


def failure_text(error: Exception) -> str:
    """Return one line that says what went wrong; unexpected errors reveal nothing internal."""
    if isinstance(error, RtaskError):
        return " ".join(str(error).split())[:MAX_FAILURE_TEXT]
    _log.error("a call failed", exc_info=error)
    return "an unexpected error; the server's log has it"
