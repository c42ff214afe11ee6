"""Episodes as recordings of ROS: a bag of ROS 1 or an MCAP file (extra ``recordings``).

Any viewer of such files shows what the robot saw and, as JSON, what it did and judged. Two further
topics hold the statements (N-Quads) and their binary data, so that nothing is lost on the way into
another graph. An MCAP file is compressed (zstd).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from pyoxigraph import RdfFormat, serialize

from rtask.errors import DataError, UsageError
from rtask.interop.episodes.episode import Episode, blobs_of, statements_of
from rtask.interop.episodes.motion import Motion
from rtask.interop.episodes.situation import Situation, situations_of
from rtask.rdf.namespaces import PREFIXES
from rtask.scratch import ScratchFolder

if TYPE_CHECKING:
    from features.geometry import Frame
    from rtask.kb.core import GraphCore

__all__ = ["BLOBS_TOPIC", "RECORDING", "STATEMENTS_TOPIC", "Written", "write_episodes"]

RECORDING = "rtask/episodes.mcap"
"""Where a data set of LeRobot has its episodes as a recording."""
STATEMENTS_TOPIC, BLOBS_TOPIC, _EPISODES = "/rtask/statements", "/rtask/blobs", "/rtask/episodes"
_SUFFIXES = (".mcap", ".bag")
_NS = 1_000_000_000
_MAX_S = 2**31
"""Seconds of a header are 32 bits, of which ROS 2 has one for the sign."""
_TF_KIND = "tf2_msgs/msg/TFMessage"
_TF_MESSAGE = "geometry_msgs/TransformStamped[] transforms"

Progress = Callable[[int, int], None]


@dataclass
class Written:
    """Numbers of what was written or read.

    Parameters
    ----------
    episodes, statements, blobs, pictures, views, motions
        Views are depth with colour, as the robot saw the object; motions its joints over time.
    doubts
        Of what was read, such as the unit of joints.
    left_out
        Attempts that were asked for and are not in what was written, in words: how many, and why.
    """

    episodes: int = 0
    statements: int = 0
    blobs: int = 0
    pictures: int = 0
    views: int = 0
    motions: int = 0
    doubts: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)


class _Sink(Protocol):
    """Destination of messages."""

    def write(
        self,
        topic: str,
        kind: str,
        fields: dict[str, Any],
        time_ns: int,
        *,
        is_ordered: bool = True,
    ) -> None:
        """Append a message; ``kind`` such as ``std_msgs/msg/String``.

        If it is ordered, its time is made later than that of all ordered ones before.
        """


@dataclass
class _Rosbag:
    """A bag under construction, of either version of ROS."""

    writer: Any
    store: Any
    serialise: Callable[[Any, str], Any]
    has_sequence: bool
    _last_ns: int = 0
    _connections: dict[str, Any] = field(default_factory=dict)

    def write(
        self,
        topic: str,
        kind: str,
        fields: dict[str, Any],
        time_ns: int,
        *,
        is_ordered: bool = True,
    ) -> None:
        """Append a message."""
        if topic not in self._connections:
            made = self.writer.add_connection(topic, kind, typestore=self.store)
            self._connections[topic] = made
        message = self._message(kind, fields)
        if is_ordered:
            # Readers sort by time, and would mix up what has the same.
            time_ns = self._last_ns = max(time_ns, self._last_ns + 1)
        self.writer.write(self._connections[topic], time_ns, self.serialise(message, kind))

    def _message(self, kind: str, fields: dict[str, Any]) -> Any:
        values = dict(fields)
        for key, value in fields.items():
            if isinstance(value, tuple) and value and value[0] == "header":
                values[key] = self._header(*value[1:])
            elif isinstance(value, tuple):
                values[key] = self._message(value[0], value[1])
            elif isinstance(value, list):
                values[key] = [
                    self._message(*part) if isinstance(part, tuple) else part for part in value
                ]
        return self.store.types[kind](**values)

    def _header(self, time_ns: int, frame_id: str) -> Any:
        types = self.store.types
        stamp = types["builtin_interfaces/msg/Time"](time_ns // _NS, time_ns % _NS)
        sequence = (0,) if self.has_sequence else ()
        return types["std_msgs/msg/Header"](*sequence, stamp, frame_id)


def write_episodes(
    kb: GraphCore,
    episodes: Iterable[Episode],
    path: Path,
    progress: Progress | None = None,
    urdf: str = "",
) -> Written:
    """Write episodes to a file, wholly or not at all.

    Parameters
    ----------
    kb
        The graph that has them.
    episodes
        From :func:`~rtask.interop.episodes.episode.episodes_of`.
    path
        ``.mcap`` or ``.bag``; it must not exist.
    progress
        Called with how many episodes are written and how many there are.
    urdf
        Description of the robot, whose episodes alone are in the file; empty = not known. With it,
        a viewer shows the robot as its joints move.

    Raises
    ------
    UsageError
        A description is given for several robots, the file exists, or its extension is another.
    DataError
        An attempt ended before 1970 or after 2038.
    MissingBlobError
        Binary data that a statement names is not in the graph's store.
    """
    if path.suffix not in _SUFFIXES:
        raise UsageError(f"{path}: expected a file {' or '.join(_SUFFIXES)}, or --format lerobot")
    if path.exists():
        raise UsageError(f"{path} exists; give another name or remove it")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}")
    episodes = sorted(episodes, key=lambda episode_: (episode_.ended, episode_.attempt))
    robots = sorted({episode.robot_name for episode in episodes})
    if urdf and len(robots) > 1:
        raise UsageError(f"a description is that of one robot, and there are {', '.join(robots)}")
    _require_statable(episodes)
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    # Beside the file, so that moving it there at the end is one step.
    with ScratchFolder("recording", path.parent) as folder:
        if path.suffix == ".bag":
            store = get_typestore(Stores.ROS1_NOETIC)
            store.register(get_types_from_msg(_TF_MESSAGE, _TF_KIND))
            with rosbag1.Writer(folder / "made.bag") as writer:
                bag = _Rosbag(writer, store, store.serialize_ros1, has_sequence=True)
                written = _write(kb, episodes, bag, progress, urdf)
        else:
            store = get_typestore(Stores.ROS2_HUMBLE)
            plugin = rosbag2.StoragePlugin.MCAP
            recording = rosbag2.Writer(folder / "made", version=9, storage_plugin=plugin)
            recording.set_compression(
                rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD
            )
            with recording:
                bag = _Rosbag(recording, store, store.serialize_cdr, has_sequence=False)
                written = _write(kb, episodes, bag, progress, urdf)
        (made,) = folder.rglob(f"*{path.suffix}")
        made.replace(path)
    return written


def _require_statable(episodes: Iterable[Episode]) -> None:
    """Refuse attempts at times that no header of ROS can state."""
    for episode in episodes:
        if not 0 <= episode.ended.timestamp() < _MAX_S:
            raise DataError(
                f"{episode.attempt} ended at {episode.ended.isoformat()}, and the times of a "
                "recording are from 1970 to 2038: leave it out with --select"
            )


def _write(
    kb: GraphCore,
    in_order: Sequence[Episode],
    sink: _Sink,
    progress: Progress | None,
    urdf: str,
) -> Written:
    written, blobs_done = Written(), set[str]()
    busy: dict[tuple[str, tuple[str, ...]], int] = {}
    situations, cameras = situations_of(kb, in_order), _cameras(kb)
    for episode in in_order:
        ended = int(episode.ended.timestamp() * _NS)
        motion = Motion.from_bytes(kb.blobs.read(episode.motion)) if episode.motion else None
        started = _start(episode, motion, ended, busy)
        if urdf and not written.episodes:
            topic = f"/{_topic(episode)}/robot_description"
            sink.write(topic, "std_msgs/msg/String", {"data": urdf}, started)
        _write_pose(sink, situations[episode.attempt], episode, started)
        quads = statements_of(kb, episode)
        facts = {**episode.to_json(), "statements": len(quads)}
        for name in blobs_of(quads):
            if name in blobs_done:
                continue
            blobs_done.add(name)
            data = kb.blobs.read(name)
            _write_bytes(sink, name, data, started)
            written.views += _write_view(sink, f"/{_topic(episode)}/camera", data, started)
            written.blobs += 1
        for picture in episode.pictures:
            phase = _fit(picture.phase) or "image"
            topic = f"/{_topic(episode)}/attempt/{phase}/compressed"
            data = kb.blobs.read(picture.blob)
            kind = "png" if data.startswith(b"\x89PNG") else "jpeg"
            fields = {
                "header": ("header", ended, cameras.get(episode.robot, "")),
                "format": kind,
                "data": np.frombuffer(data, np.uint8),
            }
            sink.write(topic, "sensor_msgs/msg/CompressedImage", fields, ended)
            written.pictures += 1
        if motion is not None:
            _write_motion(sink, _topic(episode), motion, (started, ended))
            written.motions += 1
        text = serialize(quads, format=RdfFormat.N_QUADS)
        assert text is not None
        sink.write(STATEMENTS_TOPIC, "std_msgs/msg/String", {"data": text.decode()}, ended)
        shown = json.dumps(facts, ensure_ascii=False)
        sink.write(_EPISODES, "std_msgs/msg/String", {"data": shown}, ended)
        written.episodes += 1
        written.statements += len(quads)
        if progress is not None:
            progress(written.episodes, len(in_order))
    return written


def _start(
    episode: Episode,
    motion: Motion | None,
    ended_ns: int,
    busy: dict[tuple[str, tuple[str, ...]], int],
) -> int:
    """Return when an episode started, ns, but not before the last one of the same joints ended.

    Parameters
    ----------
    busy
        Ends of the last episodes by robot and joints, ns; that of this one is added.
    """
    if motion is None:
        return int(episode.started.timestamp() * _NS) if episode.started else ended_ns
    if episode.started is None:
        started = ended_ns - round(float(motion.times[-1]) * _NS)
    else:
        started = int(episode.started.timestamp() * _NS)
    joints = (episode.robot, motion.joints)
    started = min(max(started, busy.get(joints, 0)), ended_ns)
    busy[joints] = ended_ns
    return started


def _topic(episode: Episode) -> str:
    """Return a robot's name as a name of ROS: letters, digits and underscores."""
    return _fit(episode.robot_name or episode.robot.rpartition("/")[2]) or "robot"


def _fit(name: str) -> str:
    return "".join(c if c.isascii() and c.isalnum() else "_" for c in name)


def _cameras(kb: GraphCore) -> dict[str, str]:
    """Return the frame of the camera of each robot that has a single one."""
    frames: dict[str, set[str]] = {}
    for row in kb.select(f"""{PREFIXES}
SELECT ?robot ?frame {{ ?robot rt:hasSensor/rt:bodyFrame/rt:frameId ?frame }}"""):
        frames.setdefault(str(row.value("robot")), set()).add(str(row.value("frame")))
    return {robot: next(iter(named)) for robot, named in frames.items() if len(named) == 1}


def _write_pose(sink: _Sink, situation: Situation, episode: Episode, time_ns: int) -> None:
    """Write where the object was when an attempt began, as a frame in the robot's own."""
    if situation.pose is None:
        return
    x, y, z, qx, qy, qz, qw = map(float, situation.pose)
    place = ("geometry_msgs/msg/Vector3", {"x": x, "y": y, "z": z})
    turn = ("geometry_msgs/msg/Quaternion", {"x": qx, "y": qy, "z": qz, "w": qw})
    stamped = {
        "header": ("header", time_ns, situation.frame_id),
        "child_frame_id": episode.thing_name or str(episode.thing),
        "transform": ("geometry_msgs/msg/Transform", {"translation": place, "rotation": turn}),
    }
    transforms = {"transforms": [("geometry_msgs/msg/TransformStamped", stamped)]}
    sink.write("/tf", _TF_KIND, transforms, time_ns)


def _write_motion(sink: _Sink, space: str, motion: Motion, span_ns: tuple[int, int]) -> None:
    """Write the joints between start and end of their attempt.

    Simulated seconds that do not fit, because the simulation ran faster than the clock, are
    shortened alike, so that the motions of two attempts never mix.
    """
    length_s, (started_ns, ended_ns) = float(motion.times[-1]), span_ns
    rate = min(1.0, (ended_ns - started_ns) / _NS / length_s) if length_s else 1.0
    for name, rows in (("joint_states", motion.positions), ("joint_commands", motion.commands)):
        for time, row in zip(motion.times, rows, strict=True):
            moment = started_ns + round(rate * float(time) * _NS)
            none = np.zeros(0)
            fields = {"header": ("header", moment, ""), "name": list(motion.joints),
                      "position": row, "velocity": none, "effort": none}  # fmt: skip
            topic = f"/{space}/{name}"
            sink.write(topic, "sensor_msgs/msg/JointState", fields, moment, is_ordered=False)


def _write_bytes(sink: _Sink, name: str, data: bytes, time_ns: int) -> None:
    dimension = {"label": name, "size": len(data), "stride": len(data)}
    layout = {"dim": [("std_msgs/msg/MultiArrayDimension", dimension)], "data_offset": 0}
    fields = {
        "layout": ("std_msgs/msg/MultiArrayLayout", layout),
        "data": np.frombuffer(data, np.uint8),
    }
    sink.write(BLOBS_TOPIC, "std_msgs/msg/UInt8MultiArray", fields, time_ns)


def _write_view(sink: _Sink, space: str, data: bytes, time_ns: int) -> int:
    """Write binary data that is a view with depth as images; return how many views they are."""
    from features.codec import CloudFormatError, decode
    from features.geometry import Frame

    try:
        seen = decode(data)
    except CloudFormatError:
        return 0
    if not isinstance(seen, Frame) or seen.rgb is None:
        return 0
    # Colour first: a reader that pairs by time then has it when depth comes.
    _write_camera(sink, f"{space}/color", seen, time_ns, "rgb8", seen.rgb)
    _write_camera(sink, f"{space}/depth", seen, time_ns, "32FC1", seen.depth_m.astype("<f4"))
    return 1


def _write_camera(
    sink: _Sink, space: str, frame: Frame, time_ns: int, encoding: str, image: Any
) -> None:
    header = ("header", time_ns, frame.frame_id or "camera")
    camera = frame.intrinsics
    cx, cy = camera.cx - frame.x0, camera.cy - frame.y0  # of the crop
    matrix = np.array([camera.fx, 0, cx, 0, camera.fy, cy, 0, 0, 1], np.float64)
    height, width = frame.depth_m.shape
    size = {"height": height, "width": width}
    region = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    names = ("D", "K", "R", "P") if getattr(sink, "has_sequence", False) else ("d", "k", "r", "p")
    projection = np.insert(matrix.reshape(3, 3), 3, 0.0, axis=1).ravel()
    values = (np.zeros(5), matrix, np.eye(3).ravel(), projection)
    info = {
        "header": header,
        **size,
        "distortion_model": "plumb_bob",
        **dict(zip(names, values, strict=True)),
        "binning_x": 0,
        "binning_y": 0,
        "roi": ("sensor_msgs/msg/RegionOfInterest", region),
    }
    sink.write(f"{space}/camera_info", "sensor_msgs/msg/CameraInfo", info, time_ns)
    rows = np.ascontiguousarray(image)
    fields = {
        "header": header,
        **size,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": rows.strides[0],
        "data": rows.view(np.uint8).ravel(),
    }
    sink.write(f"{space}/image_raw", "sensor_msgs/msg/Image", fields, time_ns)
