"""Simulated single views: what they show, which grasps are right, what a filter learns from."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import panda_hand
from grasp.spatial.hand_search.classifier import GraspClassifier, GraspSamples
from grasp.spatial.hand_search.hand_search import propose_from_cloud
from grasp.spatial.meshes.mesh import Mesh, as_mesh
from simulate.studies import study
from simulate.study.grasp_samples import collect_samples
from simulate.study.grasp_shapes import FAMILIES, sample_shape
from simulate.study.grasp_views import TABLE, correct, depth_view, sample_camera
from simulate.world.noise import SensorNoise

CAMERA = np.array([0.4, 0.15, 0.3])


def block(size: tuple[float, float, float]) -> Mesh:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)])
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return as_mesh(corners * size, faces)


def from_above(x: float, y: float, z: float, angle: float, opening: float) -> GraspCandidate:
    pose = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    pose[:3, :3] = [[c, s, 0], [s, -c, 0], [0, 0, -1]]
    pose[:3, 3] = x, y, z
    return GraspCandidate(pose, 0.04, opening=opening)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_shape_stands_on_the_table_and_looks_outwards(family: str) -> None:
    for seed in range(3):
        mesh = sample_shape(family, seed)
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        assert low[2] == pytest.approx(0, abs=1e-12)
        assert np.abs(low[:2] + high[:2]).max() < 1e-9
        assert mesh.extent.min() > 0.01
        assert mesh.extent.max() < 0.35
        top = mesh.vertices[mesh.faces][..., 2].min(axis=1) > high[2] - 1e-9
        assert (mesh.normals[top, 2] > 0.5).all()
    assert not np.array_equal(mesh.vertices, sample_shape(family, 0).vertices)


def test_an_exact_view_shows_the_sides_that_face_the_camera() -> None:
    view = depth_view(block((0.06, 0.04, 0.08)), CAMERA)
    assert view.points[:, 2].min() > -1e-6
    upper = view.points[view.points[:, 2] > 1e-4]
    # Depth is kept in single precision: a hundredth of a millimetre.
    on = np.max(np.abs(upper / (0.03, 0.02, 0.08)), axis=1)
    assert np.abs(on - 1).max() < 1e-3
    sides = upper[upper[:, 2] < 0.079]
    front = sides[:, 0] > 0.0299
    assert 0.3 < front.mean() < 0.9
    assert (sides[~front, 1] > 0.0199).all()


def test_noise_belongs_to_the_seed() -> None:
    mesh = block((0.06, 0.04, 0.08))
    once, again, other = (depth_view(mesh, CAMERA, SensorNoise(), s).points for s in (1, 1, 2))
    assert np.array_equal(once, again)
    assert len(once) != len(other) or not np.array_equal(once, other)


def test_right_is_what_the_whole_mesh_allows() -> None:
    mesh, hand = block((0.04, 0.06, 0.1)), panda_hand()
    tries = {
        "across": from_above(0, 0, 0.07, 0.0, 0.08),
        "turned by 20 degrees": from_above(0, 0, 0.07, np.deg2rad(20), 0.08),
        "turned by 45 degrees": from_above(0, 0, 0.07, np.deg2rad(45), 0.08),
        "finger in the block": from_above(0.03, 0, 0.07, 0.0, 0.08),
        "not open enough": from_above(0, 0, 0.07, 0.0, 0.03),
        "palm in the block": from_above(0, 0, 0.05, 0.0, 0.08),
        "above": from_above(0, 0, 0.12, 0.0, 0.08),
    }
    right = correct(list(tries.values()), mesh, hand)
    assert {name for name, r in zip(tries, right, strict=True) if r} == {
        "across",
        "turned by 20 degrees",
    }
    assert not correct([from_above(0, 0, 0.005, 0.0, 0.08)], block((0.04, 0.06, 0.03)), hand)[0]
    assert correct([], mesh, hand).shape == (0,)


def test_one_noisy_view_of_a_mug_has_no_two_opposed_sides() -> None:
    angle = np.linspace(0, 2 * np.pi, 33)
    profile = [(0, 0.004), (0.029, 0.004), (0.029, 0.09), (0.033, 0.09), (0.033, 0), (0, 0)]
    rings = np.array([[(r * np.cos(a), r * np.sin(a), z) for a in angle] for r, z in profile])
    index = np.arange(rings.shape[0] * 33).reshape(-1, 33)
    a, b, c, d = (
        part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    mug = as_mesh(rings.reshape(-1, 3), faces)
    for seed in range(3):
        camera = sample_camera(np.random.default_rng(seed))
        view = depth_view(mug, camera, SensorNoise(), seed)
        seen, whole = (
            propose_from_cloud(
                view.points,
                panda_hand(),
                table=TABLE,
                viewpoints=camera[None],
                samples=60,
                complete=complete,
            )
            for complete in (False, True)
        )
        assert {grasp.antipodal for grasp in seen} == {"half"}
        assert whole[0].completed
        assert correct(whole[:5], mug, panda_hand()).any()


def test_samples_are_repeatable_and_know_their_object() -> None:
    meshes = [sample_shape("box", 0), sample_shape("can", 3)]
    once, again = (collect_samples(meshes, panda_hand(), candidates=8) for _ in range(2))
    assert once.digest == again.digest
    assert set(once.objects.tolist()) <= {0, 1}
    # So many hands, which geometry ranks, and so many pairs of contacts, which it does not.
    for kind in (np.isfinite(once.geometry), np.isnan(once.geometry)):
        counts = np.bincount(once.objects[kind], minlength=2)
        assert counts.min() > 0
        assert counts.max() <= 8
    assert len(collect_samples([], panda_hand())) == 0


@pytest.mark.slow
def test_a_filter_is_made_by_two_commands(tmp_path: Path) -> None:
    pytest.importorskip("sklearn")
    from rtask.cli.grasping.learning import train
    from rtask.cli.grasping.space import space

    views, model = tmp_path / "views.npz", tmp_path / "model.npz"
    made = CliRunner().invoke(study, ["grasp-views", str(views), "--shapes", "1"])
    assert made.exit_code == 0, made.output
    assert "panda_hand 80" in made.output
    done = CliRunner().invoke(train, [str(views), "--out", str(model), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)
    assert GraspClassifier.load(model).about["digest"] == GraspSamples.load(views).digest
    wrong = CliRunner().invoke(train, [str(model), "--out", str(model)])
    assert "expected rtask-grasp-samples-2" in str(wrong.exception)
    view = depth_view(sample_shape("can", 3), CAMERA, SensorNoise(), 0)
    np.save(tmp_path / "cloud.npy", view.points[view.points[:, 2] > 0.008])
    asked = [str(tmp_path / "cloud.npy"), "--samples", "20", "--json"]
    asked += ["--viewpoint", *(str(x) for x in CAMERA), "--classifier", str(model)]
    planned = CliRunner().invoke(space, asked)
    assert planned.exit_code == 0, planned.output
    best = json.loads(planned.output)["grasps"][0]
    assert best["completed"]
    assert 0 <= best["classifier"] <= 1
    refused = CliRunner().invoke(space, [*asked, "--gripper", "nao"])
    assert "trained for 'panda_hand 80', not for 'nao_hand 50'" in str(refused.exception)


def test_the_filters_that_come_with_the_package_are_asked_for_by_name(tmp_path: Path) -> None:
    from rtask.cli.grasping.space import space

    view = depth_view(sample_shape("can", 3), CAMERA, SensorNoise(), 0)
    np.save(tmp_path / "cloud.npy", view.points[view.points[:, 2] > 0.008])
    asked = [str(tmp_path / "cloud.npy"), "--samples", "20", "--json"]
    asked += ["--viewpoint", *(str(x) for x in CAMERA), "--classifier"]
    planned = CliRunner().invoke(space, [*asked, "shipped"])
    assert planned.exit_code == 0, planned.output
    assert 0 <= json.loads(planned.output)["grasps"][0]["classifier"] <= 1
    other = CliRunner().invoke(space, [*asked, "shipped", "--gripper", "jaw:0.06"])
    assert "no filter comes with rtask for 'parallel_jaw 60'" in str(other.exception)
    missing = CliRunner().invoke(space, [*asked, str(tmp_path / "none.npz")])
    assert "none.npz: no file of grasp samples or models" in str(missing.exception)


def test_a_plan_takes_the_place_of_the_camera_of_each_view(tmp_path: Path) -> None:
    from rtask.cli.grasping.space import space

    can, opposite = sample_shape("can", 3), CAMERA * (-1.0, -1.0, 1.0)
    asked = ["--samples", "20", "--json"]
    seen, completed = [], []
    for number, eye in enumerate((CAMERA, opposite)):
        points = depth_view(can, eye, SensorNoise(), number).points
        seen.append(points[points[:, 2] > 0.008])
        asked += ["--viewpoint", *(str(x) for x in eye)]
        np.save(tmp_path / "cloud.npy", np.vstack(seen))
        planned = CliRunner().invoke(space, [str(tmp_path / "cloud.npy"), *asked])
        assert planned.exit_code == 0, planned.output
        completed.append([one["completed"] for one in json.loads(planned.output)["grasps"]])
    assert all(completed[0][:3])
    assert not any(completed[1][:3])
