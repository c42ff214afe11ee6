"""Training samples for the filter of grasp candidates: simulated views, labelled by the mesh.

Candidates are those of a plan on the completed cloud: hands of the search and pairs of contacts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.clouds.cloud import SurfaceCloud, prepare_cloud
from grasp.spatial.clouds.completion import complete_by_symmetry
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_search.classifier import GraspSamples, gripper_key
from grasp.spatial.hand_search.closing_region import PICTURE, STATISTICS, closing_regions
from grasp.spatial.hand_search.hand_search import propose_on
from grasp.spatial.hand_search.surface_pairs import propose_pairs
from grasp.spatial.meshes.mesh import Mesh
from simulate.study.grasp_shapes import FAMILIES, sample_shape
from simulate.study.grasp_views import TABLE, correct, depth_view, sample_camera
from simulate.study.quality.objects import generated
from simulate.world.noise import SensorNoise

__all__ = ["collect_samples", "machined", "shapes"]

_PARTS_SEED = 1000


def shapes(per_family: int, first: int = 0) -> Iterator[Mesh]:
    """Yield ``per_family`` shapes of every family, seeds from ``first`` on."""
    for seed in range(first, first + per_family):
        for family in FAMILIES:
            yield sample_shape(family, seed)


def machined(count: int, gripper: ParallelGripper) -> Iterator[Mesh]:
    """Yield generated parts of ten further families, sized for a gripper, each on z = 0."""
    for number in range(count):
        mesh = generated(_PARTS_SEED, number, gripper).mesh()
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        pose = np.eye(4)
        pose[:3, 3] = -(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]
        yield mesh.moved(pose)


def collect_samples(
    meshes: Iterable[Mesh],
    gripper: ParallelGripper,
    candidates: int = 60,
) -> GraspSamples:
    """Render meshes on a table, look for hands and pairs, and label them on the whole mesh.

    Parameters
    ----------
    meshes
        Each on z = 0.
    candidates
        Kept of the view of each mesh: so many hands, and so many pairs of contacts.

    Returns
    -------
    GraspSamples
        ``objects`` counts the meshes.
    """
    rows: dict[str, list[np.ndarray]] = {
        name: [] for name in ("statistics", "pictures", "right", "objects", "geometry", "one_sided")
    }
    for number, mesh in enumerate(meshes):
        rng = np.random.default_rng([0, number, 0])
        seen = depth_view(mesh, sample_camera(rng), SensorNoise(), int(rng.integers(1 << 31)))
        cloud = prepare_cloud(seen.points, table=TABLE, viewpoints=seen.viewpoint[None])
        cloud = complete_by_symmetry(cloud)
        proposals = _candidates(cloud, gripper, candidates)
        if not proposals:
            continue
        statistics, pictures = closing_regions(cloud, proposals, gripper)
        rows["statistics"].append(statistics)
        rows["pictures"].append(pictures)
        rows["right"].append(correct(proposals, mesh, gripper))
        rows["objects"].append(np.full(len(proposals), number))
        geometry = [candidate.scores.get("geometry", np.nan) for candidate in proposals]
        rows["geometry"].append(np.array(geometry, np.float32))
        rows["one_sided"].append(np.array([c.antipodal != "full" for c in proposals]))
    empty = {
        "statistics": np.empty((0, len(STATISTICS)), np.float32),
        "pictures": np.empty((0, *PICTURE), bool),
        "right": np.empty(0, bool),
        "objects": np.empty(0, np.int64),
        "geometry": np.empty(0, np.float32),
        "one_sided": np.empty(0, bool),
    }
    joined = {name: np.concatenate([empty[name], *parts]) for name, parts in rows.items()}
    return GraspSamples(**joined, gripper=gripper_key(gripper))


def _candidates(cloud: SurfaceCloud, gripper: ParallelGripper, most: int) -> list[GraspCandidate]:
    """Return the first ``most`` hands and the first ``most`` pairs of contacts."""
    if cloud.reason:
        return []
    hands = propose_on(cloud, gripper).candidates[:most]
    pairs = propose_pairs(cloud, cloud.surface(), gripper, cloud.support)
    return [*hands, *pairs.candidates[:most]]
