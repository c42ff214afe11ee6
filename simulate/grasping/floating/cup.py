"""A suction cup without an arm, to judge where it takes hold by physics.

The lip seals where rays from it meet the object closely enough, as :mod:`grasp.spatial.suction`
asks of a mesh; then the object hangs on the cup until inertia, weight and the moments of both
exceed what the vacuum bears.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from grasp.spatial.suction import asked_of_vacuum, lip_places, seals_at
from grasp.spatial.suction_cup import SuctionCup
from simulate.grasping.floating.execution import Conditions, Held, carry_out, misplaced_weight
from simulate.grasping.floating.hand import APPROACH_M, HAND, FloatingHand
from simulate.robots.description import Floats
from simulate.world.world import BodyPose, World

__all__ = ["FloatingCup", "execute_suction"]

_RAY_M, _GUARD_M = 0.03, 0.02
_SLOW_M_S, _PRESS_N = 0.10, 200.0
_EVACUATE_S = 0.1
_FILTER_S = 0.02
_GRAVITY = np.array([0.0, 0.0, -9.81])
_CLAMP_N = 2000.0
_OWN_GROUP = 64


class FloatingCup(FloatingHand):
    """A cup that stops at contact, and lets go of what asks too much of its vacuum.

    Parameters
    ----------
    world, world_from_gripper
        See :class:`~simulate.grasping.floating.hand.FloatingHand`.
    cup
        The suction cup.
    com_error : (3,), m
        Of the centre of mass, in the object's frame: the weight acts there.
    """

    def __init__(
        self,
        world: World,
        cup: SuctionCup,
        world_from_gripper: Floats,
        com_error: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        super().__init__(world, world_from_gripper, cup.boxes())
        # Rays from the lip are not to meet the stem, which everything else still does.
        world.client.setCollisionFilterGroupMask(self.body, HAND, _OWN_GROUP, -1)
        self.cup, self._com_error = cup, np.array(com_error)
        self._bond = -1

    def _pose(self) -> Floats:
        """Return the pose (4, 4) of the lip."""
        state = self.world.client.getLinkState(self.body, HAND, computeForwardKinematics=True)
        pose = np.eye(4)
        pose[:3, :3] = np.reshape(self.world.client.getMatrixFromQuaternion(state[5]), (3, 3))
        pose[:3, 3] = state[4]
        return pose

    def _felt(self, body: int) -> tuple[Floats, Floats]:
        """Return depths (n,), m, from the lip's plane to a body, NaN = none, and normals (n, 3)."""
        pose = self._pose()
        places = lip_places(self.cup)
        start = pose[:3, 3] + places @ pose[:3, :2].T - _RAY_M * pose[:3, 2]
        end = start + 2 * _RAY_M * pose[:3, 2]
        client = self.world.client
        depths, normals = np.full(len(start), np.nan), np.zeros((len(start), 3))
        rays = start.tolist(), end.tolist()
        for k, hit in enumerate(client.rayTestBatch(*rays, collisionFilterMask=_OWN_GROUP - 1)):
            if hit[0] == body:
                depths[k] = (2 * hit[2] - 1) * _RAY_M
                normals[k] = pose[:3, :3].T @ np.array(hit[4])
        return depths, normals

    def close(self, body: int) -> None:
        """Move on or back until the lip touches, and switch the vacuum on."""
        depths, _ = self._felt(body)
        near = float(np.nanmin(depths)) if np.isfinite(depths).any() else 0.0
        if abs(near) > _GUARD_M:
            return
        self._drive(HAND, APPROACH_M + near, _SLOW_M_S, _PRESS_N)
        self.world.step(abs(near) / _SLOW_M_S + _EVACUATE_S)
        depths, normals = self._felt(body)
        if bool(seals_at(self.cup, depths[None], -normals[None, :, 2])[0]):
            self._hold(body)

    def _hold(self, body: int) -> None:
        client, pose = self.world.client, self._pose()
        place = self.world.object_pose(body)
        turned = np.linalg.inv(pose[:3, :3]) @ place.rotation
        at = pose[:3, :3].T @ (place.position - pose[:3, 3])
        self._bond = client.createConstraint(
            self.body, HAND, body, -1, client.JOINT_FIXED, [0, 0, 0], at.tolist(), [0, 0, 0],
            Rotation.from_matrix(turned).as_quat().tolist(), [0, 0, 0, 1],
        )  # fmt: skip
        client.changeConstraint(self._bond, maxForce=_CLAMP_N)

    def holding(self, body: int, pull: Callable[[], None] | None) -> Callable[[], None]:
        """Return what happens before each step: the cup lets go where its vacuum is exceeded."""
        client = self.world.client
        info = client.getDynamicsInfo(body, -1)
        mass, inertia = float(info[0]), np.array(info[2])
        count = max(round(_FILTER_S / self.world.preset.step_s), 1)
        speeds: deque[Floats] = deque(maxlen=count + 1)

        def watch() -> None:
            if pull is not None:
                pull()
            linear, angular = client.getBaseVelocity(body)
            speeds.append(np.array([*linear, *angular]))
            if self._bond < 0 or len(speeds) <= count:
                return
            change = (speeds[-1] - speeds[0]) / (count * self.world.preset.step_s)
            place, pose = self.world.object_pose(body), self._pose()
            lever = place.position - pose[:3, 3]
            # What the object does to the cup: its weight, and its inertia against the motion.
            inert, weight = -mass * change[:3], mass * _GRAVITY
            spun = place.rotation @ (inertia * (place.rotation.T @ change[3:]))
            moment = np.cross(lever, inert) - spun
            moment += np.cross(lever + place.rotation @ self._com_error, weight)
            into = pose[:3, :3].T
            if float(asked_of_vacuum(self.cup, into @ (inert + weight), into @ moment)) > 1:
                self._let_go()

        return watch

    def _let_go(self) -> None:
        self.world.client.removeConstraint(self._bond)
        self._bond = -1

    def touches(self, body: int) -> tuple[bool, ...]:
        """Tell whether the cup holds."""
        return (self._bond >= 0,)

    def remove(self) -> None:
        """Remove the cup from the world."""
        if self._bond >= 0:
            self._let_go()
        super().remove()


def execute_suction(
    world: World,
    body: int,
    cup: SuctionCup,
    world_from_gripper: Floats,
    rest: BodyPose,
    conditions: Conditions | None = None,
) -> Held:
    """Take an object at its resting pose with a cup, lift it by 10 cm and check whether it is held.

    Parameters
    ----------
    body
        The object; it is put back to ``rest`` first.
    world_from_gripper : (4, 4)
        Where the cup was planned to touch; it stops at contact up to 2 cm before or behind.
    conditions
        Friction, centre of mass and shaking; None = the cup's own friction and a lift alone.
    """
    world.put(body, rest.position.tolist(), rest.quaternion.tolist())
    told = conditions or Conditions(friction=cup.friction)
    hand = FloatingCup(
        world, replace(cup, friction=told.friction), world_from_gripper, told.com_error
    )
    pull = misplaced_weight(world, body, told)
    return carry_out(world, body, hand, rest, pull, shaken=told.shake)
