"""Three fingers close on what is round, and physics holds it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from grasp.messages import spatial_grasp_message
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.contact_plan import plan_contacts_on_scene
from grasp.spatial.grasp_plan import SpatialOptions
from grasp.spatial.gripper_files import end_effector_from_data, end_effector_named, gripper_named
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.shapes import box_mesh, cup_mesh, sphere_mesh
from grasp.spatial.three_finger.closing import close
from grasp.spatial.three_finger.hand import WAYS, ThreeFingerHand
from grasp.spatial.three_finger.planning import (
    plan_three_finger,
    plan_three_finger_on_cloud,
)
from rtask.cli import cli
from simulate.grasping.floating.execution import Conditions, settle, spawn_parts
from simulate.grasping.floating.three_finger import execute_three_finger
from simulate.study.quality.objects import GraspObject
from simulate.world.objects import Friction
from simulate.world.world import World

HAND = ThreeFingerHand("centric", 0.1)
BALL = sphere_mesh(0.03)
CAN = cup_mesh(radius=0.03, height=0.1, wall=0.004)
FEW = SpatialOptions(samples=40, mass=0.2)


def from_above(x: float, y: float, z: float) -> np.ndarray:
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = x, y, z
    return pose


def test_fingers_centre_what_they_close_on() -> None:
    """Closed 8 mm beside the axis of a can, the hand touches it 30 mm from it all the same."""
    found = close(CAN, HAND, from_above(0.007, -0.004, 0.02)[None])
    assert found.holds[0]
    assert found.poses[0, :3, 3] == pytest.approx((0.0, 0.0, 0.02), abs=1e-3)
    assert found.radius[0] == pytest.approx(0.03, abs=5e-4)
    assert np.hypot(*found.contacts[0, :, :2].T) == pytest.approx([0.03] * 3, abs=5e-4)


def test_what_does_not_fit_between_the_fingers_is_refused_with_a_reason() -> None:
    wide = plan_three_finger(sphere_mesh(0.06), HAND, options=FEW)
    assert not wide
    assert wide.reason == "three fingers that open to 100 mm close on it nowhere"
    flat = plan_three_finger(box_mesh((0.3, 0.3, 0.01)), HAND, Surroundings(Support(-0.005)), FEW)
    assert not flat


@pytest.mark.parametrize(("mesh", "low"), [(BALL, -0.03), (CAN, -0.05)], ids=["ball", "can"])
def test_round_things_are_taken_from_above_about_their_axis(mesh: Mesh, low: float) -> None:
    found = plan_three_finger(mesh, HAND, Surroundings(Support(low)), FEW)
    best = found[0]
    assert best.approach[2] < -0.99
    assert np.hypot(*best.centre[:2]) < 2e-3
    assert best.width == pytest.approx(0.06, abs=2e-3)
    assert best.contacts is not None
    assert best.contacts.shape == (3, 3)
    assert best.scores["lower_95"] < best.scores["confidence"]
    assert 0.6 < best.scores["carry"] <= best.scores["lift"]
    message = spatial_grasp_message(best, HAND, "table")
    joint = message["grasp_posture"]["points"][0]["positions"][0]
    assert joint == pytest.approx(best.width / 2)


def test_neighbours_and_the_load_count() -> None:
    around = Surroundings(Support(-0.05), np.array([[0.045, 0.0, z] for z in (-0.04, 0.0, 0.05)]))
    alone = plan_three_finger(CAN, HAND, Surroundings(Support(-0.05)), FEW)
    beside = plan_three_finger(CAN, HAND, around, FEW)
    assert len(beside) > 0
    # No finger stands where the neighbour does, 45 mm from the axis.
    for one in beside:
        for way in WAYS:
            finger = one.centre + one.frame_from_gripper[:3, :3] @ (0.045 * way)
            assert abs(one.approach[2]) < 0.9 or np.hypot(*(finger[:2] - (0.045, 0))) > 0.007
    heavy = plan_three_finger(CAN, HAND, Surroundings(Support(-0.05)), replace(FEW, mass=2.0))
    assert heavy[0].scores["carry"] < alone[0].scores["carry"] - 0.3


def test_an_assumed_mass_orders_grasps_and_refuses_none() -> None:
    """Fingers of .1 N do not bear the ball as wood; it may be hollow."""
    weak = replace(HAND, max_force=0.1)
    found = plan_three_finger(BALL, weak, Surroundings(Support(-0.03)), replace(FEW, mass=None))
    assert "ordered for an assumed mass of 0.079 kg" in found.notes
    assert found[0].scores["carry"] < 0.1
    assert not plan_three_finger(replace(BALL, faces=BALL.faces[:0]), weak)


def test_a_view_of_a_can_is_enough() -> None:
    rng, eye = np.random.default_rng(0), np.array([0.4, 0.0, 0.45])
    points, faces = CAN.sample(20_000, rng)
    points = points[np.einsum("ij,ij->i", CAN.normals[faces], eye - points) > 0]
    points = points[np.hypot(*points[:, :2].T) > 0.027]  # no camera sees its inside from here
    found = plan_three_finger_on_cloud(points, HAND, Support(-0.05), eye[None], FEW)
    assert np.hypot(*found[0].centre[:2]) < 6e-3
    assert close(CAN, HAND, np.stack([found[0].frame_from_gripper])).holds[0]
    nothing = plan_three_finger_on_cloud(np.zeros((5, 3)), HAND)
    assert nothing.reason == "all points lie in one place"


def test_in_a_scene_each_thing_is_closed_on_with_the_others_in_the_way() -> None:
    rng = np.random.default_rng(0)
    can = CAN.sample(3000, rng)[0] + np.array([0.0, 0.0, 0.05])
    aside, far = np.array([0.2, 0.0, 0.0]), np.array([0.0, 0.3, 0.0])
    points = np.vstack([can, can + aside, can[:9] + far])
    labels = np.repeat([1, 2, 3], [len(can), len(can), 9])
    found = plan_contacts_on_scene(points, labels, HAND, Support(0.0), options=FEW)
    assert {one.segment for one in found} == {1, 2}
    assert any("thing 3: fewer than" in note for note in found.notes)
    # Beside a wall that leaves the fingers no room, only the other can is taken.
    y, z = np.meshgrid(np.linspace(-0.06, 0.06, 40), np.linspace(0.0, 0.15, 50))
    wall = np.stack([np.full(y.size, -0.034), y.ravel(), z.ravel()], axis=1)
    crowded = np.vstack([points, wall, wall * (-1, 1, 1)])
    labels = np.concatenate([labels, np.zeros(2 * len(wall), int)])
    found = plan_contacts_on_scene(crowded, labels, HAND, Support(0.0), options=FEW)
    assert {one.segment for one in found} == {2}


def test_a_file_or_a_short_text_describes_a_hand(tmp_path: Path) -> None:
    fields = {"kind": "three-finger", "name": "centric", "max_opening": 0.1, "max_force": 60}
    hand = end_effector_from_data(fields)
    assert isinstance(hand, ThreeFingerHand)
    assert hand.max_force == 60
    assert end_effector_named("three:0.1") == ThreeFingerHand("three_finger_hand", 0.1)
    path = tmp_path / "hand.json"
    path.write_text(json.dumps(fields))
    with pytest.raises(ValueError, match="describes a three-finger hand; two jaws are needed"):
        gripper_named(str(path))
    for wrong, words in (
        ({"max_opening": -1}, "max_opening"),
        ({"stroke": 0.1}, "unknown field 'stroke' of a three-finger hand"),
        ({"fingertip": 0.08}, "0 <= fingertip < finger_length"),
    ):
        with pytest.raises(ValueError, match=words):
            end_effector_from_data({**fields, **wrong})
    with pytest.raises(ValueError, match=r"an opening in m, as in three:0\.1"):
        end_effector_named("three:wide")


def test_the_command_line_takes_a_hand(tmp_path: Path) -> None:
    path = tmp_path / "ball.obj"
    lines = ["v {:.6f} {:.6f} {:.6f}".format(*v) for v in BALL.vertices]
    lines += ["f {} {} {}".format(*(face + 1)) for face in BALL.faces]
    path.write_text("\n".join(lines))
    call = ["grasp", "space", str(path), "--gripper", "three:0.1", "--samples", "20"]
    done = CliRunner().invoke(cli, [*call, "--json", "--save-plots", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["grasps"][0]["width"] == pytest.approx(0.06, abs=2e-3)
    stored = CliRunner().invoke(cli, [*call, "--store"])
    assert "object of the graph" in str(stored.exception)


@pytest.mark.parametrize(("mass", "held"), [(0.3, True), (6.0, False)])
def test_physics_holds_what_the_fingers_bear(tmp_path: Path, mass: float, held: bool) -> None:
    """Three fingers of 20 N at friction .5 bear 30 N: 300 g, shaken too, but not 6 kg."""
    angle = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    ring = 0.03 * np.column_stack([np.cos(angle), np.sin(angle)])
    corners = np.vstack([np.column_stack([ring, np.full(32, z)]) for z in (-0.04, 0.04)])
    parts = GraspObject("can", (corners,), mass).write(tmp_path)
    with World("fast") as world:
        world.add_table(0.0)
        body = spawn_parts(world, parts, mass, friction=Friction(lateral=0.5))
        world.client.resetBasePositionAndOrientation(body, (0.34, 0.0, 0.041), (0, 0, 0, 1))
        rest = settle(world, body)
        # 4 mm beside the axis: the fingers push it to their middle.
        pose = from_above(rest.position[0] + 0.004, rest.position[1], rest.z + 0.015)
        before = world.client.getNumBodies()
        done = execute_three_finger(
            world, body, HAND, pose, 0.08, rest, Conditions(0.5, shake=True)
        )
        assert world.client.getNumBodies() == before
    assert (done.held, done.carried) == (held, held)
    if held:
        assert done.gap_m == pytest.approx(0.06, abs=3e-3)
