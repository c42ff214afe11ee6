"""Object frames, kinds by shape, and what evidence weighs: by hand."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from features.tabletop import measure
from grasp.spatial.footprint import Footprint
from grasp.spatial.frames import surface_from_object
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.planar import PlanarGrasp
from rtask.engine.decisions import Option
from rtask.engine.memory.choice import Scene, choose, options
from rtask.engine.memory.experience import Weights, gather, without_trials
from rtask.engine.perception.placement import classify_shape, footprint_of, place
from rtask.engine.policy import Policy
from rtask.engine.remembered import Memory, Remembered, Tally, Trial

HAND = ParallelGripper("hand", "nao_hand", 0.0, 0.05)
SIZE = (0.04, 0.03, 0.06)
NOW = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)


@dataclass
class Seen:
    """As much of an observation as a placement needs."""

    points: NDArray[np.float64]
    support: float = 0.27
    frame_from_camera: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    @property
    def shape(self):
        return measure(self.points, self.support)


def box_points(yaw, centre=(0.16, -0.06), size=(0.05, 0.03, 0.04)):
    rng = np.random.default_rng(0)
    local = (rng.random((4000, 3)) - [0.5, 0.5, 0.0]) * size
    local[:2000, 2] = size[2]
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return np.column_stack([local[:, :2] @ turn.T + centre, local[:, 2] + 0.27])


def round_points(profile, centre=(0.15, 0.08), height=0.06):
    """Return points on a body of revolution; ``profile`` gives the radius at each height 0..1."""
    rng = np.random.default_rng(0)
    level, turn = rng.random(6000), rng.random(6000) * 2 * np.pi
    radius = profile(level) * np.where(level > 0.98, np.sqrt(rng.random(6000)), 1.0)
    x, y = centre[0] + radius * np.cos(turn), centre[1] + radius * np.sin(turn)
    return np.column_stack([x, y, 0.27 + level * height])


def test_a_box_stands_along_its_longer_side():
    placed = place(Seen(box_points(0.4)))
    assert placed.is_verified
    assert placed.yaw == pytest.approx(0.4, abs=0.03)
    assert placed.frame_from_object[:3, 3] == pytest.approx([0.16, -0.06, 0.27], abs=2e-3)


@pytest.mark.parametrize("heading", [0.1, -0.7, 1.5])
def test_which_end_is_which_is_as_the_robot_saw_it_last_where_nothing_seen_tells(heading):
    seen = Seen(box_points(0.4))
    here, turned = (place(seen, False, heading=h) for h in (heading, heading + np.pi))
    assert here.yaw == pytest.approx(0.4, abs=0.03)
    assert np.cos(turned.yaw - here.yaw) == pytest.approx(-1.0)
    assert not here.is_verified
    assert not turned.is_verified


def test_there_and_back_between_the_robots_and_the_objects_frame():
    placed = place(Seen(box_points(0.4)))
    there = placed.to_frame(0.01, -0.005, 1.2)
    assert placed.to_object(*there) == pytest.approx((0.01, -0.005, 1.2))


def test_a_round_things_frame_points_away_from_the_robot():
    placed = place(Seen(round_points(lambda z: 0.02 + 0 * z)))
    assert placed.is_round
    assert placed.yaw == pytest.approx(np.arctan2(0.08, 0.15), abs=0.02)
    assert footprint_of(Seen(round_points(lambda z: 0.02 + 0 * z)).shape, placed).kind == "round"


def test_a_rigid_match_tells_front_from_back_and_the_measured_side_makes_it_exact():
    seen = Seen(box_points(0.4))
    for quarter in range(4):
        true_yaw = 0.4 + quarter * np.pi / 2
        rough = surface_from_object(0.165, -0.055, 0.27, true_yaw + 0.08)
        placed = place(seen, is_round=False, query_from_view=rough, object_from_view=np.eye(4))
        assert placed.is_verified
        off = (placed.yaw - true_yaw + np.pi) % (2 * np.pi) - np.pi
        assert abs(off) < 0.03  # the match was 0.08 rad off


@pytest.mark.parametrize(
    "wrong",
    [
        surface_from_object(0.20, -0.06, 0.27, 0.4),
        surface_from_object(0.16, -0.06, 0.27, 0.4)
        @ np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]]),
    ],
    ids=["elsewhere", "fallen over"],
)
def test_a_match_that_contradicts_what_is_measured_is_not_believed(wrong):
    placed = place(Seen(box_points(0.4)), False, wrong, np.eye(4))
    assert not placed.is_verified
    assert placed.yaw == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize(
    ("profile", "height", "kind"),
    [
        (lambda z: 0.018 + 0 * z, 0.08, "Cylinder"),
        (lambda z: 0.018 * np.sqrt(np.clip(1 - (2 * z - 1) ** 2, 0, 1)), 0.036, "Ball"),
        (lambda z: np.where(z < 0.68, 0.018, 0.008), 0.10, "Bottle"),
    ],
)
def test_round_things_are_named_by_their_profile(profile, height, kind):
    points = round_points(profile, height=height)
    found = classify_shape(measure(points, 0.27), points)
    assert found is not None
    assert found[0] == kind


def test_flat_sided_and_thin_things_are_named_by_their_outline():
    box, pen = box_points(0.2), box_points(0.2, size=(0.11, 0.018, 0.018))
    bar = box_points(0.2, size=(0.12, 0.026, 0.027))
    assert classify_shape(measure(box, 0.27), box)[0] == "Box"
    assert classify_shape(measure(pen, 0.27), pen)[0] == "Pen"
    assert classify_shape(measure(bar, 0.27), bar)[0] == "Bar"


def remembered(**changes):
    base = Remembered("g", "o", False, 0.0, 0.0, 0.03, 0.5, 0.05, 0.9, "nao_hand", SIZE,
                      (Tally(True, 3), Tally(False, 1)))  # fmt: skip
    return replace(base, **changes)


def weights(**changes):
    return Weights(Policy(**changes), {"o": 1.0}, HAND, SIZE, NOW)


def evidence(grasp, theta=0.5, z=0.03, **changes):
    found = gather(np.array([[0.0, 0.0, z]]), np.array([theta]), [grasp], weights(**changes), 0.2)
    return float(found.successes[0]), float(found.failures[0])


def test_the_same_grasp_on_the_same_object_counts_in_full():
    # A failure of an unchanged object weighs as one of the robot's own: rho.
    assert evidence(remembered()) == (3.0, 2.0)


def test_neighbours_count_by_the_kernel():
    won, _ = evidence(remembered(), theta=0.7)
    assert won == pytest.approx(3 * np.exp(-(np.sin(0.2) ** 2) / 0.08), abs=1e-6)
    won, _ = evidence(remembered(), z=0.03 + 0.06 / 4 * 0.2)
    assert won == pytest.approx(3 * np.exp(-0.5), abs=1e-6)


def test_the_confidence_of_recognition_weighs():
    found = gather(
        np.array([[0.0, 0.0, 0.03]]), np.array([0.5]), [remembered()],
        Weights(Policy(), {"o": 0.4}, HAND, SIZE, NOW), 0.2,
    )  # fmt: skip
    assert found.successes[0] == pytest.approx(1.2)
    assert found.objects == (("o",),)


def test_coarse_physics_another_gripper_and_age_weigh_less():
    fast = remembered(tallies=(Tally(True, 1, is_fast=True),))
    assert evidence(fast)[0] == pytest.approx(0.3)
    assert evidence(remembered(gripper_type="panda"))[0] == pytest.approx(1.5)
    in_fast = replace(weights(), is_fast=True)
    assert in_fast.of(fast, fast.tallies[0]) == 1.0
    old = remembered(tallies=(Tally(True, 1, latest=NOW - dt.timedelta(days=20)),))
    assert evidence(old)[0] == 1.0
    assert evidence(old, half_life_days=10.0)[0] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("teller_n", "held", "weight"),
    [(5, True, 1.0), (5, False, 0.3), (40, True, 0.3), (40, False, 1.0)],
)
def test_a_weak_hand_speaks_for_a_strong_one_when_it_held_and_the_strong_one_when_it_lost(
    teller_n, held, weight
):
    told = remembered(gripper_type="other")
    between = replace(weights(), forces={"other": teller_n, "nao_hand": 20.0})
    factor = 1.0 if held else Policy().bandit.rho
    assert between.of(told, Tally(held, 1)) == pytest.approx(weight * factor)


def test_another_object_of_the_class_is_scaled_to_this_one():
    larger = tuple(1.2 * extent for extent in SIZE)
    other = remembered(of_class=True, object="p", size=larger, z=0.036)
    fade = np.exp(-3 * np.log(1.2) ** 2 / (2 * 0.3**2))
    assert evidence(other)[0] == pytest.approx(3 * 0.7 * fade, abs=1e-6)


def scene(neighbours=None):
    return Scene(Footprint((0.0, 0.0), 0.0, *SIZE), np.eye(4), HAND, neighbours)


def told(*grasps):
    """Return what the graph tells, as the learner sees it, of a grasp from geometry alone."""
    here = PlanarGrasp(0.0, 0.0, 0.03, 0.5, 0.03, 0.05, 0.9)
    candidate = Option("candidate:0", here, (0.0, 0.0, 0.03, 0.5))
    memory = Memory(grasps=grasps)
    (chosen,) = choose([candidate], scene(), memory, {"o": 0.9, "p": 0.9}, Policy(), NOW)
    return chosen.explanation["graph"]


def test_once_an_object_itself_was_held_its_class_says_no_more():
    alike = remembered(of_class=True, object="p", tallies=(Tally(True, 3),))
    lost, held = (remembered(tallies=(Tally(held, 1),)) for held in (False, True))
    assert told(alike) == pytest.approx((3 * 0.7, 0.0))
    assert told(alike, lost) == pytest.approx((3 * 0.7, 2 * 0.9))
    assert told(alike, held) == pytest.approx((0.9, 0.0))


@pytest.mark.parametrize("of_class", [False, True])
def test_of_two_proven_grasps_the_one_that_held_itself_goes_first(of_class):
    held = (Tally(True, 2),)
    grasp = remembered(tallies=held, of_class=of_class, object="p" if of_class else "o")
    here, beside = (
        PlanarGrasp(0.0, 0.0, 0.03, theta, 0.03, 0.05, quality)
        for theta, quality in ((0.5, 0.4), (0.55, 0.9))
    )
    own = Option("g", here, (0.0, 0.0, 0.03, 0.5), grasp)
    better = Option("candidate:0", beside, (0.0, 0.0, 0.03, 0.55))
    confident = {"o": 1.0, "p": 1.0}
    order = choose([better, own], scene(), Memory(grasps=(grasp,)), confident, Policy(), NOW)
    assert [one.choice.explanation["selected_by"] for one in order] == ["proven"] * 2
    # What held on another object of the class has not held on this one.
    assert [one.id for one in order] == (["candidate:0", "g"] if of_class else ["g", "candidate:0"])


BAR = (0.12, 0.03, 0.03)
LOST = (Tally(False, 1),)


def along_a_bar(policy, *grasps, trials=(), confidence=1.0):
    """Return what is left of the quality of grasps along a bar, from one end to the other."""
    places = [-0.04, -0.02, 0.0, 0.02, 0.04]
    found = [
        Option(f"candidate:{k}", PlanarGrasp(x, 0.0, 0.018, 1.571, 0.03, 0.05, 0.9),
               (x, 0.0, 0.018, 1.571))
        for k, x in enumerate(places)
    ]  # fmt: skip
    here = Scene(Footprint((0.0, 0.0), 0.0, *BAR), np.eye(4), HAND)
    chosen = choose(found, here, Memory(grasps=grasps, trials=trials), {"o": confidence}, policy)
    by_id = {one.id: one.choice.explanation["hidden"] for one in chosen}
    return [by_id[one.id] for one in found], chosen[0].in_object[0]


def test_failures_at_one_place_tell_of_the_whole_object():
    failed = tuple(
        Trial(f"g{k}", x, 0.0, 0.018, 1.571, False, k, "t") for k, x in enumerate((0.0, -0.04))
    )
    left, first = along_a_bar(Policy(), trials=failed)
    assert first > 0
    assert left[4] == 1.0
    assert max(left[:3]) < 0.6
    everything, _ = along_a_bar(Policy(causes=False), trials=failed)
    assert everything == [1.0] * 5


def test_what_failed_for_another_robot_tells_of_the_object_as_far_as_it_is_the_same():
    known = [
        remembered(grasp=f"g{k}", x=x, size=BAR, tallies=LOST) for k, x in enumerate((0.0, -0.04))
    ]
    sure, _ = along_a_bar(Policy(), *known)
    doubtful, _ = along_a_bar(Policy(), *known, confidence=0.3)
    assert sure[0] < doubtful[0] < 1.0
    alike = [replace(one, of_class=True, object="p") for one in known]
    assert along_a_bar(Policy(), *alike)[0] == [1.0] * 5  # what hides in others says nothing


def test_a_remembered_hand_opens_no_wider_than_it_must_between_neighbours():
    # 1 mm outside the fingers of a hand that leaves 8 mm on either side: in the way of a wider one.
    away = 0.046 / 2 + HAND.finger_width + 0.001
    posts = np.array([[0.0, away, 0.05], [0.0, -away, 0.05]])
    memory = Memory(grasps=(remembered(theta=np.pi / 2, opening=0.05, width=0.03),))
    for neighbours, opening in ((None, 0.05), (posts, 0.046)):
        (found,) = options(scene(neighbours), memory, "o", propose=False)
        assert found.opening == pytest.approx(opening)
    assert options(scene(posts - np.sign(posts) * 0.004), memory, "o", propose=False) == []


def test_the_present_episode_is_not_counted_twice():
    trials = (Trial("g", 0, 0, 0.03, 0.5, False, 1, "t"),)
    cleaned = without_trials(Memory(grasps=(remembered(),), trials=trials))
    assert cleaned[0].tallies == (Tally(True, 3),)


def end_of(answer):
    """Return the direction in which x of the object points, as the robot sees it, (2,) m."""
    along = sorted((g["in_object"]["x"], g["x"], g["y"]) for g in answer["grasps"])
    return np.subtract(along[-1][1:], along[0][1:])


@pytest.mark.slow
@pytest.mark.parametrize(("before", "after"), [(0.2, -0.2), (-0.2, 0.2), (1.4, 1.8)])
def test_a_thing_that_fell_over_keeps_its_ends(bench, robots, monkeypatch, before, after):
    # Measured sides give a direction from 0 to half a turn: the first two falls pass its limit.
    carton = bench.Thing((0.105, 0.028, 0.045), texture_seed=3).at(0.15, -0.1, before)
    robot, stood = robots("nao-1"), bench.sight(carton)
    stored = robot.insert(stood)["objects"][0]["object"]
    old = end_of(robot.recognise(stood, object=stored))
    fallen = bench.Thing((0.105, 0.045, 0.028), texture_seed=44).at(0.16, -0.11, after)
    # A side that nobody stored, seen with a camera's noise, mostly has no pose.
    monkeypatch.setattr("rtask.engine.perception.poses.find_pose", lambda *about: None)
    new = end_of(robot.recognise(bench.sight(fallen), object=stored, min_pose=0.0))
    assert float(old @ new) > 0.8 * float(np.linalg.norm(old) * np.linalg.norm(new))
