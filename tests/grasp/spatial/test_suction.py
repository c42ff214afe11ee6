"""A suction cup is put where its lip seals and its vacuum bears the load; physics agrees."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from grasp.messages import spatial_grasp_message
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.contact_plan import plan_contacts_on_scene
from grasp.spatial.grasp_plan import SpatialOptions
from grasp.spatial.gripper import panda_hand
from grasp.spatial.gripper_files import end_effector_from_data, end_effector_named, gripper_named
from grasp.spatial.meshes.mesh import Mesh, as_mesh
from grasp.spatial.meshes.shapes import box_mesh, cup_mesh, sphere_mesh
from grasp.spatial.scoring.holding import assumed_mass
from grasp.spatial.suction import (
    asked_of_vacuum,
    plan_suction,
    plan_suction_on_cloud,
    sealed,
)
from grasp.spatial.suction_cup import SuctionCup
from rtask.cli import cli
from simulate.grasping.floating.cup import FloatingCup, execute_suction
from simulate.grasping.floating.execution import Conditions, settle, spawn_parts
from simulate.study.quality.objects import GraspObject
from simulate.world.objects import Friction
from simulate.world.world import World

CUP = SuctionCup("cup")
BOX = box_mesh((0.10, 0.06, 0.04))
ON_TABLE = Surroundings(Support(-0.02))


def from_above(x: float, y: float, z: float) -> np.ndarray:
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = x, y, z
    return pose


EYE = np.array([0.4, 0.0, 0.5])


def view_of(mesh: Mesh, noise: float = 0.001) -> np.ndarray:
    """Points of a convex mesh that face the camera, m, with the noise of its depth."""
    rng = np.random.default_rng(0)
    points, faces = mesh.sample(20_000, rng)
    seen = np.einsum("ij,ij->i", mesh.normals[faces], EYE - points) > 0
    return points[seen] + rng.normal(0, noise, (int(seen.sum()), 3))


def short_of(pose: np.ndarray) -> np.ndarray:
    """The pose 5 mm before contact, from where the noise of a cloud does not matter."""
    moved = pose.copy()
    moved[:3, 3] -= 0.005 * pose[:3, 2]
    return moved


@pytest.mark.parametrize(
    "mesh",
    [BOX, box_mesh((0.20, 0.15, 0.004)), box_mesh((0.05, 0.05, 0.12))],
    ids=["box", "plate", "tower"],
)
def test_a_lip_planned_on_one_view_seals_on_the_whole_object(mesh: Mesh) -> None:
    low = float(mesh.vertices[:, 2].min())
    found = plan_suction_on_cloud(view_of(mesh), CUP, Support(low), EYE[None])
    assert "assumed mass" in " ".join(found.notes)
    poses = np.stack([short_of(one.frame_from_gripper) for one in list(found)[:10]])
    assert sealed(mesh, CUP, poses).all()
    # Only what the camera saw is taken: the top, and the side towards it.
    assert all(one.approach[2] < -0.9 or one.approach[0] < -0.9 for one in found)


def test_a_cloud_without_a_place_says_why_and_moves_with_the_object() -> None:
    found = plan_suction_on_cloud(view_of(BOX), SuctionCup("wide", radius=0.05), Support(-0.02))
    assert not found
    assert "seals nowhere" in found.reason
    assert plan_suction_on_cloud(np.zeros((5, 3)), CUP).reason == "all points lie in one place"


def test_in_a_scene_each_thing_is_taken_with_the_others_in_the_way() -> None:
    low = view_of(box_mesh((0.06, 0.06, 0.04))) + np.array([0.0, 0.0, 0.02])
    tall = view_of(box_mesh((0.06, 0.06, 0.10))) + np.array([0.0, 0.064, 0.05])
    points = np.vstack([low, tall, tall[:10] + np.array([0.2, 0.0, 0.0])])
    labels = np.repeat([1, 2, 3], [len(low), len(tall), 10])
    found = plan_contacts_on_scene(points, labels, CUP, Support(0.0), EYE[None])
    assert {one.segment for one in found} == {1, 2}
    assert any("thing 3: fewer than" in note for note in found.notes)
    # A cup on the low box keeps its stem, 12 mm in radius, off the wall beside it at y = .034.
    assert max(one.centre[1] for one in found if one.segment == 1) < 0.034 - 0.011
    nothing = plan_contacts_on_scene(points, np.zeros(len(points), int), CUP, Support(0.0))
    assert nothing.reason == "the scene holds nothing"


def test_a_lip_seals_on_a_face_and_not_over_its_edge_or_a_hole() -> None:
    inside, over = from_above(0, 0, 0.02), from_above(0.045, 0, 0.02)
    near = from_above(0.0345, 0.0, 0.02)  # half a millimetre of the face is left beside the lip
    assert sealed(BOX, CUP, np.stack([inside, over, near])).tolist() == [True, False, True]
    pipe = cup_mesh(radius=0.03, height=0.1, wall=0.004)
    assert not sealed(pipe, CUP, from_above(0.015, 0, 0.05)[None])[0]  # half over the opening
    assert sealed(pipe, CUP, from_above(0, 0, -0.046)[None])[0]  # on its bottom, from within


def test_a_soft_lip_seals_on_a_sphere_where_a_stiff_one_does_not() -> None:
    ball = sphere_mesh(0.03)
    top = from_above(0, 0, 0.03)[None]
    # A lip of 15 mm on a sphere of 30 mm: its ring is level, and the middle sticks out by 4 mm.
    assert sealed(ball, CUP, top)[0]
    beside = top.copy()
    beside[0, 0, 3] = 0.008
    stiff = replace(CUP, compliance=0.002)
    assert sealed(ball, replace(CUP, compliance=0.02), beside)[0]
    assert not sealed(ball, stiff, beside)[0]


def test_what_the_vacuum_bears() -> None:
    force = CUP.force
    none = np.zeros(3)
    pull = np.array([0, 0, 0.5 * force])
    assert asked_of_vacuum(CUP, pull, none) == 0
    assert asked_of_vacuum(CUP, 2.01 * pull, none) == np.inf
    # Half of the force is left: a quarter of the whole across it is just what friction .5 bears.
    shear = np.array([0.25 * force, 0, 0])
    assert asked_of_vacuum(CUP, pull + shear, none) == pytest.approx(1)
    tipping = np.array([0, force * CUP.radius, 0])
    assert asked_of_vacuum(CUP, none, tipping) == pytest.approx(1)
    # Against the object, load adds to the vacuum.
    assert asked_of_vacuum(CUP, shear - pull, none) < asked_of_vacuum(CUP, shear, none)


def test_the_plan_comes_from_above_near_the_middle_and_moves_with_the_object() -> None:
    found = plan_suction(BOX, CUP, ON_TABLE, SpatialOptions(mass=0.3))
    best = found[0]
    assert best.approach == pytest.approx([0, 0, -1], abs=1e-9)
    assert np.linalg.norm(best.centre[:2]) < 0.02
    assert 0 <= best.scores["carry"] <= best.scores["lift"] <= best.scores["confidence"] <= 1
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz", [0.3, -0.7, 1.1]).as_matrix()
    turn[:3, 3] = 0.4, -0.2, 0.1
    up = turn[:3, 2]
    support = Support(float(up @ turn[:3, 3]) - 0.02, tuple(float(v) for v in up))
    moved = plan_suction(
        BOX.moved(turn), CUP, Surroundings(support), SpatialOptions(mass=0.3)
    )  # fmt: skip
    # Shaken along other axes, places are ordered a little differently, and others repeat them.
    assert len(moved) == pytest.approx(len(found), abs=2)
    assert moved[0].centre == pytest.approx(turn[:3, :3] @ best.centre + turn[:3, 3], abs=1e-6)


@pytest.mark.parametrize(
    ("mesh", "mass", "words"),
    [
        (box_mesh((0.02, 0.02, 0.1)), 0.1, "seals nowhere"),
        (BOX, 5.0, "42 N of vacuum do not bear 5 kg"),
        (as_mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), 0.1, "no face"),
    ],
)
def test_without_a_place_the_plan_says_why(mesh, mass: float, words: str) -> None:
    found = plan_suction(mesh, CUP, Surroundings(), SpatialOptions(mass=mass))
    assert not found
    assert words in found.reason


def test_an_assumed_mass_orders_places_and_refuses_none() -> None:
    """A vacuum of 1 N does not bear the box as wood, but the box may be of foam."""
    weak = replace(CUP, pressure=1500.0)
    places, _ = BOX.sample(6000, np.random.default_rng(0))
    top = places[places[:, 2] > 0.0199]
    for found in (
        plan_suction(BOX, weak, ON_TABLE),
        plan_suction_on_cloud(top, weak, Support(-0.02), EYE[None]),
    ):
        assert found, found.reason
        assert any("1 N of vacuum do not bear" in note for note in found.notes)
        assert "vacuum too weak" not in found.counts
        # As light as it must be to be taken at all, it hangs from the middle of its top.
        assert found[0].approach[2] < -0.99
        assert np.linalg.norm(found[0].centre[:2]) < 0.01
    assert not plan_suction(BOX, weak, ON_TABLE, SpatialOptions(mass=0.17))


def test_places_that_do_not_bear_an_assumed_mass_come_last() -> None:
    cup = replace(CUP, pressure=12_000.0)
    guessed = plan_suction(BOX, cup, ON_TABLE)
    stated = plan_suction(BOX, cup, ON_TABLE, SpatialOptions(mass=assumed_mass(BOX)))
    assert stated.counts["vacuum too weak"] > 0
    assert len(guessed) > len(stated)
    assert guessed[0].centre == pytest.approx(stated[0].centre)
    assert guessed[-1].scores["carry"] < stated[-1].scores["carry"]


def test_a_cup_is_data_as_grippers_are(tmp_path: Path) -> None:
    data = {"kind": "suction", "name": "vac", "radius": 0.02, "pressure": 50_000}
    for ending, text in (
        ("json", json.dumps(data)),
        ("toml", 'kind = "suction"\nname = "vac"\nradius = 0.02\npressure = 50000'),
    ):
        path = tmp_path / f"cup.{ending}"
        path.write_text(text)
        assert end_effector_named(str(path)) == SuctionCup("vac", radius=0.02, pressure=50_000.0)
        with pytest.raises(ValueError, match="describes a suction cup; two jaws are needed"):
            gripper_named(str(path))
    assert end_effector_named("panda") == panda_hand()
    with pytest.raises(ValueError, match="did you mean 'pressure'"):
        end_effector_from_data({"kind": "suction", "name": "vac", "presure": 1})
    with pytest.raises(ValueError, match="parallel, suction, three-finger, got 'magnet'"):
        end_effector_from_data({"kind": "magnet", "name": "m"})
    with pytest.raises(ValueError, match="radius is positive, got -1"):
        end_effector_from_data({"kind": "suction", "name": "vac", "radius": -1})
    with pytest.raises(ValueError, match=r"as in suction:0\.015"):
        end_effector_named("suction:wide")


def test_the_message_switches_the_vacuum_on_to_grasp() -> None:
    best = plan_suction(BOX, CUP, ON_TABLE)[0]
    message = spatial_grasp_message(best, CUP, "object")
    before, after = message["pre_grasp_posture"], message["grasp_posture"]
    assert before["joint_names"] == after["joint_names"] == ["cup"]
    assert (before["points"][0]["positions"], after["points"][0]["positions"]) == ([0.0], [1.0])


def test_the_command_plans_for_a_cup_and_says_what_it_cannot_do(tmp_path: Path) -> None:
    mesh = tmp_path / "box.obj"
    GraspObject("box", (BOX.vertices,), 0.2).write(tmp_path)
    (tmp_path / "part-0.obj").rename(mesh)
    run = CliRunner().invoke
    done = run(cli, ["grasp", "space", str(mesh), "--gripper", "suction:0.015", "--limit", "2",
                      "--save-plots", str(tmp_path)])  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "lip 30 mm wide, vacuum 42 N" in done.output
    assert (tmp_path / "candidates_3d.svg").exists()
    wide = run(cli, ["grasp", "space", str(mesh), "--gripper", "suction:0.05"])
    assert wide.exit_code == 1
    assert "seals nowhere" in wide.output
    cloud = str(tmp_path / "cloud.npy")
    np.save(cloud, view_of(BOX) + np.array([0, 0, 0.02]))
    done = run(cli, ["grasp", "space", cloud, "--viewpoint", "0.4", "0", "0.5",
                     "--gripper", "suction:0.015", "--json"])  # fmt: skip
    assert done.exit_code == 0, done.output
    assert json.loads(done.output)["grasps"]
    for more, words in (
        (["space", cloud, "--classifier", "shipped"], "--classifier is for grippers"),
        (["scene", str(mesh), "--viewpoint", "0", "0", "1"], "a scene is the cloud of a table"),
    ):
        refused = run(cli, ["grasp", *more, "--gripper", "suction:0.015"])
        assert refused.exit_code != 0
        assert words in refused.output + str(refused.exception)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("x", "mass", "held", "carried"),
    [(0.0, 0.3, True, True), (0.045, 0.3, False, False), (0.03, 1.2, False, False),
     (0.0, 1.2, True, False)],
    ids=["in the middle", "over the edge", "far from the middle", "too heavy to shake"],
)  # fmt: skip
def test_physics_holds_what_the_vacuum_bears(
    tmp_path: Path, x: float, mass: float, held: bool, carried: bool
) -> None:
    parts = GraspObject("box", (BOX.vertices,), mass).write(tmp_path)
    with World("fast") as world:
        world.add_table(0.0)
        before = world.client.getNumBodies()
        body = spawn_parts(world, parts, mass, friction=Friction(lateral=0.5))
        world.client.resetBasePositionAndOrientation(body, (0.34, 0.0, 0.021), (0, 0, 0, 1))
        rest = settle(world, body)
        pose = from_above(rest.position[0] + x, rest.position[1], 0.045)  # 5 mm short of contact
        done = execute_suction(world, body, CUP, pose, rest, Conditions(0.5, shake=True))
        assert (done.held, done.carried) == (held, carried)
        world.remove(body)
        assert world.client.getNumBodies() == before


def test_a_vacuum_holds_what_moves_and_never_a_table() -> None:
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    down[:3, 3] = 0.34, 0.0, 0.0
    with World("fast") as world:
        world.add_table(0.0)
        cup = FloatingCup(world, SuctionCup("cup"), down)
        cup.approach()
        assert not cup.vacuum.seal()
        cup.remove()
        block = world.client.createCollisionShape(
            world.client.GEOM_BOX, halfExtents=[0.03, 0.03, 0.02]
        )
        body = world.client.createMultiBody(0.1, block, -1, (0.34, 0.0, 0.02))
        down[2, 3] = 0.041
        cup = FloatingCup(world, SuctionCup("cup"), down)
        cup.approach()
        assert cup.vacuum.seal()
        assert cup.touches(body) == (True,)
        cup.vacuum.release()
        assert cup.vacuum.held == -1
