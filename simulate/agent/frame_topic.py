"""Camera frames as a rosbridge topic on which only changed frames are sent.

The topic is latched: the server keeps the last frame, so that late subscribers receive the scene at
once, however long nothing has changed (Gatto 2016, 3.2.1).
"""

from __future__ import annotations

import contextlib
import json
import logging
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any

from features.codec import decode, encode_frame, from_wire, to_wire
from features.geometry import Frame
from features.scene_change import SceneChange, SceneChangeGate, SceneChangeParams
from rtask.client.calling.messages import addresses
from rtask.errors import DataError, RemoteUnavailableError

__all__ = ["FrameKeeper", "FramePublisher"]

log = logging.getLogger(__name__)

_TYPE = "rtask/Frame"
_OPEN_S = 10.0


class FramePublisher:
    """Publisher of a robot's frames; sends one when the scene has changed.

    Parameters
    ----------
    url
        The server.
    name
        Name of the robot; its frames go to ``/NAME/frame``.
    token
        Token of the robot, unless the server runs without tokens.
    params
        What counts as a change.
    """

    def __init__(
        self,
        url: str,
        name: str,
        token: str | None = None,
        params: SceneChangeParams | None = None,
    ) -> None:
        _, self._address = addresses(url)
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._gate = SceneChangeGate(params)
        self._socket: Any = None
        self._opened = contextlib.ExitStack()
        self._missed = False
        self.topic = f"/{name}/frame"
        self.offered = self.sent = 0

    def __enter__(self) -> FramePublisher:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def offer(self, frame: Frame) -> SceneChange:
        """Send a frame if it shows a change; return the reason for either.

        Raises
        ------
        RemoteUnavailableError
            It could not be sent; the next frame will be sent in any case.
        """
        self.offered += 1
        change = self._gate.offer(frame, time.monotonic(), force=self._missed)
        if change.send:
            data = encode_frame(frame)
            self._missed = True
            self._publish({"data": to_wire(data), "reason": change.reason, "number": self.offered})
            self._missed = False
            self.sent += 1
        return change

    def watch(self, frame: Frame) -> None:
        """Offer a frame, but only log a failure to send it."""
        try:
            self.offer(frame)
        except RemoteUnavailableError as error:
            log.warning("%s: frame not sent: %s", self.topic, error)

    def close(self) -> None:
        """Close the connection; the server forgets the topic."""
        self._socket = None
        self._opened.close()

    def _publish(self, message: dict[str, Any]) -> None:
        from websockets.exceptions import ConnectionClosed, InvalidHandshake
        from websockets.sync.client import connect

        try:
            if self._socket is None:
                context = connect(
                    self._address,
                    additional_headers=self._headers,
                    compression=None,  # frames are compressed already
                    open_timeout=_OPEN_S,
                    close_timeout=1.0,
                    proxy=None,
                )
                self._socket = self._opened.enter_context(context)
                self._send(op="advertise", type=_TYPE, latch=True)
            self._send(op="publish", msg=message)
        except (OSError, InvalidHandshake, ConnectionClosed) as error:
            self.close()
            raise RemoteUnavailableError(f"{self._address} cannot be reached: {error}") from error

    def _send(self, **operation: Any) -> None:
        self._socket.send(json.dumps({"topic": self.topic, **operation}))


class FrameKeeper:
    """Subscriber that keeps the latest frame of a robot.

    Attributes
    ----------
    frame
        None before the first message.
    received
        Messages taken.
    """

    def __init__(self) -> None:
        self.frame: Frame | None = None
        self.received = 0

    def take(self, message: Mapping[str, Any]) -> Frame:
        """Read a message of the topic; keep the previous frame if it is malformed.

        Raises
        ------
        CloudFormatError, DataError
            It holds no frame.
        """
        data = message.get("data")
        if not isinstance(data, str):
            raise DataError("data: expected a frame in base64, as FramePublisher sends it")
        decoded = decode(from_wire(data))
        if not isinstance(decoded, Frame):
            raise DataError("data: expected a frame, got a cloud without pixels")
        self.frame = decoded
        self.received += 1
        return decoded
