"""A recorded view is cut as the same view is live, where its TF says where the camera was."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from features.codec import encode_frame
from features.geometry import Frame
from features.imaging import recordings
from features.perception import perceive
from rtask.cli.perception import posed
from rtask.cli.perception.segment import segment
from rtask.cli.perception.selecting import Selection, objects_in
from rtask.cli.perception.view_options import View
from rtask.errors import UsageError
from rtask.ros2 import transforms
from tests.rtask.interop.ros.scene import BASE_FROM_CAMERA, INTRINSICS, urdf_of, view

pytest.importorskip("rosbags")

STAMP_NS = 1_790_000_000_123_456_789
"""To the nanosecond, which no time in s as a float holds."""

LIFT = np.array([0.0, 0.0, 0.4])
"""From base_link to where it stands in base_footprint, m."""


def record(
    folder: Path, *transforms: tuple[str, str, np.ndarray, int, bool], urdf: str = ""
) -> Path:
    """Write a view and transforms (parent, child, pose, ns after the view, static) as MCAP."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, frame = store.types, view()

    def header(time_ns: int, name: str) -> object:
        stamp = types["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)
        return types["std_msgs/msg/Header"](stamp, name)

    def image(encoding: str, pixels: np.ndarray) -> object:
        rows = np.ascontiguousarray(pixels).view("u1").reshape(len(pixels), -1)
        optical = header(STAMP_NS, frame.frame_id)
        return types["sensor_msgs/msg/Image"](
            optical, *pixels.shape[:2], encoding, 0, rows.shape[1], rows.ravel()
        )

    camera = INTRINSICS
    k = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1.0])
    region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    info = types["sensor_msgs/msg/CameraInfo"](
        header(STAMP_NS, frame.frame_id), camera.height, camera.width, "plumb_bob", np.zeros(5), k,
        np.eye(3).ravel(), np.zeros(12), 0, 0, region,
    )  # fmt: skip
    messages = [
        ("/camera/depth/camera_info", info), ("/camera/depth/image", image("32FC1", frame.depth_m)),
        ("/camera/color/image", image("rgb8", frame.rgb)),
    ]  # fmt: skip
    for parent, child, pose, after_ns, is_static in transforms:
        move = types["geometry_msgs/msg/Vector3"](*pose[:3, 3])
        turn = types["geometry_msgs/msg/Quaternion"](*quaternion(pose))
        stamped = types["geometry_msgs/msg/TransformStamped"](
            header(STAMP_NS + after_ns, parent), child,
            types["geometry_msgs/msg/Transform"](move, turn),
        )  # fmt: skip
        topic = "/tf_static" if is_static else "/tf"
        messages.append((topic, types["tf2_msgs/msg/TFMessage"]([stamped])))
    if urdf:
        messages.append(("/nao1/robot_description", types["std_msgs/msg/String"](urdf)))
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        made: dict[str, object] = {}
        # Recorded by a clock that is years behind that of the headers, as of a simulated robot.
        for number, (topic, message) in enumerate(messages):
            kind = message.__msgtype__
            if topic not in made:
                made[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(made[topic], 10**9 + number, store.serialize_cdr(message, kind))
    return folder


def quaternion(pose: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(pose[:3, :3]).as_quat()


def moved(pose: np.ndarray, *by: float) -> np.ndarray:
    changed = pose.copy()
    changed[:3, 3] += by
    return changed


def link_from_camera() -> np.ndarray:
    return moved(BASE_FROM_CAMERA, *-LIFT)


STANDS = ("base_footprint", "base_link", moved(np.eye(4), *LIFT), 0, True)


def run(*arguments: object):
    return CliRunner().invoke(segment, [str(each) for each in arguments])


def live() -> Frame:
    """Return the view as a node would send it, before its stamp."""
    return view()


@pytest.mark.parametrize("last_ns", [0, 30_000_000])
def test_a_recording_with_tf_is_cut_as_the_live_view(tmp_path, last_ns):
    """The camera moves; its newest pose is as old as the view, or newer, and it is between two."""
    early, late = moved(link_from_camera(), 0.03), moved(link_from_camera(), -0.03)
    steps = [(early, -30_000_000), (link_from_camera(), 0)]
    if last_ns:
        steps = [(early, -last_ns), (late, last_ns)]
    moving = [("base_link", "camera_optical", pose, after, False) for pose, after in steps]
    file = record(tmp_path / "rec", *moving, STANDS)
    done = run(file, "--json")
    seen = perceive(live(), BASE_FROM_CAMERA)
    answer = json.loads(done.stdout)
    assert (answer["frame"], answer["status"]) == ("base_footprint", "ok")
    # A tenth of a millimetre: halfway between two poses, and four decimals.
    assert answer["table_height_m"] == pytest.approx(seen.table_height, abs=1e-4)
    assert [row["centroid_m"] for row in answer["objects"]] == [
        pytest.approx(each.points.mean(axis=0), abs=1e-4) for each in seen.objects
    ]


def test_the_crops_of_a_recording_are_those_of_the_live_view(tmp_path):
    at = ("base_link", "camera_optical", link_from_camera(), 0, True)
    file = record(tmp_path / "rec", at, STANDS)
    frame, crops = objects_in(file, View(), "auto", Selection())
    seen = perceive(replace(live(), stamp_s=frame.stamp_s), BASE_FROM_CAMERA)
    assert len(crops) == 2
    for (_, crop), each in zip(crops, seen.objects, strict=True):
        assert encode_frame(crop) == encode_frame(each.crop)


def test_what_belongs_to_the_robot_is_no_object(tmp_path):
    """One of the two boxes is a part of the model; a part that TF does not place is named."""
    at = ("base_link", "camera_optical", link_from_camera(), 0, True)
    part = ("base_link", "bin", moved(np.eye(4), 0.27, 0.09, 0.31 - LIFT[2]), 0, True)
    file = record(tmp_path / "rec", at, part, STANDS, urdf=urdf_of("bin", "wrist"))
    done = run(file, "--json")
    assert len(json.loads(done.stdout)["objects"]) == 1
    assert "its transforms do not say where wrist are" in done.stderr
    broken = record(tmp_path / "broken", at, part, STANDS, urdf="<robot")
    done = run(broken, "--json")
    assert len(json.loads(done.stdout)["objects"]) == 2
    assert "robot_description is no XML" in done.stderr


def test_without_tf_places_are_in_the_frame_of_the_camera(tmp_path):
    done = run(record(tmp_path / "rec"), "--json")
    assert "frame" not in json.loads(done.stdout)
    assert done.stderr == ""


def test_tf_that_leads_to_no_usual_base_is_said_and_another_base_can_be_named(tmp_path):
    file = record(tmp_path / "rec", ("torso", "camera_optical", BASE_FROM_CAMERA, 0, True))
    done = run(file)
    assert "no usual base (base_footprint: nobody publishes base_footprint" in done.stderr
    assert " in torso, table at 0.270 m" in run(file, "--frame", "torso").stdout


@pytest.mark.parametrize("after_ns", [-2_000_000_000, 2_000_000_000])
def test_tf_of_another_time_is_not_taken(tmp_path, after_ns):
    at = ("base_link", "camera_optical", link_from_camera(), after_ns, False)
    done = run(record(tmp_path / "rec", at))
    assert "camera_optical is known from" in done.stderr
    assert " in base_link" not in done.stdout


def test_a_frame_that_is_of_no_use_is_refused(tmp_path):
    file = record(tmp_path / "rec", ("torso", "camera_optical", BASE_FROM_CAMERA, 0, True))
    for arguments, words in (
        ((file, "--frame", "waist"), "nobody publishes waist"),
        ((file, "--frame", "torso", "--segmentation", "near"), "--frame: the view is cut by"),
    ):
        error = run(*arguments).exception
        assert isinstance(error, UsageError)
        assert words in str(error)


def test_views_at_several_times_are_cut_together(tmp_path):
    at = ("base_link", "camera_optical", link_from_camera(), 0, True)
    file = record(tmp_path / "rec", at, STANDS)
    alone = json.loads(run(file, "--json").stdout)
    both = json.loads(run(file, "--also-at", "0", "--json").stdout)
    assert both["frame"] == "base_footprint"
    assert both["table_height_m"] == pytest.approx(alone["table_height_m"], abs=0.002)
    centres = [sorted(row["centroid_m"] for row in answer["objects"]) for answer in (alone, both)]
    assert len(centres[1]) == 2
    # By both rules an object is there; the rule for several views leaves no part out.
    assert np.allclose(*centres, atol=0.01)


def test_several_times_need_to_know_where_the_camera_was(tmp_path):
    error = run(record(tmp_path / "rec"), "--also-at", "0").exception
    assert isinstance(error, UsageError)
    assert "--also-at: needs a recording whose TF" in str(error)


def test_the_transform_that_is_as_old_as_the_view_gives_the_time(monkeypatch) -> None:
    """A time in s loses nanoseconds, by which the newest transform would be too old."""
    made: list[object] = []
    stamps = [(STAMP_NS - 90_000_000, "older"), (STAMP_NS - 40, "newest")]
    messages = [
        SimpleNamespace(transforms=[SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace(
            sec=time_ns // 10**9, nanosec=time_ns % 10**9)))])
        for time_ns, _ in stamps
    ]  # fmt: skip
    monkeypatch.setattr(
        recordings, "transforms_near", lambda file, at: [(message, False) for message in messages]
    )
    monkeypatch.setattr(
        transforms.TransformBuffer, "take", lambda self, message, is_static: made.append(message)
    )
    _, time_ns = posed._transforms_at(Path("a.mcap"), STAMP_NS / 1e9)
    assert (time_ns, made) == (STAMP_NS - 40, messages)
