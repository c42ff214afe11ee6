"""Workspace maps: the share of closing directions that a gripper reaches in each cell.

The test "positions that the gripper can reach, the gripper's workspace" of Gatto 2016, 4.3:
inverse kinematics and collisions with table, boxes and own body; no path is planned.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rtask.errors import RobotError, UsageError
from simulate.grasping.hand_rules import rules_for
from simulate.grasping.rules import GraspRequest
from simulate.motion.arm_space import ALLOWED, ArmSpace
from simulate.motion.kinematics import Goal, IkOptions, solve_ik
from simulate.robots.description import Floats

__all__ = ["WorkspaceMap", "map_workspace"]

_IK = IkOptions(starts=12, angle_tolerance=0.2, position_tolerance=0.0025)
_ALLOWED = {**ALLOWED, ("table", "finger"): 0.008}
_CELL_PX, _MARGIN_PX, _BAR_PX = 12, 56, 14
_INK = (40, 40, 40)
_LARGEST_TILT = 1.35


@dataclass(frozen=True, eq=False)
class WorkspaceMap:
    """Share of closing directions that a hand reaches.

    Parameters
    ----------
    robot
        Its name.
    x, y : (nx,), (ny,) float, m
        Centres of the cells, base frame.
    heights : (nh,) float, m
        Of the tool, base frame.
    arms
        Names.
    share : (arms, nh, nx, ny) float
        0..1.
    step
        Size of a cell, m.
    """

    robot: str
    x: Floats
    y: Floats
    heights: Floats
    arms: tuple[str, ...]
    share: Floats
    step: float

    @property
    def best(self) -> Floats:
        """Share (nh, nx, ny) of the better arm."""
        best: Floats = self.share.max(axis=0)
        return best

    def area_m2(self, least: float = 0.5) -> dict[float, float]:
        """Return for each height the area (m2) where at least this share is reached."""
        return {
            float(height): float((self.best[i] >= least).sum() * self.step**2)
            for i, height in enumerate(self.heights)
        }

    def write_npz(self, path: Path) -> None:
        """Write the arrays."""
        np.savez_compressed(
            path, x=self.x, y=self.y, heights=self.heights, share=self.share,
            arms=np.array(self.arms), robot=np.array(self.robot),
        )  # fmt: skip

    def write_png(self, path: Path) -> None:
        """Draw one panel for each height, seen from above: x up, y to the left.

        Raises
        ------
        RobotError
            The file cannot be written.
        """
        panels = [self._panel(i) for i in range(len(self.heights))]
        picture = np.concatenate([*panels, _bar(panels[0].shape[0])], axis=1)
        if not cv2.imwrite(str(path), picture):
            raise RobotError(f"cannot write {path}")

    def _panel(self, index: int) -> NDArray[np.uint8]:
        share = self.best[index][::-1, ::-1]
        colours = _colours(share)
        cells = np.kron(colours, np.ones((_CELL_PX, _CELL_PX, 1))).astype(np.uint8)
        height, width = cells.shape[:2]
        panel = np.full((height + 2 * _MARGIN_PX, width + 2 * _MARGIN_PX, 3), 255, np.uint8)
        panel[_MARGIN_PX : _MARGIN_PX + height, _MARGIN_PX : _MARGIN_PX + width] = cells
        area = self.area_m2()[float(self.heights[index])] * 1e4
        _write(panel, f"{self.robot}: tool at {self.heights[index]:.3f} m", (8, 20))
        _write(panel, f"half of the directions: {area:.0f} cm2", (8, 40))
        for k in range(0, len(self.x), max(len(self.x) // 5, 1)):
            row = _MARGIN_PX + int((len(self.x) - k - 0.5) * _CELL_PX)
            _write(panel, f"{self.x[k]:.2f}", (8, row + 4))
        for k in range(0, len(self.y), max(len(self.y) // 5, 1)):
            column = _MARGIN_PX + int((len(self.y) - k - 0.5) * _CELL_PX)
            _write(panel, f"{self.y[k]:+.2f}", (column - 18, height + _MARGIN_PX + 18))
        _write(panel, "x up, y to the left, m", (8, height + _MARGIN_PX + 40))
        return panel


def map_workspace(
    space: ArmSpace,
    *,
    step: float = 0.02,
    heights: tuple[float, ...] = (),
    angles: int = 12,
    seed: int = 0,
) -> WorkspaceMap:
    """Compute the workspace map of a gripper over the table.

    Parameters
    ----------
    space
        Of the robot.
    step
        Size of a cell, m.
    heights
        Of the tool, m, base frame; empty = 3 cm over the table.
    angles
        Number of closing directions over 180 degrees.
    seed
        Of the starts of inverse kinematics.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """
    place = space.robot.workplace
    if not 0.002 <= step <= 0.2:
        raise UsageError(f"step: expected .002 to .2 m, got {step:g}")
    if not 1 <= angles <= 72:
        raise UsageError(f"angles: expected 1 to 72, got {angles}")
    levels = np.array(heights or (place.table_height + 0.03,), dtype=np.float64)
    if not np.isfinite(levels).all() or (levels <= place.table_height).any():
        raise UsageError(f"heights: expected values above the table, {place.table_height:g} m")
    x: Floats = np.arange(place.table_near + step / 2, place.area_x[1] + 0.12, step)
    reach = place.box_centre[1] + place.box_inner / 2
    count = int(np.ceil(reach / step))
    y: Floats = np.asarray((np.arange(-count, count) + 0.5) * step, dtype=np.float64)
    arms = tuple(space.robot.arms)
    share = np.zeros((len(arms), len(levels), len(x), len(y)))
    for index, arm in enumerate(arms):
        cells = _Reach(space, arm, angles, seed)
        for level, height in enumerate(levels):
            for i, along in enumerate(x):
                for k, across in enumerate(y):
                    share[index, level, i, k] = cells.share(np.array([along, across, height]))
    return WorkspaceMap(space.robot.name, x, y, levels, arms, share, step)


class _Reach:
    """Tests the reach of one arm, one closing direction at a time."""

    def __init__(self, space: ArmSpace, arm: str, angles: int, seed: int) -> None:
        self._chain = space.chains[arm]
        request = GraspRequest(0.0, 0.0, 0.0)
        self._approach = rules_for(space.robot.arm(arm)).approach(request)
        self._spheres = space.spheres(arm, 1.0)
        self._around = space.surroundings(arm, space.robot.workplace.table_height, ())
        self._slack = self._spheres.slack(self._around, _ALLOWED)
        self._angles = np.arange(angles) * np.pi / angles
        self._rng = np.random.default_rng(seed)
        _, home = self._chain.link_frames(np.array(space.robot.arm(arm).home)[None])
        self._shoulder = home[0, 0]
        self._longest = float(
            np.linalg.norm(np.diff(home[0], axis=0), axis=1).sum()
            + np.linalg.norm(self._chain.tool.origin)
        )

    def share(self, position: Floats) -> float:
        if np.linalg.norm(position - self._shoulder) > self._longest:
            return 0.0
        return float(np.mean([self._reaches(position, float(a)) for a in self._angles]))

    def _reaches(self, position: Floats, angle: float) -> bool:
        closing = np.array([np.cos(angle), np.sin(angle), 0.0])
        goal = Goal(position, closing, self._approach, self._approach is not None)
        postures = solve_ik(self._chain, goal, self._rng, _IK)
        if len(postures) == 0:
            return False
        rotation, _ = self._chain.tool_poses(postures)
        tilt = np.arccos(np.clip(-rotation[:, 2, 2], -1, 1))
        clear = self._spheres.clearances(postures, self._around, self._slack) >= 0
        return bool((clear & (tilt <= _LARGEST_TILT)).any())


def _colours(share: Floats) -> NDArray[np.uint8]:
    """Return BGR colours (..., 3) of shares 0..1; light grey means out of reach."""
    levels = np.clip(np.rint(share * 255), 0, 255).astype(np.uint8)
    colours = cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)
    colours[share <= 0] = (225, 225, 225)
    return np.asarray(colours, dtype=np.uint8)


def _bar(height: int) -> NDArray[np.uint8]:
    """Return the colour scale."""
    bar = np.full((height, 3 * _BAR_PX + 34, 3), 255, np.uint8)
    length = height - 2 * _MARGIN_PX
    ramp = _colours(np.linspace(1.0, 1e-3, max(length, 2))[:, None])
    bar[_MARGIN_PX : _MARGIN_PX + len(ramp), 4 : 4 + _BAR_PX] = ramp
    for share, row in (("100 %", _MARGIN_PX + 10), ("0 %", _MARGIN_PX + length)):
        _write(bar, share, (6 + _BAR_PX, row))
    return bar


def _write(picture: NDArray[np.uint8], text: str, at: tuple[int, int]) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.42, _INK, 1, cv2.LINE_AA)
