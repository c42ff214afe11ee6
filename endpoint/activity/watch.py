"""Filling the activity log from commits and calls."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable

from endpoint.activity.calls import call_event
from endpoint.activity.commits import commit_events
from endpoint.activity.log import ANONYMOUS, ActivityLog
from endpoint.served import ServedGraph
from rtask.engine.engine import Call, Engine
from rtask.kb.commit.commit import Change
from rtask.knowledge_base import KnowledgeBase

__all__ = ["watch"]

_log = logging.getLogger(__name__)
_PEOPLE = ("teacher", "admin")


def watch(activity: ActivityLog, kb: ServedGraph, engine: object) -> Callable[[], None]:
    """Report each commit, and each call by a robot, to a log; return a function to stop.

    A graph that another server stores tells of nothing.
    """

    def on_commit(change: Change) -> None:
        assert isinstance(kb, KnowledgeBase)
        activity.tell(*commit_events(kb, change))

    def on_call(call: Call) -> None:
        who = call.access.agent or ANONYMOUS
        if call.answer is None and call.error is None:
            activity.calls.began(who, call.number, call.operation)
        else:
            activity.calls.ended(who, call.number)
        try:
            activity.tell(call_event(call))
        except Exception:  # noqa: BLE001 - a watcher must not make a robot's call fail
            _log.exception("call of %s not shown", call.operation)

    watched = contextlib.ExitStack()
    if isinstance(kb, KnowledgeBase):
        watched.callback(kb.on_commit(on_commit))
    if isinstance(engine, Engine):
        watched.callback(
            engine.on_call(lambda call: None if call.access.role in _PEOPLE else on_call(call))
        )
    return watched.close
