"""Lines through meshes: the hierarchy finds what trying every triangle finds."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.spatial.meshes.mesh import Mesh, as_mesh
from grasp.spatial.meshes.rays import NOTHING, build_tree, crossings, first_and_last
from grasp.spatial.meshes.shapes import box_mesh, cup_mesh, sphere_mesh


def _every_crossing(mesh: Mesh, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return distances to the planes of all faces, infinite where the line misses the face."""
    corners = mesh.vertices[mesh.faces]
    t = np.einsum("fi,fi->f", corners[:, 0] - o, mesh.normals) / (mesh.normals @ d)
    hit = o + t[:, None] * d
    inside = np.ones(len(t), bool)
    for k in range(3):
        edge = corners[:, (k + 1) % 3] - corners[:, k]
        side = np.einsum("fi,fi->f", np.cross(edge, hit - corners[:, k]), mesh.normals)
        inside &= side >= 0
    return np.where(inside, t, np.inf)


@pytest.mark.parametrize("mesh", [box_mesh((0.04, 0.06, 0.1)), cup_mesh(0.03, 0.08, 0.004),
                                  sphere_mesh(0.03, 12)], ids=["box", "cup", "sphere"])  # fmt: skip
def test_lines_meet_what_every_triangle_says(mesh: Mesh) -> None:
    rng = np.random.default_rng(1)
    origins = rng.normal(size=(60, 3)) * 0.02
    directions = rng.normal(size=(60, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    half = 0.05
    ends, faces = first_and_last(mesh.tree, origins, directions, half)
    at, _, counts = crossings(mesh.tree, origins, directions, -half, half)
    for k in range(60):
        t = _every_crossing(mesh, origins[k], directions[k])
        t = np.sort(t[np.abs(t) <= half])
        assert counts[k] == len(t)
        assert np.allclose(at[k, : len(t)], t, atol=1e-12)
        if len(t):
            assert ends[k] == pytest.approx([t[0], t[-1]], abs=1e-12)
            assert mesh.normals[faces[k, 0]] @ directions[k] != 0
        else:
            assert (faces[k] == NOTHING).all()


def test_a_line_through_an_edge_does_not_slip_between_its_faces() -> None:
    box = box_mesh((0.04, 0.04, 0.04))
    # The middle of a face lies on the diagonal between its two triangles.
    ends, faces = first_and_last(box.tree, np.zeros((3, 3)), np.eye(3), 0.1)
    assert ends == pytest.approx(np.tile([-0.02, 0.02], (3, 1)))
    assert (faces != NOTHING).all()


def test_many_faces_in_one_place_do_not_overflow_the_stack() -> None:
    rng = np.random.default_rng(2)
    base = rng.normal(size=(3, 3))
    scales = np.geomspace(1e-6, 1.0, 4000)  # sizes over six decades, all around one corner
    vertices = (scales[:, None, None] * base).reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    normal = np.cross(base[1] - base[0], base[2] - base[0])
    normals = np.tile(normal / np.linalg.norm(normal), (len(faces), 1))
    tree = build_tree(vertices, faces, normals)
    towards = base.mean(axis=0) / np.linalg.norm(base.mean(axis=0))
    _, _, counts = crossings(tree, np.zeros((1, 3)), towards[None], 0.0, 10.0)
    assert counts[0] == 64  # as many as are kept
    assert sorted(tree.faces.tolist()) == list(range(4000))


def test_no_line_meets_a_mesh_without_a_face() -> None:
    nothing = as_mesh(np.empty((0, 3)), np.empty((0, 3), int))
    origins, up = np.zeros((2, 3)), np.array([[0.0, 0, 1]] * 2)
    assert (first_and_last(nothing.tree, origins, up, 1.0)[1] == NOTHING).all()
    assert not crossings(nothing.tree, origins, up, -1.0, 1.0)[2].any()
