"""Messages of a robot that a follower answers itself, and what it waits for before."""

from __future__ import annotations

import asyncio
import json
from typing import Any, ClassVar

from websockets.asyncio.server import ServerConnection, serve

from endpoint.http.messages import Request
from endpoint.rosbridge.upstream import Upstream
from tests.sparql_servers import free_port


class _Operation:
    def __init__(self, effect: str) -> None:
        self.effect = effect


class _Engine:
    operations: ClassVar = {
        "recall_grasps": _Operation("reads"),
        "recognise_for_grasp": _Operation("records"),
        "insert_object": _Operation("writes"),
    }


class _Following:
    """Stands for the connection to a writer; notes when a read waits for it."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.waits = 0
        self.records_waiting = 0

    def catch_up(self) -> None:
        self.waits += 1


def _call(service: str) -> str:
    return json.dumps({"op": "call_service", "service": service, "id": "1"})


def _upstream(following: _Following, deliver: Any, end: Any) -> Upstream:
    return Upstream(
        following,  # type: ignore[arg-type]
        _Engine(),  # type: ignore[arg-type]
        Request("GET", "/", "", {}, b"", "", ""),
        deliver,
        end,
    )


async def _never(code: int, reason: str) -> None:
    raise AssertionError((code, reason))


def test_reads_stay_here_and_wait_for_ones_own_writes() -> None:
    async def answer(socket: ServerConnection) -> None:
        async for frame in socket:
            await socket.send(frame)  # shows what has arrived

    async def run() -> None:
        async with serve(answer, "127.0.0.1", 0) as server:
            port = next(iter(server.sockets)).getsockname()[1]
            following = _Following(f"http://127.0.0.1:{port}")
            came: asyncio.Queue[Any] = asyncio.Queue()

            upstream = _upstream(following, came.put, _never)
            for here in (
                _call("/rtask/recall_grasps"), '{"op": "search_object"}', "not JSON", '{"op": []}',
            ):  # fmt: skip
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


def test_every_message_is_refused_while_the_writer_is_away() -> None:
    async def run() -> None:
        came: asyncio.Queue[Any] = asyncio.Queue()
        upstream = _upstream(_Following(f"http://127.0.0.1:{free_port()}"), came.put, _never)
        for _ in range(30):  # more than may wait for a connection
            assert await upstream.take(_call("rtask/insert_object"))
        for _ in range(30):
            answer = json.loads(await asyncio.wait_for(came.get(), 60))
            assert (answer["result"], answer["status"]) == (False, 503)
        await upstream.close()

    asyncio.run(run())


def test_what_a_robot_sends_just_before_it_leaves_arrives() -> None:
    async def run() -> None:
        arrived: list[Any] = []
        left = asyncio.Event()

        async def note(socket: ServerConnection) -> None:
            async for frame in socket:
                arrived.append(frame)
            left.set()

        async with serve(note, "127.0.0.1", 0) as server:
            port = next(iter(server.sockets)).getsockname()[1]
            came: asyncio.Queue[Any] = asyncio.Queue()
            upstream = _upstream(_Following(f"http://127.0.0.1:{port}"), came.put, _never)
            sent = [json.dumps({"op": "publish", "topic": "/a", "msg": {"n": n}}) for n in range(5)]
            for frame in sent:
                assert await upstream.take(frame)
            await upstream.close()
            await asyncio.wait_for(left.wait(), 60)
            assert arrived == sent

    asyncio.run(run())


def test_a_writer_that_leaves_holds_nobody_up() -> None:
    async def run() -> None:
        ended = asyncio.Event()

        async def leave(socket: ServerConnection) -> None:
            await socket.recv()

        async def end(code: int, reason: str) -> None:
            ended.set()

        async with serve(leave, "127.0.0.1", 0) as server:
            port = next(iter(server.sockets)).getsockname()[1]
            came: asyncio.Queue[Any] = asyncio.Queue()
            upstream = _upstream(_Following(f"http://127.0.0.1:{port}"), came.put, end)
            assert await upstream.take(_call("rtask/insert_object"))
            await asyncio.wait_for(ended.wait(), 60)
            for _ in range(30):  # more than would wait for a connection
                assert await asyncio.wait_for(upstream.take(_call("rtask/insert_object")), 60)
            await upstream.close()

    asyncio.run(run())
