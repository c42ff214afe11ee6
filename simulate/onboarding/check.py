"""Checks of a robot: reach, touching itself at home, closing on a box, and grasps of products."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from simulate.grasping.executor import Workcell
from simulate.grasping.judgement import CLOSED_ON_SOMETHING
from simulate.onboarding.arms import tip_gap
from simulate.onboarding.touching import SelfContacts
from simulate.onboarding.workplace import reach_share
from simulate.robots import Arm, RobotDescription, describe
from simulate.robots.other_hands import STAND_OFF_M
from simulate.study.declaration import Study
from simulate.study.runner import run
from simulate.world.objects import ObjectSpec

__all__ = ["Finding", "check_closing", "check_grasps", "check_robot_body"]

_ENOUGH_REACH = 0.8
_BOX_M, _BOX_KG = 0.03, 0.05
_OFF_M = 0.006
"""Allowed difference of the measured gap to the box, m: fingers dent, and meshes are hulls."""
_SLANT = 0.5
_BESIDE_M = 0.001
_CLOSE_S = 1.5
_HELD_SHARE = 0.8


@dataclass(frozen=True)
class Finding:
    """Outcome of one check.

    Parameters
    ----------
    name
        Of the check.
    passed
        Whether the robot passes.
    says
        What was found, with figures.
    """

    name: str
    passed: bool
    says: str

    def to_json(self) -> dict[str, Any]:
        """Return the finding as JSON data."""
        return asdict(self)


def check_robot_body(robot: RobotDescription, seed: int = 0) -> Iterator[Finding]:
    """Yield the findings about a robot's body; takes some seconds.

    Parameters
    ----------
    robot
        Its description.
    seed
        Of inverse kinematics.
    """
    share = reach_share(robot, seed=seed)
    yield Finding("reach", share >= _ENOUGH_REACH, f"{share:.0%} of the table and its boxes")
    with SelfContacts(robot) as contacts:
        homes = {name: np.array(arm.home) for name, arm in robot.arms.items()}
        touching = contacts.touching(homes) - set(robot.may_touch)
    pairs = ", ".join(f"{a} and {b}" for a, b in sorted(touching)) or "nothing"
    yield Finding("home", not touching, f"at home it touches {pairs}")
    yield from check_closing(robot)


def check_closing(robot: RobotDescription) -> Iterator[Finding]:
    """Yield, for each hand, whether it closes on a box and further on nothing.

    Parameters
    ----------
    robot
        Its description.
    """
    for arm in robot.arms.values():
        if arm.grip in ("suction_cup", "three_fingers"):
            yield _takes(robot, arm)
            continue
        size = min(_BOX_M, 0.6 * arm.mouth)
        gap = tip_gap(robot, arm, _closed_on(robot, arm, size))
        empty = tip_gap(robot, arm, _closed_on(robot, arm, None))
        says = (
            f"{arm.name} closes to {1000 * gap:.0f} mm on a box of {1000 * size:.0f} mm, "
            f"to {1000 * empty:.0f} mm on nothing"
        )
        wide = size + _OFF_M + _slant(robot, arm) * size
        yield Finding("close", size - _OFF_M <= gap <= wide and gap - empty > _OFF_M, says)


def _slant(robot: RobotDescription, arm: Arm) -> float:
    """Return by which share of a box its tips may stay farther apart than the box is wide.

    A jaw that turns against a fixed one touches the box above its own tip.
    """
    turns = arm.has_single_jaw and robot.joint(arm.fingers[0]).kind == "revolute"
    return _SLANT if turns else 0.0


def _takes(robot: RobotDescription, arm: Arm) -> Finding:
    """Return whether a cup seals on a box, or three fingers close on it, and not on nothing."""
    size = _BOX_M if arm.cup is None else 3 * arm.cup.radius
    held, empty = _closed_on(robot, arm, size), _closed_on(robot, arm, None)
    does = "seals on" if arm.cup is not None else "closes on"
    well = held > CLOSED_ON_SOMETHING > empty
    return Finding(
        "close",
        well,
        f"{arm.name} {does if well else 'does not hold'} a box of {1000 * size:.0f} mm",
    )


def _closed_on(robot: RobotDescription, arm: Arm, size: float | None) -> float:
    """Return the opening (0..1) of a hand closed on a box of a size, m, without gravity."""
    with Workcell(robot, preset="fast") as cell:
        cell.world.client.setGravity(0, 0, 0)
        if size is not None:
            spec = ObjectSpec("box", (size, size, size), _BOX_KG, 0, "check-box")
            body = cell.world.spawn(spec, (0.0, 0.0, 0.0))
            tool = cell.robot.tool_pose(arm.name)
            if arm.cup is not None:  # the lip on its face
                tool[:3, 3] += (size / 2 - STAND_OFF_M) * tool[:3, 2]
            if arm.has_single_jaw:  # as in a grasp, beside the jaw that stands still
                tool[:3, 3] -= ((arm.mouth - size) / 2 - _BESIDE_M) * tool[:3, 0]
            turn = Rotation.from_matrix(tool[:3, :3])
            cell.world.put(body, tool[:3, 3].tolist(), turn.as_quat().tolist())
        cell.robot.move_fingers(arm.name, 0.0, arm.close_effort)
        cell.world.step(_CLOSE_S)
        return max(cell.robot.finger_opening(arm.name), 0.0)


def check_grasps(
    robot: str, grasps: int, folder: Path, *, preset: str, seed: int, workers: int
) -> tuple[Finding, list[Mapping[str, Any]]]:
    """Return the finding about grasps of plain products, and what happened in each.

    Parameters
    ----------
    robot
        Name of the robot.
    grasps
        Number of products, one on the table at a time.
    folder
        For the journal.
    preset, seed, workers
        Of the physics, the products and the processes.
    """
    describe(robot)
    settings = {"robot": robot, "preset": preset, "seed": seed, "max_attempts": 1}
    study = Study("grasps of a robot", "simulate.study.grasping:grasping_trial", settings, grasps)
    rows = run(study, folder, workers)
    held = sum(bool(row["held"]) for row in rows)
    placed = sum(bool(row["placed"]) for row in rows)
    says = f"held {held} and placed {placed} of {grasps} at the first try"
    return Finding("grasps", held >= _HELD_SHARE * grasps, says), list(rows)
