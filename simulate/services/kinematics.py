"""Forward and inverse kinematics of a robot as a service (Kehoe 2014, 5.7 and 5.8)."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from features.geometry import pose_matrix
from rtask.errors import RobotError, ServiceError, nearest
from rtask.scratch import ScratchFolder
from rtask.services import Service, data_resource, method, startup
from rtask.wire.message import Answer
from rtask.wire.types import Array, Bytes, Number, Pose, Unit, Whole
from simulate.motion.kinematics import Chain, Goal, IkOptions, Tool, solve_ik
from simulate.robots.description import Floats, Joint
from simulate.robots.urdf_reader import ReadRobot, read_urdf

__all__ = [
    "Kinematics",
    "chain_named",
    "checked",
    "is_body",
    "link_ends",
    "link_lines",
    "read_chains",
]


class Solutions(Answer):
    """Postures that reach a pose, best first, and how far the best one is off."""

    solutions: list[Array]
    """joint values, rad, or m of prismatic joints; none where the pose cannot be reached"""
    nearest: Array
    """joint values of the best posture found, whether or not it is good enough"""
    position_error: Annotated[float, Unit("m")]
    """of the best posture, whether or not it is good enough"""
    rotation_error: Annotated[float, Unit("rad")]
    """of the best posture"""


class LinkPose(Answer):
    """One moving link."""

    name: str
    pose: Pose
    """in the frame of the robot's root link"""


class Links(Answer):
    """The moving links of an arm."""

    links: list[LinkPose]


class Manipulator(Answer):
    """One arm of a robot."""

    name: str
    tip: str
    """link whose pose is asked for"""
    joints: list[str]
    """names, from the base to the tip"""
    lower: Array
    """smallest joint values, rad or m"""
    upper: Array
    """largest joint values, rad or m"""
    links: list[Array]
    """middle line of each link, [x, y, z, x, y, z] in m, with all joints in mid-range"""


class Manipulators(Answer):
    """The arms of a robot."""

    manipulators: list[Manipulator]


class Kinematics(Service):
    """Forward and inverse kinematics of one robot.

    Poses are those of the last link of an arm, in the frame of the robot's root link.
    """

    name = "example/Kinematics"
    version = "1.3.0"
    robot = data_resource(
        "binary",
        default="robots/NAO",
        summary="/model is URDF; /arms.json names the tip of each arm",
    )

    @startup
    def load(self) -> None:
        """Read the model and make the chains ready."""
        self.chains, self.tips = read_chains(self.robot.path("/model"))

    @method(output="pose")
    def forwardKinematics(self, manipulator: str, joints: Array) -> Pose:
        """Pose of the end of an arm.

        Parameters
        ----------
        manipulator
            Name of the arm; `describe` lists them.
        joints
            Values from the base to the tip, rad, or m of prismatic joints.
        """
        chain = self._chain(manipulator)
        rotations, positions = chain.tool_poses(checked(chain, joints)[None])
        return pose_matrix(rotations[0], positions[0])

    @method
    def inverseKinematics(
        self,
        manipulator: str,
        pose: Pose,
        position_tolerance: Annotated[Number, Unit("m"), Ge(1e-9)] = 1e-3,
        rotation_tolerance: Annotated[Number, Unit("rad"), Ge(1e-9)] = 1e-2,
        starts: Annotated[Whole, Ge(1), Le(500)] = 48,
        seed: Annotated[Whole, Ge(0)] = 0,
    ) -> Solutions:
        """Postures of an arm that reach a pose.

        Parameters
        ----------
        manipulator
            Name of the arm.
        pose
            Wanted pose of its end, in the frame of the root link.
        position_tolerance
            Largest error of the position.
        rotation_tolerance
            Largest angle by which the orientation may be off.
        starts
            Number of random postures from which the search begins.
        seed
            Of these; the same seed gives the same answer.
        """
        chain = self._chain(manipulator)
        goal = Goal(pose[:3, 3], pose[:3, 0], pose[:3, 2], approach_must=True)
        options = IkOptions(
            starts=starts, iterations=80, limit_margin=0.0, position_tolerance=np.inf,
            angle_tolerance=np.inf, converged=1e-9,
        )  # fmt: skip
        postures = solve_ik(chain, goal, np.random.default_rng(seed), options)
        distance, angle = _errors(chain, postures, pose)
        order = np.argsort(distance + chain_scale(chain) * angle, kind="stable")
        good = [
            i for i in order if distance[i] <= position_tolerance and angle[i] <= rotation_tolerance
        ]
        best = order[0]
        return Solutions(
            solutions=[postures[i] for i in good],
            nearest=postures[best],
            position_error=float(distance[best]),
            rotation_error=float(angle[best]),
        )

    @method
    def linkPoses(self, manipulator: str, joints: Array) -> Links:
        """Poses of the moving links of an arm.

        Parameters
        ----------
        manipulator
            Name of the arm.
        joints
            Values from the base to the tip, rad, or m of prismatic joints.
        """
        chain = self._chain(manipulator)
        rotations, positions = chain.link_frames(checked(chain, joints)[None])
        links = [
            LinkPose(name=name, pose=pose_matrix(rotation, position))
            for name, rotation, position in zip(
                chain.links, rotations[0], positions[0], strict=True
            )
        ]
        return Links(links=links)

    @method
    def describe(self) -> Manipulators:
        """Arms of the robot, with their joints and limits."""
        return _described(self.chains, self.tips)

    @method
    def read(self, urdf: Bytes) -> Manipulators:
        """Arms of a robot that is not stored yet, so that its model can be checked first.

        Parameters
        ----------
        urdf
            The model; meshes are not needed.
        """
        with ScratchFolder("model") as folder:
            model = folder / "model"
            model.write_bytes(urdf)
            try:
                chains, tips = read_chains(model)
            except RobotError as error:
                words = str(error).replace(str(model), "the model")
                raise ServiceError(f"urdf: {words}", field="urdf") from error
        return _described(chains, tips)

    def _chain(self, manipulator: str) -> Chain:
        return chain_named(self.chains, manipulator)


def _described(chains: dict[str, Chain], tips: dict[str, str]) -> Manipulators:
    manipulators = [
        Manipulator(
            name=name, tip=tips[name], joints=list(chain.names), lower=chain.lower,
            upper=chain.upper, links=list(_mid_range(chain)),
        )
        for name, chain in sorted(chains.items())
    ]  # fmt: skip
    return Manipulators(manipulators=manipulators)


def _mid_range(chain: Chain) -> Floats:
    middle = (chain.lower + chain.upper) / 2
    return np.asarray(link_lines(copy.copy(chain), middle[None])[0].reshape(-1, 6))


def chain_named(chains: dict[str, Chain], manipulator: str) -> Chain:
    """Return an arm by its name, in a copy, because a chain counts its evaluations.

    Raises
    ------
    ServiceError
        The robot has no such arm.
    """
    if manipulator not in chains:
        hint = nearest(manipulator, list(chains)) or f"; it has {', '.join(sorted(chains))}"
        raise ServiceError(f"manipulator: the robot has no arm {manipulator!r}{hint}")
    return copy.copy(chains[manipulator])


def checked(chain: Chain, joints: Floats) -> Floats:
    """Return joint values after making sure of their number.

    Raises
    ------
    ServiceError
        There are more or fewer than the arm has joints.
    """
    if joints.shape != (chain.dof,):
        raise ServiceError(
            f"joints: the arm has {chain.dof} ({', '.join(chain.names)}), got {len(joints)}"
        )
    return joints


def chain_scale(chain: Chain) -> float:
    """Return the length, m, at which an angle of one rad weighs as much as a distance."""
    _, positions = chain.link_frames(np.zeros((1, chain.dof)))
    return max(float(np.ptp(positions[0], axis=0).max()), 0.1)


def read_chains(model: Path) -> tuple[dict[str, Chain], dict[str, str]]:
    """Return the arms of a URDF file and the links at their ends, by name.

    The file ``arms.json`` beside it names the arms; without it there is one for each link at the
    end of a branch, called like that.
    """
    robot = read_urdf(model, shapes=False)
    names = model.with_name("arms.json")
    if names.exists():
        tips: dict[str, str] = json.loads(names.read_text("utf-8"))
    else:
        parents = {joint.parent for joint in robot.joints}
        tips = {link.name: link.name for link in robot.links if link.name not in parents}
    paths = {name: _path(robot, tip) for name, tip in tips.items()}
    tool = Tool(np.zeros(3), np.eye(3))
    chains = {
        name: Chain(path, np.eye(4), tool)
        for name, path in paths.items()
        if any(joint.kind != "fixed" for joint in path)
    }
    return chains, {name: tips[name] for name in chains}


def _path(robot: ReadRobot, tip: str) -> list[Joint]:
    """Return the joints from the root to a link."""
    above = {joint.child: joint for joint in robot.joints}
    path: list[Joint] = []
    link = tip
    while link in above:
        path.append(above[link])
        link = above[link].parent
    return path[::-1]


def _errors(chain: Chain, q: Floats, pose: Floats) -> tuple[Floats, Floats]:
    """Return by which distance (k,) m and angle (k,) rad postures miss a pose."""
    rotations, positions = chain.tool_poses(q)
    distance = np.linalg.norm(positions - pose[:3, 3], axis=1)
    cosine = (np.einsum("kij,ij->k", rotations, pose[:3, :3]) - 1.0) / 2.0
    return distance, np.arccos(np.clip(cosine, -1.0, 1.0))


def link_ends(chain: Chain, q: Floats) -> Floats:
    """Return the ends (b, dof + 1, 3) of the links, m."""
    _, positions = chain.link_frames(q)
    _, ends = chain.tool_poses(q)
    return np.concatenate([positions, ends[:, None]], axis=1)


def is_body(chain: Chain) -> NDArray[np.bool_]:
    """Return between which joints there is a link: nothing joins the parts of a prismatic one."""
    return np.append(~chain.slides[1:], True)


def link_lines(chain: Chain, q: Floats) -> Floats:
    """Return the two ends (b, links, 2, 3) of the middle line of each link, m."""
    points = link_ends(chain, q)
    return np.stack([points[:, :-1], points[:, 1:]], axis=2)[:, is_body(chain)]
