"""Looks without a cloud, with masks, boxes and poses of other tools, and as messages of ROS."""

from __future__ import annotations

import base64

import cv2
import numpy as np
import pytest

from features.codec import encode_frame
from features.imaging.masks import encode_rle
from grasp.messages import pose_message
from rtask.errors import UsageError

pytestmark = pytest.mark.slow


def jpeg(image):
    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()


@pytest.fixture
def box_frame(bench):
    return bench.look(bench.BOX, bench.Eye())


def test_a_picture_without_print_is_stored_with_a_warning(robots):
    night = np.full((120, 160, 3), 12, np.uint8)
    (entry,) = robots().call("insert_object", objects=[{"image": jpeg(night)}])["objects"]
    assert entry["message"].startswith("hardly any print is seen (0 keypoints)")
    assert "the picture is dark" in entry["message"]


def test_an_image_alone_is_stored_and_found_again(engine, bench, robots, box_frame):
    robot = robots()
    rle = encode_rle(box_frame.mask)
    picture = base64.b64encode(jpeg(box_frame.rgb)).decode()
    stored = robot.call("insert_object", objects=[{"image": picture, "mask": rle, "name": "tea"}])
    assert stored["objects"][0]["features"] > 20
    other = robot.call(
        "insert_object",
        objects=[{"image": jpeg(bench.look(bench.CAN, bench.Eye()).rgb), "name": "can"}],
    )
    assert other["objects"][0]["new"]
    again = bench.look(bench.BOX, bench.Eye(noise_seed=3))
    found = robot.call("search_object", image=jpeg(again.rgb), mask=encode_rle(again.mask))
    assert found["accepted"]
    assert found["outcome"] == "single"
    assert found["similar_objects"][0]["label"] == "tea"
    view = stored["objects"][0]["view"]
    assert found["similar_objects"][0]["view"] == view
    shown = engine.kb.blobs.read("urn:sha256:" + found["similar_objects"][0]["picture"])
    assert cv2.imdecode(np.frombuffer(shown, np.uint8), 1) is not None
    message = {"format": "jpeg", "data": base64.b64encode(jpeg(again.rgb)).decode()}
    box = [float(n) for n in cv2.boundingRect(again.mask.astype(np.uint8))]
    assert robot.call("search_object", image=message, box=box)["accepted"]
    seen = robot.recognise({}, image=jpeg(again.rgb), mask=encode_rle(again.mask))
    assert seen["task_response"] == "no_grasp"
    first = seen["recognition"]["matches"][0]
    assert (first["view"], first["picture"]) == (view, found["similar_objects"][0]["picture"])
    alike = robot.call("teach_object", operation="search", object=other["objects"][0]["object"])
    assert {(one["view"], one["picture"]) for one in alike["similar_objects"]} <= {
        (view, first["picture"])
    }


def test_several_looks_at_one_thing_are_answered_together(engine, bench, robots, box_frame):
    def picture(product, seed):
        seen = bench.look(product, bench.Eye(noise_seed=seed))
        return {"image": jpeg(seen.rgb), "mask": encode_rle(seen.mask)}

    robot = robots()
    first = {"image": jpeg(box_frame.rgb), "mask": encode_rle(box_frame.mask), "name": "tea"}
    robot.call("insert_object", objects=[first])
    robot.call("insert_object", objects=[{**picture(bench.CAN, 0), "name": "can"}])
    seen, other, strange = picture(bench.BOX, 3), picture(bench.BOX, 4), picture(bench.CAN, 5)

    def odds(answer, name="tea"):
        sure = {one["label"]: one["confidence"] for one in answer["similar_objects"]}.get(name)
        return -1.5 if sure is None else float(np.clip(np.log(sure / (1 - sure)), -6, 6))

    alone = [odds(robot.call("search_object", **one)) for one in (seen, other, strange)]
    both = robot.call("search_object", **seen, looks=[other])
    assert both["accepted"]
    assert odds(both) == pytest.approx(np.mean(alone[:2]), abs=0.01)
    three = robot.call("search_object", **seen, looks=[strange, other])
    assert odds(three) == pytest.approx(np.mean(sorted(alone)[-2:]), abs=0.01)
    mixed = robot.call("search_object", **seen, looks=[strange])
    assert not mixed["accepted"]  # two things in one request: neither is in both looks
    asked = robot.recognise({}, **seen, looks=[other])
    assert asked["recognition"]["accepted"]
    with pytest.raises(UsageError, match=r"looks\[1\].data is missing"):
        robot.call("search_object", **seen, looks=[other, {"box": [0, 0, 5, 5]}])


def test_a_mask_in_a_whole_frame_points_at_the_object(engine, robots, box_frame):
    robot = robots()
    whole = encode_frame(type(box_frame)(box_frame.depth_m, box_frame.intrinsics, box_frame.rgb))
    crop = robot.recognise({"data": encode_frame(box_frame.crop(box_frame.mask))})
    by_mask = robot.recognise({"data": whole, "mask": encode_rle(box_frame.mask)})
    assert by_mask["shape"]["length"] == pytest.approx(crop["shape"]["length"], abs=1e-3)
    left, top, width, height = cv2.boundingRect(box_frame.mask.astype(np.uint8))
    by_box = robot.recognise({"data": whole, "box": [left - 6, top - 6, width + 12, height + 12]})
    assert by_box["shape"]["length"] == pytest.approx(crop["shape"]["length"], abs=6e-3)


def test_a_picture_of_more_pixels_than_depth_keeps_the_depth(engine, robots, box_frame):
    robot = robots()
    fine = cv2.resize(box_frame.rgb, (1280, 960), interpolation=cv2.INTER_CUBIC)
    crop = encode_frame(box_frame.crop(box_frame.mask))
    answer = robot.recognise({"data": crop, "image": jpeg(fine)})
    assert answer["shape"]["length"] == pytest.approx(
        robot.recognise({"data": crop})["shape"]["length"], abs=1e-3
    )


def test_a_pose_of_another_estimator_is_taken_as_it_is(engine, bench, robots):
    robot = robots()
    seen = bench.sight(bench.BOX)
    thing = robot.insert(seen)["objects"][0]["object"]
    pose = np.eye(4)
    pose[:3, 3] = (0.16, -0.06, bench.TABLE)
    answer = robot.recognise(seen, object=thing, object_pose=pose_message(pose))
    told = answer["recognition"]
    assert told["pose"]["source"] == "given"
    assert told["pose_accepted"]
    position = told["pose"]["frame_from_object"]["position"]
    assert [position[axis] for axis in "xyz"] == pytest.approx([0.16, -0.06, bench.TABLE])


def test_looks_without_anything_to_look_at_are_refused(engine, robots, box_frame):
    robot = robots()
    with pytest.raises(UsageError, match="data is missing"):
        robot.call("search_object", mask={"size": [2, 2], "counts": [4]})
    empty = np.zeros(box_frame.mask.shape, bool)
    with pytest.raises(UsageError, match="image: the mask is empty"):
        robot.call("search_object", image=jpeg(box_frame.rgb), mask=encode_rle(empty))
    with pytest.raises(UsageError, match="no PNG, JPEG"):
        robot.call("search_object", image=b"GIF89a......")
    with pytest.raises(UsageError, match="PointCloud2"):
        robot.call("search_object", data={"points": []})
