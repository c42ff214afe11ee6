"""Motion of one arm and its hand in an attempt, timed and sensed phase by phase."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rtask.errors import RobotError
from simulate.grasping.attempt.motion_log import MotionLog
from simulate.grasping.judgement import CLOSED_ON_SOMETHING
from simulate.motion.arm_space import SPEED
from simulate.motion.kinematics import follow_line
from simulate.motion.stance import UPRIGHT
from simulate.motion.trajectory import CARRYING_ACCELERATION, Trajectory, reverse, time_path
from simulate.robots.description import Floats
from simulate.world.robot_body import FingerTouch, RobotBody
from simulate.world.world import World

__all__ = ["ArmDrive"]

_CONTROL_S = 0.010
_SETTLE_S = 0.08
_CLOSE_S, _OPEN_S, _REST_S = 0.8, 0.6, 1.0
_TRACKING_RAD = 0.05
_CONTACT_CHECK_S = 0.05
_PRESS_M, _PRESS_SPEED = 0.030, 0.04
"""Along which a cup looks for contact, and its share of the joints' velocity limits."""


class ArmDrive:
    """Moves an arm and its fingers, and keeps what they sensed at the end of each phase.

    Parameters
    ----------
    world, robot
        The physics world and the body in it.
    arm
        Name of the arm.
    on_phase
        Called with the name of each phase at its end.
    """

    def __init__(
        self, world: World, robot: RobotBody, arm: str, on_phase: Callable[[str], None]
    ) -> None:
        self.world, self.robot, self.arm = world, robot, arm
        self.hand = robot.arm(arm)
        self.log = MotionLog(robot, arm)
        self.times: dict[str, float] = {}
        """Duration of each phase that has ended, s."""
        self.touch: dict[str, FingerTouch] = {}
        """The fingers at the end of each phase."""
        self._tool_height: dict[str, float] = {}
        self._on_phase = on_phase
        self._ticks = max(round(_CONTROL_S / world.preset.step_s), 1)
        self._started = self._phase_started = world.time
        self._gave_way = False

    @property
    def elapsed_s(self) -> float:
        """Time since the attempt began, s."""
        return self.world.time - self._started

    @property
    def grips(self) -> bool:
        """Whether something keeps the fingers open."""
        return self.robot.finger_opening(self.arm) > CLOSED_ON_SOMETHING

    @property
    def rise_m(self) -> float:
        """Rise of the tool from closing to the latest phase of the lift, m."""
        heights = [self._tool_height[p] for p in ("close", "lift", "hold") if p in self.times]
        return heights[-1] - heights[0] if heights else 0.0

    def tool_error(self, target: Floats) -> float:
        """Return how far the tool is from a position, (3,) m in the base frame; in m."""
        tool = self.robot.tool_pose(self.arm)[:3, 3]
        return float(np.linalg.norm(tool - target))

    def follow(self, way: Trajectory, watch: bool = False) -> bool:
        """Move the arm along waypoints; return whether it arrived (``watch``: and kept hold)."""
        step = self._ticks * self.world.preset.step_s
        touching, since = True, 0.0
        time = 0.0
        while time < way.duration:
            time += step
            position, velocity = way.at(time)
            self.robot.command_arm(self.arm, position, velocity)
            self.world.step(step)
            self.log.sample()
            since += step
            if watch and since >= _CONTACT_CHECK_S:
                touching, since = touching and self.grips, 0.0
        self.steps(_SETTLE_S)
        error = np.abs(self._joints() - way.positions[-1])
        return touching if watch else bool(np.all(error < _TRACKING_RAD))

    def open(self, opening: float) -> None:
        """Open the fingers to a share of the widest opening."""
        self._fingers(opening, self.hand.open_effort, _OPEN_S)

    def close(self, seconds: float = _CLOSE_S, least: float = 0.0) -> bool:
        """Close the fingers with the hand's effort; a cup moves on until it seals, and back.

        Parameters
        ----------
        seconds
            Time to close.
        least
            Opening, 0..1, below which the fingers stop where they are.

        Returns
        -------
        bool
            Whether they closed that far.
        """
        if self.hand.cup is not None:
            self._seal()
        self._gave_way = False
        self.robot.move_fingers(self.arm, 0.0, self.hand.close_effort)
        for _ in range(max(round(seconds / _CONTROL_S), 1)):
            self.steps(_CONTROL_S)
            opening = self.robot.finger_opening(self.arm)
            if opening < least:
                self._fingers(max(opening, 0.0), self.hand.close_effort, _SETTLE_S)
                self._gave_way = True
                break
        return self._gave_way

    def steps(self, seconds: float) -> None:
        """Let time pass while the arm keeps its command."""
        step = self.world.preset.step_s
        left, part = max(round(seconds / step), 1), max(round(_CONTACT_CHECK_S / step), 1)
        while left > 0:
            self.world.step(min(left, part) * step)
            self.log.sample()
            left -= part

    def start_at_home(self) -> bool:
        """Move straight home if something kept the arm from it; return whether it is there."""
        home, now = self.robot.home(self.arm), self._joints()
        if np.max(np.abs(now - home)) <= _TRACKING_RAD:
            return True
        velocity = SPEED["return"] * self.robot.chains[self.arm].velocity
        return self.follow(time_path(np.stack([now, home]), velocity))

    def go_home(self, free: Trajectory) -> None:
        """Go back along the way on which the arm came from home, and rest."""
        self.follow(reverse(free, 1.0))
        self.start_at_home()
        self._rest()
        self.end("home")

    def withdraw(self, way: Trajectory) -> None:
        """Go home on a way of its own, and rest until the whole phase took its time."""
        self.follow(way)
        self._rest()
        self.steps(_REST_S - (self.world.time - self._phase_started))

    def end(self, phase: str) -> FingerTouch:
        """End a phase: read the fingers, record the duration, call back."""
        self.times[phase] = self.world.time - self._phase_started
        self._phase_started = self.world.time
        touch = self.robot.finger_touch(self.arm)
        if self._gave_way:  # they were told to stop where they are: nothing keeps them there
            touch = FingerTouch(touch.opening)
        self.touch[phase] = touch
        self._tool_height[phase] = float(self.robot.tool_pose(self.arm)[2, 3])
        self._on_phase(phase)
        return touch

    def _seal(self) -> None:
        """Move a cup with its vacuum on along its approach until it holds, and back.

        Where the surface is, the view tells to within some mm; contact tells the rest.
        """
        self.robot.move_fingers(self.arm, 0.0, 0.0)
        chain, start = self.robot.chains[self.arm], self.robot.commanded[self.arm]
        approach = chain.tool_poses(start[None])[0][0, :, 2]
        line = follow_line(chain, start, _PRESS_M * approach)
        if line is None:
            return
        way = time_path(line, _PRESS_SPEED * chain.velocity, CARRYING_ACCELERATION)
        time, step = 0.0, self._ticks * self.world.preset.step_s
        while time < way.duration and not self.grips:
            time += step
            self.robot.command_arm(self.arm, *way.at(time))
            self.world.step(step)
            self.log.sample()
        self.steps(_SETTLE_S)
        here = self.robot.commanded[self.arm]
        back = time_path(
            np.stack([here, start]), _PRESS_SPEED * chain.velocity, CARRYING_ACCELERATION
        )
        self.follow(back)

    def _rest(self) -> None:
        self.robot.rest_hand(self.arm)
        self.robot.take_stance(UPRIGHT)

    def _fingers(self, opening: float, effort: float, seconds: float) -> None:
        self.robot.move_fingers(self.arm, opening, effort)
        self.steps(seconds)

    def _joints(self) -> Floats:
        """Return the arm's measured joints.

        Raises
        ------
        RobotError
            The physics diverged: a joint is not a number, and the world is no longer usable.
        """
        joints = self.robot.arm_joints(self.arm)
        if not np.isfinite(joints).all():
            names = self.robot.chains[self.arm].names
            broken = ", ".join(n for n, q in zip(names, joints, strict=True) if not np.isfinite(q))
            raise RobotError(
                f"the simulation broke down after {self.world.time:.2f} s: {broken} of "
                f"{self.robot.description.name} is not a number; make a new world",
                reason="not_judged",
            )
        return joints
