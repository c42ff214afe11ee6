"""Collision-free motion of an arm or a point as a service (Kehoe 2014, 5.8).

The thesis wraps trajopt, which optimises; here RRT-Connect with shortcutting plans. Links are thick
lines between the joints; a point is a ball. A planned path is free all along, not only where it was
checked: at each posture that is checked there is room for the way to the next.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from features.geometry import pose_matrix
from rtask.errors import ServiceError
from rtask.services import Call, Service, data_resource, method, startup
from rtask.wire.message import Answer
from rtask.wire.types import (
    Array,
    ArrayOf,
    Carried,
    JointTrajectory,
    Number,
    Pose,
    Unit,
    Whole,
)
from simulate.motion.joint_messages import goal_message
from simulate.motion.kinematics import Chain
from simulate.motion.rrt import IsFree, PlanOptions, edge_is_free, plan_path, shortcut
from simulate.motion.trajectory import ACCELERATION, time_path
from simulate.robots.description import Floats
from simulate.services.kinematics import (
    chain_named,
    checked,
    is_body,
    link_ends,
    link_lines,
    read_chains,
)

__all__ = ["Trajopt"]

_RESOLUTION = 0.02
_WORDS = {
    "rrt_start": "start: the robot touches an obstacle there, or nearly",
    "rrt_goal": "goal: the robot touches an obstacle there, or nearly",
    "rrt_time": "no path was found; there may be none",
}
Obstacles = Annotated[
    NDArray[np.float64],
    ArrayOf(4, "m", 500, "[x, y, z, radius]"),
    Carried("string", "Sequence[Sequence[float]]", None),
]
Radius = Annotated[Number, Unit("m"), Ge(0)]


class Path(Answer):
    """A path between two postures."""

    path: list[Array]
    """postures at its corners, with straight lines in joint space between them"""
    length: float
    """sum of the largest joint movements along it, rad or m"""


class Checked(Answer):
    """Whether a path is free."""

    free: bool
    first_blocked: int | None = None
    """number of the first straight piece that touches an obstacle, from 0; null where none does"""


class Posture(Answer):
    """Poses of the robot's links in one posture."""

    joints: Array
    """rad, or m of prismatic joints"""
    links: list[Array]
    """middle line of each link, [x, y, z, x, y, z] in m, in the frame of the root link"""
    pose: Pose
    """of the end of the arm, in the frame of the root link"""
    clearance: Annotated[float | None, Unit("m")] = None
    """from the robot's surface to the nearest obstacle, negative inside; null without obstacles"""


class Traced(Answer):
    """The robot along a path."""

    postures: list[Posture]


class Timed(Answer):
    """A path with its times, as a robot's driver takes it."""

    trajectory: JointTrajectory
    """of a control_msgs/FollowJointTrajectory goal; times as in ROS 1 and in ROS 2"""
    duration_s: Annotated[float, Unit("s")]
    """from its first posture, where the arm has to be, to its last"""


class Trajopt(Service):
    """Motion planning of one robot among balls."""

    name = "example/Trajopt"
    version = "1.2.0"
    robot = data_resource("binary", default="robots/PlanarArm", summary="as for example/Kinematics")

    @startup
    def load(self) -> None:
        """Read the model and make the chains ready."""
        self.chains, _ = read_chains(self.robot.path("/model"))

    @method(effect="reads")
    def plan(
        self,
        manipulator: str,
        start: Array,
        goal: Array,
        call: Call,
        obstacles: Obstacles | None = None,
        link_radius: Radius = 0.02,
        seed: Annotated[Whole, Ge(0)] = 0,
        iterations: Annotated[Whole, Ge(1), Le(20_000)] = 3000,
    ) -> Path:
        """Plan a path around obstacles.

        Parameters
        ----------
        manipulator
            Name of the arm.
        start
            Joint values at its beginning, rad, or m of prismatic joints.
        goal
            Joint values at its end.
        obstacles
            Balls, [[x, y, z, radius], ...] in m, in the frame of the root link; default: none.
        link_radius
            Half the thickness of the links.
        seed
            Of the random samples; the same seed gives the same path.
        iterations
            Largest number of samples.
        """
        chain = chain_named(self.chains, manipulator)
        is_free = _watched(_is_free(chain, obstacles, link_radius, _margin(chain)), call)
        first, last = _inside(chain, start, "start"), _inside(chain, goal, "goal")
        rng = np.random.default_rng(seed)
        options = PlanOptions(resolution=_RESOLUTION, iterations=iterations)
        path = plan_path(first, last, chain.lower, chain.upper, is_free, rng, options)
        if isinstance(path, str):
            raise ServiceError(_WORDS[path], reason=path)
        return _answer(path)

    @method
    def check(
        self,
        manipulator: str,
        path: list[Array],
        obstacles: Obstacles | None = None,
        link_radius: Radius = 0.02,
    ) -> Checked:
        """Tell whether a path touches no obstacle.

        Parameters
        ----------
        manipulator
            Name of the arm.
        path
            Postures at its corners.
        obstacles
            Balls, [[x, y, z, radius], ...] in m; default: none.
        link_radius
            Half the thickness of the links.
        """
        chain = chain_named(self.chains, manipulator)
        is_free = _is_free(chain, obstacles, link_radius)
        corners = _corners(chain, path)
        for number, (a, b) in enumerate(itertools.pairwise(corners)):
            if not edge_is_free(a, b, is_free, _RESOLUTION):
                return Checked(free=False, first_blocked=number)
        return Checked(free=True)

    @method
    def smooth(
        self,
        manipulator: str,
        path: list[Array],
        obstacles: Obstacles | None = None,
        link_radius: Radius = 0.02,
        tries: Annotated[Whole, Ge(1), Le(2000)] = 100,
        seed: Annotated[Whole, Ge(0)] = 0,
    ) -> Path:
        """Shorten a free path by straight lines between its points.

        Parameters
        ----------
        manipulator
            Name of the arm.
        path
            Postures at its corners; free of obstacles.
        obstacles
            Balls, [[x, y, z, radius], ...] in m; default: none.
        link_radius
            Half the thickness of the links.
        tries
            Number of shortcuts to try.
        seed
            Of their choice.
        """
        chain = chain_named(self.chains, manipulator)
        is_free = _is_free(chain, obstacles, link_radius, _margin(chain))
        options = PlanOptions(resolution=_RESOLUTION, shortcuts=tries)
        rng = np.random.default_rng(seed)
        return _answer(shortcut(_corners(chain, path), is_free, rng, options))

    @method
    def time(
        self,
        manipulator: str,
        path: list[Array],
        obstacles: Obstacles | None = None,
        link_radius: Radius = 0.02,
        speed: Annotated[Number, Gt(0), Le(1)] = 0.3,
        acceleration: Annotated[Number, Gt(0), Le(100)] = ACCELERATION,
    ) -> Timed:
        """Give a path times, so that a robot can follow it (Gatto 2016, 4.2).

        Corners are rounded where that touches no obstacle; elsewhere the robot stops at them.

        Parameters
        ----------
        manipulator
            Name of the arm.
        path
            Postures at its corners; free of obstacles.
        obstacles
            Balls, [[x, y, z, radius], ...] in m; default: none.
        link_radius
            Half the thickness of the links.
        speed
            Share of the joints' velocity limits.
        acceleration
            Largest of every joint, rad/s^2 (m/s^2).
        """
        chain = chain_named(self.chains, manipulator)
        is_free = _is_free(chain, obstacles, link_radius)
        way = time_path(_corners(chain, path), speed * chain.velocity, acceleration, is_free)
        trajectory = goal_message(way, chain.names)["trajectory"]
        return Timed(trajectory=trajectory, duration_s=way.duration)

    @method
    def trace(
        self,
        manipulator: str,
        path: list[Array],
        obstacles: Obstacles | None = None,
        link_radius: Radius = 0.02,
        samples: Annotated[Whole, Ge(1), Le(500)] = 60,
    ) -> Traced:
        """Show where the robot is along a path, and how near the obstacles are.

        Parameters
        ----------
        manipulator
            Name of the arm.
        path
            Postures at its corners; a single one is shown by itself.
        obstacles
            Balls, [[x, y, z, radius], ...] in m; default: none.
        link_radius
            Half the thickness of the links.
        samples
            Number of postures, at equal distances in joint space, both ends included.
        """
        chain = chain_named(self.chains, manipulator)
        q = _sampled(_corners(chain, path, at_least=1), samples)
        links = link_lines(chain, q)
        rotations, positions = chain.tool_poses(q)
        near = _clearance(chain, obstacles, link_radius)(q)
        frames = [
            Posture(
                joints=q[i], links=list(links[i].reshape(-1, 6)),
                pose=pose_matrix(rotations[i], positions[i]),
                clearance=float(near[i]) if np.isfinite(near[i]) else None,
            )
            for i in range(len(q))
        ]  # fmt: skip
        return Traced(postures=frames)


def _is_free(chain: Chain, obstacles: Floats | None, radius: float, margin: float = 0.0) -> IsFree:
    """Return the collision check of the links against balls."""
    clearance = _clearance(chain, obstacles, radius)

    def is_free(q: Floats) -> NDArray[np.bool_]:
        return np.asarray(clearance(q) > margin)

    return is_free


def _clearance(chain: Chain, obstacles: Floats | None, radius: float) -> Callable[[Floats], Floats]:
    """Return the distance, m, of the links, thick lines between the joints, from the nearest ball.

    The distance (b,) is infinite where there is no ball.
    """
    balls = np.zeros((0, 4)) if obstacles is None else obstacles

    def clearance(q: Floats) -> Floats:
        links = link_lines(chain, q)
        a, b = links[:, :, None, 0], links[:, :, None, 1]
        along, to_ball = b - a, balls[:, :3] - a
        # A link of no length, between two joints at one place, is a point.
        squared = np.maximum((along**2).sum(axis=3), 1e-12)
        share = np.clip((to_ball * along).sum(axis=3) / squared, 0.0, 1.0)
        apart = np.linalg.norm(to_ball - share[..., None] * along, axis=3)
        # Without obstacles the distance is infinite, which JSON cannot carry: callers make it null.
        return np.asarray((apart - balls[:, 3] - radius).min(axis=(1, 2), initial=np.inf))

    return clearance


def _sampled(corners: Floats, samples: int) -> Floats:
    """Return postures (samples, dof) at equal distances along a path; one if it goes nowhere."""
    far = np.concatenate([[0.0], np.abs(np.diff(corners, axis=0)).max(axis=1).cumsum()])
    if far[-1] == 0.0 or samples == 1:
        return corners[:1]
    at = np.linspace(0.0, far[-1], samples)
    return np.stack([np.interp(at, far, joint) for joint in corners.T], axis=1)


def _margin(chain: Chain) -> float:
    """Return by how much, m, no point of the robot moves more between two checked postures.

    With that much room at every posture that is checked, a path is free between them as well.
    """
    ends = link_ends(chain, np.zeros((1, chain.dof)))[0]
    lengths = np.linalg.norm(np.diff(ends, axis=0), axis=1) * is_body(chain)
    lengths[:-1] += np.where(
        chain.slides[1:], np.abs([chain.lower, chain.upper]).max(axis=0)[1:], 0
    )
    reach = np.cumsum(lengths[::-1])[::-1]
    return float(np.where(chain.slides, 1.0, reach).sum() * _RESOLUTION / 2)


def _watched(is_free: IsFree, call: Call) -> IsFree:
    """Stop a planner when nobody waits for its path any more."""

    def watched(q: Floats) -> NDArray[np.bool_]:
        call.check_cancelled()
        return is_free(q)

    return watched


def _inside(chain: Chain, joints: Floats, name: str) -> Floats:
    q = checked(chain, joints)
    if (q < chain.lower).any() or (q > chain.upper).any():
        raise ServiceError(
            f"{name}: beyond the limits {chain.lower.tolist()} to {chain.upper.tolist()}"
        )
    return q


def _corners(chain: Chain, path: list[Floats], at_least: int = 2) -> Floats:
    if len(path) < at_least:
        raise ServiceError(f"path: expected {at_least} or more postures, got {len(path)}")
    return np.array([checked(chain, posture) for posture in path])


def _answer(path: Floats) -> Path:
    length = float(np.abs(np.diff(path, axis=0)).max(axis=1).sum())
    return Path(path=list(path), length=length)
