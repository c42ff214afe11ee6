"""Scenes: what is where in one tree of frames, written as glTF and OpenUSD for other programs."""

from __future__ import annotations

import ast
import io
import re
from typing import Any

import numpy as np
import pytest

from features.modelling import mesh_to_ply
from rtask.errors import UnknownTermError
from rtask.rdf.namespaces import PREFIXES
from rtask.world.scene import Scene, SceneNode, glb, usda
from tests.rtask.world.conftest import BASE, Lab, pose

GRASP = f"{BASE}grasp/1"
HOSTILE = 'a "cup"\n)\x07{ def \\ ü </script>'


@pytest.fixture
def scene(lab: Lab) -> Scene:
    """A table and a robot in a map, a cup seen on each, and a box that was put into another."""
    lab.kb.update(f"""{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
      <{lab.cup}> rt:extentZ 0.1e0 ; rt:hasGrasp <{GRASP}> .
      <{GRASP}> a rt:PlanarGrasp ; rt:graspPose <{GRASP}/pose> ; rt:jawOpening 0.06e0 .
      <{GRASP}/pose> rt:x 0.01e0 ; rt:y 0.0e0 ; rt:z 0.05e0 ; rt:theta 0.0e0 }} }}""")
    lab.stand(lab.table, lab.map, 2.0, 0.0, 0.0)
    lab.stand(lab.frame(), lab.map, 1.5, 0.0, 0.0)
    lab.see(lab.cup, 0.5, 0.1, 10.0)
    lab.see(lab.cup, 0.3, 0.3, 10.0, frame=lab.table)
    lab.put(lab.see(lab.box, 0.3, -0.1, 10.0), "in", lab.left_box, 60.0)
    lab.stand(lab.frame(), lab.map, 7.0, 0.0, 90.0)
    return lab.kb.world.scene(lab.noon + 100.0)


def at(scene: Scene, kind: str) -> list[list[float]]:
    """Return where nodes of a kind are in the root, m."""
    poses = zip(scene.nodes, scene.root_from_nodes(), strict=True)
    return [p[:3, 3].round(6).tolist() for node, p in poses if node.kind == kind]


def test_a_scene_has_frames_robots_things_and_grasps_where_they_were(
    lab: Lab, scene: Scene
) -> None:
    assert scene.root == lab.map
    assert at(scene, "robot") == [[7.0, 0.0, 0.0]]
    # What the robot saw stays where it was when the robot has walked away.
    assert sorted(at(scene, "thing")) == [[2.0, 0.1, 0.0], [2.3, 0.3, 0.0]]
    assert sorted(place[2] for place in at(scene, "grasp")) == [0.05, 0.05]
    (cup, _) = [node for node in scene.nodes if node.kind == "thing"]
    assert cup.size_m == (0.09, 0.08, 0.1)
    assert cup.facts["product"] == lab.cup
    before = lab.kb.world.scene(lab.noon + 50.0)
    assert at(before, "robot") == [[1.5, 0.0, 0.0]]
    assert len(at(before, "thing")) == 3
    assert at(lab.kb.world.scene(lab.noon + 5.0), "thing") == []


def test_what_cannot_be_drawn_is_named_with_the_reason(lab: Lab, scene: Scene) -> None:
    (box,) = scene.unplaced
    assert (box.label, box.reason) == ("tea box", "in left box, whose pose is not known")
    assert scene.other_roots == ((lab.frame("nao-2"), 0),)
    other = lab.kb.world.scene(lab.noon + 100.0, "nao-2/base")
    assert [(node.kind, node.label) for node in other.nodes] == [
        ("frame", "base"), ("robot", "nao-2"),
    ]  # fmt: skip
    assert other.other_roots == ((lab.map, 2),)
    for name in ("attic", f"{BASE}frame/attic"):
        with pytest.raises(UnknownTermError, match="attic"):
            lab.kb.world.scene(lab.noon, name)


def test_the_frame_of_a_product_is_no_place_of_a_robot(lab: Lab) -> None:
    lab.kb.update(f"""{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
      <{lab.cup}> rt:bodyFrame <{BASE}frame/object-1> . <{BASE}frame/object-1> a rt:Frame }} }}""")
    scene = lab.kb.world.scene(lab.noon)
    assert [node.label for node in scene.nodes if node.kind == "robot"] == ["nao-1"]
    assert f"{BASE}frame/object-1" not in dict(scene.other_roots)


def test_frames_in_a_ring_are_named_and_not_drawn(lab: Lab) -> None:
    lab.kb.update(f"""{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
      <{lab.map}> rt:parentFrame <{lab.table}> ; rt:poseInParent <{lab.map}/p> .
      <{lab.table}> rt:parentFrame <{lab.map}> ; rt:poseInParent <{lab.table}/p> .
      <{lab.map}/p> rt:inFrame <{lab.table}> . <{lab.table}/p> rt:inFrame <{lab.map}> .
      {" ".join(f"<{f}/p> rt:{n} {v} ." for f in (lab.map, lab.table)
                for n, v in zip(("x", "y", "z", "qx", "qy", "qz", "qw"), ("0e0",) * 6 + ("1e0",),
                                strict=True))}
    }} }}""")  # fmt: skip
    lab.see(lab.cup, 0.3, 0.3, 10.0, frame=lab.table)
    scene = lab.kb.world.scene(lab.noon + 20.0)
    reasons = {one.label: one.reason for one in scene.unplaced}
    assert set(reasons) == {"map", "table", "blue cup"}
    assert all("ring" in reason for reason in reasons.values())


def test_trimesh_finds_things_and_grasps_of_the_glb_at_their_places(lab: Lab, scene: Scene) -> None:
    trimesh = pytest.importorskip("trimesh")
    read = trimesh.load(io.BytesIO(glb(scene)), file_type="glb")
    nodes = {
        data["metadata"]["iri"]: (child, data["metadata"])
        for (_, child), data in read.graph.transforms.edge_data.items()
        if "iri" in data.get("metadata", {})
    }
    poses = dict(zip((n.iri for n in scene.nodes), scene.root_from_nodes(), strict=True))
    assert nodes.keys() == poses.keys() == {node.iri for node in scene.nodes}
    turn = read.graph.get("z up")[0]
    for iri, (name, _) in nodes.items():
        if iri != GRASP:  # stands at two things
            assert np.allclose(read.graph.get(name)[0], turn @ poses[iri], atol=1e-9)
    cups = [n for n, m in nodes.values() if m["kind"] == "thing"]
    boxes = [read.geometry[read.graph[name][1]] for name in cups]
    assert [np.round(box.extents, 6).tolist() for box in boxes] == [[0.09, 0.08, 0.1]] * 2
    for box in boxes:
        box.merge_vertices(merge_norm=True)  # each face has normals of its own
    assert all(box.is_watertight and box.volume > 0 for box in boxes)
    # glTF has y up: the cups stand on the floor and are 10 cm high.
    cup = boxes[0].copy().apply_transform(read.graph[cups[0]][0])
    assert np.allclose(cup.bounds[:, 1], [0.0, 0.1], atol=1e-6)


def with_surface(lab: Lab, is_current: bool = True) -> Scene:
    """Return the scene after the cup got a surface, a tetrahedron with one corner unseen."""
    corners = 0.09 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1.0)])
    faces = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    seen = np.array([False, True, True, True])
    data = mesh_to_ply(corners, faces, np.full((4, 3), 90, np.uint8), seen)
    blob = lab.kb.blobs.put(data, "model/ply").iri.value
    model = f"{BASE}model/1"
    made_from = model if is_current else f"{BASE}model/0"
    lab.kb.update(f"""{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
      <{lab.cup}> rt:hasModel <{model}> ; rt:hasFeature <{BASE}mesh/1> .
      <{model}> rt:hasBlob <{blob}> .
      <{BASE}mesh/1> a rt:TriangleMesh ; rt:hasBlob <{blob}> ; rt:seenShare 0.25e0 ;
        rt:medianResidual 0.001e0 ; rt:residual90 0.002e0 ; rt:isWatertight true ;
        prov:wasDerivedFrom <{made_from}> }} }}""")
    return lab.kb.world.scene(lab.noon + 100.0)


def test_trimesh_finds_the_surface_of_a_thing_with_what_was_filled_in_apart(
    lab: Lab, scene: Scene
) -> None:
    trimesh = pytest.importorskip("trimesh")
    assert not any(node.surface for node in scene.nodes)
    read = trimesh.load(io.BytesIO(glb(with_surface(lab))), file_type="glb")
    parts = [g for name, g in read.geometry.items() if name.startswith("thing")]
    assert sorted(len(part.faces) for part in parts) == [1, 3]
    (seen,) = [part for part in parts if len(part.faces) == 1]
    assert np.allclose(sorted(seen.extents), [0.09] * 3, atol=1e-6)
    grey = next(p for p in parts if len(p.faces) == 3).visual.material.baseColorFactor
    assert len(set(grey[:3].tolist())) == 1
    bare = lab.kb.world.scene(lab.noon + 100.0, surfaces=False)
    assert not any(node.surface for node in bare.nodes)


def test_a_stale_surface_is_not_drawn(lab: Lab, scene: Scene) -> None:
    assert not any(node.surface for node in with_surface(lab, is_current=False).nodes)


def test_usd_text_has_a_surface_with_grey_where_it_was_not_seen(lab: Lab, scene: Scene) -> None:
    text = usda(with_surface(lab))
    colours = re.findall(r"displayColor = \[(.*)\] \(interpolation = \"uniform\"\)", text)
    assert len(colours) == 2
    assert colours[0].count("(0.62, 0.62, 0.62)") == 3
    assert text.count("int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]") == 2


def test_usd_text_has_each_node_with_its_iri(scene: Scene) -> None:
    text = usda(scene)
    assert {node.kind for node in scene.nodes} == {"frame", "robot", "thing", "grasp"}
    for node in scene.nodes:
        assert f'rtask:iri = "{node.iri}"' in text
    assert text.count("def Mesh") == 2


def _placed_in_text(text: str) -> list[tuple[str, list[list[float]]]]:
    """Return IRI and pose in the root of each prim of USD text that has both.

    Reads what `usda` may write and no more: prims in braces, each a line of its own, with one
    matrix that USD multiplies row vectors by.
    """
    found, stack, opened = [], [np.eye(4)], 0
    for line in map(str.strip, text.splitlines()):
        if line == "{":
            stack.append(stack[-1])
            opened += 1
        elif line == "}":
            stack.pop()
        elif line.startswith("matrix4d xformOp:transform = "):
            rows = np.array(ast.literal_eval(line.partition(" = ")[2]), np.float64)
            stack[-1] = stack[-2] @ rows.T
        elif line.startswith("custom string rtask:iri = "):
            found.append((ast.literal_eval(line.partition(" = ")[2]), stack[-1].round(9).tolist()))
    assert (len(stack), opened) == (1, text.count("def "))
    return found


def test_usd_text_has_each_node_at_its_place_below_its_parent(scene: Scene) -> None:
    meant = [
        (node.iri, p.round(9).tolist())
        for node, p in zip(scene.nodes, scene.root_from_nodes(), strict=True)
    ]
    assert sorted(_placed_in_text(usda(scene))) == sorted(meant)


def test_usd_text_is_read_by_the_library_of_pixar(lab: Lab, scene: Scene, tmp_path: Any) -> None:
    pxr = pytest.importorskip("pxr", reason="needs usd-core")
    from pxr import Usd, UsdGeom

    assert pxr
    file = tmp_path / "scene.usda"
    file.write_text(usda(scene), encoding="utf-8")
    stage = Usd.Stage.Open(str(file))
    cache = UsdGeom.XformCache()
    found = [
        (prim.GetAttribute("rtask:iri").Get(),
         np.array(cache.GetLocalToWorldTransform(prim)).T.round(9).tolist())
        for prim in stage.Traverse() if prim.HasAttribute("rtask:iri")
    ]  # fmt: skip
    meant = [
        (node.iri, p.round(9).tolist())
        for node, p in zip(scene.nodes, scene.root_from_nodes(), strict=True)
    ]
    assert sorted(found) == sorted(meant)
    assert str(UsdGeom.GetStageUpAxis(stage)) == "Z"


def test_names_of_any_kind_become_valid_and_unique_names_of_prims() -> None:
    root = SceneNode("frame", "urn:map", "map", None, pose(0, 0))
    named = [
        SceneNode("thing", f"urn:{k}", name, 0, pose(k, 0), (0.1, 0.1, 0.1))
        for k, name in enumerate((HOSTILE, "7 cups", "7-cups", "shape", "ü"))
    ]
    text = usda(Scene(0.0, (root, *named)))
    prims = [line.split('"')[1] for line in text.splitlines() if "def Xform" in line]
    assert prims == ["world", "map", "a_cup_def_script", "_7_cups", "_7_cups_2", "shape_2", "thing"]
    assert 'displayName = "a \\"cup\\"\\n) { def \\\\ ü </script>"' in text
    assert (
        text.count("{") - text.count("}")
        == usda(Scene(0.0, (root,))).count("{") - usda(Scene(0.0, (root,))).count("}") + 1
    )  # the one in the name


def test_what_is_somewhere_in_a_box_is_an_outline_of_the_box_and_no_thing_at_a_pose(
    lab: Lab, scene: Scene
) -> None:
    """Nobody saw where in the box they lie: a box or a grasp there would be a guess."""
    lab.kb.update(f"""{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
      <{lab.left_box}> rt:bodyFrame <{lab.left_box}/frame> ; rt:surfaceLength 0.3e0 ;
        rt:surfaceWidth 0.2e0 ; rt:rimHeight 0.1e0 .
      <{lab.left_box}/frame> a rt:Frame ; rt:frameId "left box" }} }}""")
    lab.stand(f"{lab.left_box}/frame", lab.map, 1.0, 1.0, 0.0)
    (cup, _) = [node for node in scene.nodes if node.kind == "thing"]
    assert any(node.kind == "grasp" and node.parent == scene.nodes.index(cup)
               for node in scene.nodes)  # fmt: skip
    lab.put(cup.iri, "in", lab.left_box, 95.0)
    shown = lab.kb.world.scene(lab.noon + 100.0)
    inside = [node for node in shown.nodes if node.facts.get("poseOf") == "place"]
    assert {node.facts["somewhere"] for node in inside} == {"somewhere in left box"}
    assert [(node.size_m, node.surface, node.region_m) for node in inside] == [
        (None, None, (0.3, 0.2, 0.1))
    ] * 2
    numbers = {shown.nodes.index(node) for node in inside}
    assert not any(node.kind == "grasp" and node.parent in numbers for node in shown.nodes)
    trimesh = pytest.importorskip("trimesh")
    loaded = trimesh.load(io.BytesIO(glb(shown)), file_type="glb")
    outlines = [mesh for mesh in loaded.geometry.values()
                if np.allclose(np.ptp(mesh.bounds, axis=0), (0.3, 0.2, 0.1))]  # fmt: skip
    assert outlines
    assert not any(hasattr(mesh, "faces") for mesh in outlines if len(mesh.vertices) == 24)
    text = usda(shown)
    assert text.count('string rtask:somewhere = "somewhere in left box"') == 2
