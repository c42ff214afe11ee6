"""Meshes as they come: dirty, open, inside out, in millimetres, from files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grasp.spatial.meshes.mesh import Mesh, as_mesh
from grasp.spatial.meshes.mesh_files import has_faces, read_mesh
from grasp.spatial.meshes.shapes import box_mesh, cup_mesh, lathed_mesh, sphere_mesh


def _outward(mesh: Mesh) -> np.ndarray:
    """Return which faces of a convex mesh about the origin look away from it."""
    return np.einsum("fi,fi->f", mesh.normals, mesh.vertices[mesh.faces].mean(axis=1)) > 0


@pytest.mark.parametrize(
    ("mesh", "volume"),
    [
        (box_mesh((0.04, 0.06, 0.1)), 0.04 * 0.06 * 0.1),
        (sphere_mesh(0.03, 40), 4 / 3 * np.pi * 0.03**3),
        (lathed_mesh([(0.02, 0.0), (0.02, 0.05)], 90), np.pi * 0.02**2 * 0.05),
        (cup_mesh(0.04, 0.1, 0.005, 90), np.pi * (0.04**2 * 0.1 - 0.035**2 * 0.095)),
    ],
)
def test_plain_bodies_are_closed_and_have_their_volume(mesh: Mesh, volume: float) -> None:
    assert mesh.watertight
    assert mesh.com_from == "volume"
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    # Facets cut 1 % off round bodies at most.
    assert np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6 == pytest.approx(volume, rel=0.01)
    assert not mesh.notes


def test_faces_turned_at_random_are_turned_back() -> None:
    ball = sphere_mesh(0.03, 12)
    rng = np.random.default_rng(0)
    turned = rng.random(len(ball.faces)) < 0.4
    faces = np.where(turned[:, None], ball.faces[:, ::-1], ball.faces)
    mended = as_mesh(ball.vertices, faces)
    assert _outward(mended).all()
    assert any("looked inwards" in note for note in mended.notes)


def test_the_inside_of_a_cup_looks_into_the_cup() -> None:
    cup = cup_mesh(0.03, 0.08, 0.004)
    flipped = as_mesh(cup.vertices, cup.faces[:, ::-1])
    assert np.allclose(flipped.normals, cup.normals)


def test_a_hole_leaves_the_rest_outward_and_the_centre_in_place() -> None:
    box = box_mesh((0.04, 0.06, 0.1))
    # Two triangles of one side are missing, the others wrongly oriented.
    open_box = as_mesh(box.vertices, box.faces[2:, ::-1])
    assert _outward(open_box).all()
    assert not open_box.watertight
    assert open_box.com_from == "hull"
    assert open_box.com == pytest.approx([0, 0, 0], abs=1e-9)
    assert any("not closed" in note for note in open_box.notes)


def test_waste_is_dropped_and_said() -> None:
    box = box_mesh((0.04, 0.06, 0.1))
    vertices = np.vstack([box.vertices, [[np.nan, 0, 0], [9, 9, 9]], box.vertices[:1]])
    faces = np.vstack([box.faces, [[0, 1, 8], [0, 1, 1], [10, 0, 1]], box.faces[:1]])
    mended = as_mesh(vertices, faces)
    assert len(mended.faces) == 12
    assert len(mended.vertices) == 8
    assert mended.watertight
    said = " ".join(mended.notes)
    assert "not finite" in said
    assert "without area" in said
    assert "twice" in said


@pytest.mark.parametrize(("unit", "factor"), [(1000.0, "0.001"), (100.0, "0.01")])
def test_an_implausible_size_names_the_factor(unit: float, factor: str) -> None:
    big = as_mesh(box_mesh((0.04, 0.06, 0.2)).vertices * unit * 3, box_mesh((1, 1, 1)).faces)
    assert any(f"scale of {factor}" in note or "scale of 0.001" in note for note in big.notes)


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], r"vertices \(v, 3\)"),
        (np.zeros((3, 3)), [[0, 1]], r"triangles \(f, 3\)"),
        (np.zeros((3, 3)), [[0, 1, 3]], "faces name vertices 0 .. 2"),
        (np.zeros((3, 3)), [[0.9, 1.0, 2.0]], "whole numbers"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices: object, faces: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        as_mesh(vertices, faces)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [([], []), (np.full((3, 3), np.nan), [[0, 1, 2]]), (np.zeros((3, 3)), [[0, 1, 2]]),
     ([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2]])],
    ids=["empty", "nan", "one point", "a line"],
)  # fmt: skip
def test_nothing_usable_is_an_empty_mesh(vertices: object, faces: object) -> None:
    mesh = as_mesh(vertices, faces)  # type: ignore[arg-type]
    assert len(mesh.faces) == 0
    assert mesh.radius == 0.0


def _write(path: Path, mesh: Mesh) -> None:
    v, f = mesh.vertices, mesh.faces
    if path.name == "text.stl":
        rows = ["solid x"]
        for triangle in v[f]:
            rows += ["facet normal 0 0 0", "outer loop"]
            rows += ["vertex {:.9e} {:.9e} {:.9e}".format(*p) for p in triangle]
            rows += ["endloop", "endfacet"]
        path.write_text("\n".join([*rows, "endsolid x"]))
    elif path.suffix == ".stl":
        record = np.zeros(len(f), [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("r", "<u2")])
        record["c"] = v[f]
        path.write_bytes(b"\0" * 80 + np.uint32(len(f)).tobytes() + record.tobytes())
    elif path.suffix == ".obj":
        rows = ["v {:.9f} {:.9f} {:.9f}".format(*p) for p in v] + ["vt 0 0"]
        rows += ["f {}/1 {}/1 {}/1".format(*(g + 1 if k % 2 else g - len(v)))
                 for k, g in enumerate(f)]  # fmt: skip
        path.write_text("\n".join(rows))
    else:
        kind = "ascii" if path.name == "text.ply" else "binary_little_endian"
        head = (f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex {len(v)}\n"
                "property float x\nproperty float y\nproperty float z\nproperty uchar red\n"
                f"element face {len(f)}\nproperty list uchar int vertex_indices\n"
                "end_header\n")  # fmt: skip
        if kind == "ascii":
            rows = ["{:.9f} {:.9f} {:.9f} 7".format(*p) for p in v]
            rows += ["3 {} {} {}".format(*g) for g in f]
            path.write_text(head + "\n".join(rows))
        else:
            points = np.zeros(len(v), [("p", "<f4", 3), ("c", "u1")])
            points["p"] = v
            rings = np.zeros(len(f), [("n", "u1"), ("i", "<i4", 3)])
            rings["n"], rings["i"] = 3, f
            path.write_bytes(head.encode() + points.tobytes() + rings.tobytes())


@pytest.mark.parametrize("name", ["text.stl", "a.stl", "a.obj", "text.ply", "a.ply"])
def test_files_give_the_mesh_that_was_written(tmp_path: Path, name: str) -> None:
    cup = cup_mesh(0.03, 0.08, 0.004)
    _write(tmp_path / name, cup)
    read = read_mesh(tmp_path / name)
    assert len(read.faces) == len(cup.faces)
    assert read.watertight
    # Single precision of a few centimetres.
    assert read.com == pytest.approx(cup.com, abs=1e-7)
    assert read.areas.sum() == pytest.approx(cup.areas.sum(), rel=1e-6)
    if name.endswith("ply"):
        assert has_faces(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "data"),
    [("a.stl", b"rubbish"), ("a.ply", b"ply\nformat odd 1\nend_header\n"), ("a.ply", b"x"),
     ("a.obj", b"v 1 2 x\nf 1 1 1"), ("a.dae", b""), ("a.obj", b"v 0 0 0\nf 1 2 3")],
)  # fmt: skip
def test_files_that_are_no_mesh_are_named(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ValueError, match=r"mesh|faces"):
        read_mesh(tmp_path / name)


def test_a_truncated_stl_file_says_so(tmp_path: Path) -> None:
    cup = cup_mesh(0.03, 0.08, 0.004)
    for name in ("a.stl", "text.stl"):
        path = tmp_path / name
        _write(path, cup)
        path.write_bytes(path.read_bytes()[: -path.stat().st_size // 3])
        with pytest.raises(ValueError, match=f"{name} is no STL mesh: cut off"):
            read_mesh(path)


@pytest.mark.parametrize("name", ["text.ply", "a.ply"])
def test_a_truncated_ply_file_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    _write(path, cup_mesh(0.03, 0.08, 0.004))
    path.write_bytes(path.read_bytes()[: -path.stat().st_size // 3])
    with pytest.raises(ValueError, match=f"{name} is no PLY mesh"):
        read_mesh(path)
    path.write_bytes(path.read_bytes().replace(b"element face ", b"element face 9999999999"))
    with pytest.raises(ValueError, match="cut off: the header promises"):
        read_mesh(path)


def test_negative_numbers_of_an_obj_file_count_from_the_latest_vertex(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf -4 -3 -1\n")
    mesh = read_mesh(path)
    corners = {tuple(sorted(map(tuple, mesh.vertices[face].tolist()))) for face in mesh.faces}
    assert corners == {
        ((0, 0, 0), (0, 1, 0), (1, 0, 0)),
        ((0, 0, 0), (0, 0, 1), (1, 0, 0)),
    }


def test_polygons_are_cut_into_triangles(tmp_path: Path) -> None:
    square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"
    (tmp_path / "a.obj").write_text(square + "mtllib /etc/passwd\nusemtl x\nf 1 2 3\n")
    assert read_mesh(tmp_path / "a.obj").areas.sum() == pytest.approx(1.0)
