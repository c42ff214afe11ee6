"""Actions: long-running goals with feedback, for the server's actions and those of robots.

Each goal has one result with a top-level ``status`` as in actionlib_msgs/GoalStatus. Feedback
always comes before it, at most ten times a second; newer feedback replaces what has not been sent.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from endpoint.access.auth import require_scope
from endpoint.rosbridge.calls import CallQueue, Deadline, Deadlines
from endpoint.rosbridge.messages import (
    JsonObject,
    encode,
    failure_text,
    refuse_unwritable,
)
from endpoint.rosbridge.providers import Peer, Provider, Providers
from endpoint.rosbridge.services import Engine
from rtask.errors import CancelledError, RtaskError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access

SUCCEEDED, CANCELLED, ABORTED = 4, 5, 6
MAX_GOALS_PER_SESSION = 16
FEEDBACK_EVERY_S = 0.1
GOAL_S = 600.0


class Progress:
    """Connection of an action's handler to its goal: reports progress, learns of cancellation.

    Parameters
    ----------
    tell
        Receives feedback.
    """

    def __init__(self, tell: Callable[[JsonObject], None]) -> None:
        self._tell = tell
        self._furthest = 0.0
        self._cancelled = threading.Event()
        self._stop: Callable[[], object] | None = None

    @property
    def is_cancelled(self) -> bool:
        """Whether the goal has been cancelled."""
        return self._cancelled.is_set()

    def report(self, progress: float, phase: str, **members: Any) -> None:
        """Report progress from 0 to 1; it never decreases."""
        self._furthest = max(self._furthest, min(progress, 1.0))
        self._tell({"progress": self._furthest, "phase": phase, **members})

    @property
    def settles_its_end(self) -> bool:
        """Whether the handler decides if it can still be cancelled."""
        return self._stop is not None

    def cancel(self) -> bool:
        """Ask the handler to stop; return whether the goal is cancelled by that.

        It is not where what the handler did is being stored, or has been: its result follows.
        """
        self._cancelled.set()
        return self._stop is None or self._stop() is not False

    def on_cancel(self, stop: Callable[[], object]) -> None:
        """Call back when the handler is asked to stop; at once if it was.

        Parameters
        ----------
        stop
            Returns False where it is too late for that.
        """
        self._stop = stop
        if self.is_cancelled:
            stop()


@dataclass(frozen=True)
class Action:
    """An action of the server.

    Parameters
    ----------
    name
        With the leading slash.
    type
        ROS name of its type.
    scope
        Scope that a caller needs.
    handler
        Takes the arguments, the caller's rights and where to report progress.
    at_copy
        Whether a follower carries it out too, from its copy of the graph.
    """

    name: str
    type: str
    scope: str
    handler: Callable[[JsonObject, Access, Progress], JsonObject]
    at_copy: bool = False


@dataclass
class Goal:
    """A goal in progress."""

    id: Any
    action: str
    peer: Peer
    wants_feedback: bool
    deadlines: Deadlines
    provider: Provider | None = None
    progress: Progress | None = None
    late: Deadline | None = None
    last_feedback: float = float("-inf")
    held: Any = None
    done: bool = False
    stopped: tuple[int, Any] = (CANCELLED, {})
    """Status and values of the result if the handler is stopped."""
    lock: threading.Lock = field(default_factory=threading.Lock)

    def feedback(self, values: Any) -> None:
        """Send feedback if it was requested; newer feedback replaces what comes too fast."""
        with self.lock:
            if self.done or not self.wants_feedback:
                return
            wait_s = self.last_feedback + FEEDBACK_EVERY_S - time.monotonic()
            if wait_s <= 0:
                self._tell(values)
                return
            if self.held is None:
                self.deadlines.after(wait_s, self._tell_held)
            self.held = values

    def end(self, status: int, values: Any, transient: bool | None = None) -> None:
        """Send the result, once, after any feedback that waits.

        Parameters
        ----------
        transient
            Of an error: whether trying again may help. None = it is not known.
        """
        with self.lock:
            if self.done:
                return
            self.done = True
            if self.held is not None and status == SUCCEEDED:
                self._tell(self.held)
            more = {} if transient is None else {"transient": transient}
            self._emit(
                "action_result", values=values, status=status, result=status != ABORTED, **more
            )
        if self.progress is not None:
            self.progress.cancel()

    def _tell_held(self) -> None:
        with self.lock:
            if not self.done and self.held is not None:
                self._tell(self.held)

    def _tell(self, values: Any) -> None:
        self.last_feedback, self.held = time.monotonic(), None
        self._emit("action_feedback", values=values)

    def _emit(self, op: str, **members: Any) -> None:
        self.peer.emit({"op": op, "id": self.id, "action": self.action, **members})


class Actions:
    """All actions of a server, and all goals.

    Parameters
    ----------
    offered
        The server's own.
    calls
        Runs the handlers.
    deadlines
        Ends goals that nobody answers.
    """

    def __init__(self, offered: list[Action], calls: CallQueue, deadlines: Deadlines) -> None:
        self._offered = {action.name: action for action in offered}
        self._calls = calls
        self._deadlines = deadlines
        self.providers = Providers(deadlines)
        self._lock = threading.Lock()
        self._goals: dict[str, Goal] = {}
        self._numbers = itertools.count(1)

    def names(self) -> list[str]:
        """Return the names of all actions, sorted."""
        return sorted({*self._offered, *(provider.name for provider in self.providers.listing())})

    def is_at_copy(self, name: str) -> bool:
        """Return whether a follower carries an action out itself; not one that it does not have."""
        action = self._offered.get("/" + name.lstrip("/"))
        return action is not None and action.at_copy

    def send(self, peer: Peer, access: Access, message: JsonObject, name: str) -> None:
        """Accept a goal; errors become its result."""
        key = f"action_goal:{next(self._numbers)}"
        id_ = message.get("id") if message.get("id") is not None else key
        goal = Goal(id_, name, peer, message.get("feedback") is True, self._deadlines)
        try:
            args = message.get("args")
            args = {} if args is None else args
            if not isinstance(args, dict):
                raise UsageError("args: expected an object")
            with self._lock:
                held = sum(goal.peer.number == peer.number for goal in self._goals.values())
                if held >= MAX_GOALS_PER_SESSION:
                    raise UsageError(f"busy: {MAX_GOALS_PER_SESSION} goals in progress")
                self._goals[key] = goal
            self._start(key, goal, args, access)
        except RtaskError as error:
            self._end(key, goal, ABORTED, failure_text(error))

    def _start(self, key: str, goal: Goal, args: JsonObject, access: Access) -> None:
        provider = self.providers.find(goal.action)
        own = self._offered.get(goal.action)
        if provider is None and own is None:
            names = ", ".join(self.names()) or "none"
            raise UnknownTermError(f"Action {goal.action} does not exist; known: {names}")
        require_scope(access, "call" if own is None else own.scope)
        goal.late = self._deadlines.after(
            GOAL_S, lambda: self._stop(key, goal, ABORTED, f"no result after {GOAL_S:g} s")
        )
        if own is not None:
            progress = goal.progress = Progress(goal.feedback)
            action = own
            if not self._calls.submit(
                goal.peer.number, lambda: self._work(key, goal, action, args, access, progress)
            ):
                raise UsageError("busy: too many calls are waiting")
        elif provider is not None:
            refuse_unwritable(args, "args")
            goal.provider = provider
            provider.peer.emit(
                {
                    "op": "send_action_goal",
                    "id": key,
                    "action": provider.name,
                    "action_type": provider.type,
                    "args": args,
                    "feedback": goal.wants_feedback,
                }
            )
            if self.providers.find(goal.action) is None:  # it was withdrawn a moment ago
                self._end(key, goal, ABORTED, f"{provider.peer.identity} no longer offers it")

    def _work(
        self, key: str, goal: Goal, action: Action, args: JsonObject, access: Access,
        progress: Progress,
    ) -> None:  # fmt: skip
        if progress.is_cancelled:
            return
        try:
            values = action.handler(args, access, progress)
            encode(values)  # numbers that JSON has no words for fail the goal, not the session
        except CancelledError:
            self._end(key, goal, *goal.stopped)
            return
        except Exception as error:  # noqa: BLE001 - a failed goal has a result
            transient = isinstance(error, RtaskError) and error.is_transient
            self._end(key, goal, ABORTED, failure_text(error), transient)
            return
        self._end(key, goal, SUCCEEDED, values)

    def cancel(self, peer: Peer, name: str, id_: Any = None) -> None:
        """Cancel one goal of a session, or all its goals of an action."""
        with self._lock:
            goals = [
                (key, goal)
                for key, goal in self._goals.items()
                if goal.peer is peer and goal.action == name and id_ in (None, goal.id)
            ]
        for key, goal in goals:
            if goal.provider is None:
                self._stop(key, goal, CANCELLED, {})
            else:
                goal.provider.peer.emit(
                    {"op": "cancel_action_goal", "id": key, "action": goal.action}
                )

    def relay(self, peer: Peer, message: JsonObject) -> None:
        """Forward a provider's feedback or result under the caller's id.

        Raises
        ------
        UsageError
            The goal was sent to another robot, or the message holds a number that is none in JSON.
        """
        id_ = message.get("id")
        with self._lock:
            goal = self._goals.get(id_) if isinstance(id_, str) else None
        if goal is None or not isinstance(id_, str):
            return  # finished, or cancelled by its deadline: too late
        if goal.provider is None or goal.provider.peer is not peer:
            raise UsageError(f"{message.get('op')}: the goal {id_} was sent to another robot")
        values = message.get("values")
        refuse_unwritable(message, str(message.get("op")))
        if message.get("op") == "action_feedback":
            goal.feedback(values if values is not None else message.get("feedback", {}))
            return
        status = message.get("status")
        if type(status) is not int or not 0 <= status <= 6:
            status = SUCCEEDED if message.get("result") else ABORTED
        if not message.get("result", status == SUCCEEDED) and status == SUCCEEDED:
            status = ABORTED
        self._end(id_, goal, status, "" if values is None else values)

    def unadvertise(self, peer: Peer, name: str) -> bool:
        """Withdraw an action of a robot and end the goals that it was sent.

        Returns
        -------
        Whether it was this session's.
        """
        if not self.providers.unadvertise(peer, name):
            return False
        with self._lock:
            goals = [
                (key, goal)
                for key, goal in self._goals.items()
                if goal.provider is not None and goal.provider.peer is peer and goal.action == name
            ]
        for key, goal in goals:
            peer.emit({"op": "cancel_action_goal", "id": key, "action": name})
            reason = f"{peer.identity} withdrew {name} before it was done"
            self._end(key, goal, ABORTED, reason)
        return True

    def leave(self, peer: Peer) -> None:
        """Cancel the goals of a session, and end those that were sent to it."""
        with self._lock:
            goals = list(self._goals.items())
        for key, goal in goals:
            if goal.peer is peer:
                if goal.provider is not None:
                    goal.provider.peer.emit(
                        {"op": "cancel_action_goal", "id": key, "action": goal.action}
                    )
                self._stop(key, goal, CANCELLED, {})
            elif goal.provider is not None and goal.provider.peer is peer:
                self._end(key, goal, ABORTED, f"{peer.identity} left before it was done")
        self.providers.leave(peer)

    def _stop(self, key: str, goal: Goal, status: int, values: Any) -> None:
        """End a goal before its handler has, unless what that did is being stored."""
        goal.stopped = (status, values)
        progress = goal.progress
        if progress is None or not progress.settles_its_end or progress.cancel():
            self._end(key, goal, status, values)

    def _end(
        self, key: str, goal: Goal, status: int, values: Any, transient: bool | None = None
    ) -> None:
        with self._lock:
            self._goals.pop(key, None)
        if goal.late is not None:
            goal.late.cancel()
        goal.end(status, values, transient)


def plan_grasps_action(engine: Engine) -> list[Action]:
    """Return the action `/rtask/plan_grasps`, if the engine can recognise objects."""
    recognise = engine.operations.get("recognise_for_grasp")
    if recognise is None:
        return []

    def plan(args: JsonObject, access: Access, progress: Progress) -> JsonObject:
        started = time.monotonic()
        _check_samples(args.get("samples"))
        request = {name: value for name, value in args.items() if name != "samples"}
        progress.report(0.05, "sampling", candidates=0, best_quality=0.0)
        answer = engine.call("recognise_for_grasp", {**request, "propose": True}, access).as_json()
        grasps: list[JsonObject] = answer["grasps"]
        best = max((float(grasp.get("grasp_quality") or 0.0) for grasp in grasps), default=0.0)
        progress.report(1.0, "ranking", candidates=len(grasps), best_quality=best)
        return {
            "task_id": answer["task_id"],
            "object": answer["object"],
            "class": answer["class"],
            "grasps": grasps,
            "candidates": len(grasps),
            "seconds": round(time.monotonic() - started, 6),
        }

    return [
        Action("/rtask/plan_grasps", "rtask/PlanGrasps", "read", plan, recognise.effect != "writes")
    ]


def _check_samples(samples: Any) -> None:
    """Refuse a value that is no number of samples."""
    if samples is not None and (type(samples) is not int or samples < 1):
        raise UsageError("samples: expected a whole number above 0", field="samples")
