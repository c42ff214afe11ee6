"""A robot in a physics world: its joints, hands, head and camera.

All of pybullet that is needed here goes through the world's client.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from features.geometry import Intrinsics, pose_matrix
from rtask.errors import RobotError
from simulate.motion.collision import link_poses
from simulate.motion.kinematics import Chain
from simulate.motion.stance import UPRIGHT, on_moving_legs, stance_of, standing
from simulate.robots.description import (
    Arm,
    CameraMount,
    Floats,
    Pose,
    RobotDescription,
    Stance,
    transform_from,
)
from simulate.robots.other_hands import cup_with_wrist
from simulate.world.arm_cup import ArmCup
from simulate.world.world import World, places_of

__all__ = ["REST_OPENING", "FingerTouch", "HandTouch", "RobotBody"]

_ARM_GAINS = (0.5, 1.0)
_FINGER_GAINS = (0.3, 1.0)
_HEAD_FORCE = 2.0
_GEAR_FORCE, _GEAR_ERP = 100.0, 1.0
"""Of finger joints that follow another: N or N m, and the share of an error mended in a step."""
_LEG_FORCE = 100.0
"""N m: the feet bear no load in this world, so the hips only have to keep the legs in place."""
_STANCE_TICK_S = 0.02
REST_OPENING = 0.95
"""Of an idle hand: eight fingers that lean on their limits cost a quarter of the physics."""
_REST_EFFORT = 0.7
"""Share of the opening effort with which an idle hand stays open."""
_STOPPED_OPENING = 0.08
_VACUUM_ON = 0.5
"""Opening of a commanded hand below which a cup's vacuum is on."""
_FINGER_FRICTION = {"lateralFriction": 1.2, "spinningFriction": 0.002, "rollingFriction": 0.0002}
_FRAME_FROM_OPTICAL = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


@dataclass(frozen=True)
class FingerTouch:
    """Reading of the fingers of a hand.

    Parameters
    ----------
    opening
        Mean over the fingers, 0 (closed) to 1.
    links
        Finger links that something keeps open.
    force_n
        Sum of the forces (N) that the motors of these links exert, from their effort.
    """

    opening: float = 0.0
    links: int = 0
    force_n: float = 0.0


@dataclass(frozen=True)
class HandTouch:
    """Contact of a hand with one body: number of touching links, sum of normal forces in N."""

    links: int
    force_n: float


class RobotBody:
    """A robot with a fixed base in a physics world.

    Parameters
    ----------
    world
        The physics world.
    description
        Description of the robot.
    world_from_base : (4, 4) float or None
        Pose of its base frame (on the floor, z up); None places it at the world's origin.
    """

    def __init__(
        self, world: World, description: RobotDescription, world_from_base: Floats | None = None
    ) -> None:
        self.world = world
        self.described = self.description = description
        self.stance = UPRIGHT
        self.base_frame = description.base_frame
        self.world_from_base = np.eye(4) if world_from_base is None else world_from_base
        self.arms: Mapping[str, Arm] = description.arms
        self.chains = {name: Chain.of(description, name) for name in description.arms}
        self._client: Any = world.client
        self.commanded: dict[str, Floats] = {}
        """Latest command (dof,) rad of each arm."""
        self.commanded_opening: dict[str, float] = {}
        """Latest command of each arm's hand, 0..1."""
        self._head = self._head_joints()
        self._legs: RobotDescription | None = None
        self._load(description)
        self._set_up()
        if self._cups:
            world.before_each.append(self._pump)

    def _pump(self) -> None:
        for cup in self._cups.values():
            cup.before_step()

    def _load(self, description: RobotDescription) -> None:
        self.body = self.world.load_urdf(description.welded(), self.world_from_base)
        self.joint_index, self.link_index = self._indices()
        for pair in self.description.may_touch:
            first, second = (self.link_index.get(link, -1) for link in pair)  # -1: the root
            self._client.setCollisionFilterPair(self.body, self.body, first, second, 0)
        self.hand_links = {name: self._hand_links(arm) for name, arm in self.arms.items()}
        self._driven = {name: self._couple_fingers(arm) for name, arm in self.arms.items()}
        self._cups = {
            name: ArmCup(self.world, arm, self.body, self.link_index[arm.wrist])
            for name, arm in self.arms.items()
            if arm.cup is not None
        }

    def _indices(self) -> tuple[dict[str, int], dict[str, int]]:
        joints, links = {}, {}
        for index in range(self._client.getNumJoints(self.body)):
            info = self._client.getJointInfo(self.body, index)
            joints[info[1].decode()] = index
            links[info[12].decode()] = index
        return joints, links

    def _hand_links(self, arm: Arm) -> tuple[int, ...]:
        fingers = [self.description.joint(name).child for name in arm.fingers]
        return tuple(self.link_index[link] for link in (arm.wrist, *fingers))

    def _couple_fingers(self, arm: Arm) -> tuple[str, ...]:
        """Gear the finger joints that follow another to it; return those that have a motor."""
        driven = []
        for name in arm.fingers:
            mimic = self.description.joint(name).mimic
            if mimic is None or mimic[0] not in arm.fingers:
                driven.append(name)
                continue
            source, factor = mimic
            client, follower = self._client, self.joint_index[name]
            gear = client.createConstraint(
                self.body, self.joint_index[source], self.body, follower,
                client.JOINT_GEAR, [0, 1, 0], [0, 0, 0], [0, 0, 0],
            )  # fmt: skip
            client.changeConstraint(
                gear, gearRatio=-1 / factor, maxForce=_GEAR_FORCE, erp=_GEAR_ERP
            )
            client.setJointMotorControl2(self.body, follower, client.VELOCITY_CONTROL, force=0)
        return tuple(driven)

    def _head_joints(self) -> tuple[str, ...]:
        """Return the moving joints that carry the camera."""
        for camera in self.description.cameras.values():
            path = self.description.path(camera.parent)
            return tuple(joint.name for joint in path if joint.kind != "fixed")
        return ()

    def _set_up(self) -> None:
        """Put arms at home, hands open, motors on; make fingertips grip."""
        for index in self.joint_index.values():
            self._client.changeDynamics(self.body, index, linearDamping=0.0, angularDamping=0.0)
        for arm in self.arms.values():
            self.reset_arm(arm.name, np.array(arm.home))
            for name, value in arm.finger_values(REST_OPENING).items():
                index = self.joint_index[name]
                self._client.changeDynamics(self.body, index, **_FINGER_FRICTION)
                self._client.resetJointState(self.body, index, value)
            self.rest_hand(arm.name)
        self.set_head(np.zeros(len(self._head)))

    def take_stance(self, name: str, seconds: float = 1.0) -> None:
        """Take a stance; hands should be empty and arms at home.

        The legs are moved without physics: the feet stay in place, and nothing else depends on
        them. They are welded until the first stance is taken, since joints cost time.
        """
        if name == self.stance:
            return
        if self._legs is None:
            self._let_legs_move()
        before, after = stance_of(self.described, self.stance), stance_of(self.described, name)
        ticks = max(round(seconds / _STANCE_TICK_S), 1)
        for tick in range(1, ticks + 1):
            share = 0.5 - 0.5 * np.cos(np.pi * tick / ticks)
            self._stand_between(before, after, float(share))
            self.world.step(seconds / ticks)
        self.stance = name
        self.description = standing(self.described, name)
        self.chains = {arm: Chain.of(self.description, arm) for arm in self.arms}

    def _let_legs_move(self) -> None:
        """Reload the robot in its present state with legs that move."""
        arms = {name: self.arm_joints(name) for name in self.arms}
        self._legs = on_moving_legs(self.described)
        self._client.removeBody(self.body)
        self._load(self._legs)
        self._set_up()
        for name, q in arms.items():
            self.reset_arm(name, q)

    def _stand_between(self, before: Stance, after: Stance, share: float) -> None:
        """Set the root and the leg joints between two stances."""
        poses = [np.array([s.base_from_root.xyz, s.base_from_root.rpy]) for s in (before, after)]
        xyz, rpy = (1 - share) * poses[0] + share * poses[1]
        root = self.world_from_base @ transform_from(tuple(xyz), tuple(rpy))
        pose = Pose.of(root)
        client = self._client
        inertial = client.getDynamicsInfo(self.body, -1)
        position, orientation = client.multiplyTransforms(
            pose.xyz, client.getQuaternionFromEuler(pose.rpy), inertial[3], inertial[4]
        )
        client.resetBasePositionAndOrientation(self.body, position, orientation)
        for joint in {**before.joints, **after.joints}:
            value = (1 - share) * before.joints.get(joint, 0.0) + share * after.joints.get(joint, 0)
            index = self.joint_index[joint]
            client.resetJointState(self.body, index, value)
            client.setJointMotorControl2(
                self.body, index, client.POSITION_CONTROL, targetPosition=value, force=_LEG_FORCE
            )

    def arm(self, name: str) -> Arm:
        """Return an arm by its name or its side, ``left`` or ``right``."""
        return self.description.arm(name)

    def home(self, arm: str) -> Floats:
        """Return the joint values (dof,) rad of an arm between grasps."""
        return np.array(self.arm(arm).home)

    def arm_joints(self, arm: str) -> Floats:
        """Return the measured joint values (dof,) rad of an arm."""
        indices = [self.joint_index[name] for name in self.arm(arm).joints]
        return np.array([state[0] for state in self._client.getJointStates(self.body, indices)])

    def joint_values(self) -> dict[str, float]:
        """Return the measured value (rad) of every moving joint by name."""
        names = [joint.name for joint in self.description.moving_joints()]
        states = self._client.getJointStates(self.body, [self.joint_index[n] for n in names])
        return {name: float(state[0]) for name, state in zip(names, states, strict=True)}

    def reset_arm(self, arm: str, q: Floats) -> None:
        """Set an arm's joints (dof,) rad without physics, and hold them there."""
        for name, value in zip(self.arm(arm).joints, q, strict=True):
            self._client.resetJointState(self.body, self.joint_index[name], float(value))
        self.command_arm(arm, q)

    def command_arm(self, arm: str, q: Floats, velocity: Floats | None = None) -> None:
        """Command an arm: q (dof,) rad, velocity (dof,) rad/s."""
        names = self.arm(arm).joints
        self.commanded[self.arm(arm).name] = np.array(q, dtype=np.float64)
        position_gain, velocity_gain = _ARM_GAINS
        self._client.setJointMotorControlArray(
            self.body,
            [self.joint_index[name] for name in names],
            self._client.POSITION_CONTROL,
            targetPositions=[float(v) for v in q],
            targetVelocities=[0.0] * len(names)
            if velocity is None
            else [float(v) for v in velocity],
            forces=[self.description.joint(name).effort for name in names],
            positionGains=[position_gain] * len(names),
            velocityGains=[velocity_gain] * len(names),
        )

    def move_fingers(self, arm: str, opening: float, effort: float) -> None:
        """Drive all finger joints towards an opening 0..1, each with at most ``effort``.

        Each has its motor: a phalanx that touches stops, the others go on. Closing
        fingers anchor their contacts, which undoes the drift of the contact solver: without it a
        held object creeps 4.5 mm in 2 s (with it .9 mm), and every tenth creeps out on the way.
        """
        parts = self.arm(arm)
        self.commanded_opening[parts.name] = opening
        if parts.name in self._cups:
            self._cups[parts.name].switch(opening < _VACUUM_ON)
            return
        position_gain, velocity_gain = _FINGER_GAINS
        for name, value in parts.finger_values(opening).items():
            index = self.joint_index[name]
            self._client.changeDynamics(self.body, index, frictionAnchor=int(opening < 0.5))
            if name not in self._driven[parts.name]:
                continue
            self._client.setJointMotorControl2(
                self.body,
                index,
                self._client.POSITION_CONTROL,
                targetPosition=value,
                force=effort,
                positionGain=position_gain,
                velocityGain=velocity_gain,
                maxVelocity=parts.finger_speed,
            )

    def rest_hand(self, arm: str) -> None:
        """Hold a hand open without leaning on its limits."""
        self.move_fingers(arm, REST_OPENING, _REST_EFFORT * self.arm(arm).open_effort)

    def finger_opening(self, arm: str) -> float:
        """Return the measured opening of a hand, 0..1: the mean over its fingers."""
        parts = self.arm(arm)
        if parts.name in self._cups:
            return self._cups[parts.name].opening
        indices = [self.joint_index[name] for name in parts.fingers]
        values = [state[0] for state in self._client.getJointStates(self.body, indices)]
        return float(np.mean(parts.finger_openings(np.array(values))))

    def finger_touch(self, arm: str) -> FingerTouch:
        """Read positions and efforts of a hand's fingers."""
        hand = self.arm(arm)
        if hand.cup is not None:
            holds = self._cups[hand.name].held >= 0
            return FingerTouch(
                self._cups[hand.name].opening, int(holds), hand.cup.force if holds else 0.0
            )
        states = self._client.getJointStates(
            self.body, [self.joint_index[name] for name in hand.fingers]
        )
        openings = hand.finger_openings(np.array([state[0] for state in states]))
        efforts = np.abs([state[3] for state in states])
        revolute = self.description.joint(hand.fingers[0]).kind == "revolute"
        forces = efforts / (hand.finger_length if revolute else 1.0)
        stopped = openings > _STOPPED_OPENING
        return FingerTouch(float(openings.mean()), int(stopped.sum()), float(forces[stopped].sum()))

    def touch(self, arm: str, body: int) -> HandTouch:
        """Return the true contact of an arm's hand with a body, for scoring only."""
        parts = self.arm(arm)
        if parts.cup is not None and self._cups[parts.name].held == body:
            return HandTouch(1, parts.cup.force)
        links, force = set(), 0.0
        hand = self.hand_links[parts.name]
        for contact in self._client.getContactPoints(self.body, body):
            if contact[3] in hand and contact[9] > 0:
                links.add(contact[3])
                force += float(contact[9])
        return HandTouch(len(links), force)

    def tool_pose(self, arm: str) -> Floats:
        """Return ``base_from_tool`` (4, 4) of an arm's hand at the measured joints."""
        rotation, position = self.chains[self.arm(arm).name].tool_poses(self.arm_joints(arm)[None])
        return pose_matrix(rotation[0], position[0])

    def set_head(self, q: Floats) -> None:
        """Set the joints below the camera to q rad at once, and hold them."""
        for name, value in zip(self._head, q, strict=True):
            index = self.joint_index[name]
            self._client.resetJointState(self.body, index, float(value))
            self._client.setJointMotorControl2(
                self.body,
                index,
                self._client.POSITION_CONTROL,
                targetPosition=float(value),
                force=_HEAD_FORCE,
            )

    def look(self, side: str, camera: str | None = None) -> Floats:
        """Turn the head towards ``left``, ``right`` or ``ahead``.

        Returns
        -------
        (4, 4) float
            ``base_from_camera``, optical frame (x right, y down, z forward).
        """
        mount = self._camera(camera)
        if not mount.look:  # fixed: it sees one place only
            return self.base_from_camera(None, camera)
        if side not in mount.look:
            raise RobotError(f"cannot look {side!r}; known: {', '.join(mount.look)}")
        self.set_head(np.array(mount.look[side]))
        return self.base_from_camera(np.array(mount.look[side]), camera)

    def base_from_camera(self, q: Floats | None = None, camera: str | None = None) -> Floats:
        """Return the pose (4, 4) of the camera's optical frame in the base frame.

        Parameters
        ----------
        q : (h,) float, rad, or None
            Joints below the camera (NAO: HeadYaw, HeadPitch); None = as measured.
        camera
            Name; None = the first.
        """
        mount = self._camera(camera)
        values = self.joint_values() if q is None else dict(zip(self._head, q, strict=True))
        robot = self.description
        path = robot.path(mount.parent)
        poses = link_poses(robot.root, path, {k: float(v) for k, v in values.items()})
        root_from_parent = poses.get(mount.parent, np.eye(4))  # the root itself is not among them
        base_from_root = robot.base_from_root.matrix
        mounted = transform_from(mount.pose.xyz, mount.pose.rpy)
        pose: Floats = base_from_root @ root_from_parent @ mounted @ _FRAME_FROM_OPTICAL
        return pose

    def describe(self, name: str, places: list[dict[str, Any]] | None = None) -> dict[str, Any]:
        """Return the registration of the robot as JSON data: hands, cameras, frames, places.

        Parameters
        ----------
        places
            Tables and boxes as of :func:`simulate.world.world.places_of`; default: those of the
            world, if the robot stands at its origin.
        """
        robot = self.description
        if places is None:
            is_at_origin = np.allclose(self.world_from_base, np.eye(4))
            places = places_of(self.world) if is_at_origin else []
        return {
            "name": name,
            "model": robot.model,
            "simulated": True,
            "end_effectors": [_hand_message(robot, arm) for arm in self.arms.values()],
            "cameras": [_camera_message(camera) for camera in robot.cameras.values()],
            "frames": [self.base_frame, *robot.frames],
            "places": places,
        }

    def _camera(self, name: str | None) -> CameraMount:
        cameras = self.description.cameras
        if not cameras or (name is not None and name not in cameras):
            raise RobotError(f"robot {self.description.name!r} has no camera {name or ''}".strip())
        return cameras[name] if name is not None else next(iter(cameras.values()))


def _hand_message(robot: RobotDescription, arm: Arm) -> dict[str, Any]:
    common = {
        "name": arm.end_effector,
        "gripper_type": arm.gripper_type,
        "kind": arm.kind,
        "finger_length": arm.finger_length,
        "max_force": arm.max_force,
        "max_payload": arm.max_payload,
        "parent_link": arm.wrist,
        "planning_group": arm.name,
    }
    if arm.cup is not None:
        return {
            **common,
            "lip_radius": arm.cup.radius,
            "lip_compliance": arm.cup.give,
            "pressure": arm.cup.pressure,
            "flange_radius": cup_with_wrist(robot, arm).flange_radius,
        }
    return {
        **common,
        "min_opening": 0.0,
        "max_opening": arm.mouth,
        "jaw_width": arm.finger_width,
    }


def _camera_message(camera: CameraMount) -> dict[str, Any]:
    intrinsics = Intrinsics.from_fov(*camera.size, camera.horizontal_fov)
    return {
        "name": camera.name,
        "frame_id": camera.frame_id,
        **asdict(intrinsics),
        "min_range": camera.depth_range[0],
        "max_range": camera.depth_range[1],
    }
