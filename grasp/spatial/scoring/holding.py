"""Estimate how likely two pads hold an object that is lifted or carried.

Both patches together resist a force across the closing axis and a torque about it. The limit
surface of such contacts is nearly an ellipsoid (Howe and Cutkosky 1996): with the demands as shares
of what each could bear alone, a grasp holds while the sum of their squares is below one. Weight and
torque come from accelerations in any direction, so the torque is that about the middle of the
patches. Pads that lean against each other, as on a taper, use up friction by themselves; an object
whose faces are parallel turns until the pads lie flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.bodies import enclosed_volume
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.confidence import PoseNoise
from grasp.spatial.scoring.pads import ACROSS, ALONG, PadContacts, pad_contacts
from grasp.spatial.scoring.promises import Promises

__all__ = [
    "CARRY_G",
    "LIFT_G",
    "Demand",
    "assumed_mass",
    "demanded_share",
    "demands",
    "hold_shares",
    "with_holding",
]

LIFT_G, CARRY_G = 1.0, 2.5
"""Accelerations, g: of a slow lift, and of carrying with some shaking."""

_GRAVITY = 9.81
_SOFT_M = 0.002
_SLOPE = 4
_MASS_KG, _DENSITY = (0.03, 1.0), 700.0
_UNSURE, _STEEPEST = 0.65, 3.0


@dataclass(frozen=True, eq=False)
class Demand:
    """The demand of a load on a grasp, as shares of what its friction bears; all (c, K).

    Parameters
    ----------
    force
        Weight over twice the friction of a jaw's force.
    torque
        About the closing axis: weight times lever over what both patches bear.
    taper
        Tangent of half the angle between both patches over the friction coefficient.
    """

    force: FloatArray
    torque: FloatArray
    taper: FloatArray


def assumed_mass(mesh: Mesh) -> float:
    """Return a mass, kg, for a mesh of unknown material: 700 kg/m3, from 30 g to 1 kg."""
    return float(np.clip(_DENSITY * enclosed_volume(mesh), *_MASS_KG))


def demanded_share(gripper: ParallelGripper, mass: float, friction: float | None = None) -> float:
    """Return the weight of a mass, kg, over what the friction of both jaws bears.

    Parameters
    ----------
    friction
        Coulomb coefficient; None = the gripper's.

    Examples
    --------
    >>> from grasp.spatial.gripper import panda_hand
    >>> round(demanded_share(panda_hand(), 1.02), 2)
    0.5
    """
    mu = gripper.friction if friction is None else friction
    return mass * _GRAVITY / (2 * mu * gripper.max_force)


def demands(
    contacts: PadContacts, gripper: ParallelGripper, mass: float, friction: float | None = None
) -> Demand:
    """Return what a mass, kg, asks of grasps at an acceleration of 1 g.

    Parameters
    ----------
    friction
        Coulomb coefficient; None = the gripper's.
    """
    mu = gripper.friction if friction is None else friction
    share = demanded_share(gripper, mass, mu)
    reach = np.sqrt(contacts.radius**2 + _SOFT_M**2).mean(axis=-1)
    lever = np.hypot(contacts.lever[..., 1], contacts.lever[..., 2])
    # Opposed normals sum to nothing, whichever way both are turned against the pads.
    lean = np.linalg.norm(contacts.normals.sum(axis=-2), axis=-1) / 2
    taper = lean / np.sqrt(np.maximum(1 - lean**2, 1e-6)) / mu
    return Demand(np.full(lever.shape, share), share * lever / reach, taper)


def hold_shares(contacts: PadContacts, demand: Demand, acceleration: float = LIFT_G) -> FloatArray:
    """Return how likely each grasp holds under each error of the pose (c, K), in [0, 1].

    Parameters
    ----------
    acceleration
        That the task asks for, in g: 1 for lifting, 2.5 for carrying.
    """
    asked = acceleration**2 * (demand.force**2 + demand.torque**2) + demand.taper**2
    return np.asarray(np.where(contacts.met, 1 / (1 + asked ** (_SLOPE / 2)), 0.0))


def with_holding(
    candidates: Sequence[GraspCandidate],
    mesh: Mesh,
    gripper: ParallelGripper,
    mass: float,
    noise: PoseNoise | None = None,
    *,
    samples: int = 100,
    seed: int = 0,
    promises: Promises | None = None,
) -> list[GraspCandidate]:
    """Return the candidates with ``lift``, ``carry``, ``lever``, ``patch`` and ``taper`` as scores.

    These order grasps; ``lift_chance``, ``lift_at_least`` and those of ``carry`` are what is
    promised of the first two under ``load``, the weight over what the friction bears.

    Parameters
    ----------
    candidates
        With ``confidence``, the share of errors under which the middle line closes and the open
        hand touches nothing: where it does not, a grasp still holds in two of three cases.
    mass
        Of the object, kg.
    noise, samples, seed
        Of the pose, as in :func:`grasp.spatial.scoring.confidence.score_grasps`.
    promises
        Of the hand, grown from its outcomes; None = those of a hand without any.

    Notes
    -----
    ``lever`` is the distance (m) from the centre of mass to the middle of the contacts, ``patch``
    the share of its lines with which the pad that holds less meets the object, ``taper`` how much
    of the friction the pads use up by leaning against each other; both are means over the errors.
    """
    if not candidates:
        return []
    noise, promises = noise or PoseNoise(), promises or Promises.by(gripper)
    poses = np.stack([c.frame_from_gripper for c in candidates])
    openings = [gripper.max_opening if c.opening is None else c.opening for c in candidates]
    contacts = pad_contacts(
        mesh, poses, gripper, noise.transforms(samples, seed), np.array(openings),
        noise.covariance is not None,
    )  # fmt: skip
    demand = demands(contacts, gripper, mass)
    shares = {"lift": LIFT_G, "carry": CARRY_G}
    means = {name: hold_shares(contacts, demand, g).mean(axis=1) for name, g in shares.items()}
    patch = contacts.rays.min(axis=-1).mean(axis=1) / (ACROSS * ALONG)
    taper = np.minimum(demand.taper, _STEEPEST).mean(axis=1)
    scored = []
    for i, candidate in enumerate(candidates):
        sure = _UNSURE + (1 - _UNSURE) * candidate.scores.get("confidence", 1.0)
        middle = candidate.centre if candidate.contacts is None else candidate.contacts.mean(axis=0)
        scores = {name: float(mean[i]) * sure for name, mean in means.items()}
        scores |= {"load": float(demand.force[i].mean()), "taper": float(taper[i])}
        lever = float(np.linalg.norm(middle - mesh.com))
        scores |= {**promises.of(scores), "lever": lever, "patch": float(patch[i])}
        scored.append(replace(candidate, scores={**candidate.scores, **scores}))
    return scored
