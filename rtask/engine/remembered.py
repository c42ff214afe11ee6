"""Stored objects and grasps as plain values."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.candidate import Contacts
from grasp.spatial.frames import matrix_from_pose, pose_from_planar
from grasp.spatial.gripper import ContactKind

__all__ = ["Memory", "Remembered", "RememberedObject", "Tally", "Trial"]


@dataclass(frozen=True)
class Tally:
    """Number of judged attempts of a grasp with the same outcome.

    Parameters
    ----------
    robot
        IRI of the robot that reported them, if its word counts for less; empty for all others.
    weight
        Part for which that word counts, 0..1; see :mod:`rtask.engine.honesty`.
    lost
        Whether the object was held and then lost on the way: a failure of the grasp that says
        nothing of what hides in the object.
    """

    held: bool
    count: int
    is_fast: bool = False
    latest: dt.datetime | None = None
    robot: str = ""
    weight: float = 1.0
    lost: bool = False


@dataclass(frozen=True)
class Remembered:
    """A stored grasp.

    Parameters
    ----------
    x, y, z, theta
        In the frame of its object, m and rad.
    of_class
        Whether it belongs to another object of the class.
    size
        (length, width, height) of its object, m.
    prior
        Quality computed before any attempt, 0..1; None if it was not computed.
    quaternion : (x, y, z, w) or None
        Of a grasp in space; ``theta`` is then the direction of its closing axis seen from above.
    width
        Between the contacts, m; None if unknown.
    contacts
        Of a cup or of three fingers, in the frame of its object; None for jaws.
    """

    grasp: str
    object: str
    of_class: bool
    x: float
    y: float
    z: float
    theta: float
    opening: float
    quality: float
    gripper_type: str
    size: tuple[float, float, float] | None
    tallies: tuple[Tally, ...] = ()
    prior: float | None = None
    quaternion: tuple[float, float, float, float] | None = None
    width: float | None = None
    contacts: Contacts | None = None

    @property
    def contact_kind(self) -> ContactKind:
        """Kind of hand that can carry it out."""
        return "jaws" if self.contacts is None else self.contacts.kind

    @property
    def object_from_gripper(self) -> NDArray[np.float64]:
        """Pose (4, 4), m, of the tool centre point in the frame of its object."""
        return _gripper_pose(self.x, self.y, self.z, self.theta, self.quaternion)

    @property
    def attempts(self) -> int:
        """Judged attempts of all robots."""
        return sum(tally.count for tally in self.tallies)

    @property
    def successes(self) -> int:
        """Attempts that held."""
        return sum(tally.count for tally in self.tallies if tally.held)


@dataclass(frozen=True)
class Trial:
    """An attempt of the asking robot on the object that it is handling.

    Parameters
    ----------
    lost
        Whether the object was held and then lost on the way; see :class:`Tally`.
    """

    grasp: str
    x: float
    y: float
    z: float
    theta: float
    held: bool
    number: int
    ended: str
    is_fast: bool = False
    quaternion: tuple[float, float, float, float] | None = None
    lost: bool = False

    @property
    def object_from_gripper(self) -> NDArray[np.float64]:
        """Pose (4, 4), m, of the tool centre point in the frame of its object."""
        return _gripper_pose(self.x, self.y, self.z, self.theta, self.quaternion)


@dataclass(frozen=True)
class RememberedObject:
    """A stored object."""

    iri: str
    name: str = ""
    class_iri: str = ""
    label: str = ""
    short_id: str = ""
    size: tuple[float, float, float] | None = None
    is_round: bool = False


@dataclass(frozen=True)
class Memory:
    """The answer to a :class:`Question`.

    ``viewpoints`` and ``pictures`` are of views; a picture is the SHA-256 of its blob.
    """

    objects: Mapping[str, RememberedObject] = field(default_factory=dict)
    grasps: tuple[Remembered, ...] = ()
    trials: tuple[Trial, ...] = ()
    viewpoints: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    pictures: Mapping[str, str] = field(default_factory=dict)

    def of(self, iri: str) -> list[Remembered]:
        """Return the grasps of one object."""
        return [g for g in self.grasps if g.object == iri and not g.of_class]


def _gripper_pose(
    x: float, y: float, z: float, theta: float, quaternion: tuple[float, ...] | None
) -> NDArray[np.float64]:
    if quaternion is None:
        return np.asarray(pose_from_planar(x, y, z, theta), dtype=np.float64)
    return np.asarray(matrix_from_pose(np.array([x, y, z]), np.array(quaternion)), np.float64)
