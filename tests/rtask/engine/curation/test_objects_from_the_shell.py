"""``rtask rebuild`` and ``rtask objects`` on a folder that robots filled."""

from __future__ import annotations

import json
import shutil

import pytest

import rtask
from rtask.cli import main
from rtask.engine import Engine
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import iri

pytestmark = pytest.mark.slow


def told(capsys, *arguments):
    """Run a command; return what it printed."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    printed = capsys.readouterr()
    assert end.value.code == 0, printed.err
    return printed.out


def refused(capsys, *arguments):
    """Run a command that must fail; return what it said."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    assert end.value.code in (1, 2, 3)
    return capsys.readouterr().err


@pytest.fixture(scope="module")
def filled(bench, tmp_path_factory):
    """Return a folder with one box stored twice, and its two objects."""
    folder = tmp_path_factory.mktemp("shell") / "kb"
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        robot.register()
        things = []
        for yaw in (0.3, 0.6):
            seen = bench.sight(bench.BOX.at(0.16, -0.06, yaw))
            grasp = robot.recognise(seen, max_grasps=1)["grasps"][0]
            entry = robot.insert(seen, merge=False, grasp=grasp, outcome=bench.held())
            things.append(entry["objects"][0]["object"])
    return folder, things


@pytest.fixture
def folder(filled, tmp_path):
    """Return a copy that a test may change."""
    source, things = filled
    shutil.copytree(source, tmp_path / "kb")
    return str(tmp_path / "kb"), things


@pytest.mark.slow
def test_everything_derived_is_made_again(capsys, folder, shares):
    data, things = folder
    with rtask.open(data) as kb:
        for predicate in (RT.hasModel, RT.statisticsOf):
            for quad in kb.match(None, predicate):
                with kb.transaction() as tx:
                    tx.remove(quad.subject, quad.predicate, quad.object, quad.graph_name)
    shutil.rmtree(f"{data}/index")
    assert told(capsys, "rebuild", "models", "-d", data).strip() == "models: 2 objects"
    assert told(capsys, "rebuild", "recognition", "-d", data).strip() == "recognition: 2 views"
    assert shares == [(1, 2), (2, 2)] * 2
    assert "statistics: +" in told(capsys, "rebuild", "statistics", "-d", data)
    assert "index:" in told(capsys, "rebuild", "index", "-d", data)
    with rtask.open(data) as kb, Engine(kb) as engine:
        assert {row.object_iri for row in engine.index.views()} == set(things)
        assert len(kb.match(None, RT.hasModel)) == 2
        assert len({q.subject for q in kb.match(None, RT.statisticsOf)}) == 2


@pytest.mark.slow
def test_objects_are_merged_shown_taken_back_and_forgotten(capsys, folder):
    data, (one, other) = folder
    assert one in told(capsys, "objects", "name", one, "--as", "tin", "--kind", "box", "-d", data)
    assert "known already" in told(capsys, "objects", "name", "tin", "--as", "tin", "-d", data)
    done = json.loads(told(capsys, "objects", "merge", other, "tin", "-d", data, "--json"))
    assert done["object"] == one
    shown = json.loads(told(capsys, "objects", "show", other, "-d", data, "--json"))
    assert shown["object"] == one
    assert shown["formerly"] == [other]
    assert len(shown["views"]) == 2
    split = json.loads(
        told(capsys, "objects", "split", one, shown["views"][1], "-d", data, "--as", "twin",
             "--json")
    )  # fmt: skip
    assert "twin" in told(capsys, "objects", "show", split["object"], "-d", data)
    undone = json.loads(told(capsys, "objects", "undo", split["commit"], "-d", data, "--json"))
    assert undone["commit"] != split["commit"]
    assert "no object" in refused(capsys, "objects", "show", split["object"], "-d", data)
    assert "comes with RTASK" in refused(capsys, "objects", "undo", "c-00001", "-d", data)
    gone = json.loads(told(capsys, "objects", "forget", one, "--purge", "-d", data, "--json"))
    assert gone["removed"] > 10
    assert "no object" in refused(capsys, "objects", "show", one, "-d", data)


def test_what_is_stored_twice_is_found_and_merged(folder, bench, capsys):
    where, things = folder
    with rtask.open(where, reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        others = [
            robot.insert(bench.sight(other))["objects"][0]["object"]
            for other in (bench.CAN, bench.PEN)
        ]
        assert len({*things, *others}) == 4
    # Only the code tells that there are some; the line says where to see why.
    assert refused(capsys, "objects", "twins", "--data", where).startswith("why: ")
    merged = json.loads(told(capsys, "objects", "twins", "--merge", "--data", where, "--json"))
    (pair,) = merged["twins"]
    assert [pair["first"], pair["second"]] == things
    assert 0.5 < pair["confidence"] <= 1.0
    with rtask.open(where, mode="r") as kb:
        assert kb.match(None, RT.mergedInto, iri(things[0]))[0].subject.value == things[1]
    assert json.loads(told(capsys, "objects", "twins", "--data", where, "--json"))["twins"] == []
