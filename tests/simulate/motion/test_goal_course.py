"""When a trajectory's goal starts, what it allows, and with which code it ends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rtask.errors import UsageError
from simulate.motion.goal_course import GOAL_TOLERANCE, PATH_TOLERANCE, GoalCourse, OldStampError
from simulate.motion.joint_messages import InvalidJointsError

JOINTS, REST = ("shoulder", "elbow"), np.zeros(2)
NOW_S = 1000.0


def goal(start_s=0.0, points=((1, (0.0, 1.0)), (2, (0.0, 2.0))), **fields):
    stamp = {"secs": int(start_s), "nsecs": round(start_s % 1 * 1e9)}
    return {
        "trajectory": {
            "header": {"stamp": stamp}, "joint_names": list(JOINTS),
            "points": [{"positions": list(p), "time_from_start": {"secs": t}} for t, p in points],
        },
        **fields,
    }  # fmt: skip


def course(asked, measured=REST):
    return GoalCourse(asked, JOINTS, measured, NOW_S)


@pytest.mark.parametrize(
    ("start_s", "elapsed", "elbow"),
    [
        (0.0, 0.5, 0.5),  # no time: now
        (NOW_S, 0.5, 0.5),
        (NOW_S + 3, 0.5, 0.5),
        (NOW_S - 1.5, 0.5, 2.0),  # in the past: the rest, from where the arm is
        (NOW_S - 1.5, 0.25, 1.0),
    ],
)
def test_a_trajectory_starts_at_the_time_of_its_header(start_s, elapsed, elbow):
    made = course(goal(start_s))
    assert made.desired(0.0)[0].tolist() == [0.0, 0.0]
    assert made.desired(elapsed)[0].tolist() == pytest.approx([0.0, elbow])
    assert made.is_early(NOW_S + 2.9) == (start_s > NOW_S)
    assert not made.is_early(NOW_S + 3)


def test_what_was_over_before_it_came_and_what_starts_in_another_age_are_refused():
    with pytest.raises(OldStampError, match=r"it started 2\.000 s ago and takes 2\.000 s"):
        course(goal(NOW_S - 2))
    with pytest.raises(UsageError, match=r"it starts in 4000 s; is it of this clock"):
        course(goal(NOW_S + 4000))
    with pytest.raises(InvalidJointsError):
        GoalCourse(goal(), ("wrist",), REST[:1], NOW_S)


def allowed(position, name="elbow"):
    return [{"name": name, "position": position}]


@pytest.mark.parametrize(
    ("path", "off", "code"),
    [
        ([], 9.0, None),
        (allowed(0.0), 9.0, None),
        (allowed(-1.0), 9.0, None),
        (allowed(0.2), 0.19, None),
        (allowed(0.2), 0.21, PATH_TOLERANCE),
        ([], math.nan, PATH_TOLERANCE),
    ],
)
def test_on_its_way_an_arm_may_be_off_by_the_tolerance_of_the_path(path, off, code):
    ending = course(goal(path_tolerance=path)).ending(0.5, np.array([0.0, 0.5 + off]))
    assert (ending and ending[0]) == code
    if code:
        assert ending[1].startswith("elbow is ")


@pytest.mark.parametrize(
    ("at_goal", "off", "code"),
    [
        ([], 0.04, 0),
        ([], 0.06, GOAL_TOLERANCE),
        (allowed(0.1), 0.06, 0),
        (allowed(0.01), 0.04, GOAL_TOLERANCE),
        (allowed(-1.0), 9.0, 0),
        (allowed(-1.0), math.nan, GOAL_TOLERANCE),
    ],
)
def test_at_its_end_an_arm_has_to_be_within_the_tolerance_of_the_goal(at_goal, off, code):
    made, measured = course(goal(goal_tolerance=at_goal)), np.array([0.0, 2.0 + off])
    assert made.ending(2.1, measured) is None, "it may settle"
    assert made.ending(2.31, measured)[0] == code


def test_an_arm_may_come_late_by_the_time_of_the_goal():
    made = course(goal(goal_time_tolerance={"secs": 2}))
    assert made.ending(3.0, REST) is None
    assert made.ending(3.0, np.array([0.0, 2.0])) == (0, "")
    assert made.ending(4.01, REST)[0] == GOAL_TOLERANCE


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"path_tolerance": allowed(0.1, "wrist")}, "path_tolerance: 'wrist' is no joint"),
        ({"goal_tolerance": allowed(math.nan)}, "goal_tolerance: elbow: expected a number"),
        ({"goal_tolerance": ["elbow"]}, "None is no joint"),
        ({"goal_time_tolerance": {"secs": -1}}, r"expected a duration, got -1\.0 s"),
        ({"trajectory": None}, "expected a trajectory_msgs/JointTrajectory"),
    ],
)
def test_a_goal_that_says_nonsense_is_refused_before_the_arm_moves(fields, words):
    with pytest.raises(UsageError, match=words):
        course({**goal(), **fields})


@pytest.mark.parametrize("position", [math.inf, "0.1", None])
@pytest.mark.parametrize("name", ["path_tolerance", "goal_tolerance"])
def test_a_tolerance_that_is_no_number_is_refused(name, position):
    with pytest.raises(UsageError, match=f"{name}: elbow: expected a number of rad"):
        course(goal(**{name: [{"name": "elbow", "position": position}]}))


@pytest.mark.parametrize("secs", [math.inf, math.nan])
def test_a_header_whose_time_is_no_time_is_refused(secs):
    asked = goal()
    asked["trajectory"]["header"]["stamp"] = {"secs": secs, "nsecs": 0}
    with pytest.raises(UsageError, match=r"trajectory\.header\.stamp: expected a time"):
        course(asked)


@pytest.mark.parametrize("header", [None, {}, "now"])
def test_a_trajectory_without_a_time_starts_now(header):
    asked = goal()
    asked["trajectory"]["header"] = header
    made = course(asked)
    assert not made.is_early(NOW_S)
    assert made.desired(0.5)[0].tolist() == pytest.approx([0.0, 0.5])


def test_of_a_late_trajectory_a_point_without_a_time_is_refused_and_not_skipped():
    late = {"start_s": NOW_S - 1.5}
    with pytest.raises(UsageError, match="time_from_start"):
        course(goal(**late, points=((1, (0, 1)), (math.nan, (0, 5)), (2, (0, 2)))))
    with pytest.raises(OldStampError):
        course(goal(**late, points=((1, (0, 1)), (math.nan, (0, 2)))))
    with pytest.raises(UsageError, match="at least one point"):
        course(goal(**late, points=()))
