"""Collisions of gripper boxes, ranking, diversity, thresholds and features."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from grasp.spatial.boxes import boxes_meet_mesh
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import FREE, Support, Surroundings, room_around
from grasp.spatial.drawing import candidates_svg
from grasp.spatial.gripper import nao_hand, panda_hand
from grasp.spatial.meshes.shapes import box_mesh, cup_mesh, sphere_mesh
from grasp.spatial.scoring.features import FEATURES, body_of, with_features
from grasp.spatial.scoring.select import diverse, hedged, rank, select_grasp

HAND = panda_hand()


def _at(x: float = 0.0, y: float = 0.0, yaw_deg: float = 0.0, **scores: float) -> GraspCandidate:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()
    pose[:2, 3] = x, y
    contacts = np.array([[-0.02, 0, 0], [0.02, 0, 0]])
    return GraspCandidate(pose, 0.04, contacts=contacts, normals=contacts / 0.02, scores=scores)


@pytest.mark.slow
@pytest.mark.parametrize("mesh", [sphere_mesh(0.03, 20), cup_mesh(0.03, 0.08, 0.004, 24)],
                         ids=["sphere", "cup"])  # fmt: skip
def test_boxes_meet_a_surface_where_its_points_lie_in_them(mesh) -> None:
    rng = np.random.default_rng(0)
    poses = np.tile(np.eye(4), (200, 1, 1))
    poses[:, :3, :3] = Rotation.random(200, random_state=1).as_matrix()
    poses[:, :3, 3] = rng.normal(size=(200, 3)) * 0.05
    boxes = np.repeat(HAND.boxes(0.05)[None], 200, axis=0)
    hit = boxes_meet_mesh(*mesh.tree.arrays, poses, boxes)
    points, _ = mesh.sample(20000, rng)
    for pose, touched in zip(poses, hit, strict=True):
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        lies_in = [((local >= low) & (local <= high)).all(axis=1).any() for low, high in boxes[0]]
        near = [((local >= low - 1e-3) & (local <= high + 1e-3)).all(axis=1).any()
                for low, high in boxes[0]]  # fmt: skip
        # Samples are about a millimetre apart: in between they cannot tell.
        if any(lies_in):
            assert touched
        if not any(near):
            assert not touched
    assert 20 < hit.sum() < 180


def test_the_sweep_covers_the_way_in() -> None:
    ball = sphere_mesh(0.01).moved(np.array([[1, 0, 0, 0.03], [0, 1, 0, 0], [0, 0, 1, -0.09],
                                             [0, 0, 0, 1.0]]))  # fmt: skip
    # A small ball where a finger passes behind the palm: free at the end, not on the way.
    thin = np.array([0.05])
    hand = nao_hand()
    still = room_around(np.eye(4)[None], thin, hand, Surroundings(sweep=0.0), ball)
    moving = room_around(np.eye(4)[None], thin, hand, Surroundings(sweep=0.06), ball)
    assert bool(still.free[0]) != bool(moving.free[0]) or not still.free[0]
    assert not moving.free[0]


def test_a_support_is_kept_clear_at_any_tilt() -> None:
    for tilt in (0.0, 0.3, 0.7):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("y", np.pi - tilt).as_matrix()
        boxes = HAND.boxes(0.06)[None]
        low = Support(0.0).below(pose[None], boxes)[0]
        corners = np.array([[box[i, a] for a, i in enumerate(k)] for box in boxes[0]
                            for k in np.ndindex(2, 2, 2)])  # fmt: skip
        assert low == pytest.approx((corners @ pose[:3, :3].T)[:, 2].min())
        openings = np.array([0.06])
        for height, free in ((low - 0.0021, True), (low - 0.0019, False)):
            room = room_around(pose[None], openings, HAND, Surroundings(Support(height)))
            assert bool(room.free[0]) is free
    with pytest.raises(ValueError, match="unit normal"):
        Support(0.0, (0.0, 0.0, 2.0))


def test_the_clearance_is_the_distance_to_the_nearest_neighbour() -> None:
    openings = np.array([0.06])
    edge = 0.03 + HAND.thickness
    for gap in (0.001, 0.02, 0.2):
        points = np.array([[edge + gap, 0.0, 0.0], [np.nan, 0, 0]])
        room = room_around(np.eye(4)[None], openings, HAND, Surroundings(neighbours=points))
        assert room.clearance[0] == pytest.approx(min(gap, FREE))
    inside = np.array([[edge - 0.001, 0.0, 0.0]])
    room = room_around(np.eye(4)[None], openings, HAND, Surroundings(neighbours=inside))
    assert room.clearance[0] == 0.0
    assert room.hit[0] == 2


def test_confidence_goes_first_then_what_tells_equals_apart() -> None:
    sure = _at(confidence=0.9, lower_95=0.84, epsilon=0.1)
    strong = _at(confidence=0.86, lower_95=0.8, epsilon=0.3)
    weak = _at(confidence=0.5, lower_95=0.4, epsilon=0.9)
    assert rank([weak, sure, strong]) == [strong, sure, weak]
    assert rank([]) == []


def test_rounding_does_not_decide_between_grasps_of_equal_epsilon() -> None:
    """Of grasps that are alike but for noise, the surer, nearer and steeper one goes first."""
    up = np.array([0.0, 0.0, 1.0])
    told = {"confidence": 0.9, "lower_95": 0.7, "epsilon": 0.3, "lever": 0.01}
    from_above = np.diag([1.0, -1.0, -1.0, 1.0])

    def near(noise: float, pose: np.ndarray | None = None, **scores: float) -> GraspCandidate:
        pose = np.eye(4) if pose is None else pose
        return GraspCandidate(pose, 0.04, scores={**told, **scores, "epsilon": 0.3 + noise})

    surer = near(-1e-9, confidence=0.95)
    nearer, steeper, last = near(-2e-9, lever=0.004), near(-3e-9, from_above), near(4e-9)
    wide = near(-4e-9, clearance=0.02)
    assert rank([last, wide, steeper, nearer, surer], up) == [surer, nearer, steeper, wide, last]
    # Without a vertical no approach is steep; then the clearance counts.
    assert rank([last, steeper, wide])[0] is wide
    # A real difference of epsilon still goes first.
    strong = near(0.03, lever=0.03, confidence=0.85)
    assert rank([surer, strong], up)[0] is strong


def test_with_a_filter_the_order_is_by_confidence_times_its_probability() -> None:
    """One says how a grasp bears errors if the object is as thought, the other whether it is."""
    guessed = _at(confidence=0.95, lower_95=0.9, epsilon=0.9, classifier=0.5)
    seen = _at(confidence=0.8, lower_95=0.7, epsilon=0.1, classifier=0.9)
    worse = _at(confidence=0.5, lower_95=0.4, epsilon=0.1, classifier=0.9)
    assert rank([guessed, worse, seen]) == [seen, guessed, worse]
    # Where one was not judged, the probabilities of the others tell nothing about it.
    plain = _at(confidence=0.9, lower_95=0.84, epsilon=0.1)
    assert rank([seen, plain])[0] is plain


def test_below_the_threshold_there_is_no_grasp() -> None:
    found = [_at(confidence=0.29), _at(confidence=0.2)]
    assert select_grasp(found) is None
    assert select_grasp(found, 0.25) is found[0]
    assert select_grasp([]) is None


def test_repetitions_of_a_better_one_are_dropped() -> None:
    first = _at()
    near = _at(x=0.005, yaw_deg=10)
    turned = _at(x=0.005, yaw_deg=40)
    away = _at(x=0.02)
    mirrored = _at(yaw_deg=175)
    kept = diverse([first, near, turned, away, mirrored], HAND)
    assert kept == [first, turned, away]
    # For a thumb against fingers half a turn is another grasp.
    assert mirrored in diverse([first, mirrored], nao_hand())
    assert diverse([first, turned, away], HAND, most=2) == [first, turned]


def test_grasps_of_what_is_seen_stand_between_variants_of_one_guess() -> None:
    guessed = [_at(x=0.02 * k) for k in range(7)]
    seen = [_at(x=0.061), *(_at(y=0.02 * k) for k in range(1, 4))]
    order = hedged(guessed, seen, HAND)
    # The first of what is seen repeats a guess that comes later, so the guess is left out.
    assert order == [*guessed[:3], *seen[:2], *guessed[4:], *seen[2:]]
    assert hedged(guessed, seen, HAND, most=4) == order[:4]
    assert hedged([], seen, HAND) == seen
    assert hedged(guessed, [], HAND) == guessed


def test_half_a_turn_of_a_better_grasp_stands_behind_other_places() -> None:
    best, turned, away = _at(), _at(yaw_deg=180), _at(x=0.02)
    assert hedged([best, turned, away], [], nao_hand()) == [best, away, turned]
    assert hedged([best, turned], [away], nao_hand()) == [best, away, turned]
    # Equal jaws close alike both ways round: the same grasp.
    assert hedged([best, turned, away], [], HAND) == [best, away]


def test_features_are_dimensionless_and_in_order() -> None:
    points, _ = box_mesh((0.04, 0.06, 0.1)).sample(3000, np.random.default_rng(0))
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.025
    contacts = np.array([[-0.02, 0, 0.025], [0.02, 0, 0.025]])
    candidate = GraspCandidate(pose, 0.04, contacts=contacts, normals=contacts,
                               scores={"confidence": 0.8, "epsilon": 0.1,
                                       "clearance": 0.01})  # fmt: skip
    seen = with_features(candidate, body_of(points), HAND, Support(-0.05)).features
    assert seen is not None
    named = dict(zip(FEATURES, seen, strict=True))
    expected = {"confidence": 0.8, "epsilon": 0.1, "width": 0.5, "offset": 0.25, "height": 0.25,
                "approach": 0.0, "alignment": 1.0, "clearance": 0.5, "completed": 0.0,
                "elongation": 0.4, "flatness": 0.6, "size": 1.25}  # fmt: skip
    for name, value in expected.items():
        # The centroid of random points and their principal axes are a little off.
        assert named[name] == pytest.approx(value, abs=0.05), name
    assert 0 < named["support_left"] < 1.5
    bigger = GraspCandidate(np.block([[pose[:3, :3], 10 * pose[:3, 3:]], [pose[3:]]]), 0.4,
                            scores=candidate.scores)  # fmt: skip
    ten = with_features(bigger, body_of(10 * points), HAND, Support(-0.5)).features
    assert ten is not None
    assert ten[[3, 4, 5, 6, 11, 12]] == pytest.approx(seen[[3, 4, 5, 6, 11, 12]])


def test_a_drawing_shows_every_gripper_in_a_panel_of_its_own() -> None:
    svg = candidates_svg([_at(), _at(x=0.01)], HAND, box_mesh((0.04, 0.06, 0.1)))
    assert svg.count("<polyline") == 2  # the bar between the fingers
    assert svg.count(": s_G ") == 2
    # Three sides of the box look towards the eye, two faces each, and three of each finger.
    assert svg.count("<polygon") == 2 * (6 + 2 * 3)
    cloud = candidates_svg([], HAND, np.random.default_rng(0).normal(size=(50, 3)))
    assert cloud.count("<circle") == 50
