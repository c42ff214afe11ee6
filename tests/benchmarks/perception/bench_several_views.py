"""Tables seen by one camera, and by two or three together: what is found, and how much of it.

    python bench_several_views.py prim primstacked --seeds 300:320
    python bench_several_views.py prim --seeds 300:320 --off-mm 3 --off-deg 0.3

Every table is cut from its first view alone, and from two and three views joined by the poses of
their cameras, which stand evenly round it. Scores are of the pixels of the first view, so that all
ways answer for the same. *Found*: share of all objects, also those that the first camera hardly
sees, of which a segment covers three quarters (F) of what the cameras together see. *Covered*:
share of an object's surface, the underside left out, within 5 mm of the points of its segment.
Differences with intervals of 90 %, by resampling tables.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from features.geometry import transform
from features.segmentation import score_labels, segment_scene, warm_up
from features.segmentation.several import PlacedView, placed_frame, segment_views
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import plan_given, plan_on_cloud
from grasp.spatial.gripper import panda_hand
from grasp.spatial.interchange import with_contacts
from grasp.spatial.meshes.mesh import as_mesh
from tests.benchmarks.perception.tabletop_scenes import KINDS, TableScene, Thing, make_views

VIEWS = 3
NEAR_M = 0.005
FEWEST_PX = 400
COLUMNS = ("F", "p75", "found", "covered")


def surface(thing: Thing, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return samples (n, 3) of a thing's surface in the camera's frame, by area."""
    vertices, faces = thing.load()
    corners = transform(thing.camera_from_mesh, vertices)[faces]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(sides, axis=1)
    chosen = rng.choice(len(faces), 800, p=areas / areas.sum())
    shares = rng.dirichlet(np.ones(3), 800)
    return np.einsum("nk,nkj->nj", shares, corners[chosen])


def covered(
    scenes: Sequence[TableScene], labels: NDArray[np.int32], truth: NDArray[np.int32],
    points: NDArray[np.floating], rng: np.random.Generator,
) -> list[float]:  # fmt: skip
    """Return of each thing the share of its surface near the segment that shows most of it."""
    shares = []
    for thing in scenes[0].things:
        mine = labels[(truth == thing.number) & (labels > 0)]
        if not len(mine):
            shares.append(0.0)
            continue
        segment = points[labels == np.bincount(mine).argmax()]
        placed = transform(scenes[0].world_from_camera, surface(thing, rng))
        placed = placed[placed[:, 2] > placed[:, 2].min() + NEAR_M]
        far, _ = cKDTree(segment).query(placed, distance_upper_bound=NEAR_M)
        shares.append(float(np.isfinite(far).mean()))
    return shares


def grasp_chances(
    scenes: Sequence[TableScene], labels: NDArray[np.int32], truth: NDArray[np.int32],
    points: NDArray[np.floating], eyes: NDArray[np.float64],
) -> list[float]:  # fmt: skip
    """Return of each thing the true chance of the first grasp that is planned on its segment.

    It is planned on what the cameras show, with the table and no neighbours, and judged on the
    true mesh; 0 where none is found or the hand would touch the thing on its way.
    """
    hand, table, chances = panda_hand(), Surroundings(Support(0.0)), []
    for thing in scenes[0].things:
        mine = labels[(truth == thing.number) & (labels > 0)]
        if not len(mine):
            chances.append(0.0)
            continue
        segment = points[labels == np.bincount(mine).argmax()]
        vertices, faces = thing.load()
        to_world = scenes[0].world_from_camera @ thing.camera_from_mesh
        mesh = as_mesh(transform(to_world, vertices), faces)
        planned = plan_on_cloud(segment, hand, Support(0.0), eyes)
        given = with_contacts(list(planned)[:1], mesh, hand)
        judged = list(plan_given(given, mesh, hand, table)) if given else []
        chances.append(float(judged[0].scores["lift_chance"]) if judged else 0.0)
    return chances


def found(
    numbers: Sequence[int], labels: NDArray[np.int32], truth: NDArray[np.int32]
) -> list[float]:
    """Return of each thing whether a segment agrees with it to F of three quarters."""
    hits = []
    for number in numbers:
        of_thing = truth == number
        mine = labels[of_thing & (labels > 0)]
        best = np.bincount(mine).argmax() if len(mine) else -1
        both = np.count_nonzero(mine == best)
        whole = of_thing.sum() + np.count_nonzero(labels == best)
        hits.append(float(best > 0 and 2 * both / whole > 0.75))
    return hits


def measure(
    scenes: list[TableScene], count: int, off: tuple[float, float], seed: int
) -> list[float] | None:
    """Return the row of :data:`COLUMNS` by so many of the views; None where nothing is there."""
    rng = np.random.default_rng([seed, 7])
    truth = np.concatenate([scene.labels.ravel() for scene in scenes])
    placed = [
        placed_frame(scene.frame, _off(scene.world_from_camera, off, rng) if k else
                     scene.world_from_camera)
        for k, scene in enumerate(scenes)
    ]  # fmt: skip
    if count == 1:
        first = scenes[0]
        cut = segment_scene(first.frame.points(), first.frame.rgb, gravity=first.down).labels
        own = [cut]
    else:
        own = list(segment_views(placed[:count]).labels)
    own += [np.zeros_like(scene.labels) for scene in scenes[count:]]
    labels = np.concatenate([each.ravel() for each in own])
    score = score_labels(own[0], np.maximum(scenes[0].labels, 0), scenes[0].labels >= 0)
    numbers = [
        thing.number for thing in scenes[0].things
        if max(np.count_nonzero(s.labels == thing.number) for s in scenes) >= FEWEST_PX
    ]  # fmt: skip
    if score is None or not numbers:
        return None
    # A segment is judged by what its own cameras see: the others' pixels are no part of it.
    seen = np.concatenate([
        np.where(k < count, scene.labels, -1).ravel() for k, scene in enumerate(scenes)
    ])  # fmt: skip
    points = np.concatenate([_points(view) for view in placed])
    return [
        score.f, score.p75, float(np.mean(found(numbers, labels, seen))),
        float(np.mean(covered(scenes, labels, truth, points, np.random.default_rng(seed)))),
    ]  # fmt: skip


def _points(view: PlacedView) -> NDArray[np.float64]:
    return np.asarray(transform(view.frame_from_camera, view.points.reshape(-1, 3)), np.float64)


def _off(
    pose: NDArray[np.float64], off: tuple[float, float], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return a pose that is wrong by so many mm along each axis and degrees about each."""
    wrong = np.eye(4)
    wrong[:3, 3] = rng.normal(0, 1e-3 * off[0], 3)
    wrong[:3, :3] = Rotation.from_rotvec(np.radians(rng.normal(0, off[1], 3))).as_matrix()
    return np.asarray(pose @ wrong, np.float64)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="+", choices=[kind for kind in KINDS if kind != "ycb"])
    parser.add_argument("--seeds", default="300:320")
    parser.add_argument("--off-mm", type=float, default=0.0, help="error of poses, deviation")
    parser.add_argument("--off-deg", type=float, default=0.0)
    asked = parser.parse_args()
    first, last = map(int, asked.seeds.split(":"))
    warm_up()
    for kind in asked.kinds:
        rows: dict[int, list[list[float]]] = {count: [] for count in range(1, VIEWS + 1)}
        for seed in range(first, last):
            scenes = make_views(kind, seed, 2 * VIEWS)
            chosen = [scenes[0], scenes[VIEWS], scenes[1]]  # the second stands opposite
            made = {k: measure(chosen, k, (asked.off_mm, asked.off_deg), seed) for k in rows}
            if all(row is not None for row in made.values()):
                for count, row in made.items():
                    rows[count].append(row or [])
        report(kind, {count: np.array(values) for count, values in rows.items()})


def report(kind: str, rows: dict[int, NDArray[np.float64]]) -> None:
    """Print the means, and the differences to one view."""
    rng = np.random.default_rng(0)
    print(f"{kind}, {len(rows[1])} tables")
    for count, values in rows.items():
        text = "  ".join(
            f"{name} {mean:.3f}" for name, mean in zip(COLUMNS, values.mean(0), strict=True)
        )
        print(f"  {count} view{'s' * (count > 1)}: {text}")
        if count > 1:
            drawn = rng.integers(len(values), size=(2000, len(values)))
            low, high = np.quantile((values - rows[1])[drawn].mean(axis=1), (0.05, 0.95), axis=0)
            bounds = zip(COLUMNS, low, high, strict=True)
            print("    more: " + "  ".join(f"{name} {a:+.3f} to {b:+.3f}" for name, a, b in bounds))


if __name__ == "__main__":
    main()
