"""Recordings of ROS: bags of ROS 1 and ROS 2, and MCAP (extra ``recordings``; needs no ROS).

Depth is paired with the image nearest in time of its own camera's colour, by the stamps of their
headers where these tell time, and with the CameraInfo of its frame beside its topic; static
transforms say how depth and colour stand to one another. What a topic carries is read from its
messages and its name, never assumed: infrared is no depth, and a topic that cannot be read is left
out with a warning, not the whole recording.
"""

from __future__ import annotations

import logging
import re
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from features.codec.limits import CloudFormatError
from features.codec.ros import deep_colours
from features.codec.types import Cloud
from features.geometry import Frame
from features.imaging.described import name_space, stamp_of
from features.imaging.mounting import Mounting
from features.imaging.pairing import Pairing
from features.imaging.photo import Photo
from features.imaging.topics import Topic, plan_topics, sensor_of

__all__ = ["first_view", "message_mapping", "robot_description", "transforms_near", "views_of"]

_log = logging.getLogger(__name__)

_TYPES = tuple(
    f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo", "PointCloud2")
)
_TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_TRANSFORM = "geometry_msgs/msg/Transform"
"""Of RealSense's SDK: the pose of a reference in the frame of a stream, ``.../tf/REFERENCE``."""
_OTHER_PICTURES = re.compile(r"(Image|Video|Packet|PointCloud|CustomMsg)$")
"""Types of pictures and clouds that are not read, such as video, and those of other viewers."""
_SEVERAL = 20
"""Descriptions of a topic that may show more than one camera."""
_FIRST_IMAGES = 4
_SCALED_BY = 20
"""Pictures of a topic that say how many of 16 bits its colours use."""
_UNIT = "/option/Depth_Units/value"
"""Topic of a RealSense recording (SDK, not its ROS node) with the size of a step of depth, m."""

_START_OF_BAG, _START_OF_MCAP = b"#ROSBAG V2.0", b"\x89MCAP0\r\n"

_DAMAGED = (ValueError, KeyError, IndexError, AssertionError, EOFError, MemoryError, struct.error)
"""Errors of the reader where bytes are none of a recording's."""


def first_view(
    path: Path, at_s: float = 0.0, warn: Callable[[str], None] = _log.warning
) -> Frame | Cloud | Photo:
    """Return the first view of a recording at or after a time.

    Depth with colour is preferred to a cloud, a cloud to a photograph.

    Parameters
    ----------
    path
        A ``.bag``, ``.mcap`` or ``.db3`` file, or the folder of a recording of ROS 2.
    at_s
        Time since the start of the recording, s.
    warn
        Called with a sentence for each topic that is left out, and for depth in a doubtful unit.

    Raises
    ------
    CloudFormatError
        When it is no recording, or shows nothing from then on; then with why topics were left out.
    """
    colour_only: Photo | None = None
    reasons: list[str] = []
    for seen in views_of(path, at_s, reasons.append):
        if not isinstance(seen, Photo):
            break
        colour_only = colour_only or seen
    else:
        if colour_only is None:
            reason_text = "".join(f"; {reason}" for reason in reasons)
            raise CloudFormatError(f"no image and no cloud from {at_s:g} s on{reason_text}")
        seen = colour_only
    for reason in reasons:
        warn(reason)
    return seen


def views_of(
    path: Path, from_s: float = 0.0, warn: Callable[[str], None] = _log.warning
) -> Iterator[Frame | Cloud | Photo]:
    """Yield the views of a recording in the order of their times; see :func:`first_view`.

    A colour image is a view of its own only where the recording holds no depth and no cloud.
    """
    with _reading(path) as reader:
        images = [each for each in reader.connections if each.msgtype in _TYPES]
        _say_others(reader, has_views=bool(images), warn=warn)
        if not images:
            return  # none would mean all to the reader
        plan = plan_topics([_topic(reader, connection) for connection in images])
        start_s = (reader.start_time + int(from_s * 1e9)) * 1e-9
        pairing = Pairing(plan, warn, _mounting(reader), from_s=start_s)
        _read_cameras(reader, pairing)
        _read_colours(reader, pairing)
        _read_clocks(reader, images, pairing)
        for connection, time_ns, raw in reader.messages(connections=images):
            message = message_mapping(reader.deserialize(raw, connection.msgtype))
            time_s = time_ns * 1e-9
            yield from pairing.take(connection.topic, connection.msgtype, message, time_s)
        yield from pairing.finish()


def transforms_near(
    path: Path, stamp_s: float, within_s: float = 5.0
) -> Iterator[tuple[Any, bool]]:
    """Yield each tf2_msgs/TFMessage about a time, and whether it is static.

    Parameters
    ----------
    path
        See :func:`first_view`.
    stamp_s
        By the clock of the messages' headers, s; it need not be that of the recording.
    within_s
        Messages with no transform so near to the time are passed over, static ones never.

    Raises
    ------
    CloudFormatError
        When it is no recording.
    """
    with _reading(path) as reader:
        connections = [each for each in reader.connections if each.msgtype in _TF_TYPES]
        if not connections:
            return  # none would mean all to the reader
        for connection, _, raw in reader.messages(connections=connections):
            message = reader.deserialize(raw, connection.msgtype)
            is_static = connection.topic.rstrip("/").endswith("tf_static")
            if is_static or any(
                abs(_seconds(stamped.header.stamp) - stamp_s) <= within_s
                for stamped in message.transforms
            ):
                yield message, is_static


def robot_description(path: Path) -> str:
    """Return the model of the robot (URDF) in a recording; empty if it holds none.

    Of several, that of the first topic by name, which the first robot has.

    Raises
    ------
    CloudFormatError
        When it is no recording.
    """
    with _reading(path) as reader:
        models = [
            each for each in reader.connections
            if each.topic.rpartition("/")[2] == "robot_description"
            and each.msgtype == "std_msgs/msg/String"
        ]  # fmt: skip
        for connection in sorted(models, key=lambda each: str(each.topic)):
            return str(_first_message(reader, connection).get("data", ""))
    return ""


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + stamp.nanosec * 1e-9)


@contextmanager
def _reading(path: Path) -> Iterator[Any]:
    """Open a recording, and say of any error in its bytes that it is none."""
    from rosbags.highlevel import AnyReader, AnyReaderError

    try:
        with AnyReader([path]) as reader:
            yield reader
    except (AnyReaderError, OSError) as error:
        reason = str(error).rstrip(".")
        raise CloudFormatError(f"no recording of ROS: {reason}{_remedy(path)}") from error
    except CloudFormatError:
        raise
    except _DAMAGED as error:
        raise CloudFormatError(f"no recording of ROS, or a damaged one: {error}") from error


def _remedy(path: Path) -> str:
    """Return how to mend what begins like a recording, but was never finished; else nothing.

    A robot that loses power leaves the index unwritten, which stands at the end: all that was
    recorded is still there, and the tools of each format find it.
    """
    if path.is_dir():
        if (path / "metadata.yaml").is_file() or not any(path.glob("*.[dm][bc]*")):
            return ""
        return f"; `ros2 bag reindex {path}` makes its metadata.yaml anew"
    try:
        with path.open("rb") as file:
            start = file.read(len(_START_OF_BAG))
    except OSError:
        return ""
    if start.startswith(_START_OF_BAG):
        return f"; if it was cut short, `rosbag reindex {path.name}` makes its index anew"
    if start.startswith(_START_OF_MCAP):
        return f"; if it was cut short, `mcap recover {path.name} -o OUT` saves what is there"
    return ""


def _first_message(reader: Any, connection: Any) -> dict[str, Any]:
    for _, _, raw in reader.messages(connections=[connection]):
        return message_mapping(reader.deserialize(raw, connection.msgtype))
    return {}


def _topic(reader: Any, connection: Any) -> Topic:
    if not connection.msgtype.endswith("Image"):
        return Topic(connection.topic, connection.msgtype)
    first = _first_message(reader, connection)
    encoding = str(first.get("encoding", first.get("format", "")))
    frame_id = str(first.get("header", {}).get("frame_id", ""))
    return Topic(connection.topic, connection.msgtype, encoding, frame_id)


def _say_others(reader: Any, *, has_views: bool, warn: Callable[[str], None]) -> None:
    """Say which pictures and clouds are of types that are not read; where nothing is, all types."""
    types = sorted({each.msgtype for each in reader.connections})
    if not has_views and types:
        warn(f"it holds {', '.join(types[:10])}{' and others' if types[10:] else ''}")
    for connection in reader.connections:
        kind = connection.msgtype
        if kind not in _TYPES and _OTHER_PICTURES.search(kind):
            warn(f"{connection.topic}: left out: {kind} is not read")


def _mounting(reader: Any) -> Mounting:
    """Return the static transforms of a recording."""
    mounting = Mounting()
    for connection in reader.connections:
        # Streams of one device share a reference, and the frames of their images say nothing.
        if connection.msgtype == _TRANSFORM and sensor_of(connection.topic):
            stream = name_space(connection.topic)
            device = "/".join(stream.split("/")[:2])
            for _, _, raw in islice(reader.messages(connections=[connection]), 1):
                pose = reader.deserialize(raw, connection.msgtype)
                at, turn = pose.translation, pose.rotation
                mounting.add(
                    stream, f"{device}#{connection.topic.rpartition('/')[2]}",
                    (at.x, at.y, at.z), (turn.x, turn.y, turn.z, turn.w),
                )  # fmt: skip
    static = [
        each for each in reader.connections
        if each.msgtype in _TF_TYPES and each.topic.rstrip("/").endswith("tf_static")
    ]  # fmt: skip
    if static:
        for connection, _, raw in reader.messages(connections=static):
            mounting.add_message(reader.deserialize(raw, connection.msgtype))
    return mounting


def _read_cameras(reader: Any, pairing: Pairing) -> None:
    """Read each camera's first descriptions, since images may be recorded before they come."""
    for connection in reader.connections:
        if connection.topic.endswith(_UNIT):
            unit_m = float(_first_message(reader, connection).get("data", 0.0))
            if 1e-6 <= unit_m <= 1:
                pairing.units_m[sensor_of(connection.topic)] = unit_m
            else:
                pairing.warn(f"{connection.topic}: {unit_m:g} m is no step of depth: taken 1 mm")
        elif connection.msgtype.endswith("CameraInfo"):
            for _, _, raw in islice(reader.messages(connections=[connection]), _SEVERAL):
                message = message_mapping(reader.deserialize(raw, connection.msgtype))
                pairing.cameras.add(connection.topic, message)


def _read_clocks(reader: Any, images: list[Any], pairing: Pairing) -> None:
    """Read the frames of each topic, and how long after its stamps it was recorded."""
    for connection in images:
        times = []
        frames = pairing.frames.setdefault(connection.topic, set())
        for _, time_ns, raw in islice(reader.messages(connections=[connection]), _FIRST_IMAGES):
            message = message_mapping(reader.deserialize(raw, connection.msgtype))
            times.append((stamp_of(message), time_ns * 1e-9))
            frames.add(str(message["header"]["frame_id"]))
        # One stamp for all, or none, tells nothing; neither does a topic of one message.
        if len(times) > 1 and 0 < times[0][0] < times[-1][0]:
            pairing.lags_s[connection.topic] = times[0][1] - times[0][0]


def _read_colours(reader: Any, pairing: Pairing) -> None:
    """Read some pictures of each topic of deep colours, so that one scale serves all of them."""
    for connection in reader.connections:
        if not connection.msgtype.endswith("/Image"):
            continue
        for _, _, raw in islice(reader.messages(connections=[connection]), _SCALED_BY):
            message = message_mapping(reader.deserialize(raw, connection.msgtype))
            try:
                if not deep_colours(message):
                    break
                pairing.add_colours(connection.topic, message)
            except CloudFormatError:  # said when its turn comes
                break


def message_mapping(message: Any) -> dict[str, Any]:
    """Return a message of :mod:`rosbags` as nested mappings, its bytes as they are."""
    fields = dict(vars(message))
    if "header" in fields:
        fields["header"] = vars(fields["header"])
    if "fields" in fields:
        fields["fields"] = [dict(vars(field)) for field in fields["fields"]]
    return fields
