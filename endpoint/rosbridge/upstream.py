"""A robot's second connection, from a follower to the writer.

Services and actions that read the graph, or record that they were asked, are answered by the
follower, near the robot. Everything else goes on to the writer as it came: writes, topics, and what
robots and workers offer. So robots hear each other wherever they are connected.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import InvalidStatus, WebSocketException

from endpoint.http.following import Following
from endpoint.http.messages import Request
from endpoint.http.websocket import SERVICE_RESTART
from endpoint.rosbridge.messages import JsonObject, encode, parse, service_response, with_id
from endpoint.rosbridge.packing import Frame
from endpoint.rosbridge.session import CANCEL_ALL, Bridge
from rtask.errors import UsageError

__all__ = ["Upstream"]

_HERE = frozenset(("search_object", "set_level", "auth"))
_WAITING = 8
_LEAVE_S = 5.0
_LARGE = 64 << 10


class Upstream:
    """Passes the messages of one robot on; connects when the first one is to be passed.

    Parameters
    ----------
    following
        The writer.
    bridge
        Its services and actions that do not write are answered here.
    request
        The robot's handshake, whose token is shown to the writer, too.
    deliver
        Sends a frame to the robot, and waits while it has too many to read.
    end
        Closes the robot's connection: what it had subscribed to and advertised is lost.
    """

    def __init__(
        self,
        following: Following,
        bridge: Bridge,
        request: Request,
        deliver: Callable[[Frame], Awaitable[None]],
        end: Callable[[int, str], Awaitable[None]],
    ) -> None:
        self._following = following
        self._bridge = bridge
        token = request.headers.get("authorization")
        self._headers = {} if token is None else {"Authorization": token}
        self._deliver = deliver
        self._end = end
        self._frames: asyncio.Queue[Frame] = asyncio.Queue(_WAITING)
        self._task: asyncio.Task[None] | None = None
        self._has_ended = False
        self._may_have_written = False

    async def take(self, frame: Frame) -> bool:
        """Pass a frame on; tell whether it was one for the writer.

        One that is to be answered here waits until the robot's own writes have arrived here.
        """
        if isinstance(frame, str) and len(frame) > _LARGE:
            is_here = await asyncio.to_thread(self._is_for_here, frame)
        else:
            is_here = self._is_for_here(frame)
        if is_here:
            if self._may_have_written:
                self._may_have_written = False
                await asyncio.to_thread(self._following.catch_up)
            return False
        if self._following.records_waiting:
            await asyncio.to_thread(self._following.deliver_records)
        await self._frames.put(frame)
        if self._has_ended:
            self._drop()
        elif self._task is None or self._task.done():  # also if it ended while there was no room
            self._task = asyncio.create_task(self._run())
        return True

    def _is_for_here(self, frame: Frame) -> bool:
        if not isinstance(frame, str):
            return False
        try:
            message = parse(frame)
        except UsageError:
            return True  # the session says what is wrong with it
        op = message.get("op")
        if op in ("send_action_goal", "cancel_action_goal"):
            return self._bridge.actions.is_at_copy(str(message.get("action")))
        if op != "call_service":
            return not isinstance(op, str) or op in _HERE
        name = str(message.get("service"))
        if name.endswith(CANCEL_ALL):
            return self._bridge.actions.is_at_copy(name.removesuffix(CANCEL_ALL))
        return self._bridge.services.is_at_copy(name)

    async def _run(self) -> None:
        """Connect, and pass frames both ways until one side leaves."""
        url = self._following.url.replace("http", "ws", 1) + "/"
        try:
            socket = await connect(
                url,
                additional_headers=self._headers,
                max_size=None,  # the writer limits what it sends
                compression=None,
                open_timeout=5.0,
            )
        except InvalidStatus as error:
            status = error.response.status_code
            reason = f"writes go to {self._following.url}, which answered {status}"
            if status in (401, 403):
                reason += "; connect with Authorization: Bearer <token>, which is shown to it, too"
            await self._refuse(status, reason)
            return
        except (OSError, WebSocketException) as error:  # a timeout is an OSError
            reason = str(error) or type(error).__name__
            await self._refuse(
                503, f"writes go to {self._following.url}, which does not answer: {reason}"
            )
            return
        sending = asyncio.create_task(self._send(socket))
        try:
            with contextlib.suppress(WebSocketException):
                async for frame in socket:
                    self._may_have_written = True
                    await self._deliver(frame)
        finally:
            self._has_ended = True
            sending.cancel()
            self._drop()
            await socket.close()
        await self._end(SERVICE_RESTART, f"{self._following.url} closed the connection")

    async def _send(self, socket: ClientConnection) -> None:
        with contextlib.suppress(WebSocketException):
            while True:
                frame = await self._frames.get()
                try:
                    await socket.send(frame)
                finally:
                    self._frames.task_done()

    async def _refuse(self, status: int, reason: str) -> None:
        """Answer the frames that wait; the next one tries again to connect."""
        while not self._frames.empty():
            frame = self._frames.get_nowait()
            await self._deliver(encode(_refusal(frame, status, reason)))
            self._frames.task_done()

    def _drop(self) -> None:
        while not self._frames.empty():
            self._frames.get_nowait()
            self._frames.task_done()

    async def close(self) -> None:
        """Leave the writer, once it has what the robot sent before it left."""
        if self._task is None:
            return
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._frames.join(), _LEAVE_S)
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task


def _refusal(frame: Frame, status: int, reason: str) -> JsonObject:
    message = parse(frame) if isinstance(frame, str) else {}
    if message.get("op") == "call_service":
        return service_response(message, False, reason, status)
    return with_id({"op": "status", "level": "error", "msg": reason}, message)
