"""Activity page: what each robot does at this moment, and what happened lately."""

from __future__ import annotations

import base64
import binascii
from dataclasses import asdict
from datetime import UTC, datetime

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.activity.log import Event, as_json
from endpoint.follow.activity import past_events, place_of
from endpoint.http.messages import RefusedError
from endpoint.pages.render import Model, blueprint, context, embedded_graph, knowledge_base, page
from rtask.errors import GoneError, UsageError
from rtask.extras import naming_extras
from rtask.knowledge_base import KnowledgeBase

_ADDRESS = "/activity"
MAX_ROWS = 200
PAST_COMMITS = 60
_JPEG_QUALITY = 80
_SILENT = ("frame", "answered")  # seen on the robot's card only
_BOOKKEEPING = "wrote"


@page(_ADDRESS, "activity.html")
def activity() -> Model:
    """Return the state of each robot and the last events, the newest first."""
    server = context()
    log = server.activity
    place = place_of(server, None)
    since = flask.request.args.get("since", "")
    if since:
        events = past_events(server, since, MAX_ROWS)
    else:
        events = [*_before(log.first_seq), *log.after(0)]
    rows = [event for event in events if event.kind not in _SILENT]
    newest = [as_json(event) for event in reversed(rows[-MAX_ROWS:])]
    return {"place": place, "lanes": [asdict(lane) for lane in log.lanes()], "events": newest}


def last_events(count: int) -> list[Model]:
    """Return what robots did last, the newest first; nothing where the graph is at another server.

    Where nothing but bookkeeping happened, that is returned.
    """
    if not isinstance(knowledge_base(), KnowledgeBase):
        return []
    log = context().activity
    events = list(log.after(0))
    if len(_done(events)) < count:  # commits before the log began are read again each time
        events = [*_before(log.first_seq), *events]
    shown = _done(events) or [event for event in events if event.kind not in _SILENT]
    return [as_json(event) for event in reversed(shown[-count:])]


def _done(events: list[Event]) -> list[Event]:
    """Return events without bookkeeping and without those that only a robot's card shows."""
    return [event for event in events if event.kind not in (*_SILENT, _BOOKKEEPING)]


def _before(seq: int) -> list[Event]:
    """Return what the last commits before the log began tell."""
    kb = embedded_graph()
    # Where so few commits are kept, those: what they tell is no less true.
    since = max(0, (seq or kb.seq + 1) - 1 - PAST_COMMITS, kb.feed.oldest_retained() - 1)
    try:
        events = past_events(context(), f"{kb.epoch}:{since}", MAX_ROWS)
    except GoneError:  # a commit has just been dropped
        return []
    return [event for event in events if not seq or event.seq < seq]


@blueprint.app_template_filter("clock")
def clock(time_s: float) -> str:
    """Return the time of day of an event, UTC; before today with its day.

    Examples
    --------
    >>> clock(3661.0)
    '1 Jan 1970 01:01'
    """
    at = datetime.fromtimestamp(time_s, UTC)
    if at.date() == datetime.now(UTC).date():
        return at.strftime("%H:%M:%S")
    return f"{at.day} {at:%b %Y %H:%M}"


@blueprint.route(f"{_ADDRESS}/frame", methods=["GET"])
def frame() -> WerkzeugResponse:
    """Return the last picture of a robot's camera."""
    robot = flask.request.args.get("robot", "")
    message = context().activity.last_picture(robot)
    if message is None:
        raise RefusedError(404, "not-found", f"the camera of {robot!r} has sent no picture")
    data, media_type = _picture(message)
    response = flask.Response(data, content_type=media_type)
    response.headers["Cache-Control"] = "private, no-cache"
    response.add_etag()
    return response.make_conditional(flask.request)


def _picture(message: dict[str, object]) -> tuple[bytes, str]:
    """Return a picture that a browser shows, from a message as robots publish it.

    Raises
    ------
    UsageError
        The message holds no picture.
    """
    text = message["data"]
    if not isinstance(text, str):
        raise UsageError("the camera's last message has no picture: expected base64 in `data`")
    with naming_extras("activity"):
        if message["type"] == "rtask/Frame":
            return _frame_jpeg(text), "image/jpeg"
        from rtask.engine.perception.images import check_picture

        try:
            data = base64.b64decode(text, validate=True)
        except binascii.Error as error:
            raise UsageError(f"the camera's last message is not base64: {error}") from None
        return data, check_picture(data, "data")[0]


def _frame_jpeg(text: str) -> bytes:
    """Return the colours of an RGB-D frame as a JPEG."""
    from features.codec import decode, from_wire
    from features.codec.image import jpeg
    from features.geometry import Frame

    try:
        image = decode(from_wire(text))
    except ValueError as error:
        raise UsageError(f"the camera's last message holds no frame: {error}") from None
    if not isinstance(image, Frame) or image.rgb is None:
        raise UsageError("the camera's last frame has no colours")
    return jpeg(image.rgb, _JPEG_QUALITY).stored
