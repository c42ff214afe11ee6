"""Undoing corrections: in the right order, without losing anything told since."""

from __future__ import annotations

import threading

import pytest

from rtask.errors import ConflictError, ForbiddenError, RtaskError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import iri

pytestmark = pytest.mark.slow

ANN, BOB = Access("ann", "teacher"), Access("bob", "teacher")


def curate(engine, operation, who=ANN, **more):
    return engine.call("curate_object", {"operation": operation, **more}, who)


def owners(engine):
    """Return the object of each view, by graph and by index, which must agree."""
    graph = {q.object.value: q.subject.value for q in engine.kb.match(None, RT.hasView)}
    assert {name.view_iri: name.object_iri for name in engine.index.views()} == graph
    return graph


def fill_store(bench, robots):
    """Store three boxes, each with one view."""
    robot = robots("nao-1")
    seen = [bench.BOX.at(0.15 + 0.005 * k, -0.05, 0.3 * k) for k in range(3)]
    return [robot.insert(bench.sight(one), merge=False)["objects"][0] for one in seen]


@pytest.fixture
def boxes(bench, engine, filled):
    """Return a robot and three boxes, each stored with one view."""
    return bench.Robot("nao-1", engine), *filled


def test_what_was_moved_on_is_taken_back_first(engine, boxes):
    _, a, b, c = boxes
    before = owners(engine)
    first = curate(engine, "merge", object=b["object"], into=a["object"])
    second = curate(engine, "merge", object=a["object"], into=c["object"])
    with pytest.raises(ConflictError, match=second["commit"]):
        curate(engine, "undo", commit=first["commit"])
    curate(engine, "undo", commit=second["commit"])
    with pytest.raises(ConflictError, match="already"):
        curate(engine, "undo", commit=second["commit"])
    curate(engine, "undo", commit=first["commit"])
    assert owners(engine) == before
    assert {q.subject.value for q in engine.kb.match(None, RT.name)} >= set(before.values())


def test_what_robots_told_since_stays_and_follows(bench, engine, boxes):
    robot, a, b, _ = boxes
    seen = bench.sight(bench.BOX)
    merged = curate(engine, "merge", object=b["object"], into=a["object"])
    later = robot.insert(seen, object=b["object"])["objects"][0]
    assert later["object"] == a["object"]
    curate(engine, "undo", commit=merged["commit"])
    assert owners(engine)[later["view"]] == a["object"]
    assert owners(engine)[b["view"]] == b["object"]
    for thing in (a, b):
        mine = {view for view, owner in owners(engine).items() if owner == thing["object"]}
        (link,) = engine.kb.match(iri(thing["object"]), RT.hasModel)
        assert {q.object.value for q in engine.kb.match(link.object, RT.builtFrom)} <= mine


def test_an_object_that_robots_told_of_does_not_vanish(bench, engine, boxes):
    robot, a, b, _ = boxes
    curate(engine, "merge", object=b["object"], into=a["object"])
    split = curate(engine, "split", object=a["object"], views=[b["view"]])
    robot.insert(bench.sight(bench.BOX), object=split["object"])
    with pytest.raises(ConflictError, match="robots have reported on"):
        curate(engine, "undo", commit=split["commit"])


def test_a_grasp_tried_on_both_is_counted_for_both_in_one_commit(bench, engine, robots):
    robot = robots("nao-1")
    seen = [bench.sight(bench.BOX), bench.sight(bench.BOX.at(0.15, -0.05, 0.5))]
    first = robot.recognise(seen[0], max_grasps=1)["grasps"][0]
    held, lost = {"outcome": bench.held()}, {"outcome": bench.missed()}
    one = robot.insert(seen[0], grasp=first, task_id="t-1", **held)["objects"][0]
    grasp = one["grasp"]
    two = robot.insert(seen[1], object=one["object"], grasp=grasp, task_id="t-2", **lost)
    view = two["objects"][0]["view"]
    before = engine.kb.seq
    split = curate(engine, "split", object=one["object"], views=[view])
    assert engine.kb.seq == before + 1

    def counted(thing):
        (known,) = robot.call("recall_grasps", object=thing)["grasps"]
        (node,) = {q.subject for q in engine.kb.match(None, RT.statisticsOf, iri(known["id"]))}
        said = {q.predicate: int(q.object.value) for q in engine.kb.match(node)
                if q.predicate in (RT.attempts, RT.successes)}  # fmt: skip
        return said[RT.attempts], said[RT.successes]

    assert counted(one["object"]) == (1, 1)
    assert counted(split["object"]) == (1, 0)
    curate(engine, "undo", commit=split["commit"])
    assert counted(one["object"]) == (2, 1)


@pytest.mark.parametrize("crossed", [False, True])
def test_two_people_merge_at_once_and_one_of_them_is_told(engine, boxes, crossed):
    _, a, b, _ = boxes
    pairs = [(a, b), (b, a) if crossed else (a, b)]
    answers: list[object] = []
    start = threading.Barrier(2)

    def merge(who, pair):
        start.wait()
        try:
            done = curate(engine, "merge", who, object=pair[0]["object"], into=pair[1]["object"])
            answers.append(done["object"])
        except RtaskError as error:
            answers.append(error)

    threads = [
        threading.Thread(target=merge, args=(who, pair))
        for who, pair in zip((ANN, BOB), pairs, strict=True)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    (kept,) = [answer for answer in answers if isinstance(answer, str)]
    (told,) = [answer for answer in answers if isinstance(answer, UsageError)]
    assert kept in str(told)
    assert len(engine.kb.match(None, RT.mergedInto)) == 1
    assert owners(engine)[a["view"]] == owners(engine)[b["view"]] == kept


def test_a_stored_object_gets_a_name_and_a_kind(engine, boxes):
    robot, a, _, _ = boxes
    teach = {"operation": "teach", "object": a["object"]}
    said = engine.call(
        "teach_object", {**teach, "name": "Ann's mug", "class_description": "cylinder"}, ANN
    )
    (entry,) = said["objects"]
    assert (entry["label"], entry["class_iri"]) == ("Ann's mug", RT.Cylinder.value)
    kinds = {q.object for q in engine.kb.match(iri(a["object"]), RDF.type)}
    assert RT.Cylinder in kinds
    assert RT.Box not in kinds  # what the shape suggested gives way
    row = next(name for name in engine.index.views() if name.view_iri == a["view"])
    assert row.class_iri == RT.Cylinder.value
    again = engine.call("teach_object", {**teach, "class_description": "dragon cup"}, BOB)
    made = again["objects"][0]["class_iri"]
    assert made.endswith("/class/dragon-cup")
    with pytest.raises(ConflictError, match=again["commit"]):
        curate(engine, "undo", commit=said["commit"])
    for commit in (again["commit"], said["commit"]):
        curate(engine, "undo", commit=commit)
    assert robot.call("recall_grasps", object=a["object"])["object"] == a["object"]
    kinds = {q.object for q in engine.kb.match(iri(a["object"]), RDF.type)}
    assert RT.Box in kinds
    with pytest.raises(UsageError, match="name is missing"):
        engine.call("teach_object", teach, ANN)
    with pytest.raises(ForbiddenError, match="teach"):
        robot.call("teach_object", **teach, name="mine")
    with pytest.raises(ForbiddenError, match="belongs to 'ann'"):
        engine.call("teach_object", {**teach, "name": "x", "operator": "bob"}, ANN)


def test_look_alikes_of_a_stored_object_are_narrowed_by_words(engine, boxes):
    robot, a, b, c = boxes
    search = {"operation": "search", "object": a["object"]}
    found = robot.call("teach_object", **search)["similar_objects"]
    assert {one["object"] for one in found} == {b["object"], c["object"]}
    engine.call(
        "teach_object", {"operation": "teach", "object": c["object"], "class_description": "tin"},
        ANN,
    )  # fmt: skip
    narrowed = robot.call("teach_object", **search, class_description="tin")["similar_objects"]
    assert [one["object"] for one in narrowed] == [c["object"]]
    assert robot.call("teach_object", **search, class_description="tni")["suggestions"] == ["tin"]


def test_an_object_is_meant_by_its_name_unless_two_have_it(engine, boxes):
    _, a, b, c = boxes
    teach = {"operation": "teach", "name": "tin"}
    engine.call("teach_object", {**teach, "object": a["object"]}, ANN)
    with pytest.raises(UnknownTermError, match="did you mean 'tin'"):
        curate(engine, "merge", object="tim", into=b["object"])
    assert curate(engine, "merge", object="tin", into=b["object"])["object"] == b["object"]
    for thing in (b, c):
        engine.call("teach_object", {**teach, "object": thing["object"]}, ANN)
    with pytest.raises(UsageError, match="several objects"):
        curate(engine, "forget", object="tin")


def test_what_is_forgotten_is_called_so(engine, boxes):
    _, a, _, c = boxes
    gone = curate(engine, "forget", object=a["object"])
    with pytest.raises(UnknownTermError, match="was forgotten"):
        curate(engine, "merge", object=c["object"], into=a["object"])
    curate(engine, "undo", commit=gone["commit"])
    assert owners(engine)[a["view"]] == a["object"]
