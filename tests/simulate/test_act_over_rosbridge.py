"""A robot announces its act service at a real server, and an unmodified client calls it."""

from __future__ import annotations

import threading
import time

import pytest
import roslibpy

from rtask.errors import RemoteUnavailableError
from simulate.act.provider import ActProvider
from simulate.act.service import ActService
from simulate.grasping.executor import Workcell
from tests.servers import running_server

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with running_server(tmp_path_factory.mktemp("act") / "store") as running:
        yield running


@pytest.fixture(scope="module")
def robot(server):
    """A Panda in a thread of its own, which alone touches its physics."""
    ready, made = threading.Event(), []

    def live():
        with Workcell("panda", preset="fast") as cell:
            provider = ActProvider(ActService(cell, "panda-1"), server.url, "panda-1")
            made.append(provider)
            provider.serve(ready.set)

    thread = threading.Thread(target=live)
    thread.start()
    assert ready.wait(60)
    yield made[0]
    made[0].stop()
    thread.join(60)
    assert not thread.is_alive()


@pytest.fixture(scope="module")
def ros(server, robot):
    client = roslibpy.Ros(host="127.0.0.1", port=server.port)
    client.run(timeout=20)
    deadline = time.monotonic() + 30
    while "/panda-1/act" not in client.get_services():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    yield client
    client.close()


def call(ros, name, **args):
    service = roslibpy.Service(ros, f"/panda-1/{name}", "rtask/Act")
    return service.call(roslibpy.ServiceRequest(args), timeout=120)


def test_a_client_reaches_a_goal_by_the_names_of_the_thesis(ros):
    goal = {
        "position": {"x": 0.47, "y": 0.1, "z": 0.235},
        "orientation": {"x": 0, "y": 0, "z": 0, "w": 1},
    }
    answer = call(
        ros, "act", robot_name="panda-1", action_type="reach", arm_name="auto",
        plan_name="rrt_connect", end_eff_name="panda_hand", attempts_max_in=3,
        planing_time_in=5.0, tolerance_min_in=0.002, angle_resolution_in=0.2,
        grasp_depth_in=0.0, distance_error_allowed=0.01, goal_pose=goal,
    )  # fmt: skip
    assert answer["success"] == 1
    assert (answer["reason"], answer["arm"]) == ("ok", "panda_arm")
    assert call(ros, "act", action_type="home")["success"] == 1


def test_a_wrong_name_comes_back_as_the_failure_it_is(ros):
    with pytest.raises(roslibpy.core.ServiceException, match="did you mean 'action_type'"):
        call(ros, "act", action_tipe="reach")


@pytest.mark.parametrize(
    ("x", "z", "reason"),
    [(2.0, 0.235, "ik"), (0.47, 0.15, "grasp_collision"), (0.05, 0.235, "ik")],
)
def test_a_goal_nobody_can_reach_has_its_reason_and_moves_nothing(ros, x, z, reason):
    goal = {"position": {"x": x, "y": 0.1, "z": z}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    answer = call(ros, "act", action_type="grasp", attempts_max_in=2, goal_pose=goal)
    assert (answer["success"], answer["held"], answer["reason"]) == (0, False, reason)
    assert answer["distance_error_m"] is None


def test_a_goal_that_is_no_number_is_refused(ros):
    goal = {"position": {"x": "far", "y": 0.1, "z": 0.2}, "orientation": {"w": 1}}
    with pytest.raises(roslibpy.core.ServiceException, match="position"):
        call(ros, "act", action_type="reach", goal_pose=goal)


def test_the_test_interface_is_there_as_services(ros):
    tested = call(ros, "act/reach_test", n=1, seed=2)
    assert (tested["n"], tested["reached"], tested["reasons"]) == (1, 1, {"ok": 1})
    found = call(ros, "act/workspace", step=0.2, angles=1)
    assert len(found["share"][0][0]) == len(found["x"])


def test_no_server_is_said_at_once():
    with Workcell("panda", preset="fast") as cell:
        provider = ActProvider(ActService(cell), "http://127.0.0.1:9", "panda-1")
        with pytest.raises(RemoteUnavailableError, match="cannot be reached"):
            provider.serve()
