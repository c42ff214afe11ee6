"""The index follows the graph; robots introduce themselves."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import pytest

import rtask
from rtask.engine import Engine
from rtask.engine.stored import stored_views
from rtask.errors import ConflictError, UnsupportedError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.terms import NamedNode

pytestmark = pytest.mark.slow

NS = "https://w3id.org/rtask-kg/ns#"


def fill(bench, engine):
    robot = bench.Robot("nao-1", engine)
    robot.register()
    for thing in (bench.BOX, bench.CAN):
        robot.insert(bench.sight(thing))
    return robot


@pytest.mark.slow
def test_a_reopened_store_recognises_what_it_was_shown(bench, tmp_path):
    with rtask.open(tmp_path / "kb", reason=False) as kb, Engine(kb) as engine:
        robot = fill(bench, engine)
        known = robot.recognise(bench.sight(bench.BOX))["object"]
    assert (tmp_path / "kb" / "index").is_dir()
    with rtask.open(tmp_path / "kb", reason=False) as kb, Engine(kb) as engine:
        assert bench.Robot("nao-1", engine).recognise(bench.sight(bench.BOX))["object"] == known


@pytest.mark.slow
def test_a_lost_or_damaged_index_is_made_again_from_the_graph(bench, tmp_path):
    import shutil

    folder = tmp_path / "kb"
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        known = fill(bench, engine).recognise(bench.sight(bench.CAN))["object"]
        engine.index.save()
    shutil.rmtree(folder / "index")
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        assert len(engine.index) == 2
        engine.index.save()
    for file in (folder / "index").rglob("desc*"):
        file.write_bytes(file.read_bytes()[:-7])
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        assert len(engine.index) == 2
        assert bench.Robot("nao-1", engine).recognise(bench.sight(bench.CAN))["object"] == known


def test_a_commit_whose_view_was_never_indexed_is_caught_up(bench, kb, engine, monkeypatch):
    robot = bench.Robot("nao-1", engine)
    robot.register()

    def full_disk(*args):
        raise OSError("no space left")

    monkeypatch.setattr(engine.index, "add", full_disk)
    stored = robot.insert(bench.sight(bench.BOX))
    assert stored["stored"] == 1
    monkeypatch.undo()
    assert len(engine.index) == 0
    assert engine.context.views.sync() == 1
    assert robot.recognise(bench.sight(bench.BOX))["object"] == stored["objects"][0]["object"]


def test_rebuilding_the_index_changes_no_answer(bench, engine):
    robot = fill(bench, engine)
    before = robot.recognise(bench.sight(bench.BOX))["recognition"]
    assert engine.rebuild_index() == 2
    assert robot.recognise(bench.sight(bench.BOX))["recognition"] == before


def test_what_old_views_lack_is_taken_from_their_clouds(bench, kb, engine):
    """A view described before pictures and shapes were kept gets both when the index is rebuilt."""
    fill(bench, engine)
    for view in stored_views(kb):
        kept = view.features(kb)
        assert kept is not None
        old = replace(kept, shape=None, picture=b"")
        blob = kb.blobs.put(old.to_bytes(), "application/octet-stream")
        completed = replace(view, blob=f"urn:sha256:{blob.sha256}").features(kb)
        assert completed is not None
        assert len(completed.picture) > 0
        # The stored cloud is compressed: depth is rounded.
        assert completed.shape @ kept.shape > 0.99


def test_a_view_withdrawn_from_the_graph_leaves_the_index(bench, kb, engine):
    robot = fill(bench, engine)
    kb.update(
        "PREFIX rt: <https://w3id.org/rtask-kg/ns#> DELETE WHERE { GRAPH ?g { ?o rt:hasView ?v } }"
    )
    engine.context.views.sync()
    assert len(engine.index) == 0
    assert robot.recognise(bench.sight(bench.BOX))["object"] == ""


def test_an_index_of_views_that_the_graph_has_no_more_is_emptied_when_it_is_opened(bench, tmp_path):
    with rtask.open(tmp_path / "kb", reason=False) as kb, Engine(kb) as engine:
        fill(bench, engine)
    with rtask.open(tmp_path / "kb", reason=False) as kb:
        kb.update(f"DELETE WHERE {{ GRAPH ?g {{ ?o <{NS}hasView> ?v }} }}")
        with Engine(kb) as engine:
            assert len(engine.index) == 0
            engine.context.views.sync()
            assert len(engine.index) == 0


def test_an_engine_without_views_loads_nothing_for_recognition_before_it_is_asked():
    script = """
import sys, rtask
from rtask.engine import Engine
with rtask.open(":memory:", reason=False) as kb, Engine(kb) as engine:
    engine.keep_compared()
    before = [name for name in ("numba", "scipy", "features.recognition") if name in sys.modules]
    print(before, len(engine.index), "features.recognition" in sys.modules)
"""
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert ended.stdout.strip() == "[] 0 True", ended.stderr


@pytest.mark.slow
def test_a_view_given_to_another_object_is_found_under_that(bench, kb, engine):
    robot = fill(bench, engine)
    box = robot.recognise(bench.sight(bench.BOX))["object"]
    rows = kb.select(f"SELECT ?v {{ <{box}> <{NS}hasView> ?v }}")
    with kb.transaction() as tx:
        graph = kb.graphs.agent("nao-1")
        copied = [q for q in kb.match(NamedNode(box), graph=graph) if "View" not in str(q)]
        twin = NamedNode(box + "0")
        tx.remove(box, NS + "hasView", rows[0]["v"], graph)
        tx.add(twin, NS + "hasView", rows[0]["v"], graph)
        for quad in copied:
            tx.add(twin, quad.predicate, quad.object, graph)
    engine.context.views.sync()
    assert robot.recognise(bench.sight(bench.BOX))["object"] == twin.value


def test_an_index_ahead_of_the_graph_names_no_object(bench, kb, engine):
    from rtask.engine.perception.observation import Look, observe
    from rtask.wire.message import read

    robot = fill(bench, engine)
    features = observe(read(Look, bench.sight(bench.PEN))).features
    engine.index.add("urn:view", "urn:object:gone", "urn:class", features)
    answer = robot.recognise(bench.sight(bench.PEN))
    assert answer["object"] == ""
    assert "urn:object:gone" not in [m["object"] for m in answer["recognition"]["matches"]]


def test_registering_twice_changes_nothing_and_a_changed_hand_is_corrected(bench, kb, engine):
    robot = bench.Robot("nao-1", engine)
    first = robot.register()
    assert first["robot"] == "https://example.org/kb/robot/nao-1"
    assert first["commit"]
    seq = kb.seq
    assert robot.register()["commit"] == ""
    assert kb.seq == seq
    changed = bench.registration("nao-1", "right_hand")
    changed["end_effectors"][0]["max_opening"] = "0.06"
    with pytest.raises(ConflictError, match=r"right_hand maxOpening 0.05, not 0.06"):
        robot.call("register_robot", **changed)
    robot.call("register_robot", replace=True, **changed)
    assert engine.grippers.find("right_hand", Access("nao-1", "robot")).gripper.max_opening == 0.06
    rows = kb.select("SELECT ?w { ?h <https://w3id.org/rtask-kg/ns#maxOpening> ?w }")
    assert [row.value("w") for row in rows] == [0.06]


def test_hands_of_one_name_belong_to_their_robots(bench, robots, engine):
    robots("nao-1", gripper_type="nao_hand")
    robots("nao-2", gripper_type="other_hand")
    assert engine.grippers.find("right_hand", Access("nao-2", "robot")).robot_name == "nao-2"
    assert engine.grippers.find("right_hand", Access("nao-1", "robot")).robot_name == "nao-1"
    assert engine.grippers.find(None, Access("nao-2", "robot")).gripper.gripper_type == "other_hand"


@pytest.mark.parametrize("name", ["", "nao 1", "nao/1", "n" * 65])
def test_a_name_that_makes_no_iri_is_refused(bench, engine, name):
    with pytest.raises(UsageError, match="name"):
        engine.call("register_robot", bench.registration(name, "hand"), Access())


def test_a_plain_store_has_no_engine():
    with rtask.open(":memory:", plain=True) as kb, pytest.raises(UnsupportedError, match="plain"):
        Engine(kb)


def test_clients_without_names_write_for_the_robot_that_they_register(bench, kb, engine):
    engine.call("register_robot", bench.registration("nao-1", "hand"), Access(None, "anonymous"))
    assert kb.match(graph=kb.graphs.agent("nao-1"))
    writers = kb.select(
        "SELECT DISTINCT ?who { ?w <http://www.w3.org/ns/prov#wasAssociatedWith> ?who ; "
        f"<{NS}commitNumber> {kb.seq} }}"
    )
    assert [row.value("who") for row in writers] == ["https://example.org/kb/robot/nao-1"]


@pytest.mark.parametrize(
    "measures",
    [
        {"min_opening": 0.5},
        {"finger_length": 0.001},
    ],
)
def test_a_gripper_whose_measures_contradict_each_other_is_refused(bench, engine, measures):
    hand = {"name": "odd", "gripper_type": "odd", "max_opening": 0.08, "max_payload": 1.0}
    with pytest.raises(UsageError, match=r"end_effectors\[0\]: gripper 'odd'"):
        engine.call(
            "register_robot",
            {"name": "odd-1", "model": "odd", "end_effectors": [{**hand, **measures}]},
        )


def test_a_stored_gripper_that_cannot_be_leaves_the_others_usable(bench, kb, engine):
    robot = bench.Robot("nao-1", engine)
    robot.register()
    odd = NamedNode("urn:odd-hand")
    with kb.transaction() as tx:
        tx.add(NamedNode("urn:odd"), NS + "hasEndEffector", odd)
        tx.add(NamedNode("urn:odd"), NS + "name", "odd-1")
        for name, value in {
            "name": "odd", "gripperType": "odd", "minOpening": 5.0, "maxOpening": 0.08,
        }.items():  # fmt: skip
            tx.add(odd, NS + name, value)
    assert robot.recognise(bench.sight(bench.PEN))["task_response"] == "candidate"
