"""Data sets of LeRobot that others recorded, read as attempts (format v3.0, extra ``lerobot``).

Such a set has no times of day, no objects and no grasps: an attempt of it states its robot, its
task in words, its joints and whether it succeeded, where the set tells. A query over the graph can
then choose episodes, of several sets at once, and write a set of just these. Pictures, films and
other features stay in the set.
"""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rtask.errors import DataError, UsageError
from rtask.interop.episodes.motion import MAX_JOINTS, MAX_SAMPLES, MEDIA_TYPE, Motion
from rtask.interop.episodes.recording import Written
from rtask.rdf.namespaces import CORA, PROV, RDF, RDFS, RT, reason
from rtask.rdf.terms import NamedNode, iri

if TYPE_CHECKING:
    import pyarrow

    from rtask.kb.commit.access import Access
    from rtask.kb.core import GraphCore

__all__ = ["is_dataset", "read_demonstrations"]

_INFO, _TASKS = "meta/info.json", "meta/tasks.parquet"
_STATE, _ACTION = "observation.state", "action"
_SUCCESS = ("next.success", "is_episode_successful")
"""Features that tell whether an episode succeeded: LeRobot's own, and that of DROID."""
_MAX_ANGLE_RAD = 4 * np.pi
"""Two turns either way: no joint of an arm goes farther, and in m none of a gripper does."""
_COUNTED = ("timestamp", "frame_index", "episode_index", "index", "task_index")
_SHORT, _MANY = 3, 5


@dataclass(frozen=True)
class _Demonstration:
    """An episode of a set.

    Parameters
    ----------
    number
        Its index in the set.
    tasks
        In words, in the order of its rows; none where the set does not tell.
    motion
        None where the set has no joints that were commanded.
    held
        Whether it succeeded; None where the set does not tell.
    key
        By which it is known again: of the set's name, its number, task and rows.
    """

    number: int
    tasks: tuple[str, ...]
    motion: Motion | None
    held: bool | None
    key: str


@dataclass
class _Summary:
    """Counts of the episodes of a set, which may be too many to keep.

    Parameters
    ----------
    largest
        Of the joints, rad or m as far as the set tells.
    """

    episodes: int = 0
    with_motion: int = 0
    with_task: int = 0
    with_several_tasks: int = 0
    judged: int = 0
    held: int = 0
    largest: float = 0.0

    def add(self, episode: _Demonstration) -> None:
        """Count an episode."""
        self.episodes += 1
        self.with_task += bool(episode.tasks)
        self.with_several_tasks += len(episode.tasks) > 1
        self.judged += episode.held is not None
        self.held += episode.held is True
        if episode.motion is not None:
            self.with_motion += 1
            self.largest = max(self.largest, float(np.abs(episode.motion.positions).max()))


def is_dataset(folder: Path) -> bool:
    """Whether a folder looks like a data set of LeRobot, of whatever version."""
    return (folder / _INFO).is_file()


def read_demonstrations(kb: GraphCore, folder: Path, access: Access | None = None) -> Written:
    """Add the episodes of a data set as attempts, in one commit; known ones change nothing.

    They go to the graph ``{base}graph/import/<name of the folder>``, with the time of the import,
    as their ``rdfs:comment`` says.

    Parameters
    ----------
    kb
        The graph.
    folder
        With ``meta/info.json`` of format v3. Its joints are read if ``action`` commands those of
        ``observation.state``; ``doubts`` of the answer say what the set leaves open.
    access
        Rights of who imports; None = the owner.

    Raises
    ------
    DataError
        It is damaged, or of an older format.
    """
    info = _info(folder)
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", folder.resolve().name).strip("-.") or "lerobot"
    graph = iri(f"{kb.base}graph/import/{name}")
    robot = iri(f"{kb.base}import/{name}/robot")
    now, written = dt.datetime.now(dt.UTC), Written()
    before, summary = kb.seq, _Summary()
    with kb.transaction(note=f"episodes of {name}", access=access) as tx:

        def state(subject: NamedNode, properties: Mapping[NamedNode, Any]) -> None:
            for predicate, value in properties.items():
                if value is not None:
                    tx.add(subject, predicate, value, graph)
                    written.statements += 1

        for episode in _demonstrations(folder, info, name):
            summary.add(episode)
            node = iri(f"{kb.base}import/{name}/{episode.number}-{episode.key}")
            if kb.match(node, RDF.type, RT.GraspAttempt):
                continue
            state(robot, {RDF.type: CORA.Robot, RT.name: str(info.get("robot_type") or name)})
            _state_attempt(state, node, robot, episode, now, name)
            if episode.motion is not None:
                blob = kb.blobs.put(episode.motion.to_bytes(), MEDIA_TYPE)
                written.blobs += 1
                state(
                    iri(f"{node.value}/motion"),
                    {
                        RDF.type: RT.JointTrajectory,
                        RT.hasBlob: blob.iri,
                        PROV.wasGeneratedBy: node,
                    },
                )
    written.episodes = summary.episodes
    written.doubts += _doubts(info, summary)
    if kb.seq == before:
        written.statements = written.blobs = 0
    return written


def _state_attempt(
    state: Callable[[NamedNode, Mapping[NamedNode, Any]], None],
    node: NamedNode,
    robot: NamedNode,
    episode: _Demonstration,
    now: dt.datetime,
    name: str,
) -> None:
    """State an episode as an attempt with its task and outcome, as far as the set tells them."""
    outcome = iri(f"{node.value}/outcome")
    state(
        node,
        {
            RDF.type: RT.GraspAttempt,
            RT.performedBy: robot,
            # A microsecond apart, so that the attempts keep the order of the set.
            PROV.endedAtTime: now + dt.timedelta(microseconds=episode.number),
            RT.hasOutcome: outcome,
            RDFS.comment: f"episode {episode.number} of {name}; the time is that of the import, "
            "as the set has none",
        },
    )
    words = "; then ".join(episode.tasks) or None
    state(iri(f"{node.value}/task"), {RDF.type: RT.Grasp, RT.taskName: words, RT.through: node})
    state(
        outcome,
        {
            RDF.type: RT.GraspOutcome,
            RT.success: episode.held,
            RT.hasReason: reason("ok" if episode.held else "not_judged"),
        },
    )


def _doubts(info: Mapping[str, Any], summary: _Summary) -> list[str]:
    """Return what a set leaves open, and what of it was not read, a sentence each."""
    doubts = []
    # No data set says the unit of its joints: LeRobot's own arms record shares of a range.
    if summary.largest > _MAX_ANGLE_RAD:
        doubts.append(
            f"its joints go to {summary.largest:.4g}, read as rad or m: are they in degrees, or "
            "shares of their range? Only robots of the same type should repeat them"
        )
    why_not = _uncommanded(info)
    too_long = summary.episodes - summary.with_motion
    if why_not:
        doubts.append(
            f"{why_not}: its attempts have no joints, and no data set can be made of them"
        )
    elif too_long:
        doubts.append(
            f"{too_long} episodes have more than {MAX_SAMPLES} rows: these have no joints"
        )
    if summary.episodes and not summary.with_task:
        doubts.append(f"no task is in words: {_TASKS} is missing, or its rows name none")
    if summary.with_several_tasks:
        doubts.append(
            f"{summary.with_several_tasks} episodes have several tasks; each is stored as one, in "
            "their order"
        )
    if summary.episodes and not summary.judged:
        doubts.append("nothing says which episodes succeeded: they are not judged")
    elif summary.judged and not summary.held:
        doubts.append("no episode is marked as a success: did all fail, or was it never filled in?")
    read = {_STATE, _ACTION, *_COUNTED, *_SUCCESS}
    left = [str(feature) for feature in info["features"] if feature not in read]
    if left:
        more = f" and {len(left) - _MANY} more" if len(left) > _MANY else ""
        doubts.append(f"not read: {', '.join(left[:_MANY])}{more}")
    return doubts


def _info(folder: Path) -> dict[str, Any]:
    """Return the description of a set.

    Raises
    ------
    DataError
        It cannot be read, or has another format.
    """
    try:
        info = json.loads((folder / _INFO).read_text("utf-8"))
        version, features = str(info["codebase_version"]), dict(info["features"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{folder} is no data set of LeRobot, or it is damaged: {error}") from error
    if not version.startswith("v3"):
        raise DataError(
            f"{folder} has format {version}, expected v3; convert it with LeRobot's own "
            "lerobot.datasets.v30.convert_dataset_v21_to_v30"
        )
    if "episode_index" not in features:
        raise DataError(f"{folder} has no feature episode_index; it has {', '.join(features)}")
    return dict(info)


def _names(feature: Mapping[str, Any]) -> list[str]:
    """Return the names of the numbers of a feature; empty where the set has none that fit.

    They come as a list, in groups (``{"motors": [...]}``, ``[[...]]``), or with their places
    (``{"x": 0}``).
    """
    names = feature.get("names")
    if isinstance(names, Mapping):
        places = list(names.values())
        if all(isinstance(place, int) for place in places):
            places = sorted(names, key=dict(names).__getitem__)
        names = places
    flat = [str(n) for part in names or () for n in (part if isinstance(part, list) else [part])]
    return flat if len(set(flat)) == int(np.prod(feature["shape"])) == len(flat) else []


def _uncommanded(info: Mapping[str, Any]) -> str:
    """Say why the actions of a set are no commands of its joints; empty if they may be."""
    features = info["features"]
    missing = [name for name in (_STATE, _ACTION) if name not in features]
    if missing:
        return f"it has no feature {missing[0]}"
    state, action = (features[name] for name in (_STATE, _ACTION))
    if list(state["shape"]) != list(action["shape"]):
        return (
            f"{_STATE} has the shape {state['shape']} and {_ACTION} {action['shape']}, not a "
            "command for each joint"
        )
    if int(np.prod(state["shape"])) > MAX_JOINTS:
        return f"{_STATE} has the shape {state['shape']}, more than {MAX_JOINTS} joints"
    names, commanded = _names(state), _names(action)
    if names and commanded and names != commanded:
        return (
            f"{_ACTION} ({', '.join(commanded[:_SHORT])} ...) is about other things than {_STATE} "
            f"({', '.join(names[:_SHORT])} ...)"
        )
    return ""


def _demonstrations(folder: Path, info: Mapping[str, Any], name: str) -> Iterator[_Demonstration]:
    """Yield the episodes of a set, a file of rows at a time."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    features = info["features"]
    success = next((feature for feature in _SUCCESS if feature in features), None)
    joints = () if _uncommanded(info) else (_STATE, _ACTION)
    optional = [f for f in ("timestamp", "task_index") if f in features]
    columns = ["episode_index", *optional, *joints, *([success] if success else [])]
    seen: set[int] = set()
    try:
        tasks = _tasks(pq.read_table(folder / _TASKS)) if (folder / _TASKS).is_file() else {}
        for file in sorted(folder.glob("data/**/*.parquet")):
            table = pq.read_table(file, columns=columns)
            episode = np.asarray(table["episode_index"])
            for number in map(int, np.unique(episode)):
                if number in seen:
                    raise DataError(f"{file}: episode {number} is in another file as well")
                seen.add(number)
                part = table.take(pa.array(np.flatnonzero(episode == number)))
                rows = {column: part[column].to_pylist() for column in columns}
                motion = _motion(info, rows, f"{file}: episode {number}") if joints else None
                words = tuple(
                    tasks[k] for k in dict.fromkeys(rows.get("task_index", ())) if tasks.get(k)
                )
                key = hashlib.sha256(f"{name}\0{number}\0{'; '.join(words)}\0".encode())
                # As before commands told when they were given, so that sets are known again.
                bare = b"" if motion is None else replace(motion, leads=False).to_bytes()
                key.update(bare or str(rows.get("timestamp")).encode())
                held = _held(rows[success]) if success else None
                yield _Demonstration(number, words, motion, held, key.hexdigest()[:12])
    except (pa.ArrowException, OSError, KeyError, ValueError) as error:
        raise DataError(f"{folder} is damaged: {error}") from error


def _held(rows: Sequence[Any]) -> bool | None:
    """Return whether any row says that the episode succeeded; None if no row says anything."""
    marks = [bool(np.any(row)) for row in rows if row is not None]
    return any(marks) if marks else None


def _motion(info: Mapping[str, Any], rows: Mapping[str, list[Any]], where: str) -> Motion | None:
    """Return the joints of an episode; None if it has more rows than a motion may."""
    count = len(rows[_STATE])
    if count > MAX_SAMPLES:
        return None
    if "timestamp" in rows:
        times = np.array(rows["timestamp"], np.float64).ravel()
    else:
        times = np.arange(count) / float(info["fps"])
    feature = info["features"][_STATE]
    joints = _names(feature) or [f"joint_{k}" for k in range(int(np.prod(feature["shape"])))]
    try:
        state, action = (np.array(rows[name], np.float64).ravel() for name in (_STATE, _ACTION))
        # An action of LeRobot is what was sent after its row was seen.
        return Motion.of_rows(joints, times - times[0], state, action, where, leads=True)
    except (UsageError, TypeError) as error:
        raise DataError(f"{where}: {error}") from error


def _tasks(table: pyarrow.Table) -> dict[int, str]:
    """Return the tasks in words by number; pandas stores the words as the index of the rows."""
    rows = table.to_pydict()
    words = rows.get("task") or rows["__index_level_0__"]
    return dict(zip(rows["task_index"], map(str, words), strict=True))
