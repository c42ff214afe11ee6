"""Grasps of opposed contacts on the surface that a cloud shows and its completion guesses.

A hand search tries hands about the local axis of least curvature: never from the end of that axis,
as onto the rim of a cup, whose wall is straight upwards, and only in eighths of a turn. Pairs of
opposed contacts are approached from all around their closing axis, the steepest free way first.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from grasp.spatial.candidate import Proposals
from grasp.spatial.clouds.cloud import SurfaceCloud
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.confidence import PoseNoise

__all__ = ["propose_pairs"]


def propose_pairs(
    cloud: SurfaceCloud,
    surface: Mesh,
    gripper: ParallelGripper,
    support: Support | None = None,
    noise: PoseNoise | None = None,
    tries: int = 2000,
    seed: int = 0,
) -> Proposals:
    """Propose grasps whose two contacts are known points of a cloud.

    Parameters
    ----------
    cloud
        Of one object, ready; its points that are no target are obstacles.
    surface
        Its target as small squares; see :meth:`SurfaceCloud.surface`.
    support
        In the frame of the cloud.
    noise, tries, seed
        See :func:`grasp.spatial.mesh_candidates.propose_on_mesh`.

    Returns
    -------
    Candidates with label ``full``, not scored yet; ``completed`` where a contact was not seen.
    """
    around = Surroundings(support, cloud.obstacles)
    proposals = propose_on_mesh(surface, gripper, around, tries=tries, noise=noise, seed=seed)
    if not proposals:
        return proposals
    contacts = np.stack([pair.contacts for pair in proposals if pair.contacts is not None])
    points, guessed = cloud.points[cloud.target], cloud.completed[cloud.target]
    hidden = guessed[cKDTree(points).query(contacts.reshape(-1, 3))[1]].reshape(-1, 2).any(axis=1)
    return replace(
        proposals,
        candidates=tuple(
            replace(pair, source="cloud", completed=bool(unseen))
            for pair, unseen in zip(proposals, hidden, strict=True)
        ),
    )
