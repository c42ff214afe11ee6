"""Forward kinematics, Jacobian and inverse kinematics of a serial chain, in batches.

Everything is plain numpy over a leading batch dimension: a hundred postures cost little more than
one. Angles are in rad, lengths in m; frames are the robot's base frame unless a name says
otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simulate.robots.description import Arm, Floats, Joint, RobotDescription, transform_from

__all__ = ["Chain", "Goal", "IkOptions", "Tool", "follow_line", "solve_ik"]

_FREE_DOF = 6
_SOFT, _HARD = 0.004, 0.06


@dataclass(frozen=True)
class Tool:
    """Tool frame in the last link: z = approach axis, x = closing direction.

    Parameters
    ----------
    origin : (3,) float, m
    rotation : (3, 3) float
        Columns x, y, z.
    """

    origin: Floats
    rotation: Floats

    @classmethod
    def of(cls, arm: Arm) -> Tool:
        """Return the tool frame of an arm's hand."""
        z, x = np.array(arm.approach), np.array(arm.closing)
        return cls(np.array(arm.tcp), np.stack([x, np.cross(z, x), z], axis=1))


class Chain:
    """A serial chain of revolute and prismatic joints with a tool at the end.

    Parameters
    ----------
    joints
        From the base to the tip; fixed joints may stand between.
    base_from_root : (4, 4) float
        Pose of the chain's first parent link in the base frame.
    tool
        Tool frame in the last link.
    """

    def __init__(self, joints: Sequence[Joint], base_from_root: Floats, tool: Tool) -> None:
        self.names = tuple(joint.name for joint in joints if joint.kind != "fixed")
        self.links = tuple(joint.child for joint in joints if joint.kind != "fixed")
        moving, fixed_before = [], np.asarray(base_from_root, dtype=np.float64)
        for joint in joints:
            fixed_before = fixed_before @ transform_from(joint.pose.xyz, joint.pose.rpy)
            if joint.kind != "fixed":
                moving.append((joint, fixed_before))
                fixed_before = np.eye(4)
        tail = fixed_before
        self._origins = np.array([origin[:3, 3] for _, origin in moving])
        self._rotations = np.array([origin[:3, :3] for _, origin in moving])
        # Most joints of a URDF have no turn of their own, whose product would be half of the work.
        self._rotates = [not np.allclose(rotation, np.eye(3)) for rotation in self._rotations]
        axes = np.array([joint.axis for joint, _ in moving], dtype=np.float64)
        self._axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        self.slides = np.array([joint.kind == "prismatic" for joint, _ in moving])
        """Which joints (dof,) are prismatic."""
        self._skews = np.array([_skew(axis) for axis in self._axes])
        self._squares = self._skews @ self._skews
        self.lower = np.array([joint.lower for joint, _ in moving])
        self.upper = np.array([joint.upper for joint, _ in moving])
        self.velocity = np.array([joint.velocity for joint, _ in moving])
        self.effort = np.array([joint.effort for joint, _ in moving])
        self.evaluations = 0
        """Number of postures whose forward kinematics were computed: the work done so far."""
        self.tool = Tool(tail[:3, :3] @ tool.origin + tail[:3, 3], tail[:3, :3] @ tool.rotation)

    @classmethod
    def of(cls, robot: RobotDescription, arm: str) -> Chain:
        """Return the chain from the root of a robot to the hand of an arm.

        The base frame stands on the floor below the root.
        """
        parts = robot.arm(arm)
        path = robot.path(parts.wrist)
        return cls(path, robot.base_from_root.matrix, Tool.of(parts))

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.names)

    @property
    def orients_freely(self) -> bool:
        """Whether the arm has enough joints for any orientation at a position."""
        return self.dof >= _FREE_DOF

    def link_frames(self, q: Floats) -> tuple[Floats, Floats]:
        """Return the pose of every moving link.

        Parameters
        ----------
        q : (b, dof) float, rad, or m of prismatic joints

        Returns
        -------
        rotations : (b, dof, 3, 3) float
        positions : (b, dof, 3) float, m
            Of the child link of each joint, in the base frame.
        """
        q = np.atleast_2d(q)
        if q.ndim != 2 or q.shape[1] != self.dof:
            raise ValueError(f"expected joint values of shape (b, {self.dof}) rad, got {q.shape}")
        batch = len(q)
        self.evaluations += batch
        # A prismatic joint does not turn, so its Rodrigues term becomes the identity.
        angles = np.where(self.slides, 0.0, q)
        sin, cos = np.sin(angles)[:, :, None, None], 1.0 - np.cos(angles)[:, :, None, None]
        spins = np.eye(3) + sin * self._skews + cos * self._squares  # Rodrigues
        rotations = np.empty((batch, self.dof, 3, 3))
        positions = np.empty((batch, self.dof, 3))
        rotation = np.broadcast_to(np.eye(3), (batch, 3, 3))
        position = np.zeros((batch, 3))
        for i in range(self.dof):
            position = position + rotation @ self._origins[i]
            if self._rotates[i]:
                rotation = rotation @ self._rotations[i]
            if self.slides[i]:
                position = position + q[:, i : i + 1] * (rotation @ self._axes[i])
            rotation = rotation @ spins[:, i]
            rotations[:, i], positions[:, i] = rotation, position
        return rotations, positions

    def tool_poses(self, q: Floats) -> tuple[Floats, Floats]:
        """Return rotation (b, 3, 3) and position (b, 3) of the tool frame for q (b, dof)."""
        rotations, positions = self.link_frames(q)
        return self._tool(rotations, positions)

    def jacobian(self, q: Floats) -> tuple[Floats, Floats, Floats]:
        """Return tool rotation (b, 3, 3), position (b, 3) and geometric Jacobian (b, 6, dof)."""
        rotations, positions = self.link_frames(q)
        rotation, position = self._tool(rotations, positions)
        axes = (rotations @ self._axes[None, :, :, None])[..., 0]
        linear = _cross(axes, position[:, None] - positions)
        if self.slides.any():
            slides = self.slides[:, None]
            linear, axes = np.where(slides, axes, linear), np.where(slides, 0.0, axes)
        jacobian = np.concatenate([linear, axes], axis=2).transpose(0, 2, 1)
        return rotation, position, jacobian

    def _tool(self, rotations: Floats, positions: Floats) -> tuple[Floats, Floats]:
        last = rotations[:, -1]
        return last @ self.tool.rotation, positions[:, -1] + last @ self.tool.origin


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross product along the last axis; numpy's own costs ten times as much here."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def _skew(axis: Floats) -> Floats:
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True)
class Goal:
    """Goal of the tool: a position and the constrained part of its orientation.

    Parameters
    ----------
    position : (3,) float, m
    closing : (3,) float or None
        Desired closing direction; either sign is the same grasp. None only requires a horizontal
        closing axis, which leaves one degree of freedom for round objects.
    approach : (3,) float or None
        Desired approach direction.
    approach_must
        Whether the approach direction is required; otherwise it is followed as far as possible.
    """

    position: Floats
    closing: Floats | None = None
    approach: Floats | None = None
    approach_must: bool = False

    @property
    def approach_weight(self) -> float:
        """Position error (m) that weighs as much as one rad of the approach."""
        return _HARD if self.approach_must else _SOFT


@dataclass(frozen=True)
class IkOptions:
    """Parameters of the damped least squares iteration."""

    starts: int = 24
    iterations: int = 40
    damping: float = 0.002
    closing_weight: float = 0.06
    largest_step: float = 0.35
    limit_margin: float = 0.02
    position_tolerance: float = 0.0015
    angle_tolerance: float = 0.15
    distinct: float = 0.15
    converged: float = 1e-5


def solve_ik(
    chain: Chain,
    goal: Goal,
    rng: np.random.Generator,
    options: IkOptions | None = None,
    warm: Floats | None = None,
) -> Floats:
    """Return all distinct postures that reach a goal.

    Batched damped least squares (Buss 2004) over random starts within the joint limits.

    Parameters
    ----------
    chain
        The arm.
    goal
        The goal of the tool.
    rng
        Source of the random starts.
    options
        Tolerances and numbers of the iteration.
    warm : (w, dof) float or None
        Additional initial postures; with ``options.starts`` = 0 the only ones.

    Returns
    -------
    (k, dof) float, rad
        Best first; k = 0 if the goal cannot be reached.
    """
    options = options or IkOptions()
    lower, upper = chain.lower + options.limit_margin, chain.upper - options.limit_margin
    starts = lower + rng.random((options.starts, chain.dof)) * (upper - lower)
    if warm is not None:
        starts = np.concatenate([np.clip(np.atleast_2d(warm), lower, upper), starts])
    q = starts
    for _ in range(options.iterations):
        rows, residual = _equations(chain, q, goal, options.closing_weight)
        step = _damped_step(rows, residual, 4 * options.damping**2)
        # Far from the goal the linearised step means nothing beyond some tenths of a radian.
        step = np.clip(step, -options.largest_step, options.largest_step)
        before, q = q, np.clip(q + step, lower, upper)
        if np.max(np.abs(q - before)) < options.converged:
            break
    distance, angle = _errors(chain, q, goal)
    order = np.argsort(distance + options.closing_weight * angle, kind="stable")
    good = [
        i
        for i in order
        if distance[i] <= options.position_tolerance and angle[i] <= options.angle_tolerance
    ]
    return _distinct(q[good], options.distinct)


def _equations(chain: Chain, q: Floats, goal: Goal, closing_weight: float) -> tuple[Floats, Floats]:
    """Return the linearised constraints: rows (b, m, dof) and residual (b, m), all in m."""
    rotation, position, jacobian = chain.jacobian(q)
    linear, angular = jacobian[:, :3], jacobian[:, 3:]
    closing = rotation[:, :, 0]
    rows, residuals = [linear], [goal.position - position]
    if goal.closing is not None:
        # Swapping the jaws is the same grasp: turn to the nearer sense.
        sign = np.where(closing @ goal.closing < 0, -1.0, 1.0)[:, None]
        # For small turns the cross product is the rotation vector; the weight makes rad into m.
        rows.append(closing_weight * angular)
        residuals.append(closing_weight * _cross(closing, sign * goal.closing))
    else:
        vertical = _cross(angular.transpose(0, 2, 1), closing[:, None])[:, :, 2]
        rows.append(closing_weight * vertical[:, None])
        residuals.append(-closing_weight * closing[:, 2:3])
    if goal.approach is not None:
        rows.append(goal.approach_weight * angular)
        residuals.append(goal.approach_weight * _cross(rotation[:, :, 2], goal.approach))
    return np.concatenate(rows, axis=1), np.concatenate(residuals, axis=1)


def _damped_step(rows: Floats, residual: Floats, damping: float) -> Floats:
    transposed = rows.transpose(0, 2, 1)
    normal = transposed @ rows + damping * np.eye(rows.shape[2])
    solved = np.linalg.solve(normal, transposed @ residual[:, :, None])
    return np.asarray(solved[..., 0], dtype=np.float64)


def _errors(chain: Chain, q: Floats, goal: Goal) -> tuple[Floats, Floats]:
    """Return the position error (b,) m and the angle (b,) rad by which the hand is turned off."""
    rotation, position = chain.tool_poses(q)
    distance = np.linalg.norm(position - goal.position, axis=1)
    closing = rotation[:, :, 0]
    if goal.closing is None:
        angle = np.abs(np.arcsin(np.clip(closing[:, 2], -1, 1)))
    else:
        angle = np.arccos(np.clip(np.abs(closing @ goal.closing), 0, 1))
    if goal.approach is not None and goal.approach_must:
        off = np.arccos(np.clip(rotation[:, :, 2] @ goal.approach, -1, 1))
        angle = np.maximum(angle, off)
    return distance, angle


def _distinct(q: Floats, distance: float) -> Floats:
    distinct: list[Floats] = []
    for candidate in q:
        if all(np.max(np.abs(candidate - other)) >= distance for other in distinct):
            distinct.append(candidate)
    return np.array(distinct).reshape(-1, q.shape[1])


def follow_line(
    chain: Chain,
    start: Floats,
    offset: Floats,
    *,
    points: int = 8,
    tolerance: float = 0.0025,
    largest_jump: float = 0.6,
    level: bool = False,
) -> Floats | None:
    """Return postures (points + 1, dof) that carry the tool along a straight line.

    The hand keeps its orientation as well as the arm can. None is returned if the tool leaves the
    line by more than ``tolerance`` m or a joint jumps by more than ``largest_jump`` rad.

    Parameters
    ----------
    chain
        The arm.
    start : (dof,) float, rad
    offset : (3,) float, m
        End of the line relative to its start, base frame.
    points, tolerance, largest_jump
        Resolution and limits.
    level
        Allow the hand to rotate about the vertical, with the closing axis kept level.
    """
    rotation, position = chain.tool_poses(start[None])
    closing, approach = rotation[0, :, 0], rotation[0, :, 2]
    options = IkOptions(
        starts=0, iterations=30, position_tolerance=tolerance, angle_tolerance=np.inf
    )
    rng = np.random.default_rng(0)
    line = [np.asarray(start, dtype=np.float64)]
    for fraction in np.linspace(0, 1, points + 1)[1:]:
        goal = Goal(
            position[0] + fraction * offset,
            None if level else closing,
            approach,
            chain.orients_freely,
        )
        postures = solve_ik(chain, goal, rng, options, warm=line[-1][None])
        if len(postures) == 0 or np.max(np.abs(postures[0] - line[-1])) > largest_jump:
            return None
        line.append(postures[0])
    return np.array(line)
