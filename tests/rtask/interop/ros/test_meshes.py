"""Meshes of a robot's model: where they are found, what is read, and that their links are body."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from features.perception import perceive
from rtask.errors import DataError, UsageError
from rtask.interop.ros.robot.body import body_of_json, body_pixels
from rtask.interop.ros.robot.meshes import MeshFiles, read_mesh
from rtask.interop.ros.robot.model import RobotModel
from rtask.interop.ros.robot.surface import MAX_POINTS, surface_of_mesh
from tests.rtask.interop.ros.scene import BASE_FROM_CAMERA, view

trimesh = pytest.importorskip("trimesh")

SIZE = (0.05, 0.07, 0.08)
"""Of the first box of the view, m."""


def model_of(uri: str, scale: str = "1 1 1") -> str:
    mesh = f"<mesh filename='{uri}' scale='{scale}'/>"
    collision = f"<collision><geometry>{mesh}</geometry></collision>"
    return f"<robot name='r'><link name='bin'>{collision}</link></robot>"


@pytest.fixture
def share(tmp_path):
    """Return the folder of a package of ROS 2, with a box in each format."""
    folder = tmp_path / "install/share/nao/meshes"
    folder.mkdir(parents=True)
    box = trimesh.creation.box(SIZE)
    for name in ("box.stl", "box.obj"):
        box.export(folder / name)
    (folder / "text.stl").write_text(trimesh.exchange.stl.export_stl_ascii(box))
    trimesh.creation.box(np.array(SIZE) * 1000).export(folder / "mm.STL")
    return folder


def lookup(link):
    pose = np.eye(4)
    pose[:3, 3] = (0.27, 0.09, 0.31)
    return pose


def seen_beside(model):
    frame = view()
    shapes, unplaced = model.placed(lookup, "base")
    assert not unplaced
    body = body_pixels(frame.points(), BASE_FROM_CAMERA, body_of_json(shapes))
    objects = perceive(frame, BASE_FROM_CAMERA, body=body).objects
    return [round(float(each.position[1]), 2) for each in objects]


def test_a_link_whose_shape_is_a_mesh_of_a_package_is_no_object(tmp_path, share):
    files = MeshFiles({"AMENT_PREFIX_PATH": f"/nowhere:{tmp_path / 'install'}"})
    model = RobotModel(model_of("package://nao/meshes/mm.STL", "0.001 0.001 0.001"), files)
    assert model.notes == []
    assert seen_beside(model) == [-0.09]


@pytest.mark.parametrize("name", ["box.stl", "text.stl", "box.obj"])
def test_each_format_has_the_triangles_that_another_library_reads(share, name):
    path = share / name
    corners = read_mesh(path)
    other = trimesh.load(path, force="mesh")
    assert len(corners) == len(other.faces) == 12
    np.testing.assert_allclose(corners.reshape(-1, 3).min(axis=0), other.bounds[0], atol=1e-7)
    np.testing.assert_allclose(corners.reshape(-1, 3).max(axis=0), other.bounds[1], atol=1e-7)


COLLADA = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="s"><float_array id="a" count="12">
0 0 0  1 0 0  1 1 0  0 1 0</float_array><technique_common><accessor source="#a" count="4"
stride="3"/></technique_common></source><vertices id="v"><input semantic="POSITION"
source="#s"/></vertices><polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="NORMAL" source="#s" offset="1"/><vcount>4</vcount><p>0 0 1 0 2 0 3 0</p>
</polylist></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="w">
<node><translate>0 0 5</translate><node><rotate>0 0 1 90</rotate><scale>2 2 2</scale>
<instance_geometry url="#g"/></node></node></visual_scene></library_visual_scenes><scene>
<instance_visual_scene url="#w"/></scene></COLLADA>"""


def test_collada_has_its_unit_and_the_places_of_its_nodes_but_not_its_up_axis(tmp_path):
    file = tmp_path / "a.dae"
    file.write_text(COLLADA)
    corners = read_mesh(file)
    assert corners.shape == (2, 3, 3)
    expected = [[0, 0, 0.05], [0, 0.02, 0.05], [-0.02, 0.02, 0.05]]
    np.testing.assert_allclose(corners[0], expected, atol=1e-12)


def test_what_is_not_here_or_cannot_be_read_is_said_and_the_other_links_count(tmp_path, share):
    (share / "torn.stl").write_bytes((share / "box.stl").read_bytes()[:200])
    (share / "box.ply").write_bytes(b"ply")
    files = MeshFiles({"AMENT_PREFIX_PATH": str(tmp_path / "install")})
    notes = {
        "package://other/hand.stl": "package://other/hand.stl is not in this environment",
        "package://nao/../../../../etc/hostname": "is not in this environment",
        "package://nao/meshes/torn.stl": "torn.stl: 0 triangles; expected 1 to",
        "package://nao/meshes/box.ply": "box.ply: expected .stl, .obj, .dae",
    }
    sphere = "<collision><geometry><sphere radius='0.1'/></geometry></collision>"
    for uri, words in notes.items():
        text = model_of(uri).replace("</robot>", f"<link name='head'>{sphere}</link></robot>")
        model = RobotModel(text, files)
        [note] = model.notes
        assert note.startswith("the shape of bin is not known: "), note
        assert words in note
        assert [each["kind"] for each in model.placed(lookup, "base")[0]] == ["sphere"]


def test_packages_of_ros_1_and_files_by_their_path_are_found(tmp_path, share):
    source = tmp_path / "install/share"
    for variables in ({"ROS_PACKAGE_PATH": f"{source}"}, {"ROS_PACKAGE_PATH": f"{source / 'nao'}"}):
        assert MeshFiles(variables).find("package://nao/meshes/box.stl") == share / "box.stl"
    assert MeshFiles({}).find(f"file://{share / 'box.stl'}") == share / "box.stl"
    assert MeshFiles({}).find("meshes/box.stl") is None


def test_a_model_without_any_shape_says_so():
    model = RobotModel("<robot name='r'><link name='a'/></robot>")
    assert model.notes == ["no link has a collision shape that is known"]
    assert model.placed(lookup, "base") == ([], [])


def test_no_point_of_a_surface_is_farther_from_the_next_sample_than_the_request_says():
    rng = np.random.default_rng(5)
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.15)
    surface = surface_of_mesh(mesh.triangles, np.eye(4))
    assert len(surface.points) < 4 * np.pi * (0.15 / 0.01) ** 2 * 1.5
    places = trimesh.sample.sample_surface(mesh, 4000, seed=rng)[0]
    apart = cKDTree(surface.points).query(places)[0]
    # The first of each cell of 1 cm: one in a hundred is a little farther than its radius.
    assert np.quantile(apart, 0.99) <= surface.radius
    assert apart.max() <= surface.radius + 0.005
    shape = {"kind": "points", "size": [surface.radius], "pose": np.eye(4).ravel().tolist(),
             "points": surface.as_text()}  # fmt: skip
    outward = places * ([[1.0]] * 2000 + [[1.25]] * 2000)  # 3.75 cm off
    on_body = body_pixels(outward[None], np.eye(4), body_of_json([shape]))[0]
    assert on_body[:2000].mean() == 1.0
    assert not on_body[2000:].any()


def test_a_very_large_mesh_has_its_points_farther_apart():
    wall = np.array([[[0, 0, 0], [8.0, 0, 0], [0, 8.0, 0]]])
    surface = surface_of_mesh(wall, np.eye(4))
    assert len(surface.points) <= MAX_POINTS
    assert surface.radius > 0.0075


@pytest.mark.parametrize(
    ("points", "size", "words"),
    [
        ("", [0.01], "0 bytes"),
        ("AAAA", [0.01], "3 bytes"),
        ("!", [0.01], "points: "),
        ("AADAfwAAwH8AAMB/", [0.01], "not finite"),
        ("AAAAAAAAAAAAAAAA", [2.0], "a radius beyond 1 m"),
        ("AAAAAAAAAAAAAAAA", [], "shape 0"),
    ],
)
def test_a_surface_that_is_none_is_refused(points, size, words):
    shape = {"kind": "points", "size": size, "pose": np.eye(4).ravel().tolist(), "points": points}
    with pytest.raises(UsageError, match="shape 0 of the body") as caught:
        body_of_json([shape])
    assert words in str(caught.value)


def test_a_file_that_is_too_large_is_refused_by_its_size(tmp_path):
    file = tmp_path / "a.stl"
    with file.open("wb") as opened:
        opened.truncate(101 * 2**20)
    with pytest.raises(DataError, match="larger than 100 MiB"):
        read_mesh(file)
