"""A worker: carries out calls of services for a server on another machine (Kehoe 2014, 5.6).

It connects outwards, so its machine needs no open port, and comes back after the connection was
lost. docs/workers.md describes the messages, for workers in other languages.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from rtask.client.calling.messages import addresses
from rtask.client.work.data import ServerDatasets
from rtask.errors import AuthenticationError, ForbiddenError, RtaskError, UsageError
from rtask.kb.commit.access import Access
from rtask.services.call import Invocation
from rtask.services.definition import Definition
from rtask.services.description import described
from rtask.services.host import ServiceHost
from rtask.services.outward.frames import pack, packed, plain, unpack
from rtask.services.task import Task
from rtask.wire.address import authorization, is_near

__all__ = ["Worker"]

_log = logging.getLogger(__name__)
_ALIVE_S = 5.0
_PAUSE_S = 0.5
_MAX_PAUSE_S = 10.0
_MAX_BYTES = 64 << 20
_PROGRESS_S = 0.1


class Worker:
    """Serves definitions for one server until it is stopped.

    Parameters
    ----------
    server
        Address of the server, ``https://host:8765``.
    definitions
        The services.
    token
        With the right ``deploy``; None for a server without tokens.
    slots
        How many calls of a service it carries out at a time; None = as the service says, or one for
        each core.
    cache
        Folder for the files of data resources; None = a temporary one.
    is_binary
        Whether calls and answers travel as CBOR; False = as JSON.
    on_state
        Told ``connected`` with the names of the services, and ``lost`` with the reason.
    """

    def __init__(
        self,
        server: str,
        definitions: Iterable[Definition],
        token: str | None = None,
        slots: int | None = None,
        cache: Path | None = None,
        *,
        is_binary: bool = True,
        on_state: Callable[[str, str], None] = lambda state, words: None,
    ) -> None:
        _, self._address = addresses(server)
        self._token = token
        self._is_binary = is_binary
        self._on_state = on_state
        self._datasets = ServerDatasets(server, token, cache)
        self._definitions = list(definitions)
        self._slots = {
            definition.exact: slots or _seats(definition) for definition in self._definitions
        }
        self._host = ServiceHost(self._definitions, None, self._datasets)
        self._tasks: dict[str, Task] = {}
        self._stopping = threading.Event()
        self._socket: Any = None

    @property
    def slots(self) -> dict[str, int]:
        """Calls at a time of each service, by its exact name."""
        return dict(self._slots)

    def run(self) -> None:
        """Connect and carry out calls until :meth:`stop`.

        Raises
        ------
        AuthenticationError, ForbiddenError
            The server does not take the token.
        UsageError
            The server does not take a service.
        """
        pause_s = _PAUSE_S
        try:
            while not self._stopping.is_set():
                began = time.monotonic()
                try:
                    self._serve()
                except (OSError, EOFError) as error:
                    self._on_state("lost", f"{self._address}: {error}")
                if time.monotonic() - began > _MAX_PAUSE_S:
                    pause_s = _PAUSE_S
                self._stopping.wait(pause_s)
                pause_s = min(2 * pause_s, _MAX_PAUSE_S)
        finally:
            self._host.close()

    def stop(self) -> None:
        """End after the calls in progress; may be called from any thread, or by a signal."""
        self._stopping.set()

    def _serve(self) -> None:
        """Serve over one connection until it is lost, or the worker is stopped."""
        from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
        from websockets.sync.client import connect

        headers = authorization(self._token)
        try:
            with connect(
                self._address,
                additional_headers=headers,
                compression=None,
                max_size=_MAX_BYTES,
                close_timeout=1.0,
                proxy=None if is_near(self._address) else True,
            ) as socket:
                self._socket = socket
                try:
                    self._listen(socket)
                finally:
                    self._abandon()
        except InvalidStatus as error:
            status = error.response.status_code
            if status == 401:
                raise AuthenticationError(f"{self._address} wants a valid token") from None
            if status == 403:
                raise ForbiddenError(f"{self._address} refuses this caller") from None
            raise OSError(f"the server answered {status}") from None
        except (InvalidHandshake, ConnectionClosed) as error:
            raise EOFError(str(error)) from None

    def _listen(self, socket: Any) -> None:
        waiting = self._advertise(socket)
        announced_at = time.monotonic()
        leaving = False
        while not (leaving and not self._tasks):
            if self._stopping.is_set() and not leaving:
                leaving = True
                self._say({"op": "worker_leaves"})
            try:
                frame = socket.recv(timeout=0.2)
            except TimeoutError:
                frame = None
            if time.monotonic() - announced_at > _ALIVE_S:
                announced_at = time.monotonic()
                socket.send(json.dumps({"op": "worker_alive"}))
            if frame is None:
                continue
            message = json.loads(frame) if isinstance(frame, str) else unpack(frame)
            if message.get("op") == "call_service":
                self._start(message)
            elif message.get("op") == "cancel_action_goal":
                task = self._tasks.get(str(message.get("id")))
                if task is not None:
                    task.cancel()
            elif message.get("op") == "status":
                self._on_message(message, waiting)

    def _advertise(self, socket: Any) -> set[str]:
        for own in self._definitions:
            message = {
                "op": "advertise_service", "id": own.exact, "service": f"/services/{own.name}",
                "type": "", "slots": self._slots[own.exact],
                "compression": "cbor" if self._is_binary else "none",
                "description": described(own, [own.version], "ready"),
            }  # fmt: skip
            socket.send(json.dumps(message))
        return {own.exact for own in self._definitions}

    def _on_message(self, message: Mapping[str, Any], waiting: set[str]) -> None:
        """Note what the server says of an advertisement.

        Raises
        ------
        UsageError
            It does not take the service.
        OSError
            It dropped the worker.
        """
        name, words = message.get("id"), str(message.get("msg"))
        if message.get("level") == "error":
            if name in waiting:
                raise UsageError(f"{self._address} does not take {name}: {words}")
            raise OSError(words)
        if name in waiting:
            waiting.discard(str(name))
            if not waiting:
                self._on_state("connected", ", ".join(sorted(self._slots)))

    def _start(self, message: Mapping[str, Any]) -> None:
        key = str(message.get("id"))
        try:
            caller = message.get("caller") or {}
            access = Access(caller.get("agent"), caller.get("role", "anonymous"))
            method = str(message.get("service")).rpartition("/")[2]
            asked = Invocation(
                str(message.get("exact")), method, message.get("args") or {}, access,
                message.get("data") or None, float(message.get("timeout") or 0.0),
            )  # fmt: skip
            task = self._host.prepare(asked)
            self._tasks[key] = task
            task.call.on_progress(self._reporter(key))
            task.done.add_done_callback(lambda _: self._reply(key, task))
            self._host.start(task)
        except RtaskError as error:
            self._tasks.pop(key, None)
            self._say({"op": "service_response", "id": key, **_failure(error)})

    def _reporter(self, key: str) -> Callable[[float, str], None]:
        """Return what sends progress, at most ten times a second and always its end."""
        last = [0.0]

        def report(fraction: float, text: str) -> None:
            now = time.monotonic()
            if fraction < 1.0 and now - last[0] < _PROGRESS_S:
                return
            last[0] = now
            values = {"progress": fraction, "message": text}
            self._say({"op": "action_feedback", "id": key, "values": values})

        return report

    def _reply(self, key: str, task: Task) -> None:
        if self._tasks.pop(key, None) is None:
            return  # nobody is there any more
        message: dict[str, Any] = {"op": "service_response", "id": key}
        try:
            answer = task.result()
            values = packed(answer) if self._is_binary else plain(answer)
            message.update(result=True, values=values)
            written = self._datasets.take_written(task.call.caller)
            if written:
                resources = {name.partition("@")[0]: own for own, name, _ in task.data}
                message["written"] = {
                    resources[own_name]: files for own_name, files in written.items()
                }
        except RtaskError as error:
            message.update(_failure(error))
        self._say(message)

    def _say(self, message: dict[str, Any]) -> None:
        """Send a message; where the connection is gone, nobody waits for it."""
        from websockets.exceptions import ConnectionClosed

        try:
            frame: str | bytes = pack(message) if self._is_binary else json.dumps(_texts(message))
        except (RtaskError, ValueError, TypeError) as error:
            failed = {"result": False, "values": f"the answer cannot be sent: {error}"}
            frame = json.dumps({"op": message["op"], "id": message.get("id"), **failed})
        with contextlib.suppress(ConnectionClosed, OSError):
            self._socket.send(frame)

    def _abandon(self) -> None:
        """Cancel what nobody waits for any more."""
        tasks, self._tasks = dict(self._tasks), {}
        for task in tasks.values():
            task.cancel()


def _seats(definition: Definition) -> int:
    if definition.is_writing:
        return 1
    return definition.max_workers or os.cpu_count() or 1


def _failure(error: RtaskError) -> dict[str, Any]:
    return {
        "result": False, "values": str(error), "error": error.slug, "transient": error.is_transient
    }  # fmt: skip


def _texts(message: dict[str, Any]) -> dict[str, Any]:
    """Return a message with the files that a call wrote as base64."""
    import base64

    written = message.get("written")
    if not written:
        return message
    texts = {
        own: {path: base64.b64encode(data).decode() for path, data in files.items()}
        for own, files in written.items()
    }
    return {**message, "written": texts}
