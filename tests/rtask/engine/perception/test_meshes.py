"""Surfaces of objects: made on request, stale when views come, marked where nothing was seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rtask
from grasp.spatial.meshes.mesh_files import mesh_from_ply
from rtask.cli import main
from rtask.engine import Engine
from rtask.engine.records.shapes import object_shape
from rtask.errors import DataError, UnknownTermError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES, PROV, RT
from rtask.rdf.terms import iri
from rtask.world.surfaces import read_surface, stored_mesh

pytestmark = pytest.mark.slow

SIZE = (0.050, 0.036, 0.110)


@pytest.fixture
def known(bench: Any, engine: Any) -> tuple[Any, Any, str]:
    """Return a robot, a box and the object that the robot inserted."""
    robot = bench.Robot("nao-1", engine)
    robot.call("register_robot", **bench.registration("nao-1", "right_hand"))
    box = bench.Thing(SIZE, texture_seed=1)
    thing = robot.insert(bench.sight(box), name="tea box")["objects"][0]["object"]
    return robot, box, thing


def test_a_surface_says_what_it_was_made_from_and_how_good_it_is(
    engine: Any, known: tuple[Any, Any, str]
) -> None:
    robot, _, thing = known
    made = robot.call("reconstruct_mesh", object="tea box")
    assert made["object"] == thing
    assert made["commit"]
    # A camera above sees the top and two sides of six.
    assert 0.2 < made["seen_share"] < 0.8
    assert 0 < made["median_residual"] <= made["residual_90"] < 0.004
    rows = engine.kb.select(f"""{PREFIXES}
SELECT ?view ?method WHERE {{ <{thing}> rt:hasFeature ?mesh . ?mesh a rt:TriangleMesh ;
  rt:seenShare ?share ; rt:reconstructionMethod ?method ; prov:wasDerivedFrom ?model, ?view .
  <{thing}> rt:hasModel ?model ; rt:hasView ?view }}""").to_dicts()
    assert len(rows) == made["views"] == 1
    assert rows[0]["method"] == "screened Poisson"
    assert not engine.kb.match(iri(made["mesh"]), RT.builtFrom), "that would make it a model"


def test_the_stored_bytes_mark_what_was_filled_in(engine: Any, known: tuple[Any, Any, str]) -> None:
    made = known[0].call("reconstruct_mesh", object="tea box")
    surface = read_surface(engine.kb, made["blob"])
    assert surface is not None
    extent = np.ptp(surface.vertices, axis=0)
    assert abs(extent[2] - SIZE[2]) < 0.008
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    seen = areas[surface.seen[surface.faces].all(axis=1)].sum() / areas.sum()
    assert abs(seen - made["seen_share"]) < 1e-3
    low = surface.vertices[:, 2] < 0.001
    normals_down = low[surface.faces].all(axis=1)
    assert not surface.seen[surface.faces[normals_down]].all(axis=1).any()


def test_a_surface_is_stale_when_a_view_joins_and_is_made_again_then(
    bench: Any, engine: Any, known: tuple[Any, Any, str]
) -> None:
    robot, box, thing = known
    first = robot.call("reconstruct_mesh", object=thing)
    same = robot.call("reconstruct_mesh", object=thing)
    assert (same["mesh"], same["commit"]) == (first["mesh"], "")
    robot.insert(bench.sight(box.at(0.16, -0.06, -0.5)), object=thing)
    stale = stored_mesh(engine.kb, iri(thing))
    assert stale is not None
    assert (stale.iri, stale.is_current) == (first["mesh"], False)
    second = robot.call("reconstruct_mesh", object=thing)
    assert second["views"] == 2
    assert second["seen_share"] > first["seen_share"]
    now = stored_mesh(engine.kb, iri(thing))
    assert now is not None
    assert now.is_current
    assert not engine.kb.match(iri(first["mesh"])), "the earlier one is withdrawn"


def test_another_author_adds_a_surface_and_leaves_the_first(
    engine: Any, known: tuple[Any, Any, str]
) -> None:
    robot, _, thing = known
    first = robot.call("reconstruct_mesh", object=thing)
    args = {"object": thing, "again": True}
    other = engine.call("reconstruct_mesh", args, Access("pepper", "robot")).as_json()
    assert other["mesh"] != first["mesh"] or other["commit"]
    assert engine.kb.match(iri(first["mesh"]), RT.seenShare)
    links = engine.kb.match(iri(thing), RT.hasFeature)
    meshes = [q for q in links if engine.kb.match(q.object, RT.seenShare)]
    assert len(meshes) == 2


def test_objects_without_a_model_and_unknown_ones_are_refused(
    engine: Any, known: tuple[Any, Any, str]
) -> None:
    robot = known[0]
    with pytest.raises(UnknownTermError):
        robot.call("reconstruct_mesh", object="nothing")
    engine.kb.update(
        f"{PREFIXES} INSERT DATA {{ <urn:bare> a rt:ManipulableObject ; rt:objectId 'bare' }}"
    )
    with pytest.raises(DataError, match="no model"):
        robot.call("reconstruct_mesh", object="urn:bare")


def test_a_reader_may_not(engine: Any, known: tuple[Any, Any, str]) -> None:
    from rtask.errors import ForbiddenError

    with pytest.raises(ForbiddenError):
        engine.call("reconstruct_mesh", {"object": known[2]}, Access("eve", "reader"))


def test_a_model_of_another_object_does_not_make_a_surface_current(
    engine: Any, known: tuple[Any, Any, str]
) -> None:
    made = known[0].call("reconstruct_mesh", object="tea box")
    (model,) = [q.object for q in engine.kb.match(iri(known[2]), RT.hasModel)]
    assert model in {q.object for q in engine.kb.match(iri(made["mesh"]), PROV.wasDerivedFrom)}
    engine.kb.update(f"{PREFIXES} DELETE WHERE {{ GRAPH ?g {{ <{known[2]}> rt:hasModel ?m }} }}")
    stale = stored_mesh(engine.kb, iri(known[2]))
    assert stale is not None
    assert not stale.is_current


def test_bytes_that_are_no_surface_are_none(engine: Any) -> None:
    blob = engine.kb.blobs.put(b"ply\nformat ascii 1.0\nend_header\n", "model/ply")
    assert read_surface(engine.kb, blob.iri.value) is None
    assert read_surface(engine.kb, "urn:sha256:" + "0" * 64) is None


def test_a_good_surface_is_planned_on_where_that_is_asked_for(
    bench: Any, engine: Any, known: tuple[Any, Any, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, box, thing = known
    robot.insert(bench.sight(box.at(0.16, -0.06, -0.5)), object=thing)
    assert object_shape(engine.context, thing, surface=True).kind == "model", "there is none"
    made = robot.call("reconstruct_mesh", object=thing)
    assert object_shape(engine.context, thing, surface=True).kind == "model", "two views are few"
    monkeypatch.setattr("rtask.engine.records.shapes._MIN_VIEWS", 2)
    monkeypatch.setattr("rtask.engine.records.shapes._MIN_SEEN", 0.3)
    assert object_shape(engine.context, thing).kind == "model", "nobody asked for it"
    shape = object_shape(engine.context, thing, surface=True)
    assert (shape.kind, shape.sources) == ("mesh", (made["mesh"],))
    assert shape.mesh is not None
    monkeypatch.setattr("rtask.engine.records.shapes._MAX_RESIDUAL_M", 1e-6)
    assert object_shape(engine.context, thing, surface=True).kind == "model"


def test_a_stale_surface_is_not_planned_on(
    bench: Any, engine: Any, known: tuple[Any, Any, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rtask.engine.records.shapes._MIN_VIEWS", 1)
    monkeypatch.setattr("rtask.engine.records.shapes._MIN_SEEN", 0.2)
    robot, box, thing = known
    robot.call("reconstruct_mesh", object=thing)
    assert object_shape(engine.context, thing, surface=True).kind == "mesh"
    robot.insert(bench.sight(box.at(0.16, -0.06, -0.5)), object=thing)
    assert object_shape(engine.context, thing, surface=True).kind == "model"


def test_the_command_reconstructs_writes_a_file_and_says_how_to_undo_it(
    bench: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, target = tmp_path / "kb", tmp_path / "box.ply"
    with rtask.open(folder, base="urn:lab/", reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        robot.call("register_robot", **bench.registration("nao-1", "right_hand"))
        robot.insert(bench.sight(bench.Thing(SIZE, texture_seed=1)), name="tea box")

    def run(*words: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as end:
            main([*words, "--data", str(folder)])
        return (int(str(end.value.code or 0)), *capsys.readouterr())

    code, out, err = run("objects", "mesh", "tea box", "--out", str(target))
    assert code == 0, err
    assert "of it seen in 1 view, " in out
    assert "undo: rtask undo" in err
    mesh = mesh_from_ply(target.read_bytes())
    assert abs(mesh.extent[2] - SIZE[2]) < 0.008
    code, _, err = run("objects", "mesh", "tea box")
    assert (code, "known already" in err) == (0, True)
    assert "--again" in err
    assert run("objects", "mesh", "nothing")[0] == 1
