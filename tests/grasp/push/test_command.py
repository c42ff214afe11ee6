"""`rtask grasp push`: parts, clouds, and objects of the graph; what is stored is recalled."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner, Result

import ontology
import rtask
from rtask.cli import cli
from rtask.engine.engine import Engine


def _run(*args: str) -> Result:
    return CliRunner().invoke(cli, ["grasp", "push", *args])


@pytest.fixture
def part(tmp_path: Path) -> Path:
    path = tmp_path / "part.json"
    path.write_text("[[0, 0], [4, 0], [4, 1], [0, 2]]")
    return path


def test_a_part_gives_a_table(part: Path) -> None:
    done = _run(str(part), "--samples", "20", "--limit", "3")
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert lines[0].startswith("4 vertices")
    assert [line.split()[0] for line in lines[2:5]] == ["1", "2", "3"]


def test_a_race_finds_the_same_best_with_fewer_evaluations(part: Path) -> None:
    whole, raced = (
        json.loads(_run(str(part), "--samples", "100", "--json", *more).stdout)
        for more in ((), ("--race",))
    )
    assert raced["grasps"][0]["quality"] == whole["grasps"][0]["quality"]
    assert raced["evaluations"] < whole["evaluations"]


@pytest.mark.slow
def test_json_and_drawings(part: Path, tmp_path: Path) -> None:
    folder = tmp_path / "drawings"
    done = _run(str(part), "--samples", "20", "--eliminate", "5,0.8", "--json", "--save-plots",
                str(folder))  # fmt: skip
    assert done.exit_code == 0, done.output
    found = json.loads(done.output)
    qualities = [g["quality"] for g in found["grasps"]]
    assert qualities[0] == max(qualities)
    assert all(g["lower_95"] <= g["quality"] for g in found["grasps"])
    names = {path.stem for path in folder.iterdir()}
    assert names == {"whiskers", "best", "tolerance", "pose", "eliminated"}
    for path in folder.iterdir():
        assert ElementTree.parse(path).getroot().tag.endswith("svg")


@pytest.mark.slow
def test_drawings_show_the_holes_of_a_part(tmp_path: Path) -> None:
    hole = [[0.5, 0.4], [1.0, 0.4], [1.0, 0.6], [0.5, 0.6]]
    path = tmp_path / "plate.json"
    path.write_text(json.dumps({"polygon": [[0, 0], [2, 0], [2, 1], [0, 1]], "holes": [hole]}))
    done = _run(str(path), "--samples", "20", "--eliminate", "5,0.8", "--save-plots", str(tmp_path))
    assert done.exit_code == 0, done.output
    for name in ("whiskers", "best", "eliminated"):
        drawn = ElementTree.parse(tmp_path / f"{name}.svg").getroot()
        rings = [part for part in drawn if part.tag.endswith("polygon")]
        filled = [part.get("fill") for part in rings if part.get("fill") != "none"]
        assert filled == ["#eee", "white"], name
        xs = [float(pair.split(",")[0]) for pair in rings[-1].get("points", "").split()]
        outline = next(part for part in rings if part.get("fill") == "#eee")
        whole = [float(pair.split(",")[0]) for pair in outline.get("points", "").split()]
        assert max(xs) - min(xs) == pytest.approx((max(whole) - min(whole)) / 4, abs=0.2)  # px


def test_rounded_corners_of_a_drawing_are_not_what_perturbations_cross(tmp_path: Path) -> None:
    """36 vertices that each deviate by more than their distance would cross in every trial."""
    path = tmp_path / "plate.svg"
    shapes = '<rect width="60" height="40" rx="10"/><circle cx="20" cy="20" r="9"/>'
    path.write_text(f"<svg>{shapes}</svg>")
    done = _run(str(path), "--samples", "20", "--density", "3", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.output)
    assert found["unit"] == "px"
    assert "none of the rest off by more than half a deviation" in found["note"]
    assert len(found["holes"]) == 1
    assert found["com"][0] > 30.9
    assert found["crossed"] < 0.15
    assert found["grasps"][0]["quality"] > 0.8
    rough = tmp_path / "rough.json"
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rough.write_text(json.dumps(np.column_stack([np.cos(turn), np.sin(turn)]).tolist()))
    assert "cross themselves and count as failures" in _run(str(rough), "--samples", "5").output


@pytest.mark.slow
def test_a_cloud_is_drawn_in_space(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "box.npy"
    np.save(path, rng.uniform(0, 1, (4000, 3)) * (0.08, 0.04, 0.05))
    called = ["grasp", "space", str(path), "--samples", "10", "--json", "--save-plots"]
    done = CliRunner().invoke(cli, [*called, str(tmp_path / "d")])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "d" / "candidates_3d.svg").exists()


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--friction", "-1"], "friction"),
        (["--max-opening", "0.1"], "stroke"),
        (["--eliminate", "many"], "two numbers"),
        (["--eliminate", "5,0.8", "--race"], "exclude each other"),
        (["--store"], "object of the graph"),
        (["--angles", "2"], "odd"),
        (["--jaw-width", "0"], "jaw_width must be positive"),
        (["--samples", "10000000000"], "at most 1000000 samples"),
        (["--samples", "1000000", "--density", "60"], "500000000 evaluations"),
        (["--samples", "10000000000", "--eliminate", "5,0.9"], "at most 1000000 samples"),
        (["--part", "2"], "part 2: a file .json holds one part"),
        (["--workers", "-1"], "-1 is not in the range x>=0"),
        (["--gripper", "nao"], "'--gripper'. It is an option of rtask grasp space"),
        (["--save-plots", "/proc/none/here"], "--save-plots /proc/none/here: No such file"),
    ],
)
def test_bad_calls_are_one_line(part: Path, args: list[str], words: str) -> None:
    done = _run(str(part), *args)
    assert done.exit_code != 0
    assert words in done.output + str(done.exception)


def test_a_plan_without_a_grasp_fails(tmp_path: Path) -> None:
    """A disc against frictionless jaws that are far too narrow for its spread centre of mass."""
    path = tmp_path / "disc.json"
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    path.write_text(json.dumps(np.column_stack([np.cos(angle), np.sin(angle)]).tolist()))
    args = [str(path), "--friction", "0", "--jaw-width", "0.001", "--samples", "20"]
    plain, as_json = _run(*args), _run(*args, "--json")
    assert (plain.exit_code, as_json.exit_code) == (1, 1)
    assert "no candidate closes" in plain.output or "count as failures" in plain.output
    assert {row["quality"] for row in json.loads(as_json.output)["grasps"]} == {0.0}


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "null.json"
    path.write_text("null")
    assert "a part in JSON is" in str(_run(str(path)).exception)
    for command in ("push", "space"):
        given = ["grasp", command, str(tmp_path), "-d", str(tmp_path / "none")]
        done = CliRunner().invoke(cli, given)
        assert str(done.exception) == f"{tmp_path} is a folder; give a file in it"
    path.write_bytes(b"{\xff")
    assert str(_run(str(path)).exception) == f"{path}: no JSON: byte 1 is no UTF-8 text"


_PLY = "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nend_header\n"
_PCD = "# .PCD v.7\nPOINTS {}\nDATA {}\n"


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("x.ply", b"", "does not begin with ply"),
        ("x.ply", b"ply\n", "its header does not state how many points"),
        ("x.ply", _PLY.format(10**11).encode(), "header states 100000000000 points, the file has"),
        ("x.pcd", _PCD.format(10**11, "binary").encode(), "header states 100000000000 points"),
        ("x.pcd", _PCD.format(10**11, "binary_compressed").encode(), "100000000000 points"),
        ("x.npy", b"junk", "does not begin as a .npy file"),
        ("x.npy", b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f8', 'fortran_order': False, "
         b"'shape': (99999999999, 3), }".ljust(117) + b"\n", "greater than file size"),
    ],
)  # fmt: skip
def test_a_cloud_whose_header_promises_what_is_not_there_is_refused_unread(
    tmp_path: Path, name: str, data: bytes, words: str
) -> None:
    (tmp_path / name).write_bytes(data)
    said = str(_run(str(tmp_path / name)).exception)
    assert words in said
    assert "pickle" not in said
    assert said.startswith(str(tmp_path / name))


def test_a_missing_file_is_said_to_be_missing(tmp_path: Path) -> None:
    for name in ("none.json", "urn:lab/object/7"):
        done = _run(str(tmp_path / name), "-d", str(tmp_path / "no-store"))
        assert "no such file" in str(done.exception)
    assert not (tmp_path / "no-store").exists()


def _seen_box() -> dict[str, object]:
    """Return a box of 9 x 5 x 6 cm as an upright cloud in a robot's base frame."""
    from features.codec import encode_cloud, to_wire

    rng = np.random.default_rng(3)
    size = np.array([0.09, 0.05, 0.06])
    points = rng.uniform(-0.5, 0.5, (9000, 3)) * size
    face = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), face] = np.sign(rng.uniform(-1, 1, len(points))) * size[face] / 2
    points += (0.3, 0.0, 0.03)
    return {"data": to_wire(encode_cloud(points.astype(np.float32))), "frame_id": "base_link",
            "support_height": 0.0}  # fmt: skip


HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.08, "max_payload": 0.3}


@pytest.mark.slow
def test_planned_grasps_of_an_object_are_stored_recalled_and_offered(tmp_path: Path) -> None:
    data = tmp_path / "store"
    with rtask.open(data) as kb, Engine(kb) as engine:
        engine.call("register_robot", {"name": "r", "model": "m", "end_effectors": [HAND]})
        stored = engine.call("insert_object", {"objects": [_seen_box()]})
        thing = stored["objects"][0]["object"]
    unknown = _run("no-such-object", "-d", str(data))
    assert "unknown object" in str(unknown.exception)
    asked = ["-d", str(data), "--jaw-width", "0.015", "--samples", "20", "--store", "--limit", "3",
             "--vertex-std", "0.001", "--com-std", "0.002", "--gripper-type", "nao_hand",
             "--json"]  # fmt: skip
    sparse = _run(thing, *asked, "--max-opening", "0.08")
    assert "no candidate closes" in str(sparse.exception)
    done = _run(thing, *asked, "--max-opening", "0.08", "--density", "8")
    assert done.exit_code == 0, (done.output, done.exception)
    found = json.loads(done.output)
    assert found["note"].startswith(thing)
    with rtask.open(data) as kb, Engine(kb) as engine:
        recalled = engine.call("recall_grasps", {"object": thing})["grasps"]
        rows = kb.select(
            f"PREFIX rt: <{ontology.NS}> SELECT ?g ?q ?n WHERE "
            "{ ?g rt:hasEvaluation ?e . ?e rt:forceClosureLowerBound ?q ; rt:sampleCount ?n }"
        )
        bounds = {str(row.value("g")): float(str(row.value("q"))) for row in rows}
        assert not [v for v in kb.validate() if "/grasp/" in v.focus]
        seen = {k: v for k, v in _seen_box().items() if k != "support_height"}
        answer = engine.call(
            "recognise_for_grasp",
            {**seen, "task": "pick", "gripper_id": "hand", "propose": True, "max_grasps": 20},
        )
        tried = {"object": thing, "grasp": recalled[0], "gripper_id": "hand"}
        for success in (True, False, True):
            engine.call("report_outcome", {**tried, "success": success})
        after = engine.call("recall_grasps", {"object": thing})["grasps"]
    counts = {g["id"]: (g["statistics"]["attempts"], g["statistics"]["successes"]) for g in after}
    assert counts.pop(recalled[0]["id"]) == (3, 2)
    assert set(counts.values()) == {(0, 0)}
    assert {g["id"] for g in recalled} == set(found["stored"]["grasps"]) == set(bounds)
    best = max(g["grasp_quality"] for g in recalled)
    assert best == pytest.approx(found["grasps"][0]["quality"], abs=1e-6)
    assert best == pytest.approx(max(bounds.values()))
    assert all(abs(g["x"]) < 0.05 and abs(g["y"]) < 0.05 for g in recalled)
    offered = {g["id"] for g in answer["grasps"] if g["source"] == "memory"}
    assert offered & set(bounds)
