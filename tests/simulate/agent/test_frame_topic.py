"""Frames over a real server: only those that show a change, and the last one for latecomers."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from websockets.sync.client import connect

from features.codec import encode_cloud, to_wire
from features.geometry import Frame, Intrinsics
from features.scene_change import SceneChangeParams
from rtask.errors import DataError, RemoteUnavailableError
from simulate.agent.frame_topic import FrameKeeper, FramePublisher
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

CAMERA = Intrinsics.from_fov(160, 120, 1.2)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    with running_server(tmp_path_factory.mktemp("frames") / "store") as running:
        yield running


def _table(box: int | None = None, noise: int = 0) -> Frame:
    depth = np.full((120, 160), 0.8, np.float32)
    if box is not None:
        depth[40:100, box : box + 60] = 0.7
    depth += np.random.default_rng(noise).normal(0, 0.001, depth.shape).astype(np.float32)
    return Frame(np.round(depth, 4), CAMERA, np.full((120, 160, 3), 90, np.uint8))


def _subscribe(server: RunningServer, topic: str, keeper: FrameKeeper, until: int) -> None:
    """Take messages of a topic until so many came; 30 s at most."""
    with connect(f"ws://127.0.0.1:{server.port}/rosbridge", proxy=None) as socket:
        socket.send(json.dumps({"op": "subscribe", "topic": topic}))
        while keeper.received < until:
            message = json.loads(socket.recv(timeout=60))
            if message["op"] == "publish":
                keeper.take(message["msg"])


def test_a_still_scene_is_sent_once_and_who_comes_late_sees_the_last_one(
    server: RunningServer,
) -> None:
    patient = SceneChangeParams(max_age_s=3600)  # however slow the machine is
    with FramePublisher(server.url, "nao-9", params=patient) as robot:
        reasons = [robot.offer(_table(noise=k)).reason for k in range(8)]
        early = FrameKeeper()
        listener = threading.Thread(target=_subscribe, args=(server, robot.topic, early, 2))
        listener.start()
        while early.received < 1:  # the first one is kept for it
            assert listener.is_alive()
            time.sleep(0.01)
        reasons += [robot.offer(_table(30, noise=k)).reason for k in range(8, 12)]
        assert reasons == ["first", *["unchanged"] * 7, "depth", *["unchanged"] * 3]
        assert (robot.offered, robot.sent) == (12, 2)
        listener.join(60)
        assert early.received == 2  # so the server has it, before somebody else subscribes
        late = FrameKeeper()
        _subscribe(server, robot.topic, late, 1)
    assert late.frame is not None
    np.testing.assert_allclose(late.frame.depth_m, _table(30, noise=8).depth_m, atol=1e-6)
    assert late.frame.intrinsics == CAMERA


def test_what_could_not_be_sent_is_made_up_for_and_does_not_stop_the_robot(
    server: RunningServer,
) -> None:
    robot = FramePublisher("http://127.0.0.1:9", "nao-9")  # nobody listens there
    with pytest.raises(RemoteUnavailableError):
        robot.offer(_table())
    robot.watch(_table())
    assert (robot.offered, robot.sent) == (2, 0)
    robot._address = FramePublisher(server.url, "nao-9")._address
    assert robot.offer(_table()).reason == "forced"
    assert robot.sent == 1
    robot.close()


def test_messages_that_hold_no_frame_leave_the_last_one(server: RunningServer) -> None:
    keeper = FrameKeeper()
    cloud = to_wire(encode_cloud(np.zeros((3, 3))))
    for message in ({}, {"data": 7}, {"data": cloud}):
        with pytest.raises(DataError, match="expected a frame"):
            keeper.take(message)
    assert keeper.frame is None
    assert keeper.received == 0
