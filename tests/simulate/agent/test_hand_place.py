"""Where a hand closed, in the frame of the product."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simulate.agent.hand_place import describe_product, place_hand
from simulate.world.hidden import Part, Secret
from simulate.world.objects import ObjectSpec
from simulate.world.world import BodyPose


def _robot(base_from_tool: np.ndarray, opening: float) -> Any:
    return SimpleNamespace(
        world_from_base=np.eye(4), tool_pose=lambda arm: base_from_tool,
        finger_opening=lambda arm: opening, arm=lambda arm: SimpleNamespace(mouth=0.08),
    )  # fmt: skip


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_the_place_of_a_hand_turns_with_the_product(yaw: float) -> None:
    turned = Rotation.from_euler("z", yaw)
    pose = BodyPose(np.array([0.3, -0.1, 0.02]), turned.as_quat())
    tool = np.eye(4)
    tool[:3, :3] = (turned * Rotation.from_euler("z", np.pi / 2)).as_matrix()
    tool[:3, 3] = pose.position + turned.apply([0.03, -0.004, 0.01])
    carton = ObjectSpec("carton", (0.1, 0.03, 0.04), 0.05, 1, "carton-1")
    hand = place_hand(cast("Any", _robot(tool, 0.5)), "right_arm", carton, pose)
    assert (hand.along_m, hand.across_m, hand.opening_m) == (0.03, -0.004, 0.04)
    assert hand.angle == pytest.approx(np.pi / 2, abs=1e-3)
    assert hand.width_m == 0.03


def test_a_product_is_described_with_what_it_hides() -> None:
    weak = Part((0.06, 0.03, 0.04), (-0.02, 0.0, 0.0), breaks_at_n=1.5)
    strong = Part((0.04, 0.03, 0.04), (0.03, 0.0, 0.0))
    carton = ObjectSpec(
        "carton", (0.1, 0.03, 0.04), 0.05, 1, "c", secret=Secret(parts=(strong, weak))
    )
    rod = ObjectSpec("rod", (0.12, 0.02, 0.02), 0.1, 1, "r", secret=Secret(mass_offset_m=0.04))
    plain = ObjectSpec("box", (0.05, 0.06, 0.04), 0.1, 1, "b")
    assert describe_product(carton) == {"length_m": 0.1, "weak_m": [-0.05, 0.01], "mass_m": None}
    assert describe_product(rod) == {"length_m": 0.12, "weak_m": None, "mass_m": 0.04}
    assert describe_product(plain) == {"length_m": 0.06, "weak_m": None, "mass_m": None}
