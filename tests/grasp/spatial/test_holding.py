"""Scores for lifting and carrying: patches, levers, tapers, order."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.frames import pose_from_planar
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_mesh
from grasp.spatial.gripper import ParallelGripper, panda_hand
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.meshes.bodies import bodies_apart, enclosed_volume
from grasp.spatial.meshes.mesh import Mesh, as_mesh
from grasp.spatial.meshes.shapes import box_mesh, lathed_mesh, sphere_mesh
from grasp.spatial.scoring.confidence import PoseNoise, score_grasps
from grasp.spatial.scoring.holding import (
    CARRY_G,
    LIFT_G,
    Demand,
    assumed_mass,
    demands,
    hold_shares,
    with_holding,
)
from grasp.spatial.scoring.pads import PadContacts, pad_contacts
from grasp.spatial.scoring.promises import Promises
from grasp.spatial.scoring.select import rank, rank_by_holding

HAND = panda_hand()
EXACT = np.eye(4)[None]


def _pressed(mesh: Mesh, pose: np.ndarray, hand: ParallelGripper = HAND) -> PadContacts:
    return pad_contacts(mesh, pose[None], hand, EXACT, np.array([hand.max_opening]))


def _down(x: float = 0.0, z: float = 0.0) -> np.ndarray:
    return np.asarray(pose_from_planar(x, 0.0, z, 0.0))


def test_a_face_fills_the_pads_and_a_ball_touches_their_middle() -> None:
    face = _pressed(box_mesh((0.04, 0.1, 0.2)), _down())
    assert face.met.all()
    assert face.rays.tolist() == [[[21.0, 21.0]]]
    assert face.gap[0, 0] == pytest.approx(0.04)
    # Of a rectangle of 20 by 54 mm in 3 by 7 points.
    grid = np.hypot(0.02 / 3 * np.sqrt(2 / 3), 0.054 / 7 * 2)
    assert face.radius == pytest.approx(grid, abs=1e-9)
    ball = _pressed(sphere_mesh(0.02, 48), _down())
    assert ball.met.all()
    assert ball.rays.max() < 4
    assert ball.radius.max() < face.radius.min()


def test_normals_and_levers_are_in_the_gripper() -> None:
    box = box_mesh((0.04, 0.1, 0.2))
    pressed = _pressed(box, _down(z=0.03))
    assert np.allclose(pressed.normals[0, 0], [[-1, 0, 0], [1, 0, 0]])
    # Straight down, the centre of mass is 3 cm beyond the tips' middle; the pads' own middle is
    # 18 mm behind it, as fingers reach 45 mm up and 9 mm down.
    assert pressed.lever[0, 0] == pytest.approx([0.0, 0.0, 0.03 + 0.018], abs=1e-9)


def test_what_lies_between_no_pads_is_not_met() -> None:
    far = _pressed(box_mesh((0.02, 0.02, 0.02)), _down(x=0.2))
    assert not far.met.any()
    assert hold_shares(far, demands(far, HAND, 0.1)).tolist() == [[0.0]]
    nothing = pad_contacts(as_mesh([], []), _down()[None], HAND, EXACT, np.array([0.08]))
    assert not nothing.met.any()


def _share(pressed: PadContacts, mass: float, g: float, friction: float | None = None) -> float:
    return float(hold_shares(pressed, demands(pressed, HAND, mass, friction), g)[0, 0])


def test_more_mass_a_longer_lever_and_less_friction_hold_less() -> None:
    bar = box_mesh((0.03, 0.02, 0.3))
    near, far = _pressed(bar, _down()), _pressed(bar, _down(z=0.08))
    assert 1 >= _share(near, 0.2, LIFT_G) > _share(far, 0.2, LIFT_G) > _share(far, 0.6, LIFT_G) > 0
    assert _share(far, 0.2, LIFT_G) > _share(far, 0.2, CARRY_G)
    assert _share(far, 0.2, LIFT_G, 0.8) > _share(far, 0.2, LIFT_G, 0.3)


def test_a_taper_slides_out_and_parallel_faces_that_are_turned_do_not() -> None:
    wedge = lathed_mesh([(0.030, -0.03), (0.006, 0.03)])
    pressed = _pressed(wedge, _down())
    assert demands(pressed, HAND, 0.1).taper[0, 0] > 0.6
    block = box_mesh((0.04, 0.04, 0.1))
    turned = _down()
    c, s = np.cos(0.2), np.sin(0.2)
    turned[:3, :3] = turned[:3, :3] @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    assert demands(_pressed(block, turned), HAND, 0.1).taper[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert _share(pressed, 0.1, LIFT_G) < _share(_pressed(block, turned), 0.1, LIFT_G)


def test_holding_adds_its_scores_and_keeps_the_others() -> None:
    box = box_mesh((0.04, 0.06, 0.1))
    candidate = GraspCandidate(_down(), 0.04, opening=0.06, scores={"confidence": 0.5})
    (found,) = with_holding([candidate], box, HAND, 0.1, PoseNoise(0.0, 0.0), samples=1)
    assert found.scores["confidence"] == 0.5
    assert found.scores["load"] == pytest.approx(0.1 * 9.81 / (2 * HAND.friction * HAND.max_force))
    promised = Promises.by(HAND).of(found.scores)
    assert set(promised) == {"lift_chance", "lift_at_least", "carry_chance", "carry_at_least"}
    assert promised.items() <= found.scores.items()
    taught = Promises.by(HAND).after([(found.scores, {"lift": False, "carry": False})] * 30)
    (less,) = with_holding(
        [candidate], box, HAND, 0.1, PoseNoise(0.0, 0.0), samples=1, promises=taught
    )
    assert all(less.scores[name] < found.scores[name] for name in promised)
    assert 0 < found.scores["carry"] < found.scores["lift"] <= 0.65 + 0.35 * 0.5
    assert found.scores["lever"] == pytest.approx(0.0, abs=1e-9)
    assert with_holding([], box, HAND, 0.1) == []


def _scored(lift: float, carry: float, lever: float, down: float = 1.0) -> GraspCandidate:
    pose = np.eye(4)
    pose[:3, 2] = (np.sqrt(1 - down**2), 0.0, -down)
    return GraspCandidate(pose, 0.04, scores={"lift": lift, "carry": carry, "lever": lever})


def test_what_is_nearly_as_good_goes_by_lever_and_then_by_steepness() -> None:
    best, near = _scored(0.9, 0.7, 0.04), _scored(0.88, 0.7, 0.001)
    steep, worse = _scored(0.9, 0.69, 0.001, 1.0), _scored(0.7, 0.6, 0.0)
    near = replace(near, frame_from_gripper=_scored(0, 0, 0, 0.9).frame_from_gripper)
    up = np.array([0.0, 0.0, 1.0])
    assert rank_by_holding([best, near, steep, worse], up) == [steep, near, best, worse]
    assert rank_by_holding([worse, best]) == [best, worse]
    assert rank_by_holding([]) == []
    no_number = replace(best, scores={**best.scores, "carry": float("nan")})
    assert rank_by_holding([no_number, worse]) == [worse, no_number]


def test_from_the_side_counts_less_than_from_above() -> None:
    side, above = _scored(0.9, 0.7, 0.0, 0.0), _scored(0.8, 0.6, 0.0, 1.0)
    assert rank_by_holding([side, above], np.array([0.0, 0.0, 1.0])) == [above, side]
    assert rank_by_holding([side, above]) == [side, above]


def test_without_all_scores_the_confidence_ranks() -> None:
    sure = GraspCandidate(np.eye(4), 0.04, scores={"confidence": 0.9})
    held = replace(_scored(0.9, 0.9, 0.0), scores={**_scored(0.9, 0.9, 0.0).scores,
                                                   "confidence": 0.1})  # fmt: skip
    assert rank([held, sure]) == [sure, held]
    assert rank([held])[0] is held


def test_central_pairs_lie_flat_and_near_the_centre_of_mass() -> None:
    bar = box_mesh((0.03, 0.3, 0.03))
    around = Surroundings(Support(-0.015))
    without = propose_on_mesh(bar, HAND, around, central=0)
    both = propose_on_mesh(bar, HAND, around)
    added = both.candidates[len(without) :]
    assert [c.frame_from_gripper.tolist() for c in both.candidates[: len(without)]] == [
        c.frame_from_gripper.tolist() for c in without
    ]
    assert added
    nearest = min(float(np.linalg.norm(c.contacts.mean(axis=0))) for c in added)
    assert nearest < 0.01
    for one in added:
        assert abs(one.normals[1] @ one.closing) == pytest.approx(1.0, abs=1e-9)


def test_a_plan_orders_a_heavy_bar_by_its_middle() -> None:
    bar = box_mesh((0.03, 0.3, 0.03))
    around = Surroundings(Support(-0.015))
    found = plan_on_mesh(bar, HAND, around, SpatialOptions(mass=0.6))
    assert abs(found[0].centre[1]) < 0.015
    assert {"lift", "carry", "lever", "confidence", "epsilon"} <= set(found[0].scores)
    assert found[0].scores["carry"] < found[0].scores["lift"]


def test_an_unknown_mass_is_assumed_and_said() -> None:
    assert assumed_mass(box_mesh((0.05, 0.1, 0.1))) == pytest.approx(0.35)
    assert assumed_mass(box_mesh((0.01, 0.01, 0.01))) == 0.03
    assert assumed_mass(box_mesh((0.2, 0.2, 0.2))) == 1.0
    found = plan_on_mesh(box_mesh((0.05, 0.1, 0.1)), HAND)
    assert any("assumed mass of 0.35 kg" in note for note in found.notes)
    told = plan_on_mesh(box_mesh((0.05, 0.1, 0.1)), HAND, options=SpatialOptions(mass=0.2))
    assert not any("assumed" in note for note in told.notes)


def _two_boxes(offset: float) -> Mesh:
    box = box_mesh((0.1, 0.06, 0.04))
    moved = box.vertices + np.array([offset, 0.0, 0.0])
    return as_mesh(
        np.vstack([box.vertices, moved]), np.vstack([box.faces, box.faces + len(box.vertices)])
    )


@pytest.mark.parametrize("offset", [0.03, 0.05, 0.25])
def test_space_that_two_bodies_share_counts_once(offset: float) -> None:
    both = 0.06 * 0.04 * (0.1 + min(offset, 0.1))
    assert enclosed_volume(_two_boxes(offset)) == pytest.approx(both, rel=0.02)


def test_a_hollow_body_is_not_filled() -> None:
    outer, inner = box_mesh((0.1, 0.1, 0.1)), box_mesh((0.08, 0.08, 0.08))
    hollow = as_mesh(
        np.vstack([outer.vertices, inner.vertices]),
        np.vstack([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)]),
    )
    assert enclosed_volume(hollow) == pytest.approx(1e-3 - 0.08**3, rel=0.05)


def test_bodies_that_lie_apart_are_told_from_one_in_parts() -> None:
    assert len(bodies_apart(_two_boxes(0.1))) == 1
    first, second = bodies_apart(_two_boxes(0.25))
    assert first.extent.tolist() == pytest.approx(second.extent.tolist())


def test_a_flat_mesh_encloses_nothing() -> None:
    assert enclosed_volume(as_mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])) == 0.0


@pytest.mark.slow
def test_closing_quality_by_epsilon_keeps_its_own_order() -> None:
    box = box_mesh((0.04, 0.06, 0.1))
    found = plan_on_mesh(box, HAND, options=SpatialOptions(quality="epsilon", samples=5, tries=200))
    assert found
    assert "carry" not in found[0].scores
    scored = score_grasps(list(propose_on_mesh(box, HAND, tries=200)), box, HAND, samples=5)
    assert all("carry" not in c.scores for c in scored)


def test_an_acceleration_asks_for_as_many_times_the_force():
    contacts = SimpleNamespace(met=np.ones((1, 1), bool))

    def share(force: float, torque: float, taper: float, acceleration: float) -> float:
        demand = Demand(*(np.full((1, 1), value) for value in (force, torque, taper)))
        return float(hold_shares(contacts, demand, acceleration)[0, 0])

    assert share(0.3, 0.2, 0.4, 2.0) == pytest.approx(share(0.6, 0.4, 0.4, 1.0))
    alone = [share(*(0.7 * (k == n) for k in range(3)), 1.0) for n in range(3)]
    assert alone == pytest.approx([alone[0]] * 3)
