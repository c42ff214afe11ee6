"""Which messages of a robot a follower answers itself, and what it waits for before."""

from __future__ import annotations

import asyncio
import json
from typing import Any, ClassVar

from websockets.asyncio.server import ServerConnection, serve

from endpoint.http.messages import Request
from endpoint.rosbridge.upstream import Upstream


class _Operation:
    def __init__(self, scope: str) -> None:
        self.scope = scope


class _Engine:
    operations: ClassVar = {
        "recall_grasps": _Operation("read"),
        "teach_object": _Operation("read"),  # writes, if its request says so
        "insert_object": _Operation("write"),
    }


class _Following:
    """Stands for the connection to a writer; notes when a read waits for it."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.waits = 0

    def catch_up(self) -> None:
        self.waits += 1


def _call(service: str) -> str:
    return json.dumps({"op": "call_service", "service": service, "id": "1"})


def test_reads_stay_here_and_wait_for_ones_own_writes() -> None:
    async def answer(socket: ServerConnection) -> None:
        async for frame in socket:
            await socket.send(frame)  # shows what has arrived

    async def run() -> None:
        async with serve(answer, "127.0.0.1", 0) as server:
            port = next(iter(server.sockets)).getsockname()[1]
            following = _Following(f"http://127.0.0.1:{port}")
            came: asyncio.Queue[Any] = asyncio.Queue()

            async def end(code: int, reason: str) -> None:
                raise AssertionError((code, reason))

            upstream = Upstream(
                following,  # type: ignore[arg-type]
                _Engine(),  # type: ignore[arg-type]
                Request("GET", "/", "", {}, b"", "", ""),
                came.put_nowait,
                end,
                1 << 20,
            )
            for here in (_call("/rtask/recall_grasps"), '{"op": "search_object"}', "not JSON"):
                assert not await upstream.take(here)
            assert following.waits == 0
            for name in ("insert_object", "teach_object"):
                assert await upstream.take(_call(f"rtask/{name}"))
                assert await asyncio.wait_for(came.get(), 60) == _call(f"rtask/{name}")
            assert await upstream.take(b"binary")
            assert await asyncio.wait_for(came.get(), 60) == b"binary"
            assert not await upstream.take(_call("rtask/recall_grasps"))
            assert not await upstream.take(_call("rtask/recall_grasps"))
            assert following.waits == 1  # nothing was written between the two
            await upstream.close()

    asyncio.run(run())
