"""Operations of the engine over HTTP: the same objects as over the websocket."""

from __future__ import annotations

import difflib
import json
import re
from typing import Any

from endpoint.access.auth import Authenticator, Caller
from endpoint.access.rights import authorise
from endpoint.http.idempotency import IdempotencyKeys
from endpoint.http.messages import JSON_TYPE, RefusedError, Request, Response
from endpoint.http.plan import Plan
from endpoint.rosbridge.services import Engine
from endpoint.routes.addresses import ENGINE
from endpoint.sparql.negotiation import prefers_html
from rtask.errors import UsageError
from rtask.wire.fields import request_id_of
from rtask.wire.message import Answer

_HALF_PAIR = re.compile(rb"\\u[dD][89A-Fa-f]")


def plan_operation(
    engine: Engine,
    auth: Authenticator,
    request: Request,
    caller: Caller,
    keys: IdempotencyKeys,
) -> Plan:
    """Prepare an operation of the engine; browsers are sent to its form.

    Raises
    ------
    RefusedError
        404 with the nearest name, 415.
    AuthenticationError
        It needs a token, and none came.
    ForbiddenError
        The caller's role does not include the operation.
    """
    name = request.raw_path.rstrip("/").removeprefix(f"{ENGINE}/")
    operation = engine.operations.get(name)
    if operation is None:
        near = difflib.get_close_matches(name, engine.operations, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise RefusedError(404, "not-found", f"no operation {name}{hint}")
    if request.method in ("GET", "HEAD") and prefers_html(request.header("accept")):
        return Plan.ready(Response(303, headers=(("Location", f"/operations/{name}"),)))
    authorise(auth, request, caller, operation.scope, name)
    args = json_object(request)
    if operation.effect != "writes":
        return Plan(lambda: _answered(engine.call(name, args, caller.access)))
    ids = request_id_of(operation.request)
    run = keys.prepared(
        request, name, caller.name, ids, args, lambda given: engine.call(name, given, caller.access)
    )
    return Plan(lambda: _answered(run()))


def _answered(answer: Answer) -> Response:
    return Response(200, answer.to_json(), JSON_TYPE)


def json_object(request: Request, allowed: tuple[str, ...] | None = None) -> dict[str, Any]:
    """Return the JSON object in the body of a request; an empty one has no members.

    Parameters
    ----------
    allowed
        Members that it may have; any by default.

    Raises
    ------
    RefusedError
        415.
    UsageError
        It is not JSON, or not an object, or has another member.
    """
    args = json_value(request)
    if not isinstance(args, dict):
        raise UsageError("expected one JSON object")
    allowed = (*args,) if allowed is None else allowed
    for name in args.keys() - set(allowed):
        raise UsageError(f"unknown field {name!r}; one of {', '.join(allowed)}", field=name)
    return args


def json_value(request: Request) -> Any:
    """Return the JSON in the body of a request.

    Raises
    ------
    RefusedError
        415.
    UsageError
        It is not JSON.
    """
    media_type, _ = request.content_type
    if media_type != JSON_TYPE:
        raise RefusedError(
            415,
            "unsupported-media-type",
            f"send the arguments as {JSON_TYPE}",
            headers=(("Accept-Post", JSON_TYPE),),
        )
    try:
        sent = json.loads(request.body.decode("utf-8-sig") or "{}")
    except json.JSONDecodeError as error:
        raise UsageError(
            f"not JSON: {error.msg} at line {error.lineno}, column {error.colno}",
            line=error.lineno,
            column=error.colno,
        ) from None
    except (ValueError, RecursionError):
        raise UsageError("not JSON that can be read") from None
    if _HALF_PAIR.search(request.body) and not _is_unicode(sent):
        raise UsageError("a text holds half of a surrogate pair, which is not Unicode")
    return sent


def _is_unicode(value: Any) -> bool:
    """Tell whether all texts in a JSON value can be written as UTF-8."""
    try:
        json.dumps(value, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        return False
    return True
