"""A motion planned here and carried out by an arm behind a rosbridge server."""

from __future__ import annotations

import json
import threading

import numpy as np
import pytest
from click.testing import CliRunner

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.act.provider import ActProvider
from simulate.act.service import ActService
from simulate.drivers.rosbridge import RosbridgeArm
from simulate.grasping.executor import Workcell
from simulate.motion.trajectory import time_path
from simulate.onboarding.commands import robot as main
from simulate.robots import describe
from tests.servers import running_server

pytestmark = pytest.mark.slow

ARM = describe("panda").arm("panda_arm")
ACTION = "/cell/panda_arm_controller/follow_joint_trajectory"


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """A server before a Panda, in a thread of its own."""
    ready, made = threading.Event(), []
    with running_server(tmp_path_factory.mktemp("arm") / "store") as server:

        def live():
            with Workcell("panda", preset="fast") as cell:
                made.append(ActProvider(ActService(cell, "cell"), server.url, "cell"))
                made[0].serve(ready.set)

        thread = threading.Thread(target=live)
        thread.start()
        assert ready.wait(60)
        yield f"ws://127.0.0.1:{server.port}/rosbridge"
        made[0].stop()
        thread.join(60)


@pytest.fixture
def arm(address):
    """Return a driver of the arm, which is at home, wherever other tests left it."""
    with RosbridgeArm(address, ACTION, ARM.joints, "/cell/joint_states") as driver:
        here, home = driver.measured(), np.array(ARM.home)
        if np.abs(here - home).max() > 0.02:
            driver.follow(time_path(np.stack([here, home]), np.full(7, 0.8)))
        yield driver


def way(offset, start=0.0):
    home = np.array(ARM.home)
    home[-1] += start
    return time_path(np.stack([home, home + [0, 0, 0, 0, 0, 0, offset]]), np.full(7, 0.8))  # noqa: RUF005


def test_the_arm_tells_its_joints_and_follows(arm):
    np.testing.assert_allclose(arm.measured(), ARM.home, atol=0.02)
    arm.follow(way(0.3))
    np.testing.assert_allclose(arm.measured(), way(0.3).positions[-1], atol=0.02)
    with pytest.raises(RobotError, match=r"panda_joint7 is 0\.3\d rad from the start"):
        arm.follow(way(0.3))
    arm.follow(way(-0.3, 0.3))


def test_what_the_driver_says_of_a_failure_is_told(arm, address):
    with pytest.raises(
        RobotError, match=r"ended with -5 \(GOAL_TOLERANCE_VIOLATED\): panda_joint7 ended"
    ):
        arm.follow(way(4.0))
    with RosbridgeArm(address, ACTION, ARM.joints[:2], "/cell/joint_states") as two:
        short = time_path(np.array([two.measured(), two.measured() + 0.1]), np.full(2, 0.5))
        with pytest.raises(
            RobotError, match=r"ended with -2 \(INVALID_JOINTS\): joints panda_joint1"
        ):
            two.follow(short)


def test_a_topic_without_these_joints_is_said(address, monkeypatch):
    monkeypatch.setattr("simulate.drivers.rosbridge._STATE_S", 0.3)
    with (
        RosbridgeArm(address, ACTION, ("elbow",), "/cell/joint_states") as other,
        pytest.raises(RemoteUnavailableError, match="no state of elbow came within"),
    ):
        other.measured()


def test_no_server_is_said_at_once():
    with pytest.raises(RemoteUnavailableError, match="cannot be reached"):
        RosbridgeArm("ws://127.0.0.1:9", ACTION, ARM.joints, "/joint_states")


def test_the_command_brings_the_arm_home_reaches_and_returns(address):
    words = ["reach", "0.47", "0.1", "0.235", "--robot", "panda", "--rosbridge", address]
    names = ["--action", ACTION, "--joints", "/cell/joint_states"]
    done = CliRunner().invoke(main, [*words, *names, "--home", "--back", "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert (told["arm"], told["is_home"], told["held"]) == ("panda_arm", True, None)
