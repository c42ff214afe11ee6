"""A gripper without an arm: good grasps hold, bad ones do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grasp.spatial.frames import pose_from_planar
from grasp.spatial.gripper import panda_hand
from simulate.grasping.floating import FloatingGripper, execute, settle, spawn_parts
from simulate.world.objects import Friction, ObjectSpec
from simulate.world.world import World

HAND = panda_hand()
BOX = ObjectSpec("box", (0.04, 0.06, 0.05), 0.1, 1, "box-under-test", Friction(lateral=0.5))


@pytest.mark.parametrize(
    ("x", "y", "theta", "held"),
    [(0.34, 0.0, 0.0, True), (0.34, 0.0, np.pi / 2, True), (0.34, 0.06, 0.0, False)],
    ids=["across", "along", "beside"],
)
def test_a_box_is_held_where_the_jaws_close_on_it(
    x: float, y: float, theta: float, held: bool
) -> None:
    with World("fast") as world:
        world.add_table(0.0)
        body = world.spawn(BOX, (0.34, 0.0))
        rest = settle(world, body)
        pose = pose_from_planar(x, y, 0.025, theta)
        done = execute(world, body, HAND, np.asarray(pose), 0.08, rest)
        assert done.held is held
        if held:
            assert done.lifted_m == pytest.approx(0.1, abs=0.01)
            assert done.gap_m == pytest.approx(0.04 if theta == 0 else 0.06, abs=0.003)
        else:
            assert abs(done.lifted_m) < 0.01


def test_the_gripper_opens_as_told_and_leaves_without_a_trace() -> None:
    with World("fast") as world:
        before = world.client.getNumBodies()
        pose = np.asarray(pose_from_planar(0.3, 0.0, 0.2, 0.3))
        hand = FloatingGripper(world, HAND, pose, 0.05)
        hand.approach()
        assert hand.gap == pytest.approx(0.05, abs=1e-3)
        hand.close()
        assert hand.gap == pytest.approx(0.0, abs=2e-3)
        hand.remove()
        assert world.client.getNumBodies() == before


def test_convex_parts_make_one_object(tmp_path: Path) -> None:
    from grasp.spatial.meshes.shapes import box_mesh

    for k, shift in enumerate((-0.02, 0.02)):
        mesh = box_mesh((0.04, 0.03, 0.03))
        lines = [
            "v {:.6f} {:.6f} {:.6f}".format(*(p + np.array([shift, 0, 0]))) for p in mesh.vertices
        ]
        lines += ["f {} {} {}".format(*(f + 1)) for f in mesh.faces]
        (tmp_path / f"{k}.obj").write_text("\n".join(lines))
    with World("fast") as world:
        world.add_table(0.0)
        body = spawn_parts(world, sorted(tmp_path.glob("*.obj")), 0.05)
        world.client.resetBasePositionAndOrientation(body, (0.34, 0, 0.03), (0, 0, 0, 1))
        rest = settle(world, body)
        assert rest.z == pytest.approx(0.015, abs=0.003)
        pose = np.asarray(pose_from_planar(0.34, 0.0, 0.02, np.pi / 2))
        assert execute(world, body, HAND, pose, 0.05, rest).held
