"""Grasps go to HDF5 files in ACRONYM's layout and come back, contacts measured on the mesh."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import SpatialOptions, plan_given, plan_on_mesh
from grasp.spatial.gripper import nao_hand, panda_hand
from grasp.spatial.interchange import read_grasps, write_grasps
from grasp.spatial.meshes.shapes import box_mesh

h5py = pytest.importorskip("h5py")
BOX, HAND = box_mesh((0.04, 0.12, 0.1)), panda_hand()
AROUND = Surroundings(Support(-0.05))
FEW = SpatialOptions(tries=300, samples=20)


@pytest.fixture(scope="module")
def planned():
    return plan_on_mesh(BOX, HAND, AROUND, FEW)


@pytest.mark.parametrize("hand", [HAND, nao_hand(), replace(HAND, parent_from_gripper=None)])
def test_poses_and_confidences_return_exactly(planned, tmp_path: Path, hand) -> None:
    path = tmp_path / "grasps.h5"
    write_grasps(path, planned.candidates, hand, "box.obj", 0.001)
    back = read_grasps(path, hand)
    assert (back.mesh, back.scale) == ("box.obj", 0.001)
    assert len(back.candidates) == len(planned)
    for one, other in zip(back.candidates, planned, strict=True):
        np.testing.assert_allclose(one.frame_from_gripper, other.frame_from_gripper, atol=1e-12)
        assert one.scores["stored"] == other.scores["confidence"]


def test_the_file_holds_the_hands_pose_as_acronym_does(planned, tmp_path: Path) -> None:
    write_grasps(tmp_path / "g.h5", planned.candidates, HAND)
    with h5py.File(tmp_path / "g.h5") as file:
        first = file["grasps/transforms"][0]
        assert file["grasps/qualities/flex/object_in_gripper"].shape == (len(planned),)
    best = planned[0]
    np.testing.assert_allclose(first[:3, 3], best.centre - 0.1034 * best.approach, atol=1e-12)
    np.testing.assert_allclose(first[:3, :3], best.frame_from_gripper[:3, :3], atol=1e-12)


def test_a_mesh_gives_contacts_and_leaves_out_what_misses_it(planned, tmp_path: Path) -> None:
    away = planned[0].frame_from_gripper.copy()
    away[:3, 3] += 1.0
    beside = replace(planned[0], frame_from_gripper=away)
    write_grasps(tmp_path / "g.h5", (*planned.candidates, beside), HAND)
    back = read_grasps(tmp_path / "g.h5", HAND, BOX).candidates
    assert 0 < len(back) <= len(planned)
    for one in back:
        np.testing.assert_allclose(
            np.linalg.norm(np.diff(one.contacts, axis=0)), one.width, atol=1e-12
        )
        assert np.einsum("ij,ij->i", one.normals, [-one.closing, one.closing]).min() > 0


def test_given_grasps_are_ranked_like_own_ones(planned, tmp_path: Path) -> None:
    write_grasps(tmp_path / "g.h5", planned.candidates, HAND)
    given = read_grasps(tmp_path / "g.h5", HAND, BOX).candidates
    found = plan_given(given, BOX, HAND, AROUND, FEW)
    assert found
    assert found[0].scores["carry"] == pytest.approx(planned[0].scores["carry"], abs=0.1)
    assert plan_given((), BOX, HAND).reason == "no given grasp closes on the object"
    under = Surroundings(Support(0.5))
    assert "way to every given grasp" in plan_given(given, BOX, HAND, under, FEW).reason


def _with(path: Path, **sets) -> Path:
    with h5py.File(path, "w") as file:
        for name, value in sets.items():
            file[name.replace("__", "/")] = value
    return path


def test_a_declared_size_is_refused_before_it_is_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "g.h5", "w") as file:  # some kB that stand for 12 TiB
        file.create_dataset("grasps/transforms", (10**11, 4, 4), "f8", chunks=(1000, 4, 4))
    with pytest.raises(ValueError, match="more than 1,000,000 grasps"):
        read_grasps(tmp_path / "g.h5", HAND)


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "no.h5").write_text("grasps")
    with pytest.raises(ValueError, match="no HDF5 file"):
        read_grasps(tmp_path / "no.h5", HAND)
    with pytest.raises(ValueError, match="holds no grasps/transforms"):
        read_grasps(_with(tmp_path / "a.h5", other=[1]), HAND)
    with pytest.raises(ValueError, match=r"expected \(n, 4, 4\)"):
        read_grasps(_with(tmp_path / "b.h5", grasps__transforms=np.eye(4)), HAND)
    with pytest.raises(ValueError, match="rigid"):
        read_grasps(_with(tmp_path / "c.h5", grasps__transforms=2 * np.eye(4)[None]), HAND)
    mirrored = np.diag([1.0, 1.0, -1.0, 1.0])[None]
    with pytest.raises(ValueError, match="rigid"):
        read_grasps(_with(tmp_path / "m.h5", grasps__transforms=mirrored), HAND)
    with pytest.raises(ValueError, match="object/scale holds no numbers"):
        read_grasps(
            _with(tmp_path / "s.h5", grasps__transforms=np.eye(4)[None], object__scale="mm"), HAND
        )
    with pytest.raises(ValueError, match="positive"):
        read_grasps(
            _with(tmp_path / "d.h5", grasps__transforms=np.eye(4)[None], object__scale=0.0), HAND
        )
    with pytest.raises(ValueError, match="qualities"):
        read_grasps(
            _with(tmp_path / "e.h5", grasps__transforms=np.eye(4)[None],
                  grasps__qualities__flex__object_in_gripper=[1, 0]), HAND,
        )  # fmt: skip
