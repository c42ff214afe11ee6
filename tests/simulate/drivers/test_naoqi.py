"""A NAO's arm, hand and cameras through NAOqi, on a stand-in that speaks its protocol."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.act.reach import plan_reach
from simulate.drivers import motions
from simulate.drivers.joint_states import JointLimits
from simulate.drivers.naoqi import NaoqiArm
from simulate.grasping.executor import Workcell
from simulate.motion.trajectory import time_path
from simulate.onboarding.commands import robot as main
from simulate.robots import describe
from tests.processes import wait_until
from tests.simulate.drivers.benches import be_patient, waits_restored

qi: Any = pytest.importorskip("qi")
pytestmark = pytest.mark.slow

ARM = describe("nao").arm("right")
HOME = dict(zip(ARM.joints, ARM.home, strict=True))
GOAL = (0.15, -0.10, 0.30)


@pytest.fixture(scope="module", autouse=True)
def _patient():
    with waits_restored():
        be_patient()
        yield


@pytest.fixture(scope="module")
def robot():
    """Address of a stand-in in a process of its own, as NAOqi is, and its services."""
    program = Path(__file__).with_name("naoqi_robot.py")
    with subprocess.Popen(
        [sys.executable, str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        address = next(line for line in child.stdout if line.startswith("ready ")).split()[1]
        session = qi.Session()
        session.connect(address)
        yield address, session
        session.close()
        child.stdin.close()


@pytest.fixture
def motion(robot):
    """The stand-in's ALMotion, with the right arm at home and nothing in its hand."""
    service = robot[1].service("ALMotion")
    service.put(HOME | {"RHand": 0.5})
    service.arrange(0.0, "", 20.0)
    return service


@pytest.fixture
def arm(robot, motion):
    with NaoqiArm(robot[0], ARM.joints, "RHand") as driver:
        yield driver


@pytest.fixture(scope="module")
def cell():
    with Workcell("nao", preset="fast") as made:
        yield made


def moved(offset):
    goal = np.array(ARM.home) + [offset, 0.0, 0.0, 0.0, 0.0]  # noqa: RUF005
    return time_path(np.stack([np.array(ARM.home), goal]), np.full(5, 0.5))


def test_the_arm_follows_a_trajectory_by_few_points_and_tells_where_it_is(arm, motion):
    way = moved(0.4)
    arm.follow(way)
    np.testing.assert_allclose(arm.measured(), way.positions[-1], atol=1e-6)
    points = int(motion.told()[-1].split()[-1])
    # One in 80 ms of a motion of about a second, where the trajectory has one in 10 ms.
    assert way.duration / 0.08 - 1 <= points <= way.duration / 0.08 + 1
    assert motion.getAngles(["LShoulderPitch"], True) == [0.0]


def test_an_arm_that_is_elsewhere_is_not_moved(arm, motion):
    motion.put({"RElbowRoll": 1.4})
    before = len(motion.told())
    with pytest.raises(RobotError, match="RElbowRoll is"):
        arm.follow(moved(0.4))
    assert len(motion.told()) == before


def test_an_arm_that_something_stops_is_said_not_to_have_arrived(arm, motion):
    motion.arrange(0.0, "RShoulderPitch", 20.0)
    with pytest.raises(RobotError, match=r"RShoulderPitch ended 0\.40 rad from its goal"):
        arm.follow(moved(0.4))


def test_a_motion_that_does_not_end_is_killed(arm, motion, monkeypatch):
    monkeypatch.setattr("simulate.drivers.naoqi._SPARE_S", -0.5)
    motion.arrange(0.0, "", 0.01)
    with pytest.raises(RemoteUnavailableError, match="angleInterpolation"):
        arm.follow(moved(0.4))
    assert motion.told()[-1].startswith("killed ")


def test_the_motion_of_another_program_goes_on_when_ours_is_killed(arm, robot, motion, monkeypatch):
    monkeypatch.setattr("simulate.drivers.naoqi._SPARE_S", -0.5)
    motion.arrange(0.0, "", 0.01)
    motion.setStiffnesses(["LElbowRoll"], 1.0)
    theirs = motion.angleInterpolation(["LElbowRoll"], [[-0.5]], [[1.0]], True, _async=True)
    wait_until(motion.getTaskList)
    (other,) = [number for _, number in motion.getTaskList()]
    with pytest.raises(RemoteUnavailableError):
        arm.follow(moved(0.4))
    assert theirs.isRunning()
    assert f"killed {other}" not in motion.told()
    assert "killed all" not in motion.told()
    motion.killTask(other)
    theirs.wait()


def test_a_lost_link_is_told_and_a_second_connection_stops_the_arm(robot, motion):
    motion.arrange(0.0, "", 0.01)
    session = robot[1]
    driver = NaoqiArm(robot[0], ARM.joints, "RHand")
    with ThreadPoolExecutor(1) as pool:
        going = pool.submit(driver.follow, moved(0.4))
        wait_until(motion.getTaskList)
        driver._session.close()  # as if the network were gone
        with pytest.raises(RemoteUnavailableError):
            going.result()
    wait_until(lambda: not session.service("ALMotion").getTaskList())
    assert motion.told()[-1].startswith("killed")
    robot[1].service("ALAutonomousLife").setState("solitary")


def test_an_arm_whose_sensors_stand_still_or_that_moves_is_not_moved(
    arm, robot, motion, monkeypatch
):
    monkeypatch.setattr("simulate.drivers.naoqi._STATE_S", 0.4)  # to rest, for which it never comes
    memory = robot[1].service("ALMemory")
    memory.freeze(True)
    before = len(motion.told())
    with pytest.raises(RobotError, match=r"sensors of .* stand still.*restart NAOqi"):
        arm.follow(moved(0.4))
    memory.freeze(False)
    motion.drift("RElbowRoll", 0.5)
    with pytest.raises(RobotError, match="RElbowRoll is moving"):
        arm.follow(moved(0.4))
    motion.drift("RElbowRoll", 0.0)
    assert len(motion.told()) == before


def test_what_a_lost_link_would_do_is_said_before_the_motion(robot, motion):
    said = []
    with NaoqiArm(robot[0], ARM.joints, "RHand", say=said.append) as driver:
        driver.follow(moved(0.4))
    assert len(said) == 1
    assert "if the link" in said[0]


def test_autonomous_life_rests_and_joints_are_stiff_only_while_the_arm_is_driven(robot, motion):
    life = robot[1].service("ALAutonomousLife")
    assert life.getState() == "solitary"
    with NaoqiArm(robot[0], ARM.joints, "RHand"):
        assert life.getState() == "disabled"
        assert motion.told()[-1] == "stiff 1"
    assert life.getState() == "solitary"
    assert motion.told()[-1] == "stiff 0"


def test_after_an_error_the_arm_stays_stiff_and_life_off(robot, motion):
    life = robot[1].service("ALAutonomousLife")
    motion.arrange(0.0, "RShoulderPitch", 20.0)
    with (
        pytest.raises(RobotError, match="ended"),
        NaoqiArm(robot[0], ARM.joints, "RHand") as driver,
    ):
        driver.follow(moved(0.4))
    assert life.getState() == "disabled"
    assert motion.told()[-1] != "stiff 0"
    life.setState("solitary")


def test_a_nao_whose_joints_are_in_degrees_is_not_moved(robot, motion):
    limits = JointLimits.of(describe("nao"), ARM.joints)
    motion.put({"RShoulderPitch": 80.0})
    before = len(motion.told())
    with NaoqiArm(robot[0], ARM.joints, "RHand", limits) as driver:
        with pytest.raises(RobotError, match="RShoulderPitch is 80"):
            driver.follow(moved(0.4))
        assert len(motion.told()) == before + 1  # the stiffness


def test_a_picture_of_the_camera_has_its_colours_in_place(arm, robot):
    picture = arm.picture(1)
    assert picture.shape == (480, 640, 3)
    assert picture[0, 0].tolist() == [255, 0, 0]
    assert picture[-1, -1].tolist() == [0, 0, 255]
    with pytest.raises(RemoteUnavailableError, match=r"camera 7 .* is not free"):
        arm.picture(7)
    assert robot[1].service("ALVideoDevice").subscribed() == []


def test_the_hand_tells_what_stops_it(arm, motion):
    motion.arrange(0.4, "", 20.0)
    arm.move_hand(0.0)
    assert arm.opening() == pytest.approx(0.4)


@pytest.mark.parametrize(("in_hand", "held"), [(0.4, "yes"), (0.0, "no")])
def test_the_robot_judges_by_its_hand_whether_it_held(arm, motion, cell, in_hand, held):
    motion.arrange(in_hand, "", 200.0)
    waited = []
    judged = motions.grasp(arm, plan_reach(cell, GOAL, 0.0, 0), cell, waited.append)
    assert judged.answer == held, judged.evidence
    assert waited == ([2.0] if held == "yes" else [])
    np.testing.assert_allclose(arm.measured(), ARM.home, atol=1e-6)


def test_an_arm_is_brought_home_along_a_planned_path(arm, motion, cell):
    motion.put({"RShoulderPitch": -0.6, "RElbowRoll": 0.3})
    motion.arrange(0.0, "", 200.0)
    assert motions.bring_home(arm, cell, "right_arm", 0) > 0.1
    np.testing.assert_allclose(arm.measured(), ARM.home, atol=1e-6)
    assert motions.bring_home(arm, cell, "right_arm", 0) == 0.0
    motion.put({"RShoulderPitch": 1.5, "RShoulderRoll": 0.0, "RElbowRoll": 0.1})  # in the table
    with pytest.raises(RobotError, match="no free path leads home"):
        motions.bring_home(arm, cell, "right_arm", 0)


def command(address, *arguments):
    words = ["reach", *arguments, "--naoqi", address, "--json", "--", *map(str, GOAL)]
    return CliRunner().invoke(main, words)


def test_the_command_grasps_with_the_robot(robot, motion):
    motion.arrange(0.4, "", 200.0)
    done = command(robot[0], "--grasp")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert (told["arm"], told["held"], told["is_home"]) == ("right_arm", True, True)
    motion.arrange(0.0, "", 200.0)
    assert command(robot[0], "--grasp").exit_code == 1


def test_a_robot_that_is_not_there_is_said_in_one_line():
    with pytest.raises(RemoteUnavailableError, match=r"tcp://127\.0\.0\.1:9, connecting: "):
        NaoqiArm("tcp://127.0.0.1:9", ARM.joints, "RHand")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "expected one of"),
        (["--naoqi", "tcp://h:1", "--rosbridge", "ws://h:1"], "expected one of"),
        (["--rosbridge", "ws://h:1", "--grasp"], "only --naoqi does"),
    ],
)
def test_a_command_without_one_driver_is_refused(arguments, words):
    done = CliRunner().invoke(main, ["reach", *arguments, "0.15", "0.1", "0.3"])
    assert words in str(done.exception)
