"""The thesis's own ops, as printed in Gatto 2016, 3.2.4.

`search_object` and `send_new_object` are no ops of rosbridge; the printed answers have no `op` and
their numbers are strings. Every field of the printed answers is there, with `op`, `service` and
`result` always, and numbers as numbers.
"""

from __future__ import annotations

import logging
import math
from typing import Any

from endpoint.access.auth import require_scope
from endpoint.rosbridge.messages import JsonObject
from endpoint.rosbridge.services import Engine
from rtask.errors import RtaskError, UsageError
from rtask.kb.commit.access import Access

_log = logging.getLogger(__name__)

_SERVICES = {"search_object": "query", "send_new_object": "insert"}
_LISTS = {"search_object": "similar_objects", "send_new_object": "objects"}
_PLACE = ("X", "Y", "Z", "rad")
_FAR_M = 10.0


def answer(message: JsonObject, engine: Engine, access: Access) -> JsonObject:
    """Carry out one of the two ops; a failure is an answer too.

    Parameters
    ----------
    message
        As it came in.
    engine
        What does the work.
    access
        What the robot may do.
    """
    try:
        if message["op"] == "search_object":
            return _search(message, engine, access)
        return _insert(message, engine, access)
    except RtaskError as error:
        return refusal(message, " ".join(str(error).split()))
    except Exception:  # noqa: BLE001 - a failed call is an answer
        _log.exception("op %s failed", message["op"])
        return refusal(message, "an unexpected error; the server's log has it")


def refusal(message: JsonObject, reason: str) -> JsonObject:
    """Return the answer that says why not, with an empty list."""
    return {**_frame(message, False), "error": reason[:500], _LISTS[message["op"]]: []}


def _frame(message: JsonObject, result: bool) -> JsonObject:
    op = message["op"]
    return {"op": f"{op}_response", "service": _SERVICES[op], "result": result}


def _search(message: JsonObject, engine: Engine, access: Access) -> JsonObject:
    args = message.get("args")
    if isinstance(args, str):
        args = {"data": args}
    if not isinstance(args, dict):
        raise UsageError("args: expected the point cloud as base64 text, or an object with `data`")
    require_scope(access, "read")
    try:
        hits = engine.call("search_object", args, access).as_json()
    except RtaskError as error:
        raise UsageError(f"args: {error}") from error
    # The thesis's robot expects numbers; an empty list sends it to its learner.
    similar = [entry for entry in hits["similar_objects"] if entry.get("X") is not None]
    return {**_frame(message, True), "similar_objects": similar}


def _insert(message: JsonObject, engine: Engine, access: Access) -> JsonObject:
    entries = message.get("new_object")
    if isinstance(entries, dict):
        entries = [entries]
    if not isinstance(entries, list):
        raise UsageError("new_object: expected a list of objects")
    require_scope(access, "write")
    objects = [_new_object(entry, f"new_object[{index}]") for index, entry in enumerate(entries)]
    stored = engine.call("insert_object", {"objects": objects}, access).as_json()
    return {
        **_frame(message, True),
        "stored": stored["stored"],
        "objects": [
            {name: entry.get(name) for name in ("object", "class", "new", "features")}
            for entry in stored["objects"]
        ],
    }


def _new_object(entry: Any, where: str) -> JsonObject:
    """Return the entry in the words of `insert_object`: strings of the thesis become numbers."""
    if not isinstance(entry, dict):
        raise UsageError(f"{where}: expected an object")
    fields = dict(entry)
    if "new_point_cloud" in fields:
        fields["data"] = fields.pop("new_point_cloud")
    for name in _PLACE:
        if fields.get(name) is not None:
            fields[name] = _number(fields[name], f"{where}.{name}")
    if any(abs(fields.get(name) or 0.0) > _FAR_M for name in _PLACE[:3]):
        _log.warning("%s lies more than %g m away; stored as given", where, _FAR_M)
    return fields


def _number(value: Any, where: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if isinstance(value, bool) or not math.isfinite(number):
        raise UsageError(f"{where}: {value!r} is not a number")
    return number
