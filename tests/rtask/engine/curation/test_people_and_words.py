"""People teach and search; the thesis's own messages; names and words."""

from __future__ import annotations

import base64

import numpy as np
import pytest

from features.codec import encode_cloud, from_wire, to_wire
from rtask.engine.terms import find_task
from rtask.errors import ForbiddenError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access

ANN = Access("ann", "teacher")
NOBODY = Access(None, "anonymous")


def teach(engine, bench, thing, words, **more):
    request = {"operation": "teach", "class_description": words, **bench.sight(thing), **more}
    return engine.call("teach_object", request, ANN)


@pytest.mark.slow
def test_a_taught_name_becomes_a_class_and_is_found_by_its_words(bench, engine, kb):
    taught = teach(engine, bench, bench.BOX, "Juice  Carton", name="anns juice")
    made = taught["objects"][0]
    assert made["new"] is True
    assert made["class_iri"].endswith("/class/juice-carton")
    assert made["label"] == "anns juice"
    teach(engine, bench, bench.CAN, "tin")
    for words in ("juice carton", "JUICE", "carton juice"):
        found = engine.call(
            "teach_object",
            {"operation": "search", "class_description": words, **bench.sight(bench.BOX)}, ANN,
        )  # fmt: skip
        assert [entry["object"] for entry in found["similar_objects"]] == [made["object"]], words
        assert found["similar_objects"][0]["class"] == made["class"]


def test_words_that_mean_nothing_get_suggestions(bench, engine):
    teach(engine, bench, bench.BOX, "juice carton")
    found = engine.call(
        "search_object", {"class_description": "juice kartoon", **bench.sight(bench.BOX)}, ANN
    )
    assert found["similar_objects"] == []
    assert "juice carton" in found["suggestions"]


def test_words_filter_what_looks_alike(bench, engine):
    teach(engine, bench, bench.BOX, "juice carton")
    teach(engine, bench, bench.CAN, "tin")
    found = engine.call(
        "search_object", {"class_description": "tin", **bench.sight(bench.BOX)}, ANN
    )
    assert [e["label"] for e in found["similar_objects"] if e["confidence"] > 0.5] == []


@pytest.mark.slow
def test_teaching_a_known_object_of_the_class_adds_a_view(bench, engine):
    first = teach(engine, bench, bench.BOX, "juice carton")["objects"][0]
    teach(engine, bench, bench.CAN, "tin")
    eye = bench.Eye((0.04, 0.02, 0.6), (*bench.BOX.position, bench.TABLE))
    seen = bench.sight(bench.BOX, eye)
    again = engine.call(
        "teach_object", {"operation": "teach", "class_description": "juice carton", **seen}, ANN
    )["objects"][0]
    assert again["new"] is False
    assert again["object"] == first["object"]
    other = engine.call(
        "teach_object", {"operation": "teach", "class_description": "lantern", **seen}, ANN
    )["objects"][0]
    assert other["new"] is True


def test_robots_search_and_do_not_teach(bench, robots):
    robot = robots()
    request = {"operation": "teach", "class_description": "tin", **bench.sight(bench.BOX)}
    with pytest.raises(ForbiddenError, match="scope teach"):
        robot.call("teach_object", **request)
    request["operation"] = "search"
    assert robot.call("teach_object", **request)["similar_objects"] == []


def test_a_search_without_words_or_an_attempt_without_outcome_is_named(bench, engine):
    with pytest.raises(UsageError, match="class_description is missing: search needs it"):
        engine.call("teach_object", {"operation": "search", **bench.sight(bench.BOX)}, ANN)
    with pytest.raises(UnknownTermError, match="nothing to judge"):
        engine.call("teach_object", {"operation": "confirm", "task_id": "urn:none"}, ANN)
    with pytest.raises(UsageError, match="task_id is missing"):
        engine.call("teach_object", {"operation": "confirm"}, ANN)


def cloud_of(bench, thing):
    """Return a coloured cloud as the thesis's robots send it, in a frame with z up."""
    seen = bench.look(thing, bench.Eye(target=(*thing.position, bench.TABLE)))
    pose = bench.Eye(target=(*thing.position, bench.TABLE)).base_from_camera()
    points = seen.points()[seen.mask] @ pose[:3, :3].T + pose[:3, 3]
    return to_wire(encode_cloud(points.astype(np.float32), seen.rgb[seen.mask], 0.0005))


def test_the_thesis_inserts_a_cloud_with_four_numbers_and_finds_it_again(bench, engine, kb):
    entry = {"new_point_cloud": cloud_of(bench, bench.BOX),
             "X": "0.16", "Y": "-0.06", "Z": "0.30", "rad": "0.314"}  # fmt: skip
    stored = engine.call("insert_object", {"objects": [entry]}, NOBODY)
    assert stored["stored"] == 1
    assert stored["objects"][0]["features"] > 20
    assert kb.match(graph=kb.graphs.shared)
    found = engine.call("search_object", {"data": entry["new_point_cloud"]}, NOBODY)
    best = found["similar_objects"][0]
    assert best["object"] == stored["objects"][0]["object"]
    assert (best["X"], best["Y"], best["Z"]) == pytest.approx((0.16, -0.06, 0.30), abs=1e-5)
    # The grasp's axis has no sign: half a turn more is the same closing direction.
    assert best["rad"] % np.pi == pytest.approx(0.314, abs=1e-5)


def test_one_objects_fields_may_stand_at_top_level(bench, engine):
    stored = engine.call("insert_object", {**bench.sight(bench.BOX), "name": "it"}, NOBODY)
    assert stored["objects"][0]["label"] == "it"


def test_an_object_without_a_grasp_has_no_numbers(bench, engine):
    engine.call("insert_object", bench.sight(bench.BOX), NOBODY)
    found = engine.call("search_object", bench.sight(bench.BOX), NOBODY)["similar_objects"][0]
    assert found["X"] is found["Y"] is found["Z"] is found["rad"] is found["grasp"] is None


def test_a_cloud_without_colours_is_told_apart_by_its_shape(bench, engine):
    seen = bench.look(bench.BOX, bench.Eye(target=(*bench.BOX.position, bench.TABLE)))
    data = to_wire(encode_cloud(seen.points()[seen.mask], None, 0.001))
    stored = engine.call("insert_object", {"objects": [{"data": data}]}, NOBODY)
    assert stored["objects"][0]["new"] is True


def test_text_that_is_no_cloud_is_refused_with_its_first_bytes(engine):
    data = base64.b64encode(b"zc5p81H1cO8P+Ksmfdf").decode()
    with pytest.raises(UsageError, match="data: not a point cloud"):
        engine.call("search_object", {"data": data}, NOBODY)
    assert from_wire(data).startswith(b"zc5p")


@pytest.mark.parametrize(
    ("name", "kind"), [("pick", "Grasp"), ("Place", "Place"), ("pick and place", "PickAndPlace")]
)
def test_tasks_are_known_by_name(name, kind):
    assert find_task(name)[0].value.endswith("#" + kind)


def test_an_unknown_task_or_gripper_lists_what_is_known(bench, robots):
    with pytest.raises(UnknownTermError, match=r"unknown task 'pik'; did you mean 'pick'.*push"):
        find_task("pik")
    with pytest.raises(UnknownTermError, match="'rihgt_hand'; did you mean 'right_hand'"):
        robots().recognise(bench.sight(bench.BOX), gripper_id="rihgt_hand")


@pytest.mark.slow
def test_known_grasps_are_recalled_by_name_surest_first(bench, robots):
    robot = robots()
    seen = bench.sight(bench.BOX)
    answer = robot.recognise(seen)
    thing = robot.insert(seen, grasp=answer["grasps"][0], outcome=bench.missed(), name="tea box")
    robot.insert(
        seen, object=thing["objects"][0]["object"], grasp=answer["grasps"][4],
        outcome=bench.held(attempt_number=2),
    )  # fmt: skip
    told = robot.call("recall_grasps", object="tea box")
    assert told["label"] == "tea box"
    assert [g["statistics"]["successes"] for g in told["grasps"]] == [1, 0]
    assert told["grasps"][0]["z"] == pytest.approx(answer["grasps"][4]["z"] - bench.TABLE, abs=1e-6)
    with pytest.raises(UnknownTermError, match="did you mean 'tea box'"):
        robot.call("recall_grasps", object="tee box")


def test_an_unknown_operation_is_met_with_the_nearest(engine):
    with pytest.raises(UnknownTermError, match="did you mean 'recognise_for_grasp'"):
        engine.call("recognize_for_grasp", {}, NOBODY)
