"""Vacuum of a suction cup in physics: it seals what lies close before its lip, and lets go.

The lip seals where rays from it meet an object closely enough, as :mod:`grasp.spatial.suction` asks
of a mesh; then the object hangs on the cup until inertia, weight and the moments of both exceed
what the vacuum bears.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import numpy as np

from grasp.spatial.suction import asked_of_vacuum, lip_places, seals_at
from grasp.spatial.suction_cup import SuctionCup
from simulate.robots.description import Floats
from simulate.world.world import World

__all__ = ["Vacuum"]

_RAY_M = 0.03
_FILTER_S = 0.02
_GRAVITY = np.array([0.0, 0.0, -9.81])
_CLAMP_N = 2000.0
_OWN_GROUP = 64


class Vacuum:
    """Vacuum behind the lip of a cup that is part of a body.

    Parameters
    ----------
    world
        The physics world.
    body, link
        That carry the cup.
    cup
        Its sizes and the pressure.
    lip
        Returns the pose (4, 4) of the lip in the world, z out of the cup, m.
    com_error : (3,), m
        Of the centre of mass of what it holds, in the object's frame: the weight acts there.
    """

    def __init__(
        self,
        world: World,
        body: int,
        link: int,
        cup: SuctionCup,
        lip: Callable[[], Floats],
        com_error: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self._world, self._body, self._link = world, body, link
        self.cup, self._lip, self._com_error = cup, lip, np.array(com_error)
        # Rays from the lip are not to meet what carries it, which everything else still does.
        world.client.setCollisionFilterGroupMask(body, link, _OWN_GROUP, -1)
        self._bond = -1
        self.held = -1
        """The body that hangs on the cup; -1 = none."""
        self._still = (0.0, np.zeros(3))
        self._speeds: deque[Floats] = deque()

    def gap(self) -> float:
        """Return how far the lip is from what lies before it, m; NaN = nothing within 3 cm."""
        _, depths, _ = self._felt()
        return float(np.nanmin(depths)) if np.isfinite(depths).any() else float("nan")

    def seal(self, within_m: float = np.inf) -> bool:
        """Hold what the lip seals on, if it is no farther away; tell whether something is held.

        What cannot move, such as a table, is never held: an arm would tear itself off.
        """
        if self._bond >= 0:
            return True
        body, depths, normals = self._felt()
        if body < 0 or float(np.nanmin(depths)) > within_m:
            return False
        if bool(seals_at(self.cup, depths[None], -normals[None, :, 2])[0]):
            self._hold(body)
        return self._bond >= 0

    def release(self) -> None:
        """Let go of what is held."""
        if self._bond >= 0:
            self._world.client.removeConstraint(self._bond)
        self._bond = self.held = -1

    def watch(self) -> None:
        """Let go if the load exceeds what the vacuum bears; to be called before each step."""
        if self._bond < 0:
            return
        client: Any = self._world.client
        linear, angular = client.getBaseVelocity(self.held)
        self._speeds.append(np.array([*linear, *angular]))
        count = self._speeds.maxlen or 1
        if len(self._speeds) < count:
            return
        span = (count - 1) * self._world.preset.step_s
        change = (self._speeds[-1] - self._speeds[0]) / span
        place, pose = self._world.object_pose(self.held), self._lip()
        at = np.array(client.getBasePositionAndOrientation(self.held)[0])
        mass, inertia = self._still
        # What the object does to the cup: its weight, and its inertia against the motion.
        inert, weight = -mass * change[:3], mass * _GRAVITY
        spun = place.rotation @ (inertia * (place.rotation.T @ change[3:]))
        lever = at - pose[:3, 3]
        moment = np.cross(lever, inert) - spun
        moment += np.cross(lever + place.rotation @ self._com_error, weight)
        into = pose[:3, :3].T
        if float(asked_of_vacuum(self.cup, into @ (inert + weight), into @ moment)) > 1:
            self.release()

    def _felt(self) -> tuple[int, Floats, Floats]:
        """Return the movable body before the lip, -1 = none, and what rays from the lip meet of it.

        Depths (n,), m, from the lip's plane, NaN = nothing, and normals (n, 3) in the lip's frame.
        """
        client, pose = self._world.client, self._lip()
        places = lip_places(self.cup)
        start = pose[:3, 3] + places @ pose[:3, :2].T - _RAY_M * pose[:3, 2]
        end = start + 2 * _RAY_M * pose[:3, 2]
        rays = start.tolist(), end.tolist()
        hits = client.rayTestBatch(*rays, collisionFilterMask=_OWN_GROUP - 1)
        met = Counter(hit[0] for hit in hits if hit[0] not in (-1, self._body))
        movable = [b for b, _ in met.most_common() if client.getDynamicsInfo(b, -1)[0] > 0]
        body = movable[0] if movable else -1
        depths, normals = np.full(len(hits), np.nan), np.zeros((len(hits), 3))
        for k, hit in enumerate(hits):
            if hit[0] == body >= 0:
                depths[k] = (2 * hit[2] - 1) * _RAY_M
                normals[k] = pose[:3, :3].T @ np.array(hit[4])
        return body, depths, normals

    def _hold(self, body: int) -> None:
        client: Any = self._world.client
        link = client.getLinkState(self._body, self._link, computeForwardKinematics=True)
        inverse = client.invertTransform(link[0], link[1])
        at, turned = client.multiplyTransforms(
            *inverse, *client.getBasePositionAndOrientation(body)
        )
        self._bond = client.createConstraint(
            self._body, self._link, body, -1, client.JOINT_FIXED, [0, 0, 0], at, [0, 0, 0],
            turned, [0, 0, 0, 1],
        )  # fmt: skip
        client.changeConstraint(self._bond, maxForce=_CLAMP_N)
        info = client.getDynamicsInfo(body, -1)
        self._still = float(info[0]), np.array(info[2])
        self.held = body
        steps = max(round(_FILTER_S / self._world.preset.step_s), 1)
        self._speeds = deque(maxlen=steps + 1)
