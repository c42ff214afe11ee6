"""The contract of drivers, each case for each driver: states, endings, other programs, lost links.

Drivers are rosbridge before ROS 2 and before ROS 1, rospy with a real master, rclpy (a stand-in)
and NAOqi (its own protocol). What a protocol cannot say is no cell of it: joints of NAOqi are asked
for by name and carry no time.
"""

from __future__ import annotations

import re

import pytest

from tests.processes import EVER_LONGER_S, wait_until
from tests.rtask.interop.ros.conftest import roscore  # noqa: F401  (a fixture)
from tests.simulate.drivers.benches import (
    BRIDGES,
    DRIVERS,
    GOAL,
    NAOQI,
    ROS1,
    ROS2,
)

pytestmark = pytest.mark.slow

_ALL, _TIMED = frozenset(DRIVERS), frozenset(DRIVERS) - {NAOQI}
STATES = {
    "old": (_TIMED, r"\d s old; restart the driver .* clocks"),
    "ahead": (_TIMED, "ahead of this machine"),
    "without time": (_TIMED, r"carry no time.*have the driver fill header\.stamp"),
    "frozen": (_ALL, "time stands still|sensors of .* stand still"),
    "moving": (_TIMED, "elbow is moving; stop what moves the arm"),
    "unannounced motion": (_ALL, "is moving; stop what moves the arm"),
    "NaN": (_ALL, "is not a finite number; check its encoder"),
    "degrees": (_ALL, "looks like degrees; .* radians"),
    "outside": (_ALL, "outside its limits .*; move the arm back"),
    "an old copy between": (_TIMED, r"\d s old; restart the driver"),
    "another publisher between": (_TIMED, "two programs publish states of these joints"),
    "a twin ahead of it between": (_TIMED, "two programs publish states of these joints"),
    "renamed": (_TIMED, "no state of shoulder, elbow came"),
    "time goes back": (_TIMED, "time stands still, or goes back"),
    "in another order": (_TIMED, "another order of the joints: check that the driver's names"),
    "incomplete": (_TIMED, "the joint states lack elbow; start the broadcaster"),
    "twice the same joint": (_TIMED, "names 1 joints and has 2 positions"),
    "uneven": (_ALL, "names 2 joints and has 1 positions|expected 5 numbers"),
}
"""Drivers that can be told so, and what is said."""
ENDS = {
    "canceled by another program": (_ALL, "canceled|preempted|from its goal"),
    "aborted": (_TIMED, r"aborted \(status (4 of ROS 1|6 of ROS 2)"),
    "rejected": (_ALL, "rejected|unknown|refused"),
    "an unknown status": (_TIMED, "unknown.* 42"),
    "success of the other version": (_TIMED, "aborted|unknown"),
    "an error code": (_TIMED, "PATH_TOLERANCE_VIOLATED"),
    "success, but it stayed": (_ALL, r"ended 0\.\d+ rad from its goal, although"),
    "success, but it stopped short": (_TIMED, r"ended 0\.06 rad"),
    "the end of another's goal": (_TIMED - {ROS2}, "did not end within"),
    "feedback and no end": (frozenset(BRIDGES), "did not end within"),
    "no end": (_ALL, "did not end within|angleInterpolation"),
    "no end, and states that stop": (_TIMED, "no new joint state came"),
    "no end, and joints get other names": (_TIMED, "no new joint state came"),
    "success of a twin on the topic": (_TIMED, "two programs publish states of these joints"),
    "failure, then success": (frozenset(BRIDGES), "aborted"),
    "a status in words": (frozenset(BRIDGES), "unknown.* SUCCEEDED"),
    "a status that is true": (frozenset(BRIDGES), "unknown.* True"),
    "an error code in words": (frozenset(BRIDGES), "GOAL_TOLERANCE_VIOLATED"),
    "success, but it fell limp": (frozenset({NAOQI}), r"ended \d\.\d+ rad from its goal"),
}
LATER = {
    "success, but it goes on": (_ALL, "is moving; stop what moves the arm"),
    "success, and the time jumps back": (_TIMED, r"\d s old; restart the driver"),
}


def cells(rows):
    return [
        pytest.param(driver, row, words, id=f"{row}-{driver}")
        for row, (drivers, words) in rows.items()
        for driver in DRIVERS
        if driver in drivers
    ]


@pytest.mark.parametrize(("driver", "state", "words"), cells(STATES))
def test_a_state_that_cannot_be_trusted_starts_nothing(benches, driver, state, words):
    bench = benches(driver)
    # A state that will do is waited for in vain; a busy machine shows none at all within a moment.
    for wait_s in EVER_LONGER_S:
        bench.arrange(state=state, state_s=wait_s)
        complaint = bench.follow()
        assert complaint
        assert bench.goals() == []
        if re.search(words, complaint):
            return
    pytest.fail(complaint)


@pytest.mark.parametrize(("driver", "end", "words"), cells(ENDS))
def test_every_end_but_a_measured_arrival_fails_and_cancels_only_the_own_goal(
    benches, driver, end, words
):
    bench = benches(driver)
    bench.arrange(end=end)
    said = bench.follow()
    assert re.search(words, said), said
    if driver == NAOQI:
        is_begun, is_cancelled = end != "rejected", end == "no end"
    else:
        is_begun, is_cancelled = True, (driver, end) != (ROS2, "rejected")
    wait_until(lambda: len(bench.goals()) == is_begun)
    wait_until(lambda: bool(bench.cancelled()) == is_cancelled)
    assert set(bench.cancelled()) <= set(bench.goals())


@pytest.mark.parametrize(("driver", "end", "words"), cells(LATER))
def test_success_is_no_arrival_before_the_arm_is_seen_to_rest_at_its_goal(
    benches, driver, end, words
):
    bench = benches(driver)
    for wait_s in EVER_LONGER_S:
        bench.arrange(end=end, state_s=wait_s)
        said = bench.follow()
        if bench.goals() and re.search(words, said):
            return
    pytest.fail(said)


@pytest.mark.parametrize("driver", DRIVERS)
def test_an_arm_that_goes_on_when_it_is_cancelled_is_said_to(benches, driver):
    bench = benches(driver)
    bench.arrange(end="no end, and it goes on when cancelled")
    assert bench.follow()
    wait_until(lambda: bench.cancelled())
    assert "nobody can tell whether the arm" in bench.said()[-1]


@pytest.mark.parametrize("driver", DRIVERS)
def test_an_arm_that_arrives_has_succeeded_and_each_goal_has_an_id_of_its_own(benches, driver):
    bench = benches(driver)
    bench.arrange()
    assert bench.follow(pieces=3) == ""
    assert len(set(bench.goals())) == 3
    assert bench.cancelled() == []
    [said] = bench.said()
    assert "the arm stops within" in said


@pytest.mark.parametrize("driver", [driver for driver in DRIVERS if driver in _TIMED])
def test_joints_that_change_their_order_are_read_by_their_names(benches, driver):
    bench = benches(driver)
    bench.arrange(state="in changing order")
    assert bench.follow() == ""


@pytest.mark.parametrize("driver", BRIDGES)
def test_a_goal_that_ends_twice_does_not_end_the_next_one(benches, driver):
    bench = benches(driver)
    bench.arrange(end="success twice", is_timed=True)
    assert bench.follow(pieces=3) == ""
    assert len(set(bench.goals())) == 3
    assert bench.cancelled() == []


@pytest.mark.parametrize("driver", DRIVERS)
def test_success_that_is_told_before_the_arm_is_there_counts_once_it_is(benches, driver):
    bench = benches(driver)
    bench.arrange(end="success at once", is_timed=True)
    assert bench.follow() == ""
    assert not bench.report()["moves"]
    if driver != NAOQI:
        assert bench.report()["at"] == pytest.approx(GOAL, abs=0.05)


@pytest.mark.parametrize("driver", BRIDGES)
def test_a_topic_whose_name_comes_back_without_its_slash_is_heard(benches, driver):
    bench = benches(driver)
    bench.arrange(state="a topic without slash")
    assert bench.follow() == ""


def test_a_nao_whose_list_of_tasks_is_none_is_moved_all_the_same(benches):
    bench = benches(NAOQI)
    bench.arrange(end="no list of tasks")
    assert bench.follow() == ""


def test_of_two_motions_that_begin_at_once_on_a_nao_none_is_killed_by_a_guessed_number(benches):
    bench = benches(NAOQI)
    bench.arrange(end="another begins as well")
    assert bench.follow()
    assert bench.cancelled() == []
    assert "killed all" in bench.motion.told()  # all that use these joints: the arm has to stop


@pytest.mark.parametrize("driver", DRIVERS)
def test_the_motion_of_another_program_is_not_cancelled(benches, driver):
    bench = benches(driver)
    bench.arrange(end="no end")
    theirs = bench.begin_another()
    assert bench.follow()
    wait_until(lambda: bench.cancelled())
    assert theirs not in bench.cancelled()
    bench.end_another()


@pytest.mark.parametrize("driver", [*BRIDGES, ROS1, NAOQI])
def test_a_killed_program_leaves_an_arm_that_stops_within_the_horizon(benches, driver):
    bench = benches(driver)
    bench.arrange(is_timed=True)
    program = bench.start_program()
    wait_until(lambda: bench.report()["goals"] >= 2 and bench.report()["moves"])
    program.kill()
    program.wait()
    assert_stops(bench)


@pytest.mark.parametrize("driver", [*BRIDGES, ROS2])
def test_a_lost_link_leaves_an_arm_that_stops_within_the_horizon(benches, driver):
    bench = benches(driver)
    bench.arrange(is_timed=True)
    error = bench.follow_until_cut()
    assert re.search("connection was lost|no (new joint )?state .*came", error), error
    assert "nobody can tell whether the arm" in bench.said()[-1]
    assert_stops(bench)


def assert_stops(bench):
    """Check in the robot's own time that no piece goes on for longer than the horizon."""
    cut = bench.report()["clock"]
    wait_until(lambda: bench.report()["clock"] > cut + 3.0)
    after = bench.report()
    assert not after["moves"]
    assert after["last_moved"] - cut <= bench.horizon_s + bench.step_s
    assert abs(after["at"][bench.joint] - bench.far) > 0.2  # it was far from its goal
