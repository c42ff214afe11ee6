"""One websocket to a server, held open: calls of several threads at once, and topics.

A lost connection is opened again by a thread of its own, and its topics are subscribed again
(rosbridge protocol 2: ``call_service``, ``subscribe``).
"""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
import queue
import threading
from collections.abc import Callable, Mapping
from typing import Any

from rtask.client.calling.messages import answer_values, open_socket, service_call
from rtask.client.failures import Patience
from rtask.errors import CallFailedError, RemoteUnavailableError, RtaskError

__all__ = ["Hear", "HeldSocket"]

log = logging.getLogger(__name__)

_PAUSE_S, _MAX_PAUSE_S = 0.1, 2.0
_OPEN_S = 10.0
Hear = Callable[[Mapping[str, Any]], None]


class _Link:
    """One connection, and the calls that wait for its answers."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self._lock = threading.Lock()
        self._is_lost = False
        self._waiting: dict[str, queue.SimpleQueue[Any]] = {}

    def ask(self, number: str, text: str) -> queue.SimpleQueue[Any]:
        """Send a call and return where its answer will be; None is put there when it is lost."""
        answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        with self._lock:
            # Its answer could only have come on this connection.
            if self._is_lost:
                raise EOFError("the connection was lost")
            self._waiting[number] = answers
        try:
            self.send(text)
        except EOFError:
            self.forget(number)
            raise
        return answers

    def send(self, text: str) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            self.socket.send(text)
        except (ConnectionClosed, OSError) as error:
            raise EOFError(str(error)) from error

    def forget(self, number: str) -> None:
        with self._lock:
            self._waiting.pop(number, None)

    def take(self, message: Mapping[str, Any]) -> None:
        """Hand an answer to the call that waits for it; later ones are dropped."""
        number = message.get("id")
        with self._lock:
            answers = self._waiting.pop(number, None) if isinstance(number, str) else None
        if answers is not None:
            answers.put(message)

    def lose(self) -> None:
        with self._lock:
            self._is_lost, waiting = True, list(self._waiting.values())
            self._waiting.clear()
        for answers in waiting:
            answers.put(None)


class HeldSocket:
    """A websocket that is opened at once and again whenever it was lost.

    Parameters
    ----------
    address
        ``ws://host:port/rosbridge``.
    token
        Sent as a bearer token.
    timeout_s
        For each answer.
    """

    def __init__(self, address: str, token: str | None, timeout_s: float) -> None:
        self._address, self._token, self._timeout_s = address, token, timeout_s
        self._ids = itertools.count(1)
        self._changed = threading.Condition()
        self._link: _Link | None = None
        self._trouble: Exception | None = None
        self._topics: dict[str, Hear] = {}
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True, name="rtask-socket")
        self._thread.start()

    @property
    def is_open(self) -> bool:
        """Whether there is a connection."""
        return self._link is not None

    def call(
        self,
        service: str,
        args: Mapping[str, Any],
        may_repeat: bool,
        timeout_s: float | None = None,
    ) -> dict[str, Any]:
        """Call a service and return its answer; several threads may call at once.

        Parameters
        ----------
        may_repeat
            Whether the call may be sent again on a new connection after the old one was lost.
        timeout_s
            For this call, instead of the usual time.

        Raises
        ------
        RemoteUnavailableError
            Not connected, or no answer in time.
        AuthenticationError, ForbiddenError
            The server does not accept the token.
        CallFailedError
            The server's words.
        UsageError
            The arguments are not JSON, such as a number that is not finite.
        """
        patience = Patience(self._timeout_s if timeout_s is None else timeout_s)
        while True:
            link = self._wait_for_link(patience)
            number = f"call_service:{service}:{next(self._ids)}"
            text = service_call(service, args, number, patience)
            try:
                answers = link.ask(number, text)
            except EOFError:
                self._lose(link)
                continue
            try:
                message = answers.get(timeout=max(patience.left_s, 0.001))
            except queue.Empty:
                link.forget(number)
                raise RemoteUnavailableError(
                    f"no answer from {self._address} within {patience.timeout_s:g} s"
                ) from None
            # It was sent, and nobody knows whether it was carried out.
            if message is None:
                if may_repeat:
                    continue
                raise RemoteUnavailableError(
                    f"{self._address}: the connection was lost; the call may have been carried out"
                )
            try:
                return answer_values(message)
            except CallFailedError as error:
                # Nobody had time for it: nothing was done, so it does no harm to ask again.
                busy = error.details.get("http_status") in (429, 503) and error.is_transient
                if not busy or not patience.wait():
                    raise

    def subscribe(self, topic: str, hear: Hear) -> None:
        """Call a function with each message of a topic, over as many connections as it takes."""
        with self._changed:
            self._topics[topic] = hear
            link = self._link
        if link is not None:
            self._tell(link, {"op": "subscribe", "topic": topic})

    def unsubscribe(self, topic: str) -> None:
        """End a subscription."""
        with self._changed:
            was_there = self._topics.pop(topic, None) is not None
            link = self._link
        if was_there and link is not None:
            self._tell(link, {"op": "unsubscribe", "topic": topic})

    def close(self) -> None:
        """Close the websocket; calls that wait fail."""
        self._closed.set()
        with self._changed:
            link = self._link
            self._changed.notify_all()
        if link is not None:
            self._lose(link)
        self._thread.join(_OPEN_S)

    def _wait_for_link(self, patience: Patience) -> _Link:
        with self._changed:
            while self._link is None:
                if self._closed.is_set():
                    raise RemoteUnavailableError(f"{self._address}: closed")
                # A wrong token stays wrong: no use in waiting for another try.
                if isinstance(self._trouble, RtaskError):
                    raise self._trouble
                if not self._changed.wait(patience.left_s if patience.left_s > 0 else 0.0):
                    raise RemoteUnavailableError(
                        f"{self._address} cannot be reached: {self._trouble or 'no answer'}"
                    )
            return self._link

    def _run(self) -> None:
        pause_s = _PAUSE_S
        while not self._closed.is_set():
            try:
                with contextlib.ExitStack() as opened:
                    link = _Link(open_socket(opened, self._address, self._token, _OPEN_S))
                    pause_s = _PAUSE_S
                    self._serve(link)
                # Anew at once, since a connection that came about shows that somebody answers.
                continue
            except (OSError, RtaskError) as error:
                trouble: Exception = error
            except Exception as error:  # whatever it was, the next connection may do better
                log.exception("%s: the connection ended", self._address)
                trouble = error
            with self._changed:
                self._trouble = trouble
                self._changed.notify_all()
            self._closed.wait(pause_s)
            # Longer each time: a server that restarts is not helped by a thousand knocks.
            pause_s = min(2 * pause_s, _MAX_PAUSE_S)

    def _serve(self, link: _Link) -> None:
        """Read one connection to its end."""
        from websockets.exceptions import ConnectionClosed

        with self._changed:
            self._link, self._trouble = link, None
            topics = list(self._topics)
            self._changed.notify_all()
        try:
            # Before anything else, since messages of a topic may have been missed already.
            for topic in topics:
                self._tell(link, {"op": "subscribe", "topic": topic})
            while not self._closed.is_set():
                self._take(link, json.loads(link.socket.recv()))
        except (ConnectionClosed, OSError, EOFError) as error:
            log.info("%s: the connection ended: %s", self._address, error)
        except ValueError as error:
            log.warning("%s: a message that is no JSON: %s", self._address, error)
        finally:
            self._lose(link)

    def _take(self, link: _Link, message: Any) -> None:
        if not isinstance(message, dict):
            return
        if message.get("op") in ("service_response", "status"):
            link.take(message)
        elif message.get("op") == "publish":
            hear = self._topics.get(str(message.get("topic")))
            if hear is not None:
                try:
                    hear(message.get("msg") or {})
                except Exception:  # a subscriber's fault must not cut the calls of others
                    log.exception("a message of %s could not be handled", message.get("topic"))

    def _tell(self, link: _Link, message: Mapping[str, Any]) -> None:
        # What is lost with its connection is said again on the next.
        with contextlib.suppress(EOFError):
            link.send(json.dumps(message))

    def _lose(self, link: _Link) -> None:
        from websockets.exceptions import WebSocketException

        link.lose()
        with self._changed:
            if self._link is link:
                self._link = None
        # Saying goodbye on a connection that was cut fails in its own ways; it is gone anyhow.
        with contextlib.suppress(WebSocketException, OSError):
            link.socket.close()
