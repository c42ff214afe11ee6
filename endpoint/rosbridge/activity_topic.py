"""Topic on which the server tells what robots do."""

from __future__ import annotations

from endpoint.activity.log import Event
from endpoint.rosbridge.session import Bridge

ACTIVITY = "/rtask/activity"
_TYPE = "rtask/Activity"


def announce_activity(bridge: Bridge, event: Event) -> None:
    """Publish an event to the subscribers of the activity topic."""
    if not bridge.topics.is_heard(ACTIVITY):
        return
    message = {
        "robot": event.who,
        "service": event.service,
        "kind": event.kind,
        "words": event.words,
        "detail": event.detail,
    }
    bridge.topics.announce(ACTIVITY, _TYPE, message)
