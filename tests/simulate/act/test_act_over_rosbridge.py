"""A robot announces its act service at a real server, and an unmodified client calls it."""

from __future__ import annotations

import threading
import time

import pytest
import roslibpy

from rtask.errors import RemoteUnavailableError
from simulate.act.arm_goals import ACTION_TYPE
from simulate.act.provider import ActProvider
from simulate.act.service import ActService
from simulate.grasping.executor import Workcell
from simulate.robots import describe
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
    client.run(timeout=60)
    deadline = time.monotonic() + 60
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


ACTION = "/panda-1/panda_arm_controller/follow_joint_trajectory"
ARM = describe("panda").arm("panda_arm")


class Asked:
    """A goal that an unmodified client sent, with everything that came back."""

    def __init__(self, ros, positions, seconds, names=ARM.joints):
        self.feedback, self._ended, self._came = [], threading.Event(), None
        point = {"positions": list(positions), "time_from_start": {"sec": seconds, "nanosec": 0}}
        trajectory = {"joint_names": list(names), "points": [point]}
        self.client = roslibpy.ActionClient(ros, ACTION, ACTION_TYPE)
        self.id = self.client.send_goal(
            roslibpy.Goal({"trajectory": trajectory}), self._take, self.feedback.append, self._take
        )

    def _take(self, came):
        self._came = came
        self._ended.set()

    def result(self):
        assert self._ended.wait(60)
        return self._came["status"].value, self._came["values"]


def turned(offset):
    return [*ARM.home[:-1], ARM.home[-1] + offset]


def joints_of(ros):
    came, heard = threading.Event(), []
    topic = roslibpy.Topic(ros, "/panda-1/joint_states", "sensor_msgs/JointState")
    topic.subscribe(lambda state: (heard.append(state), came.set()))
    assert came.wait(60)
    topic.unsubscribe()
    return dict(zip(heard[0]["name"], heard[0]["position"], strict=True))


def test_an_arm_follows_a_trajectory_that_a_client_of_ros_2_sends(ros):
    asked = Asked(ros, turned(0.3)[::-1], 1, ARM.joints[::-1])
    status, result = asked.result()
    assert (status, result) == (4, {"error_code": 0, "error_string": ""})
    assert asked.feedback  # at most ten a second of the wall's time
    assert list(asked.feedback[0]["joint_names"]) == list(ARM.joints)
    assert abs(joints_of(ros)[ARM.joints[-1]] - turned(0.3)[-1]) < 0.05
    assert Asked(ros, ARM.home, 1).result()[0] == 4


def test_a_trajectory_that_cannot_be_followed_is_aborted_with_its_code(ros):
    status, result = Asked(ros, [0.0], 1, ["elbow"]).result()
    assert (status, result["error_code"]) == (6, -2)
    assert "joints elbow: expected panda_joint1" in result["error_string"]
    status, result = Asked(ros, turned(5.0), 1).result()
    assert (status, result["error_code"]) == (6, -5)
    assert "panda_joint7 ended" in result["error_string"]
    status, result = Asked(ros, turned(-2.0), 0).result()
    assert (status, result["error_code"]) == (6, -1)
    assert Asked(ros, ARM.home, 2).result()[0] == 4


def test_a_cancelled_goal_stops_the_arm_before_its_end(ros):
    asked = Asked(ros, turned(0.5), 600)
    deadline = time.monotonic() + 60
    while not asked.feedback:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    asked.client.cancel_goal(asked.id)
    assert asked.result()[0] == 5
    assert joints_of(ros)[ARM.joints[-1]] < turned(0.4)[-1]
    assert Asked(ros, ARM.home, 2).result()[0] == 4


def test_an_arm_that_stands_at_a_goal_of_the_act_service_follows_no_trajectory(ros):
    upright = {"x": 0, "y": 0, "z": 0, "w": 1}
    goal = {"position": {"x": 0.47, "y": 0.1, "z": 0.235}, "orientation": upright}
    assert call(ros, "act", action_type="reach", goal_pose=goal)["success"] == 1
    status, result = Asked(ros, ARM.home, 1).result()
    assert (status, result["error_code"]) == (6, -1)
    assert "act service has the arm" in result["error_string"]
    assert call(ros, "act", action_type="home")["success"] == 1
