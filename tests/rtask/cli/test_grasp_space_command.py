"""`rtask grasp space` and `scene`: of meshes, clouds and objects; what is stored is recalled."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner, Result

import ontology
import rtask
import rtask.errors
from rtask.cli import cli, main
from rtask.engine.engine import Engine


def _run(*args: str) -> Result:
    return CliRunner().invoke(cli, ["grasp", "space", *args])


def _scene(*args: str) -> Result:
    return CliRunner().invoke(cli, ["grasp", "scene", *args])


def _box(path: Path, size: tuple[float, float, float]) -> Path:
    from grasp.spatial.meshes.shapes import box_mesh

    mesh = box_mesh(size)
    lines = ["v {:.6f} {:.6f} {:.6f}".format(*p) for p in mesh.vertices]
    lines += ["f {} {} {}".format(*(f + 1)) for f in mesh.faces]
    path.write_text("\n".join(lines))
    return path


def test_a_mesh_gives_a_table_and_a_drawing(tmp_path: Path) -> None:
    mesh = _box(tmp_path / "box.obj", (0.04, 0.12, 0.08))
    done = _run(str(mesh), "--samples", "30", "--limit", "3", "--save-plots", str(tmp_path / "d"))
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert lines[0] == "12 faces, 40 x 120 x 80 mm"
    table = next(k for k, line in enumerate(lines) if line.startswith("rank"))
    assert [line.split()[0] for line in lines[table + 1 : table + 4]] == ["1", "2", "3"]
    drawing = ElementTree.parse(tmp_path / "d" / "candidates_3d.svg").getroot()
    assert drawing.tag.endswith("svg")
    assert "why: computed from the shape alone, with 30 drawn errors" in done.stderr


def test_json_holds_messages_and_planar_views(tmp_path: Path) -> None:
    mesh = _box(tmp_path / "box.obj", (40, 120, 80))
    asked = ["--scale", "0.001", "--samples", "30", "--gripper", "jaw:0.07", "--json"]
    done = _run(str(mesh), *asked)
    assert done.exit_code == 0, done.output
    found = json.loads(done.output)
    best = found["grasps"][0]
    assert best["width"] == pytest.approx(0.04, abs=0.003)
    assert best["message"]["grasp_pose"]["header"]["frame_id"] == "object"
    assert len(best["features"]) == 14
    flat = [g for g in found["grasps"] if g["planar"]]
    assert flat
    assert all(abs(np.cos(g["planar"]["theta"])) > 0.8 for g in flat)
    assert found["verdict"] == ""


def test_of_bodies_that_lie_apart_one_is_planned_for_and_the_others_are_named(
    tmp_path: Path,
) -> None:
    large, small = (_box(tmp_path / f"{k}.obj", size) for k, size in enumerate(
        [(0.04, 0.12, 0.08), (0.03, 0.05, 0.06)]))  # fmt: skip
    lines = small.read_text().splitlines()
    moved = [f"v {float(w[1]) + 0.2} {w[2]} {w[3]}" for w in map(str.split, lines) if w[0] == "v"]
    faces = ["f " + " ".join(str(int(n) + 8) for n in w[1:]) for w in map(str.split, lines)
             if w[0] == "f"]  # fmt: skip
    both = tmp_path / "both.obj"
    both.write_text("\n".join([*large.read_text().splitlines(), *moved, *faces]))
    asked = [str(both), "--samples", "10", "--limit", "1"]
    first, second = _run(*asked), _run(*asked, "--part", "2")
    assert (
        "12 faces, 40 x 120 x 80 mm; of 2 bodies that lie apart: --part 2 is 30 x 50 x 60 mm"
        in (first.output)
    )
    assert "12 faces, 30 x 50 x 60 mm; of 2 bodies" in second.output
    assert "--part 3" in str(_run(*asked, "--part", "3").exception)


def test_a_table_left_in_a_cloud_is_taken_for_the_support(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    table = np.c_[rng.uniform(-0.15, 0.15, (6000, 2)), rng.normal(0.0, 0.001, 6000)]
    sides = rng.uniform(-1, 1, (4000, 3)) * (0.02, 0.03, 0.04)
    axis, sign = rng.integers(0, 3, 4000), rng.choice([-1, 1], 4000)
    sides[np.arange(4000), axis] = sign * np.array([0.02, 0.03, 0.04])[axis]
    # A point far below the table, as cameras give them: the lowest point is not the table.
    points = np.vstack([table, sides + np.array([0, 0, 0.04]), [[0.0, 0.1, -0.05]]])
    np.save(tmp_path / "cloud.npy", points)
    done = _run(str(tmp_path / "cloud.npy"), "--samples", "20", "--json")
    assert done.exit_code == 0, done.output
    answer = json.loads(done.output)
    assert any("was taken for its support" in note for note in answer["notes"])
    for grasp in answer["grasps"]:
        assert grasp["message"]["grasp_pose"]["pose"]["position"]["z"] > 0.0
    floating = _run(str(tmp_path / "cloud.npy"), "--samples", "20", "--json", "--floating")
    assert not any("support" in note for note in json.loads(floating.output)["notes"])


def test_no_grasp_is_an_answer(tmp_path: Path) -> None:
    wide = _run(str(_box(tmp_path / "box.obj", (0.2, 0.2, 0.2))), "--samples", "5")
    assert wide.exit_code == 1
    assert isinstance(wide.exception, SystemExit)
    assert "no grasp found" in wide.output
    unsure = _run(str(_box(tmp_path / "b.obj", (0.04, 0.12, 0.08))), "--samples", "20",
                  "--rotation-std-deg", "90", "--min-confidence", "0.9")  # fmt: skip
    assert "the best confidence is" in unsure.output


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--gripper", "hook"], "suction:RADIUS or three:OPENING"),
        (["--gripper", "jaw:"], "expected a stroke"),
        (["--part", "2"], "that lie apart number 1"),
        (["--workers", "2"], "an option of rtask grasp push, rtask grasp batch"),
        (["--gripper", "jaw:0"], "stroke"),
        (["--scale", "0"], "scale"),
        (["--store"], "object of the graph"),
        (["--samples", "0"], "samples: expected at least 1"),
        (["--position-std", "-1"], "deviations"),
        (["--rotation-std-deg", "inf"], "deviations"),
        (["--mass", "nan"], "mass"),
        (["--friction", "nan"], "friction"),
        (["--gripper", "jaw:nan"], "stroke"),
        (["--limit", "-1"], "-1 is not in the range x>=0"),
        (["--min-confidence", "nan"], "0 to 1"),
        (["--min-confidence", "1.5"], "0 to 1"),
    ],
)
def test_bad_calls_are_one_line(tmp_path: Path, args: list[str], words: str) -> None:
    done = _run(str(_box(tmp_path / "box.obj", (0.04, 0.12, 0.08))), *args)
    assert done.exit_code != 0
    assert words in done.output + str(done.exception)


def test_a_source_of_another_command_is_refused_with_its_name(tmp_path: Path) -> None:
    mesh = str(_box(tmp_path / "box.obj", (0.04, 0.12, 0.08)))
    pushed = CliRunner().invoke(cli, ["grasp", "push", mesh])
    assert str(pushed.exception) == f"{mesh} is a mesh: `rtask grasp space` plans grasps of it"
    shown = _scene(mesh, "--viewpoint", "0", "0", "1")
    assert str(shown.exception) == f"{mesh} is a mesh; a scene is the cloud of a table"
    np.save(tmp_path / "cloud.npy", np.eye(3))
    table = str(tmp_path / "cloud.npy")
    heavy = _scene(table, "--viewpoint", "0", "0", "1", "--mass", "1")
    assert "--mass has no effect on the grasps of two jaws" in str(heavy.exception)
    ranked = _run(table, "--grasps", mesh)
    assert "--grasps needs the mesh that they are grasps of" in str(ranked.exception)


def test_the_former_command_names_those_that_took_its_place() -> None:
    gone = CliRunner().invoke(cli, ["grasp", "plan", "part.json"])
    assert gone.exit_code == 2
    assert "`push` plans on a plane, `space` in space" in gone.output


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("depth.png", "depth.png is no point cloud; those are .pcd, .ply, .npy, .xyz"),
        ("torn.pcd", "torn.pcd holds no point cloud: its header does not state how many"),
    ],
)
def test_what_is_no_cloud_is_told_so_in_one_line(
    tmp_path: Path, name: str, words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(b"\x89PNG\r\n")
    done = _scene(str(tmp_path / name), "--viewpoint", "0", "0", "1")
    assert done.exit_code != 0
    assert words in str(done.exception)
    assert "WARNING" not in capfd.readouterr().out


def test_a_reader_that_goes_away_is_no_error_of_the_file(tmp_path: Path) -> None:
    part = tmp_path / "part.json"
    part.write_text("[[0, 0], [4, 0], [4, 2], [0, 2]]")
    command = [sys.executable, "-m", "rtask", "grasp", "push", str(part), "--samples", "10"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros((1, 3)), "all points lie in one place"),
        (np.full((40, 3), np.nan), "no finite point"),
        (np.outer(np.linspace(0, 0.1, 300), [1, 0, 0]), "all points lie on one line"),
        (np.outer(np.linspace(0, 0.1, 300), [0, 0, 1]), "all points lie on one line"),
        (np.random.default_rng(0).uniform(0, 0.1, (3000, 3)) * (1, 1, 0), "stands on the table"),
        (np.random.default_rng(0).uniform(0, 0.1, (3000, 3)) * (1, 0, 1), "in one plane"),
    ],
    ids=["point", "nan", "line", "post", "floor", "wall"],
)
def test_a_cloud_without_a_shape_is_told_why(
    tmp_path: Path, points: np.ndarray, words: str
) -> None:
    np.save(tmp_path / "cloud.npy", points)
    done = _run(str(tmp_path / "cloud.npy"), "--samples", "5")
    assert done.exit_code == 1
    assert isinstance(done.exception, SystemExit)
    assert "no grasp found: " in done.output
    assert words in done.output


@pytest.mark.slow
@pytest.mark.parametrize("which", ["flipped", "mixed", "holed"])
def test_flipped_normals_and_holes_change_nothing_where_two_sides_are_left(
    tmp_path: Path, which: str
) -> None:
    from grasp.spatial.meshes.shapes import box_mesh

    whole = _box(tmp_path / "box.obj", (0.04, 0.12, 0.1))
    mesh = box_mesh((0.04, 0.12, 0.1))
    faces = mesh.faces.copy()
    if which != "holed":
        rows = slice(None) if which == "flipped" else slice(None, None, 2)
        faces[rows] = faces[rows, ::-1]
    else:
        faces = faces[np.abs(mesh.normals[:, 0]) > 0.5]  # both sides that the jaws touch
    lines = ["v {:.6f} {:.6f} {:.6f}".format(*p) for p in mesh.vertices]
    lines += ["f {} {} {}".format(*(f + 1)) for f in faces]
    (tmp_path / "odd.obj").write_text("\n".join(lines))
    asked = ("--samples", "20", "--floating", "--json")
    plain, odd = (json.loads(_run(str(p), *asked).output) for p in (whole, tmp_path / "odd.obj"))
    assert odd["grasps"]
    assert odd["grasps"][0]["width"] == pytest.approx(0.04, abs=0.004)
    # The open shell lets the fingers deeper in, to its middle: the order is by holding.
    assert odd["grasps"][0]["carry"] >= plain["grasps"][0]["carry"] - 0.1
    sure, plainly = (max(g["confidence"] for g in one["grasps"]) for one in (odd, plain))
    # Two standard errors of the difference of two shares of twenty samples around .8.
    assert sure >= plainly - 0.25


def test_a_broken_mesh_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.stl").write_bytes(b"no mesh")
    done = _run(str(tmp_path / "bad.stl"))
    assert "no STL mesh" in str(done.exception)


@pytest.mark.slow
def test_grasps_in_space_are_stored_and_recalled(tmp_path: Path) -> None:
    from features.codec import encode_cloud, to_wire
    from grasp.spatial.meshes.shapes import box_mesh

    points, _ = box_mesh((0.09, 0.04, 0.06)).sample(9000, np.random.default_rng(3))
    seen = {"data": to_wire(encode_cloud((points + np.array([0.3, 0.0, 0.03])).astype(np.float32))),
            "frame_id": "base_link", "support_height": 0.0}  # fmt: skip
    data = tmp_path / "store"
    with rtask.open(data) as kb, Engine(kb) as engine:
        stored = engine.call("insert_object", {"objects": [seen]})
        thing = stored["objects"][0]["object"]
    done = _run(thing, "-d", str(data), "--samples", "40", "--store", "--limit",
                "12", "--json")  # fmt: skip
    assert done.exit_code == 0, (done.output, done.exception)
    found = json.loads(done.output)
    with rtask.open(data) as kb, Engine(kb) as engine:
        recalled = engine.call("recall_grasps", {"object": thing, "max_grasps": 50})["grasps"]
        rows = kb.select(
            f"PREFIX rt: <{ontology.NS}> SELECT ?g ?c ?e ?s WHERE {{ ?g rt:hasEvaluation ?v . "
            "?v rt:graspConfidence ?c ; rt:confidenceLower95 ?l ; rt:epsilonQuality ?e ; "
            "rt:positionSigma ?s ; rt:sampleCount 40 }"
        )
        assert not [v for v in kb.validate() if "/grasp/" in v.focus]
    said = {str(row.value("g")): float(str(row.value("c"))) for row in rows}
    assert set(said) == set(found["stored"]["grasps"])
    ranked = [said[name] for name in found["stored"]["grasps"]]
    assert ranked == pytest.approx([g["confidence"] for g in found["grasps"]], abs=1e-6)
    from_above = {g["id"] for g in recalled}
    assert from_above
    assert from_above <= set(said)
    best = recalled[0]
    assert best["gripper_type"] == "panda_hand"
    assert abs(best["x"]) < 0.05


@pytest.mark.slow
def test_promises_follow_the_outcomes_of_such_hands_in_the_graph(tmp_path: Path) -> None:
    from rtask.kb.commit.access import Access

    data = tmp_path / "store"
    hand = {"name": "hand", "gripper_type": "panda_hand", "kind": "ParallelJawGripper",
            "max_opening": 0.08, "jaw_width": 0.02, "finger_length": 0.054,
            "max_payload": 3.0}  # fmt: skip
    me = Access("panda-1", "robot")
    with rtask.open(data) as kb, Engine(kb) as engine:
        engine.call("register_robot", {"name": "panda-1", "model": "panda",
                                       "end_effectors": [hand]}, me)  # fmt: skip
        thing = _stored_box(kb, (0.05, 0.04, 0.08))
    few = (thing, "-d", str(data), "--samples", "20", "--mass", "0.3", "--json")
    done = _run(*few, "--store")
    assert done.exit_code == 0, (done.output, done.exception)
    first = json.loads(done.output)
    assert not any("promises follow" in note for note in first["notes"])
    with rtask.open(data) as kb, Engine(kb) as engine:
        for k, grasp in enumerate(first["stored"]["grasps"][:4]):
            engine.call(
                "report_outcome",
                {"task_id": f"urn:try:{k}", "object": thing, "grasp": grasp, "success": False,
                 "reason": "missed", "gripper_id": "hand"},
                me,
            )  # fmt: skip
    after = json.loads(_run(*few).output)
    assert any("promises follow 4 outcomes of such hands" in note for note in after["notes"])
    for name in ("lift_chance", "lift_at_least", "carry_chance", "carry_at_least"):
        assert after["grasps"][0][name] < first["grasps"][0][name]
    assert after["grasps"][0]["lift"] == first["grasps"][0]["lift"]
    with rtask.open(data) as kb, Engine(kb) as engine:
        corrected = {"task_id": "urn:try:0", "verdict": "correct", "held": True}
        engine.call("give_feedback", corrected, Access("ann", "teacher"))
    judged = json.loads(_run(*few).output)
    assert judged["grasps"][0]["lift_chance"] > after["grasps"][0]["lift_chance"]


def _stored_box(kb: rtask.KnowledgeBase, size: tuple[float, float, float]) -> str:
    """Store an object with the closed mesh of a box that stands on z = 0; return its IRI."""
    from features.modelling import mesh_to_ply
    from grasp.spatial.meshes.shapes import box_mesh
    from rtask.engine.triples import Triples
    from rtask.rdf.namespaces import RT
    from rtask.rdf.terms import iri

    box, thing = box_mesh(size), iri("https://w3id.org/rtask-kg/kb/object/crate")
    grey = np.full((len(box.vertices), 3), 90, np.uint8)
    data = mesh_to_ply(box.vertices + np.array([0, 0, size[2] / 2]), box.faces, grey)
    triples, node = Triples(), iri(thing.value + "/cad")
    triples.node(thing, [RT.ManipulableObject], {RT.objectId: "crate", RT.hasFeature: node})
    triples.node(
        node, [RT.TriangleMesh], {RT.hasBlob: triples.blob(kb.blobs.put(data, "model/ply"))}
    )
    with kb.transaction(note="a mesh") as tx:
        triples.write(tx)
    return thing.value


@pytest.mark.slow
def test_the_cloud_of_a_table_gives_grasps_of_each_thing(tmp_path: Path) -> None:
    from grasp.spatial.meshes.shapes import box_mesh

    rng = np.random.default_rng(0)
    side = np.linspace(-0.3, 0.3, 250)
    x, y = (v.ravel() for v in np.meshgrid(side, side))
    table = np.c_[x, y, rng.normal(0, 3e-4, x.size)]
    eye, box = np.array([0.1, 0.0, 0.5]), box_mesh((0.04, 0.05, 0.06))
    things = []
    for place in (-0.05, 0.05):
        points, face = box.sample(6000, rng)
        points += np.array([0.0, place, 0.03])
        things.append(points[np.einsum("ij,ij->i", box.normals[face], eye - points) > 0])
    np.save(tmp_path / "table.npy", np.vstack([table, *things]))
    given = (str(tmp_path / "table.npy"), "--samples", "10")
    done = _scene(*given, "--viewpoint", "0.1", "0", "0.5", "--json")
    told = json.loads(done.stdout)
    assert {row["segment"] for row in told["grasps"]} == {1, 2}
    assert "2 objects on a table" in told["notes"][1]
    blind = _scene(*given)
    assert blind.exit_code == 2
    assert "Missing option '--viewpoint'" in blind.output


def test_grasps_of_a_view_are_ranked_over_the_shapes_it_may_have(tmp_path: Path) -> None:
    from grasp.spatial.meshes.shapes import box_mesh

    points = box_mesh((0.04, 0.06, 0.05)).sample(6000, np.random.default_rng(0))[0]
    seen = points[(points[:, 0] > 0.0199) | (points[:, 2] > 0.0249)]
    np.save(tmp_path / "view.npy", seen)
    usual = (str(tmp_path / "view.npy"), "--samples", "10", "--json", "--shapes", "6")
    ranked = json.loads(_run(*usual, "--viewpoint", "0.4", "0", "0.4").stdout)
    values = [grasp["carry"] for grasp in ranked["grasps"]]
    assert values[0] > values[-1]
    assert all(0 <= grasp["lift_chance"] <= 1 for grasp in ranked["grasps"])
    blind = json.loads(_run(*usual).stdout)
    assert "no shapes were sampled: needs a support and a viewpoint" in blind["notes"]
    assert "carry" not in blind["grasps"][0]


def test_grippers_and_grasps_come_from_files(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    mesh = _box(tmp_path / "box.obj", (0.04, 0.12, 0.08))
    hand = tmp_path / "slim.json"
    hand.write_text(json.dumps({"name": "slim", "max_opening": 0.06}))
    grasps = tmp_path / "grasps.h5"
    usual = (str(mesh), "--gripper", str(hand), "--samples", "20", "--json")
    first = json.loads(_run(*usual, "--save-grasps", str(grasps)).stdout)
    assert first["gripper"] == "slim"
    again = json.loads(_run(*usual, "--grasps", str(grasps)).stdout)
    assert again["grasps"][0]["stored"] >= 0
    hand.write_text(json.dumps({"name": "slim", "stroke": 0.06}))
    done = _run(*usual)
    assert done.exit_code != 0
    assert "unknown field 'stroke'" in str(done.exception)


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--viewpoint", "nan", "0", "0"], "--viewpoint nan 0.0 0.0: expected numbers, m"),
        (["--viewpoint", "1", "0", "0"], "--viewpoint is about clouds"),
        (["--classifier", "shipped"], "--classifier is about clouds"),
        (["--shapes", "24"], "--shapes is about clouds"),
        (["--shapes", "24", "--classifier", "shipped"], "--shapes and --classifier both rank"),
        (["--shapes", "24", "--gripper", "suction:0.01"], "--shapes is about clouds"),
        (["--save-grasps", "/nowhere/x.h5"], "--save-grasps /nowhere/x.h5: there is no folder"),
        (["--scale", "1e300"], "is a scale of 1e+300 m per unit right?"),
    ],
)
def test_what_cannot_have_an_effect_is_refused_before_planning(
    tmp_path: Path, args: list[str], words: str
) -> None:
    done = _run(str(_box(tmp_path / "box.obj", (0.04, 0.12, 0.08))), *args)
    assert done.exit_code != 0
    assert isinstance(done.exception, rtask.errors.UsageError)
    assert words in str(done.exception)


def test_what_is_quoted_from_a_file_does_not_steer_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "junk.dxf"
    path.write_bytes(b"\x1b[2J\x07\n0\n")
    with pytest.raises(SystemExit) as stopped:
        main(["grasp", "push", str(path)])
    assert stopped.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.strip().isprintable()
    assert "\\x1b[2J" in said


def test_samples_that_are_no_archive_are_named(tmp_path: Path) -> None:
    path = tmp_path / "junk.npz"
    path.write_bytes(b"junk")
    given = ["grasp", "train", str(path), "--out", str(tmp_path / "model.npz")]
    done = CliRunner().invoke(cli, given)
    assert (
        str(done.exception) == f"{path}: no file of grasp samples or models: it is no .npz archive"
    )
    assert not (tmp_path / "model.npz").exists()


def test_own_outcomes_move_what_is_promised_of_a_mesh_and_of_nothing_else(tmp_path: Path) -> None:
    mesh = _box(tmp_path / "box.obj", (0.04, 0.12, 0.08))
    asked = [str(mesh), "--samples", "20", "--mass", "0.3", "--limit", "1", "--json"]
    (before,) = json.loads(_run(*asked).stdout)["grasps"]
    own = tmp_path / "own.jsonl"
    own.write_text(json.dumps({**before, "lifted": False, "carried": False}) + "\n")
    own.write_text(own.read_text() * 30)
    (after,) = json.loads(_run(*asked, "--outcomes", str(own)).stdout)["grasps"]
    for name in ("lift_chance", "lift_at_least", "carry_chance", "carry_at_least"):
        assert after[name] < before[name] - 0.1
    assert after["carry"] == before["carry"]  # the order of grasps stays
    np.save(tmp_path / "cloud.npy", np.random.default_rng(0).random((50, 3)))
    refused = _run(str(tmp_path / "cloud.npy"), "--outcomes", str(own))
    assert "--outcomes is about meshes" in str(refused.exception)
    refused = _run(str(mesh), "--gripper", "suction:0.015", "--outcomes", str(own))
    assert "--outcomes is about jaws" in str(refused.exception)
