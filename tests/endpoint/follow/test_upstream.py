"""Messages of a robot that a follower answers itself, and what it waits for before."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from typing import Any

import pytest
from websockets.asyncio.server import ServerConnection, serve

from endpoint.http.messages import Request
from endpoint.rosbridge.session import Bridge
from endpoint.rosbridge.upstream import Upstream
from rtask.engine import Engine
from rtask.services.offered import open_host
from tests.sparql_servers import free_port


@pytest.fixture(scope="module", autouse=True)
def bridge() -> Iterator[None]:
    """Services and actions of a follower, by their declarations alone."""
    global _bridge
    with open_host() as host:
        _bridge = Bridge(Engine, host=host)  # type: ignore[arg-type]
        yield
        _bridge.close()


_bridge: Bridge


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


def _goal(action: str) -> str:
    return json.dumps({"op": "send_action_goal", "action": action, "id": "1"})


def _upstream(following: _Following, deliver: Any, end: Any) -> Upstream:
    return Upstream(
        following,  # type: ignore[arg-type]
        _bridge,
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
                _call("/rtask/recall_grasps"), _call("/rtask/recognise_for_grasp"),
                _call("/services/example/Grasping/plan"), _goal("/rtask/plan_grasps"),
                _goal("/services/example/Grasping/plan"), '{"op": "search_object"}', "not JSON",
                '{"op": []}', '{"op": "cancel_action_goal", "action": "rtask/plan_grasps"}',
                _call("rtask/plan_grasps/_action/cancel_goal"),
            ):  # fmt: skip
                assert not await upstream.take(here), here
            assert following.waits == 0
            for name in ("insert_object", "teach_object"):
                assert await upstream.take(_call(f"rtask/{name}"))
                assert await asyncio.wait_for(came.get(), 60) == _call(f"rtask/{name}")
            for there in (
                _goal("/services/rtask/Pipeline/run"), _goal("/fold_towel"),
                _call("/services/example/Kinematics/describe"), _call("/rosapi/topics"),
                _call("fold_towel/_action/cancel_goal"), '{"op": "subscribe", "topic": "/a"}',
            ):  # fmt: skip
                assert await upstream.take(there)
                assert await asyncio.wait_for(came.get(), 60) == there
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
