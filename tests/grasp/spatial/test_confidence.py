"""Confidence under pose uncertainty: closed forms, bounds, options; epsilon: known values."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import panda_hand, parallel_jaw
from grasp.spatial.meshes.shapes import box_mesh, sphere_mesh
from grasp.spatial.scoring.confidence import Load, PoseNoise, closures, confidences, score_grasps
from grasp.spatial.scoring.wrench import Contacts, epsilon, epsilon_bound, wrenches

HAND = panda_hand()
HERE = np.eye(4)[None]


@pytest.mark.parametrize("sigma", [0.004, 0.008, 0.012])
def test_a_sphere_follows_the_closed_form(sigma: float) -> None:
    radius, mu = 0.03, 0.5
    wide = parallel_jaw(0.2)
    found = confidences(
        sphere_mesh(radius, 64), HERE, wide, PoseNoise(sigma, 0.0), samples=3000, friction=mu
    )
    # Both contacts are inside the cones while the line passes the centre within r sin(atan mu).
    within = radius * np.sin(np.arctan(mu))
    expected = 1 - np.exp(-(within**2) / (2 * sigma**2))
    # 3 standard errors of 3,000 draws, and 1 % for the facets.
    assert found.value[0] == pytest.approx(expected, abs=0.01 + 3 * 0.5 / np.sqrt(3000))


def test_rotation_lowers_the_confidence_in_a_flat_pinch_as_the_cone_says() -> None:
    plate = box_mesh((0.03, 2.0, 2.0))
    sigma = 0.3
    found = confidences(plate, HERE, HAND, PoseNoise(0.0, sigma), samples=3000)
    # The closing axis may tilt by atan mu; its tilt is the length of two components.
    expected = 1 - np.exp(-(np.arctan(0.5) ** 2) / (2 * sigma**2))
    assert found.value[0] == pytest.approx(expected, abs=0.03)


def test_without_uncertainty_it_is_the_nominal_closure() -> None:
    box = box_mesh((0.04, 0.06, 0.1))
    across = np.eye(4)
    across[:3, :3] = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    beside = np.eye(4)
    beside[1, 3] = 0.05
    poses = np.stack([np.eye(4), across, beside])
    found = confidences(box, poses, HAND, PoseNoise(0.0, 0.0), samples=5)
    assert found.value.tolist() == [1.0, 0.0, 0.0]


def test_all_candidates_see_the_same_errors() -> None:
    ball = sphere_mesh(0.03, 24)
    twice = np.concatenate([HERE, HERE])
    found = confidences(ball, twice, HAND, PoseNoise(0.01, 0.1), samples=200, seed=4)
    assert (found.closed[0] == found.closed[1]).all()
    other = confidences(ball, twice, HAND, PoseNoise(0.01, 0.1), samples=200, seed=5)
    assert (found.closed != other.closed).any()


def test_the_bound_lies_below_and_rises_with_the_samples() -> None:
    ball = sphere_mesh(0.03, 24)
    noise = PoseNoise(0.01, 0.0)
    few = confidences(ball, HERE, HAND, noise, samples=20)
    many = confidences(ball, HERE, HAND, noise, samples=2000)
    assert few.lower_95[0] < few.value[0]
    assert many.value[0] - many.lower_95[0] < 0.03 < few.value[0] - few.lower_95[0]


def test_a_full_object_closes_no_jaw_inside_it() -> None:
    # Both jaws would start inside a box that is wider than the stroke.
    assert not closures(box_mesh((0.3, 0.3, 0.3)), HERE, HAND, HERE).any()


def test_a_covariance_acts_in_the_frame_of_the_object() -> None:
    plate = box_mesh((0.03, 0.03, 2.0))
    along = np.diag([0.0, 0.0, 0.01, 0.0, 0.0, 0.0]) ** 2
    across = np.diag([0.0, 0.01, 0.0, 0.0, 0.0, 0.0]) ** 2
    turned = np.eye(4)
    # The gripper's z axis along the object's x: its own frame would give another answer.
    turned[:3, :3] = np.array([[0, 0, 1.0], [1.0, 0, 0], [0, 1.0, 0]])
    assert np.linalg.det(turned[:3, :3]) == pytest.approx(1.0)
    poses = turned[None]
    harmless = confidences(plate, poses, HAND, PoseNoise(covariance=along), samples=300)
    assert harmless.value[0] == 1.0
    # The closing axis is the object's y; errors along it are met by either jaw first.
    assert confidences(plate, poses, HAND, PoseNoise(covariance=across), samples=300).value[0] > 0.9
    sideways = np.diag([0.015, 0.0, 0.0, 0.0, 0.0, 0.0]) ** 2
    off = confidences(plate, poses, HAND, PoseNoise(covariance=sideways), samples=2000)
    # Misses when an error along x exceeds half the width: 2 Phi(1) - 1.
    assert off.value[0] == pytest.approx(0.683, abs=0.035)


def test_density_weights_and_epsilon_are_options() -> None:
    ball = sphere_mesh(0.03, 24)
    noise = PoseNoise(0.01, 0.1)
    plain = confidences(ball, HERE, HAND, noise, samples=400)
    weighted = confidences(ball, HERE, HAND, noise, samples=400, weighting="density")
    # The weights favour small errors.
    assert weighted.value[0] > plain.value[0]
    robust = confidences(ball, HERE, HAND, noise, samples=30, quality="epsilon")
    nominal = Contacts(np.array([[-0.03, 0, 0], [0.03, 0, 0]]), np.array([[-1.0, 0, 0], [1, 0, 0]]),
                       np.zeros(3), 0.03)  # fmt: skip
    assert 0 < robust.lower_95[0] < robust.value[0] < epsilon(nominal, 0.5) * 1.2
    with pytest.raises(ValueError, match="quality"):
        confidences(ball, HERE, HAND, quality="luck")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="weighting"):
        confidences(ball, HERE, HAND, weighting="luck")  # type: ignore[arg-type]


def test_boxes_and_weight_lower_the_confidence_where_they_count() -> None:
    bar = box_mesh((0.03, 0.4, 0.03))
    noise = PoseNoise(0.004, 0.05)
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    end = down.copy()
    end[1, 3] = 0.15
    poses = np.stack([down, end])
    light = confidences(bar, poses, HAND, noise)
    heavy = confidences(bar, poses, HAND, noise, load=Load(0.5))
    assert (light.value > 0.9).all()
    # 0.7 N m on pads that hold .08 at the end; near none in the middle.
    assert heavy.value[1] == 0.0
    assert heavy.value[0] > 0.7
    assert (confidences(bar, poses, HAND, noise, load=Load(5.0)).value == 0).all()
    tight = np.full(2, 0.032)
    touching = confidences(bar, poses, HAND, noise, openings=tight, sweep=0.05)
    free = confidences(bar, poses, HAND, noise, openings=np.full(2, 0.08), sweep=0.05)
    # One millimetre beside each finger against errors of four.
    assert (touching.value < 0.3).all()
    assert (free.value > 0.9).all()


def test_scores_are_written_on_candidates() -> None:
    box = box_mesh((0.04, 0.06, 0.1))
    contacts = np.array([[-0.02, 0, 0], [0.02, 0, 0]])
    candidate = GraspCandidate(np.eye(4), 0.04, contacts=contacts, normals=contacts / 0.02)
    scores = score_grasps([candidate], box, HAND)[0].scores
    assert {"confidence", "lower_95", "epsilon"} <= set(scores)
    assert scores["lower_95"] < scores["confidence"] <= 1.0
    assert score_grasps([], box, HAND) == []


@pytest.mark.parametrize("bad", [{"position_std": -1.0}, {"rotation_std": np.nan},
                                 {"covariance": np.ones((3, 3))}])  # fmt: skip
def test_impossible_noise_is_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"deviations|covariance"):
        PoseNoise(**bad)  # type: ignore[arg-type]


# Epsilon

POLES = np.array([[-1.0, 0, 0], [1.0, 0, 0]])


def _ball(scale: float = 1.0, at: float = 0.0) -> Contacts:
    return Contacts(scale * POLES + at, POLES, np.full(3, at), scale)


def _inside(w: np.ndarray, target: np.ndarray) -> bool:
    """Tell whether a wrench is a convex combination of others."""
    rows = np.vstack([w.T, np.ones(len(w))])
    done = linprog(np.zeros(len(w)), A_eq=rows, b_eq=np.append(target, 1.0), method="highs")
    return bool(done.status == 0)


def test_epsilon_is_the_ball_in_the_hull() -> None:
    contacts = Contacts(np.array([[-1.0, 0.2, 0], [0.9, -0.1, 0.3]]), POLES, np.zeros(3), 1.1)
    value = epsilon(contacts, 0.6)
    assert value > 0
    w = wrenches(contacts, 0.6)
    rng = np.random.default_rng(0)
    for direction in rng.normal(size=(25, 6)):
        unit = direction / np.linalg.norm(direction)
        assert _inside(w, 0.999 * value * unit)
    # And no larger ball: towards the nearest facet the hull ends just behind it.
    from scipy.spatial import ConvexHull

    nearest = ConvexHull(w).equations
    facet = nearest[np.argmax(nearest[:, 6]), :6]
    assert not _inside(w, 1.001 * value * facet)


@pytest.mark.parametrize("opposed", [True, False], ids=["parallel faces", "any faces"])
@pytest.mark.parametrize("edges", [5, 8])
def test_epsilon_of_two_soft_fingers_is_that_of_the_hull_of_their_wrenches(
    opposed: bool, edges: int
) -> None:
    from scipy.spatial import ConvexHull

    rng = np.random.default_rng(3)
    held = 0
    for k in range(40):
        normals = POLES + (0.0 if opposed else 0.1) * rng.normal(size=(2, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        # Every fourth has both contacts on one line through the centre of mass.
        points = POLES + (0.0 if k % 4 == 0 else 0.2) * rng.normal(size=(2, 3))
        contacts = Contacts(points, normals, np.zeros(3), 1.4, rng.normal(size=3))
        w = wrenches(contacts, 0.5, 0.3, edges)
        nearest = -ConvexHull(w).equations[:, 6].max()
        assert epsilon(contacts, 0.5, 0.3, edges) == pytest.approx(max(nearest, 0.0), abs=1e-9)
        held += nearest > 0
    assert held > 20


def test_the_fast_bound_is_a_bound_and_near() -> None:
    rng = np.random.default_rng(1)
    exact, fast = [], []
    for _ in range(40):
        tilt = Rotation.from_rotvec(rng.normal(size=3) * 0.15).as_matrix()
        points = POLES @ tilt.T + rng.normal(size=3) * 0.15
        contacts = Contacts(points, POLES, np.zeros(3), 1.3)
        exact.append(epsilon(contacts, 0.5))
        fast.append(epsilon_bound(contacts, 0.5))
    exact_, fast_ = np.array(exact), np.array(fast)
    assert (fast_ >= exact_ - 1e-9).all()
    # Ranking with it is what it is for.
    assert np.corrcoef(exact_, fast_)[0, 1] > 0.9


def test_epsilon_does_not_change_with_size_place_and_turn() -> None:
    value = epsilon(_ball(), 0.5)
    assert epsilon(_ball(0.04), 0.5) == pytest.approx(value, abs=1e-9)
    assert epsilon(_ball(0.04, 0.7), 0.5) == pytest.approx(value, abs=1e-9)
    turn = Rotation.from_rotvec([0.4, -0.8, 0.3]).as_matrix()
    approach = np.array([0.0, 0.6, 0.8])
    here = Contacts(POLES, POLES, np.zeros(3), 1.0, approach)
    there = Contacts(POLES @ turn.T, POLES @ turn.T, np.zeros(3), 1.0, turn @ approach)
    assert epsilon(there, 0.5) == pytest.approx(epsilon(here, 0.5), abs=1e-9)


def test_more_friction_and_softer_fingers_never_lower_epsilon() -> None:
    values = [epsilon(_ball(), mu) for mu in (0.1, 0.3, 0.5, 0.8, 1.2)]
    assert values == sorted(values)
    soft = [epsilon(_ball(), 0.5, gamma) for gamma in (0.0, 0.1, 0.3, 0.6)]
    assert soft == sorted(soft)
    assert soft[0] == 0.0  # two hard fingers do not resist torsion about their line


def test_contacts_that_do_not_close_resist_nothing() -> None:
    same_side = Contacts(np.array([[1.0, 0, 0], [1, 0.1, 0]]), np.array([[1.0, 0, 0], [1, 0, 0]]),
                         np.zeros(3), 1.0)  # fmt: skip
    assert epsilon(same_side, 0.5) == 0.0
    with pytest.raises(ValueError, match="radius"):
        epsilon(Contacts(POLES, POLES, np.zeros(3), 0.0), 0.5)
