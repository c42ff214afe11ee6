"""Collision-free motion of an arm or a point as a service (Kehoe 2014, 5.8).

The thesis wraps trajopt, which optimises; here RRT-Connect with shortcutting plans. Links are thick
lines between the joints; a point is a ball. A planned path is free all along, not only where it was
checked: at each posture that is checked there is room for the way to the next.
"""

from __future__ import annotations

import itertools
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from rtask.errors import ServiceError
from rtask.services import Call, Service, data_resource, method, startup
from rtask.wire.message import Answer
from rtask.wire.types import Array, ArrayOf, Carried, Number, Unit, Whole
from simulate.motion.kinematics import Chain
from simulate.motion.rrt import IsFree, PlanOptions, edge_is_free, plan_path, shortcut
from simulate.robots.description import Floats
from simulate.services.kinematics import chain_named, checked, read_chains

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


class Trajopt(Service):
    """Motion planning of one robot among balls."""

    name = "example/Trajopt"
    version = "1.0.0"
    robot = data_resource("binary", default="robots/PlanarArm", summary="as for example/Kinematics")

    @startup
    def load(self) -> None:
        """Read the model and make the chains ready."""
        self.chains, _ = read_chains(self.robot.path("/model"))

    @method
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
        found = plan_path(first, last, chain.lower, chain.upper, is_free, rng, options)
        if isinstance(found, str):
            raise ServiceError(_WORDS[found], reason=found)
        return _answer(found)

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


def _is_free(chain: Chain, obstacles: Floats | None, radius: float, margin: float = 0.0) -> IsFree:
    """Return the collision check of the links, thick lines between the joints, against balls."""
    balls = np.zeros((0, 4)) if obstacles is None else obstacles
    is_body = _is_body(chain)

    def is_free(q: Floats) -> NDArray[np.bool_]:
        points = _points(chain, q)
        a, b = points[:, :-1][:, is_body, None], points[:, 1:][:, is_body, None]
        along, to_ball = b - a, balls[:, :3] - a
        squared = np.maximum((along**2).sum(axis=3), 1e-12)
        share = np.clip((to_ball * along).sum(axis=3) / squared, 0.0, 1.0)
        apart = np.linalg.norm(to_ball - share[..., None] * along, axis=3)
        return np.asarray((apart > balls[:, 3] + radius + margin).all(axis=(1, 2)))

    return is_free


def _points(chain: Chain, q: Floats) -> Floats:
    """Return the ends (b, dof + 1, 3) of the links, m."""
    _, positions = chain.link_frames(q)
    _, ends = chain.tool_poses(q)
    return np.concatenate([positions, ends[:, None]], axis=1)


def _is_body(chain: Chain) -> NDArray[np.bool_]:
    """Return between which joints there is a link: nothing joins the parts of a prismatic one."""
    return np.append(~chain.slides[1:], True)


def _margin(chain: Chain) -> float:
    """Return by how much, m, no point of the robot moves more between two checked postures.

    With that much room at every posture that is checked, a path is free between them as well.
    """
    ends = _points(chain, np.zeros((1, chain.dof)))[0]
    lengths = np.linalg.norm(np.diff(ends, axis=0), axis=1) * _is_body(chain)
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


def _corners(chain: Chain, path: list[Floats]) -> Floats:
    if len(path) < 2:
        raise ServiceError("path: expected two postures or more")
    return np.array([checked(chain, one) for one in path])


def _answer(path: Floats) -> Path:
    length = float(np.abs(np.diff(path, axis=0)).max(axis=1).sum())
    return Path(path=list(path), length=length)
