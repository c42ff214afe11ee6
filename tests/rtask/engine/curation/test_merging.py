"""People put objects right: merged, split, forgotten, and taken back."""

from __future__ import annotations

import pytest

import rtask
from rtask.engine import Engine
from rtask.errors import ForbiddenError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import iri

pytestmark = pytest.mark.slow

ANN = Access("ann", "teacher")


def curate(engine, operation, **more):
    return engine.call("curate_object", {"operation": operation, **more}, ANN)


def stored(engine):
    """Return the statements that agents made, without the describing of bytes."""
    kept = engine.kb.graphs
    return {
        quad
        for quad in engine.kb.match()
        if kept.owner(quad.graph_name) is not None or quad.graph_name == kept.shared
    }


def tried(bench, robot, thing, task_id, outcome, **more):
    """Ask about a thing, try the first grasp, tell; return what was stored."""
    seen = bench.sight(thing)
    first = robot.recognise(seen, max_grasps=1)["grasps"][0]
    return robot.insert(seen, grasp=first, outcome=outcome, task_id=task_id, **more)["objects"][0]


def fill_store(bench, robots):
    """Store one box as two objects, each with a try."""
    robot = robots("nao-1")
    one = tried(bench, robot, bench.BOX, "t-1", bench.held())
    other = tried(bench, robot, bench.BOX.at(0.15, -0.05, 0.5), "t-2", bench.missed(), merge=False)
    assert one["object"] != other["object"]
    return one, other


@pytest.fixture
def twice(bench, engine, filled):
    """Return a robot and one box that was stored as two objects, each with a try."""
    return bench.Robot("nao-1", engine), *filled


def test_two_objects_become_one_and_the_old_name_still_answers(bench, engine, twice):
    robot, one, other = twice
    done = curate(engine, "merge", object=other["object"], into=one["object"])
    assert done["object"] == one["object"]
    known = robot.call("recall_grasps", object=other["object"])
    assert known["object"] == one["object"]
    assert {grasp["id"] for grasp in known["grasps"]} == {one["grasp"], other["grasp"]}
    assert sum(grasp["statistics"]["attempts"] for grasp in known["grasps"]) == 2
    views = {q.object.value for q in engine.kb.match(iri(one["object"]), RT.hasView)}
    assert views == {one["view"], other["view"]}
    assert {name.object_iri for name in engine.index.views()} == {one["object"]}
    (link,) = engine.kb.match(iri(other["object"]), RT.mergedInto)
    assert link.object.value == one["object"]
    assert not engine.kb.match(iri(other["object"]), RT.objectId)
    model = engine.models.of(iri(one["object"]))
    assert model is not None
    assert model[0].views <= views
    told = robot.insert(bench.sight(bench.BOX.at(0.17, -0.05, 0.2)), object=other["object"])
    assert told["objects"][0]["object"] == one["object"]
    robot.call(
        "report_outcome", object=other["object"], grasp=other["grasp"], outcome=bench.held(),
        gripper_id="right_hand",
    )  # fmt: skip
    # Statements stay with whoever made them, whoever moves them.
    owners = {engine.kb.graphs.owner(q.graph_name) for q in engine.kb.match(None, RT.hasGrasp)}
    assert owners == {"nao-1"}


def test_a_merge_is_taken_back_to_the_last_statement(engine, twice):
    _, one, other = twice
    before = stored(engine)
    done = curate(engine, "merge", object=other["object"], into=one["object"])
    assert stored(engine) != before
    curate(engine, "undo", commit=done["commit"])
    assert stored(engine) == before
    names = {name.view_iri: name.object_iri for name in engine.index.views()}
    assert names == {one["view"]: one["object"], other["view"]: other["object"]}


def test_merged_poses_are_turned_into_the_frame_of_the_object_that_stays(bench, engine, robots):
    robot = robots("nao-1")
    one = robot.insert(bench.sight(bench.BOX))["objects"][0]
    # Seen a quarter turn on, so that its longer side may point elsewhere.
    seen = bench.sight(bench.BOX.at(0.15, -0.05, 0.3 + 3.0))
    grasp = {"x": 0.15, "y": -0.05, "z": bench.TABLE + 0.03, "theta": 0.3 + 3.0, "width": 0.03}
    other = robot.insert(
        seen, merge=False, X=grasp["x"], Y=grasp["y"], Z=grasp["z"], rad=grasp["theta"]
    )["objects"][0]
    curate(engine, "merge", object=other["object"], into=one["object"])
    (kept,) = robot.call("recall_grasps", object=one["object"])["grasps"]
    # At the middle, closing along x: as it was tried, in either frame.
    assert abs(kept["x"]) < 0.005
    assert abs(kept["y"]) < 0.005
    assert min(kept["theta"] % 3.14159, 3.14159 - kept["theta"] % 3.14159) < 0.12


def test_views_and_their_tries_split_off(bench, engine, twice):
    robot, one, other = twice
    curate(engine, "merge", object=other["object"], into=one["object"])
    done = curate(engine, "split", object=one["object"], views=[other["view"]], name="twin")
    new = done["object"]
    assert new not in (one["object"], other["object"])
    names = {name.view_iri: name.object_iri for name in engine.index.views()}
    assert names == {one["view"]: one["object"], other["view"]: new}
    for thing, won in ((one["object"], 1), (new, 0)):
        (grasp,) = robot.call("recall_grasps", object=thing)["grasps"]
        assert (grasp["statistics"]["attempts"], grasp["statistics"]["successes"]) == (1, won)
        assert engine.models.of(iri(thing)) is not None
    assert robot.call("recall_grasps", object="twin")["object"] == new


def test_a_forgotten_object_is_gone_at_once_and_its_history_stays(bench, engine, twice):
    robot, one, other = twice
    curate(engine, "forget", object=other["object"])
    curate(engine, "forget", object=one["object"])
    assert len(engine.index) == 0
    assert robot.recognise(bench.sight(bench.BOX))["object"] == ""
    assert len(engine.kb.match(None, RT.executesGrasp)) == 2
    with pytest.raises(UnknownTermError):
        robot.call("recall_grasps", object=one["object"])


def test_forgetting_for_good_takes_tries_and_bytes(bench, engine, twice):
    _, one, other = twice
    assert set(engine.kb.blobs.digests())
    done = curate(engine, "forget", object=other["object"], purge=True)
    curate(engine, "forget", object=one["object"], purge=True)
    assert not engine.kb.match(None, RT.executesGrasp)
    assert not engine.kb.match(None, RT.hasBlob)
    engine.kb.collect_blobs(0)
    assert not set(engine.kb.blobs.digests())
    with pytest.raises(ForbiddenError, match="were deleted"):
        curate(engine, "undo", commit=done["commit"])


def test_one_view_is_forgotten_and_the_model_made_again(bench, engine, robots):
    robot = robots("nao-1")
    first = robot.insert(bench.sight(bench.BOX))["objects"][0]
    second = robot.insert(bench.sight(bench.BOX.at(0.15, -0.05, 0.9)), object=first["object"])[
        "objects"
    ][0]
    done = curate(engine, "forget", object=first["object"], views=[second["view"]])
    assert {name.view_iri for name in engine.index.views()} == {first["view"]}
    model = engine.models.of(iri(first["object"]))
    assert model is not None
    assert model[0].views == {first["view"]}
    curate(engine, "undo", commit=done["commit"])
    assert len(engine.index) == 2


def test_what_was_forgotten_stays_so_after_reopening(bench, tmp_path):
    with rtask.open(tmp_path / "kb", reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        robot.register()
        name = robot.insert(bench.sight(bench.BOX))["objects"][0]["object"]
        kept = robot.insert(bench.sight(bench.CAN))["objects"][0]["object"]
        curate(engine, "forget", object=name)
    with rtask.open(tmp_path / "kb", reason=False) as kb, Engine(kb) as engine:
        assert {row.object_iri for row in engine.index.views()} == {kept}
        robot = bench.Robot("nao-1", engine)
        assert robot.recognise(bench.sight(bench.BOX))["object"] == ""
        assert robot.insert(bench.sight(bench.BOX))["objects"][0]["object"] not in (name, kept)


def test_robots_may_not_put_objects_right(bench, engine, twice):
    robot, one, other = twice
    with pytest.raises(ForbiddenError, match="teach"):
        robot.call("curate_object", operation="merge", object=other["object"], into=one["object"])


def test_mistakes_are_named(bench, engine, twice):
    robot, one, other = twice
    with pytest.raises(UsageError, match="itself"):
        curate(engine, "merge", object=one["object"], into=one["object"])
    with pytest.raises(UsageError, match="into is missing"):
        curate(engine, "merge", object=one["object"])
    with pytest.raises(UnknownTermError, match="no object urn:nothing"):
        curate(engine, "forget", object="urn:nothing")
    with pytest.raises(UnknownTermError, match="is not a view of"):
        curate(engine, "split", object=one["object"], views=[other["view"]])
    with pytest.raises(UsageError, match="at least one view of the object must stay"):
        curate(engine, "split", object=one["object"], views=[one["view"]])
    with pytest.raises(ForbiddenError, match="may not write"):
        curate(engine, "undo", commit=robot.insert(bench.sight(bench.PEN))["commit"])
    with pytest.raises(UnknownTermError, match="is not a commit"):
        curate(engine, "undo", commit="yesterday")
