"""A camera without clouds: depth, colour and the camera's own message, joined by the node."""

from __future__ import annotations

import pytest

from tests.rtask.interop.ros.conftest import running
from tests.rtask.interop.ros.test_node import ABORTED, SUCCEEDED

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture(scope="module")
def other(start_node, robot, ros_server):
    """Start a node with other eyes; return what makes the robot look through them."""
    children = []

    def start(namespace, *remaps):
        child = start_node("ros", "node", "--server", ros_server.url, "--gripper", "hand",
                           f"__ns:={namespace}", *remaps)  # fmt: skip
        children.append(child)
        child.expect(f"ready {namespace}/rtask_node")
        return lambda **told: robot("see", node=namespace, **told)

    yield start
    for child in children:
        with running(child):
            pass


@pytest.mark.parametrize("compressed", [False, True])
def test_depth_and_colour_are_one_view(other, robot, compressed, stamp):
    image = "/camera/packed" if compressed else "/camera/image"
    look = other(
        f"/eyes{int(compressed)}", "~depth:=/camera/depth", f"~image:={image}",
        "~camera_info:=/camera/info",
    )  # fmt: skip
    taken = {"depth_stamp": stamp, "image_stamp": stamp + 0.02, "tf_stamp": stamp}
    robot("photograph", **taken, compressed=compressed)
    seen = look(goal={}, since=stamp)
    assert seen["state"] == SUCCEEDED, seen["text"]
    found = seen["result"]["objects"]
    assert len(found) == 2
    assert {one["header"]["stamp"]["secs"] for one in found} == {stamp}
    # The boxes are 8 and 6 cm high on a table at 0.27 m; depth comes in whole mm.
    tops = sorted(one["pose"]["position"]["z"] + one["size"]["z"] / 2 for one in found)
    assert tops == pytest.approx([0.33, 0.35], abs=0.005)


def test_what_does_not_come_or_does_not_belong_together_is_said(other, robot, stamp):
    look = other(
        "/blind", "~depth:=/camera/depth", "~image:=/nowhere", "~camera_info:=/camera/info"
    )
    robot("photograph", depth_stamp=stamp, image_stamp=stamp, tf_stamp=stamp)
    seen = look(goal={}, since=stamp)
    assert seen["state"] == ABORTED
    assert "of depth and colour, nothing came on /nowhere" in seen["text"]
    look = other(
        "/late", "~depth:=/camera/depth", "~image:=/camera/image", "~camera_info:=/camera/info"
    )
    later = stamp + 50
    robot("photograph", depth_stamp=later, image_stamp=later + 0.2, tf_stamp=later)
    seen = look(goal={}, since=later)
    assert seen["state"] == ABORTED
    assert "they belong together when at most 0.1 s lie between them" in seen["text"]
