"""The learned filter: what it measures, how stored models are evaluated, what it refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grasp.spatial.clouds.cloud import prepare_cloud
from grasp.spatial.collision import Support
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud
from grasp.spatial.gripper import ParallelGripper, nao_hand, panda_hand
from grasp.spatial.hand_search.classifier import GraspClassifier, GraspSamples, gripper_key, train
from grasp.spatial.hand_search.closing_region import PICTURE, STATISTICS, closing_regions, hog
from grasp.spatial.hand_search.hand_search import propose_from_cloud, propose_on
from grasp.spatial.hand_search.shipped import shipped_classifier

JAW = ParallelGripper("jaw", "jaw", 0.0, 0.08, finger_width=0.012, finger_length=0.06)
TABLE = np.array([0.0, 0.0, 1.0, 0.0])


def half_can(camera: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(0)
    turn = rng.uniform(0, 2 * np.pi, 8000)
    out = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    points = 0.03 * out + np.outer(rng.uniform(0, 0.1, 8000), [0, 0, 1])
    return points[np.einsum("ij,ij->i", out, camera - points) > 0]


@pytest.fixture(scope="module")
def samples() -> GraspSamples:
    """A task that both models can learn: right where width and picture say so."""
    rng = np.random.default_rng(0)
    count = 240
    statistics = rng.normal(size=(count, len(STATISTICS))).astype(np.float32)
    right = statistics[:, STATISTICS.index("width")] + 0.3 * rng.normal(size=count) > 0
    pictures = np.zeros((count, *PICTURE), bool)
    for k in range(count):
        if right[k]:
            pictures[k, 10:40, 20:24] = True
        else:
            pictures[k, 10:14, 20:60] = True
    pictures ^= rng.random(pictures.shape) < 0.02
    return GraspSamples(
        statistics,
        pictures,
        right,
        np.repeat(np.arange(count // 10), 10),
        np.zeros(count, np.float32),
        np.zeros(count, bool),
        gripper_key(JAW),
    )


@pytest.mark.slow
def test_stored_boosting_says_what_scikit_learn_says(samples: GraspSamples, tmp_path: Path) -> None:
    ensemble = pytest.importorskip("sklearn.ensemble")
    made = []
    original = ensemble.GradientBoostingClassifier.fit

    def remember(self: object, *args: object) -> object:
        made.append(self)
        return original(self, *args)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ensemble.GradientBoostingClassifier, "fit", remember)
        train(samples).save(tmp_path / "model.npz")
    model = GraspClassifier.load(tmp_path / "model.npz")
    theirs = made[0].decision_function(samples.statistics)
    # The same sums in the same order but for the last digits.
    assert np.allclose(model.score(samples.statistics, samples.pictures), theirs, atol=1e-9)
    probability = model.probability(samples.statistics, samples.pictures)
    assert probability.min() >= 0
    assert probability.max() <= 1
    assert np.mean((probability > 0.5) == samples.right) > 0.85
    assert model.about["digest"] == samples.digest
    assert model.about["objects"] == 24


@pytest.mark.slow
def test_the_linear_machine_tells_pictures_apart(samples: GraspSamples, tmp_path: Path) -> None:
    pytest.importorskip("sklearn")
    model = train(samples, "svm")
    model.save(tmp_path / "model.npz")
    again = GraspClassifier.load(tmp_path / "model.npz")
    score = again.score(samples.statistics, samples.pictures)
    assert np.array_equal(score, model.score(samples.statistics, samples.pictures))
    assert np.mean((score > 0) == samples.right) > 0.95


@pytest.mark.slow
def test_training_is_repeatable(samples: GraspSamples) -> None:
    pytest.importorskip("sklearn")
    first, second = train(samples, seed=3), train(samples, seed=3)
    assert all(np.array_equal(first.arrays[k], second.arrays[k]) for k in first.arrays)


def test_training_takes_right_and_wrong_on_several_objects(samples: GraspSamples) -> None:
    for few in (
        samples.take(np.flatnonzero(samples.right)),
        samples.take(np.flatnonzero(samples.objects < 3)),
        replace(samples, one_sided=np.ones(len(samples), bool)),
    ):
        with pytest.raises(ValueError, match="at least four objects"):
            train(few)


def test_samples_survive_their_file(samples: GraspSamples, tmp_path: Path) -> None:
    samples.save(tmp_path / "views.npz")
    again = GraspSamples.load(tmp_path / "views.npz")
    assert again.digest == samples.digest
    assert np.array_equal(again.pictures, samples.pictures)


def test_other_files_are_refused(samples: GraspSamples, tmp_path: Path) -> None:
    samples.save(tmp_path / "views.npz")
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "objects.npz", a=np.array([{}], dtype=object))
    for name in ("views.npz", "text.npz", "objects.npz", "missing.npz"):
        with pytest.raises(ValueError, match=name):
            GraspClassifier.load(tmp_path / name)


def test_a_model_whose_trees_would_not_end_is_refused(
    samples: GraspSamples, tmp_path: Path
) -> None:
    pytest.importorskip("sklearn")
    model = train(samples)
    model.arrays["left"][model.arrays["roots"][0]] = 0
    model.save(tmp_path / "loop.npz")
    with pytest.raises(ValueError, match="do not fit together"):
        GraspClassifier.load(tmp_path / "loop.npz")


def test_the_model_orders_candidates_and_refuses_other_grippers(samples: GraspSamples) -> None:
    pytest.importorskip("sklearn")
    camera = np.array([0.4, 0.1, 0.3])
    model = train(samples)
    found = propose_from_cloud(
        half_can(camera), JAW, table=TABLE, viewpoints=camera[None], samples=40, classifier=model
    )
    chances = [grasp.scores["classifier"] for grasp in found]
    assert len(chances) > 10
    assert chances == sorted(chances, reverse=True)
    other = replace(JAW, max_opening=0.07)
    with pytest.raises(ValueError, match="trained for 'jaw 80', not for 'jaw 70'"):
        propose_from_cloud(half_can(camera), other, table=TABLE, classifier=model)


# what is measured


def test_a_half_seen_can_shows_one_side() -> None:
    camera = np.array([0.5, 0.0, 0.05])
    cloud = prepare_cloud(half_can(camera), table=TABLE, viewpoints=camera[None])
    # Closing along the view: one jaw in front, one behind, where nothing was seen.
    along = next(g for g in propose_on(cloud, JAW) if abs(g.closing[0]) > 0.95)
    (row,), (picture,) = closing_regions(cloud, [along], JAW)
    value = dict(zip(STATISTICS, row, strict=True))
    assert value["opposing_left"] > 0.1
    assert value["opposing_right"] == 0
    assert value["hidden"] == 0
    # More was seen near the jaw in front; straight down is 0, level is a half.
    assert value["near_left"] > value["near_right"]
    assert value["approach"] == pytest.approx(np.arccos(-along.approach[2]) / np.pi, abs=1e-6)
    assert value["over_table"] == pytest.approx(along.centre[2] / 0.1, abs=1e-6)
    assert picture[:, : PICTURE[1] // 2].sum() > picture[:, PICTURE[1] // 2 :].sum()


def test_a_picture_is_the_same_for_both_ways_round() -> None:
    camera = np.array([0.5, 0.1, 0.3])
    cloud = prepare_cloud(half_can(camera), table=TABLE, viewpoints=camera[None])
    grasp = propose_on(cloud, JAW, 40)[0]
    pose = grasp.frame_from_gripper.copy()
    pose[:3, :2] *= -1
    assert grasp.contacts is not None
    turned = replace(grasp, frame_from_gripper=pose, contacts=grasp.contacts[::-1])
    rows, pictures = closing_regions(cloud, [grasp, turned], JAW)
    assert np.allclose(rows[0], rows[1])
    assert np.array_equal(pictures[0], pictures[1])


def test_gradients_of_an_upright_edge_fall_into_the_bins_beside_zero() -> None:
    picture = np.zeros((1, *PICTURE), bool)
    picture[:, :, 30:] = True
    cells = hog(picture).reshape(2, 7, 7, 4, 9)
    votes = cells.sum(axis=(0, 1, 2, 3))
    assert votes[[0, 8]].min() > 0
    assert votes[1:8].max() == 0
    # Blocks that do not touch the edge are empty.
    assert np.flatnonzero(cells[0].sum(axis=(0, 2, 3))).tolist() == [2, 3]


@pytest.mark.parametrize("hand", [panda_hand(), nao_hand()], ids=["panda", "nao"])
def test_a_filter_comes_with_each_hand_that_is_known_here(hand: ParallelGripper) -> None:
    model = shipped_classifier(hand)
    assert model is not None
    assert model.kind == "boosting"
    assert model.about["objects"] >= 300
    assert shipped_classifier(replace(hand, max_opening=0.06)) is None
    camera = np.array([0.4, 0.1, 0.3])
    seen = half_can(camera) * (0.7, 0.7, 1.0)
    few = SpatialOptions(tries=400, samples=40)
    plain, judged = (
        plan_on_cloud(seen, hand, Support(), camera[None], few, **choice)
        for choice in ({}, {"classifier": "shipped"})
    )
    with pytest.raises(ValueError, match="no filter comes with rtask for 'jaw 80'"):
        plan_on_cloud(seen, JAW, Support(), camera[None], few, classifier="shipped")
    assert all("classifier" not in one.scores for one in plain)
    sure = [one.scores["confidence"] * one.scores["classifier"] for one in judged]
    assert len(sure) > 2
    # Three of the completed cloud come before two of what is seen.
    assert sure[:3] == sorted(sure[:3], reverse=True)
    assert sure[3:5] == sorted(sure[3:5], reverse=True)
    assert sure[0] > 0.5
