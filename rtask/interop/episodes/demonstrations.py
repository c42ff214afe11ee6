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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import DataError, UsageError
from rtask.interop.episodes.motion import MEDIA_TYPE, Motion
from rtask.interop.episodes.recording import Written
from rtask.rdf.namespaces import CORA, PROV, RDF, RDFS, RT, reason
from rtask.rdf.terms import NamedNode, iri

if TYPE_CHECKING:
    import pyarrow

    from rtask.kb.commit.access import Access
    from rtask.kb.core import GraphCore

__all__ = ["is_dataset", "read_demonstrations"]

_INFO, _TASKS = "meta/info.json", "meta/tasks.parquet"
_STATE, _ACTION, _SUCCESS = "observation.state", "action", "next.success"
_MAX_ANGLE_RAD = 4 * np.pi
"""Two turns either way: no joint of an arm goes farther, and in m none of a gripper does."""
_NEEDED = (_STATE, _ACTION, "timestamp", "episode_index", "task_index")


@dataclass(frozen=True)
class _Demonstration:
    """An episode of a set.

    Parameters
    ----------
    number
        Its index in the set.
    held
        Whether it succeeded; None where the set does not tell.
    """

    number: int
    task: str
    motion: Motion
    held: bool | None


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
        With ``meta/info.json`` of format v3, joints as ``observation.state`` and ``action``.
    access
        Rights of who imports; None = the owner.

    Raises
    ------
    DataError
        It is damaged, of an older format, or lacks joints.
    """
    info = _info(folder)
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", folder.resolve().name).strip("-.") or "lerobot"
    graph = iri(f"{kb.base}graph/import/{name}")
    robot = iri(f"{kb.base}import/{name}/robot")
    now, written = dt.datetime.now(dt.UTC), Written()
    before = kb.seq
    with kb.transaction(note=f"episodes of {name}", access=access) as tx:

        def state(subject: NamedNode, properties: Mapping[NamedNode, Any]) -> None:
            for predicate, value in properties.items():
                if value is not None:
                    tx.add(subject, predicate, value, graph)
                    written.statements += 1

        for shown in _demonstrations(folder, info):
            # No data set says the unit of its joints: LeRobot's own arms record shares of a range.
            largest = float(np.abs(shown.motion.positions).max(initial=0))
            if largest > _MAX_ANGLE_RAD and not written.doubts:
                written.doubts.append(
                    f"its joints go to {largest:.4g}, read as rad or m: are they in degrees, or "
                    "shares of their range? Only robots of the same type should repeat them"
                )
            data = shown.motion.to_bytes()
            key = hashlib.sha256(f"{name}\0{shown.number}\0{shown.task}\0".encode() + data)
            node = f"{kb.base}import/{name}/{shown.number}-{key.hexdigest()[:12]}"
            written.episodes += 1
            if kb.match(iri(node), RDF.type, RT.GraspAttempt):
                continue
            blob = kb.blobs.put(data, MEDIA_TYPE)
            written.blobs += 1
            state(robot, {RDF.type: CORA.Robot, RT.name: str(info.get("robot_type") or name)})
            # A microsecond apart, so that the attempts keep the order of the set.
            ended = now + dt.timedelta(microseconds=shown.number)
            state(
                iri(node),
                {
                    RDF.type: RT.GraspAttempt,
                    RT.performedBy: robot,
                    PROV.endedAtTime: ended,
                    RT.hasOutcome: iri(f"{node}/outcome"),
                    RDFS.comment: f"episode {shown.number} of {name}; the time is that of the "
                    "import, as the set has none",
                },
            )
            state(
                iri(f"{node}/task"),
                {RDF.type: RT.Grasp, RT.taskName: shown.task, RT.through: iri(node)},
            )
            state(
                iri(f"{node}/outcome"),
                {
                    RDF.type: RT.GraspOutcome,
                    RT.success: shown.held,
                    RT.hasReason: reason("ok" if shown.held else "not_judged"),
                },
            )
            state(
                iri(f"{node}/motion"),
                {
                    RDF.type: RT.JointTrajectory,
                    RT.hasBlob: blob.iri,
                    PROV.wasGeneratedBy: iri(node),
                },
            )
    if kb.seq == before:
        written.statements = written.blobs = 0
    return written


def _info(folder: Path) -> dict[str, Any]:
    """Return the description of a set.

    Raises
    ------
    DataError
        It cannot be read, has another format, or lacks the joints.
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
    missing = [name for name in _NEEDED if name not in features]
    if missing:
        raise DataError(f"{folder} has no feature {missing[0]}; it has {', '.join(features)}")
    return dict(info)


def _joints(feature: Mapping[str, Any]) -> list[str]:
    """Return the names of the numbers of a feature; LeRobot has them as a list or by group."""
    names = feature.get("names")
    if isinstance(names, Mapping):
        names = [part for group in names.values() for part in group]
    count = int(np.prod(feature["shape"]))
    if not names or len(names) != count or len({*map(str, names)}) < count:
        return [f"joint_{k}" for k in range(count)]
    return [str(part) for part in names]


def _demonstrations(folder: Path, info: Mapping[str, Any]) -> Iterator[_Demonstration]:
    """Yield the episodes of a set, a file of rows at a time."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    state, action = (info["features"][name] for name in (_STATE, _ACTION))
    joints = _joints(state)
    if list(state["shape"]) != list(action["shape"]):
        raise DataError(
            f"{folder}: {_STATE} has the shape {state['shape']} and {_ACTION} {action['shape']}; "
            "attempts have a command for each joint"
        )
    columns = [*_NEEDED, *([_SUCCESS] if _SUCCESS in info["features"] else [])]
    try:
        tasks = _tasks(pq.read_table(folder / _TASKS))
        for file in sorted(folder.glob("data/*/*.parquet")):
            table = pq.read_table(file, columns=columns)
            episode = np.asarray(table["episode_index"])
            for number in np.unique(episode):
                rows = np.flatnonzero(episode == number)
                values = {name: _rows(table.slice(rows[0], len(rows))[name]) for name in columns}
                yield _Demonstration(
                    int(number),
                    tasks[int(values["task_index"][0])],
                    _motion(joints, values, f"{file}: episode {number}"),
                    bool(values[_SUCCESS].any()) if _SUCCESS in values else None,
                )
    except (pa.ArrowException, OSError, KeyError, ValueError) as error:
        raise DataError(f"{folder} is damaged: {error}") from error


def _rows(column: pyarrow.ChunkedArray) -> NDArray[Any]:
    """Return a column as an array; one of lists as rows."""
    return np.array(column.to_pylist())


def _motion(joints: list[str], values: Mapping[str, NDArray[Any]], where: str) -> Motion:
    times = np.asarray(values["timestamp"], np.float64)
    try:
        return Motion.of_rows(
            joints, times - times[0], values[_STATE].ravel(), values[_ACTION].ravel(), where
        )
    except UsageError as error:
        raise DataError(str(error)) from error


def _tasks(table: pyarrow.Table) -> dict[int, str]:
    """Return the tasks in words by number; pandas stores the words as the index of the rows."""
    rows = table.to_pydict()
    words = rows.get("task") or rows["__index_level_0__"]
    return dict(zip(rows["task_index"], map(str, words), strict=True))
