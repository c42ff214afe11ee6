"""Contacts of a robot with itself, from the physics engine."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from simulate.robots.description import Floats, RobotDescription
from simulate.world.robot_body import RobotBody
from simulate.world.world import World

__all__ = ["SelfContacts"]

_POSTURES = 40
_ALWAYS = 0.9
"""Share of random postures in which links touch that overlap by their shapes."""
_OPENINGS = (0.4, 0.7, 1.0)
_DEEP_M = -0.0005


class SelfContacts:
    """A robot in an empty world, to see which of its links touch each other.

    Parameters
    ----------
    robot
        With arms; where they are at home does not matter.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self._world = World("fast", workplace=robot.workplace)
        self._robot = robot
        self._body = RobotBody(self._world, robot)
        self._names = {index: name for name, index in self._body.link_index.items()}
        self._names[-1] = robot.root

    def __enter__(self) -> SelfContacts:
        return self

    def __exit__(self, *exc: object) -> None:
        self._world.close()

    def touching(self, postures: dict[str, Floats]) -> set[tuple[str, str]]:
        """Return the pairs of links that touch with the arms in postures, by arm, (dof,) rad."""
        for arm, q in postures.items():
            self._body.reset_arm(arm, q)
        client = self._world.client
        client.performCollisionDetection()
        body = self._body.body
        return {
            self._pair(contact[3], contact[4])
            for contact in client.getContactPoints(body, body)
            if contact[8] < _DEEP_M
        }

    def _pair(self, first: int, second: int) -> tuple[str, str]:
        a, b = sorted((self._names[first], self._names[second]))
        return a, b

    def overlapping(self, seed: int = 0) -> tuple[tuple[str, str], ...]:
        """Return the pairs that touch wherever the robot is, and those within an open hand."""
        rng = np.random.default_rng((seed, 4))
        counts: Counter[tuple[str, str]] = Counter()
        for _ in range(_POSTURES):
            drawn = {}
            for name, chain in self._body.chains.items():
                drawn[name] = chain.lower + rng.random(chain.dof) * (chain.upper - chain.lower)
            counts.update(self.touching(drawn))
        pairs = {pair for pair, count in counts.items() if count >= _ALWAYS * _POSTURES}
        for opening in _OPENINGS:
            pairs |= self._within_hands(opening)
        return tuple(sorted(pairs))

    def _within_hands(self, opening: float) -> set[tuple[str, str]]:
        client, touching_pairs = self._world.client, set()
        for arm in self._robot.arms.values():
            for joint, value in arm.finger_values(opening).items():
                client.resetJointState(self._body.body, self._body.joint_index[joint], value)
            hand = {arm.wrist, *(self._robot.joint(name).child for name in arm.fingers)}
            touching = self.touching({arm.name: np.array(arm.home)})
            touching_pairs |= {pair for pair in touching if set(pair) <= hand}
        return touching_pairs


def without_contacts(robot: RobotDescription, seed: int = 0) -> RobotDescription:
    """Return the robot with the pairs of links that overlap allowed to touch."""
    with SelfContacts(robot) as contacts:
        return replace(robot, may_touch=contacts.overlapping(seed))
