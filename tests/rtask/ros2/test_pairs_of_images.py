"""Which colour belongs to which depth of a live camera, in ROS 1 and 2."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from features.imaging.topics import Topic, is_rectified_topic
from rtask.errors import RemoteUnavailableError
from rtask.interop.ros.views.newest import NewestView
from rtask.ros2.camera import is_rectified

NOW = SimpleNamespace(sec=0, nanosec=0)


class Pairs(NewestView[tuple[Any, Any]]):
    """Views that are the two messages themselves."""

    def __init__(self, depth: str = "/head/depth/image_raw") -> None:
        super().__init__()
        self._depth = depth

    def topic(self, name: str) -> str:
        return self._depth if name == "depth" else f"/{name}"

    def is_published(self, name: str) -> bool:
        return True

    def remapping(self) -> str:
        return "remap"

    def read_cloud(self, cloud: Any) -> Any:
        raise AssertionError("no cloud was sent")

    def read_images(self, depth: Any, colour: Any, info: Any) -> tuple[Any, Any]:
        return depth, colour


def image(frame: str, milliseconds: int = 0) -> Any:
    stamp = SimpleNamespace(sec=1, nanosec=milliseconds * 1_000_000)
    return SimpleNamespace(header=SimpleNamespace(frame_id=frame, stamp=stamp))


def show(view: Pairs, depth: Any, *colours: Any) -> Pairs:
    view.take_info(image("head"))
    view.take_depth(depth)
    for colour in colours:
        view.take_colour(colour)
    return view


def test_the_picture_of_another_camera_is_not_laid_over_depth_however_near_in_time():
    own, other = image("head", 60), image("wrist")
    assert show(Pairs(), image("head"), other, own).wait(0.0, NOW).read()[1] is own
    with pytest.raises(RemoteUnavailableError) as told:
        show(Pairs(), image("head"), other).wait(0.0, NOW)
    assert "is in the frame head, and the image on /image in wrist" in str(told.value)


@pytest.mark.parametrize("frames", [("/head", "head"), ("", "head"), ("head", "")])
def test_a_slash_before_a_frame_or_a_frame_that_is_not_said_parts_nothing(frames):
    depth, colour = (image(frame) for frame in frames)
    assert show(Pairs(), depth, colour).wait(0.0, NOW).read() == (depth, colour)


@pytest.mark.parametrize(
    "name",
    ["/camera/aligned_depth_to_color/image_raw", "/camera/depth_registered/image_rect",
     "/k4a/depth_to_rgb/image_raw", "/camera/depth/image_rect_raw", "/registered/points"],
)  # fmt: skip
def test_depth_that_was_laid_over_colour_is_told_by_its_name_as_in_recordings(name):
    view = show(Pairs(name), image("depth_optical"), image("colour_optical"))
    is_taken = True
    try:
        view.wait(0.0, NOW)
    except RemoteUnavailableError:
        is_taken = False
    assert is_taken == Topic(name, "sensor_msgs/msg/Image", "16UC1").is_aligned


@pytest.mark.parametrize(
    ("topic", "answer"),
    [
        ("/camera/depth/image_rect_raw", True), ("/camera/rgb/image_rect_color/compressed", True),
        ("/left/rect/image", True), ("/camera/depth_rectified/image", True),
        ("/camera/depth/image_raw", False), ("/rectangles/image", False), ("/direct/image", False),
    ],
)  # fmt: skip
def test_nodes_and_recordings_tell_rectified_images_by_one_rule(topic: str, answer: bool):
    assert (is_rectified(topic), is_rectified_topic(topic)) == (answer, answer)


@pytest.mark.parametrize(
    ("of_info", "k", "says"),
    [
        ({"frame_id": "eye"}, [60.0, 0, 31.5, 0, 60, 23.5, 0, 0, 1], ""),
        ({"frame_id": "wrist"}, [60.0, 0, 31.5, 0, 60, 23.5, 0, 0, 1], "in the frame wrist"),
        ({"frame_id": "eye"}, [120.0, 0, 63, 0, 120, 47, 0, 0, 1], "K or P of another size"),
    ],
)
def test_depth_that_another_camera_describes_is_doubted(caplog, of_info, k, says):
    from rtask.interop.ros.clouds import _warn_once, frame_of_images

    _warn_once.cache_clear()
    header, size = {"frame_id": "eye"}, {"height": 48, "width": 64}
    depth = {"header": header, **size, "encoding": "16UC1", "data": b"\xbc\x02" * (48 * 64)}
    colour = {"header": header, **size, "encoding": "rgb8", "step": 192, "data": bytes(48 * 192)}
    for _ in range(2):
        frame_of_images(depth, colour, {"header": of_info, **size, "k": k, "d": []})
    assert [says in record.getMessage() for record in caplog.records] == [True] * bool(says)
