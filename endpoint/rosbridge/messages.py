"""JSON of rosbridge messages: parsed within bounds, written strictly."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from typing import Any

from rtask.errors import TRANSIENT_STATUSES, RtaskError, UsageError
from rtask.wire.message import strict_json

JsonObject = dict[str, Any]

MAX_DEPTH = 64
MAX_FAILURE_TEXT = 500
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


def is_writable(value: Any) -> bool:
    """Tell whether strict JSON can carry a value, which has no NaN or infinity.

    Examples
    --------
    >>> is_writable({"x": [0.5, "NaN"]}), is_writable([{"x": float("nan")}])
    (True, False)
    """
    try:
        strict_json(value)
    except ValueError:
        return False
    return True


def refuse_unwritable(value: Any, field: str) -> None:
    """Refuse a value of a field that JSON cannot carry to another robot.

    Raises
    ------
    UsageError
        A number in it is not finite.
    """
    if not is_writable(value):
        raise UsageError(f"{field}: JSON has no NaN or infinity")


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
    message: JsonObject,
    result: bool,
    values: Any,
    status: int | None = None,
    transient: bool | None = None,
    slug: str | None = None,
) -> JsonObject:
    """Return the answer to a call, naming the service as the caller spelled it.

    Parameters
    ----------
    status
        HTTP status of a failure.
    transient
        Whether trying again may help; None = as the status says.
    slug
        Which error of RTASK it is, as workers say it in ``error``.
    """
    answer: JsonObject = {
        "op": "service_response",
        "service": message.get("service"),
        "values": values,
        "result": result,
    }
    if status is not None:
        answer["status"] = status
        answer["transient"] = status in TRANSIENT_STATUSES if transient is None else transient
    if slug is not None:
        answer["error"] = slug
    return with_id(answer, message)


def with_id(answer: JsonObject, message: Any) -> JsonObject:
    """Add the caller's id exactly as it was sent; none if none was sent that JSON can carry."""
    id_ = message.get("id") if isinstance(message, dict) else None
    return answer if id_ is None or not is_writable(id_) else {**answer, "id": id_}


def failure_text(error: Exception) -> str:
    """Return one line that says what went wrong; unexpected errors reveal nothing internal."""
    if isinstance(error, RtaskError):
        return " ".join(str(error).split())[:MAX_FAILURE_TEXT]
    _log.error("a call failed", exc_info=error)
    return "an unexpected error; the server's log has it"
