"""A gripper without an arm: good grasps hold, bad ones do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grasp.spatial.frames import pose_from_planar
from grasp.spatial.gripper import nao_hand, panda_hand
from simulate.grasping.floating.execution import (
    Conditions,
    execute,
    settle,
    spawn_parts,
)
from simulate.grasping.floating.hand import FloatingGripper
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
        hand.close(-1)  # there is nothing
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


@pytest.mark.parametrize(
    ("mass", "carried"), [(0.1, True), (1.6, False)], ids=["light", "as heavy as friction lifts"]
)
def test_shaking_takes_what_a_lift_does_not(mass: float, carried: bool) -> None:
    # 20 N at friction .5 bear 2.0 kg at rest; the shaking's 2 g ask for twice as much again.
    heavy = ObjectSpec("box", (0.04, 0.04, 0.05), mass, 1, "box-under-test", Friction(lateral=0.5))
    with World("fast") as world:
        world.add_table(0.0)
        body = world.spawn(heavy, (0.34, 0.0))
        rest = settle(world, body)
        pose = np.asarray(pose_from_planar(0.34, 0.0, 0.025, 0.0))
        shaken = Conditions(friction=0.5, shake=True)
        done = execute(world, body, HAND, pose, 0.06, rest, conditions=shaken)
        assert done.held
        assert done.carried is carried
        assert execute(world, body, HAND, pose, 0.06, rest).carried is None


def test_the_hand_shakes_as_far_as_it_says_and_returns() -> None:
    with World("fast") as world:
        hand = FloatingGripper(world, HAND, np.asarray(pose_from_planar(0.3, 0.0, 0.2, 0.0)), 0.05)
        hand.approach()
        places: list[np.ndarray] = []
        hand.shake(lambda: places.append(np.array(world.client.getLinkState(hand.body, 4)[0])))
        swing = np.ptp(np.array(places), axis=0)
        # Twice 3 cm, a little less while the fading lasts; along y the rocking by 35 degrees adds
        # as much as the wrist is behind the fingertips, 5 cm each way.
        assert 0.05 < swing[0] < 0.065
        assert 0.05 < swing[1] < 0.06 + 2 * 0.05 * np.sin(np.deg2rad(35))
        assert np.linalg.norm(places[-1][:2] - places[0][:2]) < 0.002
        hand.remove()


def test_a_weight_beside_the_centre_turns_the_object_in_the_hand() -> None:
    with World("fast") as world:
        world.add_table(0.0)
        body = world.spawn(BOX, (0.34, 0.0))
        rest = settle(world, body)
        pose = np.asarray(pose_from_planar(0.34, 0.0, 0.025, 0.0))
        turned = [
            execute(
                world, body, HAND, pose, 0.06, rest,
                conditions=Conditions(friction=0.3, com_error=(0.0, off, 0.0)),
            ).turned_rad
            for off in (0.0, 0.3)
        ]  # fmt: skip
        assert turned[0] < 0.05 < turned[1]


def test_every_hand_closes_with_its_own_force() -> None:
    # The NAO's 2 N at friction .5 bear 200 g, the Panda's 20 N ten times as much.
    brick = ObjectSpec("box", (0.03, 0.03, 0.05), 0.4, 1, "box-under-test", Friction(lateral=0.5))
    with World("fast") as world:
        world.add_table(0.0)
        body = world.spawn(brick, (0.34, 0.0))
        rest = settle(world, body)
        pose = np.asarray(pose_from_planar(0.34, 0.0, 0.03, 0.0))
        lifted = [
            execute(world, body, hand, pose, 0.045, rest, conditions=Conditions(0.5)).held
            for hand in (HAND, nao_hand())
        ]
        assert lifted == [True, False]
