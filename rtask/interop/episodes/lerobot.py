"""Episodes as a data set of LeRobot, format v3.0, for programs that learn from demonstrations.

Written without LeRobot's own package, which brings torch (extra ``lerobot``: pyarrow). A copy of
the episodes as MCAP lies beside, so that importing the data set into a graph loses nothing.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.interop.episodes.episode import Episode
from rtask.interop.episodes.films import Shots, films_of, pooled, shots_of
from rtask.interop.episodes.motion import Motion
from rtask.interop.episodes.recording import RECORDING, Written, write_episodes
from rtask.interop.episodes.situation import POSE, Situation, situations_of
from rtask.scratch import ScratchFolder

if TYPE_CHECKING:
    import pyarrow

    from rtask.interop.episodes.recording import Progress
    from rtask.kb.core import GraphCore

__all__ = ["write_lerobot"]

_VERSION = "v3.0"
_CHUNK = "chunk-000/file-000.parquet"
_PATTERN = "chunk-{chunk_index:03d}/file-{file_index:03d}"


@dataclass(frozen=True)
class _Part:
    """Rows of one episode.

    Parameters
    ----------
    columns
        (n, ...) arrays by the names of the features.
    shots
        What cameras saw, by the names of the features.
    """

    episode: Episode
    task: str
    columns: dict[str, NDArray[Any]]
    shots: dict[str, Shots]

    @property
    def frames(self) -> int:
        return len(self.columns["index"])


def write_lerobot(
    kb: GraphCore,
    episodes: Iterable[Episode],
    folder: Path,
    rate_hz: int = 20,
    hand: str | None = None,
    progress: Progress | None = None,
) -> Written:
    """Write the episodes whose joints were recorded as a data set, wholly or not at all.

    ``observation.state`` has the measured joints and ``action`` what was commanded from there to
    the next row, the last of which is the opening of the hand; ``next.success`` is what was judged,
    where every episode was. Where the robot
    estimated the object's pose before each attempt, ``observation.environment_state`` has it, as it
    was before the attempt. Where a camera filmed each attempt, ``observation.images.CAMERA`` has
    its pictures. Judgements with their evidence are columns ``rtask/...`` of ``meta/episodes``.

    Parameters
    ----------
    kb
        The graph that has them.
    episodes
        From :func:`~rtask.interop.episodes.episode.episodes_of`.
    folder
        It must not exist.
    rate_hz
        Rows per second; joints are interpolated.
    hand
        Only attempts with this hand, the last of the joints; None = all are of one hand.
    progress
        Called with how many episodes are written and how many there are.

    Returns
    -------
    Written
        With the attempts that are left out, by reason: a caller that chose them is to be told.

    Raises
    ------
    UsageError
        The folder exists, no episode has a motion, or hands or types of robots differ.
    """
    if folder.exists():
        raise UsageError(f"{folder} exists; give another name or remove it")
    if not folder.parent.is_dir():
        raise UsageError(f"{folder}: there is no folder {folder.parent}")
    episodes = sorted(episodes, key=lambda e: (e.ended, e.attempt))
    recorded = [
        (episode, Motion.from_bytes(kb.blobs.read(episode.motion)).at_rate(rate_hz))
        for episode in episodes
        if episode.motion
    ]
    if not recorded:
        raise UsageError("no attempt has its joints recorded (`motion` of an outcome)")
    selected, motions = _of_single_hand(recorded, hand)
    situations = situations_of(kb, selected)
    _require_single_type(situations.values())
    shots = shots_of(
        [films_of(kb, episode) for episode in selected], [motion.times for motion in motions]
    )
    # Beside it, so that moving it there at the end is one step.
    with ScratchFolder("lerobot", folder.parent) as scratch:
        made = scratch / folder.name
        made.mkdir()
        _write(selected, motions, situations, shots, made, rate_hz)
        (made / RECORDING).parent.mkdir()
        written = write_episodes(kb, selected, made / RECORDING, progress)
        made.replace(folder)
    written.left_out = _left_out(len(episodes), len(recorded), len(selected), hand)
    return written


def _left_out(asked: int, recorded: int, selected: int, hand: str | None) -> list[str]:
    """Return in words how many attempts are not in the data set, and why."""
    reasons = {
        "without recorded joints (`motion` of an outcome)": asked - recorded,
        f"with another hand than {hand}": recorded - selected,
    }
    return [f"{count} of {asked} left out: {why}" for why, count in reasons.items() if count]


def _of_single_hand(
    recorded: Sequence[tuple[Episode, Motion]], hand: str | None
) -> tuple[list[Episode], list[Motion]]:
    """Return what was recorded with a hand, as a data set has but one kind of row."""
    hands = sorted({motion.joints[-1] for _, motion in recorded})
    selected = [
        (episode, motion) for episode, motion in recorded if hand in (None, motion.joints[-1])
    ]
    if not selected:
        raise UsageError(f"no attempt with the hand {hand!r}; there are: {', '.join(hands)}")
    if len({motion.joints for _, motion in selected}) > 1:
        raise UsageError(
            f"a data set has the joints of one hand, and there are {', '.join(hands)}: choose one, "
            "or one robot"
        )
    return [episode for episode, _ in selected], [motion for _, motion in selected]


def _require_single_type(situations: Iterable[Situation]) -> None:
    """Refuse robots of several types, whose states and actions mean different things."""
    types = sorted({situation.robot_type for situation in situations})
    if len(types) > 1:
        raise UsageError(
            f"a data set has robots of one type, and there are {', '.join(types)}: choose one "
            "robot, or a hand"
        )


def _write(
    episodes: Sequence[Episode],
    motions: Sequence[Motion],
    situations: Mapping[str, Situation],
    shots: Sequence[Mapping[str, Shots]],
    folder: Path,
    rate_hz: int,
) -> None:
    ordered = [situations[recorded.attempt] for recorded in episodes]
    tasks = list(dict.fromkeys(situation.task for situation in ordered))
    # A column has a value in every row: without one of some episode there is none.
    frames = {situation.frame_id for situation in ordered}
    has_pose = all(situation.pose is not None for situation in ordered) and len(frames) == 1
    parts, start = list[_Part](), 0
    is_judged = all(episode.held is not None for episode in episodes)
    for number, (episode, motion, situation, seen) in enumerate(
        zip(episodes, motions, ordered, shots, strict=True)
    ):
        task = situation.task
        columns = _columns(motion, number, tasks.index(task), start, episode.held is True)
        if not is_judged:  # a row can say yes or no; one that nobody judged is neither
            del columns["next.success"]
        if has_pose:
            assert situation.pose is not None
            rows = np.tile(situation.pose.astype(np.float32), (len(motion.times), 1))
            columns = {"observation.environment_state": rows, **columns}
        images = {f"observation.images.{camera}": shot for camera, shot in seen.items()}
        parts.append(_Part(episode, task, columns, images))
        start += len(motion.times)
    joints = list(motions[0].joints)
    _write_parquet(_frames(parts), folder / "data" / _CHUNK)
    _write_parquet(_episodes(parts), folder / "meta/episodes" / _CHUNK)
    _write_parquet(_tasks(tasks), folder / "meta/tasks.parquet")
    whole = {name: np.concatenate([p.columns[name] for p in parts]) for name in parts[0].columns}
    stats = {name: _stats(values) for name, values in whole.items()}
    stats |= {name: pooled([part.shots[name] for part in parts]) for name in parts[0].shots}
    (folder / "meta/stats.json").write_text(json.dumps(stats, indent=4), "utf-8")
    names = {"observation.environment_state": [f"{min(frames)}/{part}" for part in POSE]}
    info = {
        "codebase_version": _VERSION,
        "robot_type": ordered[0].robot_type,
        "total_episodes": len(parts),
        "total_frames": start,
        "total_tasks": len(tasks),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        "fps": rate_hz,
        "splits": {"train": f"0:{len(parts)}"},
        "data_path": f"data/{_PATTERN}.parquet",
        "video_path": None,
        "features": {
            **{name: shot.feature for name, shot in parts[0].shots.items()},
            **{name: _feature(values, names.get(name, joints)) for name, values in whole.items()},
        },
    }
    (folder / "meta/info.json").write_text(json.dumps(info, indent=4), "utf-8")


def _columns(
    motion: Motion, episode: int, task: int, start: int, held: bool
) -> dict[str, NDArray[Any]]:
    count = len(motion.times)
    last = np.arange(count) == count - 1
    return {
        "observation.state": motion.positions.astype(np.float32),
        "action": motion.actions.astype(np.float32),
        "next.done": last,
        "next.success": last & held,
        "timestamp": (motion.times - motion.times[0]).astype(np.float32),
        "frame_index": np.arange(count),
        "episode_index": np.full(count, episode),
        "index": start + np.arange(count),
        "task_index": np.full(count, task),
    }


def _feature(values: NDArray[Any], names: list[str]) -> dict[str, Any]:
    shape = list(values.shape[1:]) or [1]
    return {
        "dtype": values.dtype.name,
        "shape": shape,
        "names": names if values.ndim > 1 else None,
    }


def _stats(values: NDArray[Any]) -> dict[str, list[float]]:
    """Return the statistics of a feature, by which programs scale it."""
    rows = values.reshape(len(values), -1).astype(np.float64)
    statistics = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    return {**{name: column.tolist() for name, column in statistics.items()}, "count": [len(rows)]}


def _frames(parts: Sequence[_Part]) -> pyarrow.Table:
    import pyarrow as pa

    arrays = {
        name: pa.concat_arrays([part.shots[name].column() for part in parts])
        for name in parts[0].shots
    }
    for name in parts[0].columns:
        values = np.concatenate([part.columns[name] for part in parts])
        if values.ndim == 1:
            arrays[name] = pa.array(values)
        else:
            flat = pa.array(values.ravel())
            arrays[name] = pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
    return pa.table(arrays)


def _episodes(parts: Sequence[_Part]) -> pyarrow.Table:
    import pyarrow as pa

    ends = np.cumsum([part.frames for part in parts])
    zeros = pa.array(np.zeros(len(parts), np.int64))
    columns: dict[str, Any] = {
        "episode_index": pa.array(np.arange(len(parts))),
        "tasks": pa.array([[part.task] for part in parts], pa.list_(pa.string())),
        "length": pa.array([part.frames for part in parts], pa.int64()),
        "data/chunk_index": zeros,
        "data/file_index": zeros,
        "dataset_from_index": pa.array(ends - [part.frames for part in parts]),
        "dataset_to_index": pa.array(ends),
        "meta/episodes/chunk_index": zeros,
        "meta/episodes/file_index": zeros,
    }
    judged: dict[str, tuple[pa.DataType, list[Any]]] = {
        "rtask/attempt": (pa.string(), [part.episode.attempt for part in parts]),
        "rtask/robot": (pa.string(), [part.episode.robot_name for part in parts]),
        "rtask/held": (pa.bool_(), [part.episode.held for part in parts]),
        "rtask/placed": (pa.bool_(), [part.episode.placed for part in parts]),
        "rtask/reason": (pa.string(), [part.episode.reason for part in parts]),
        "rtask/evidence": (pa.string(), ["; ".join(part.episode.evidence) for part in parts]),
    }
    columns |= {name: pa.array(values, kind) for name, (kind, values) in judged.items()}
    of_parts = [
        {name: _stats(v) for name, v in part.columns.items()}
        | {name: shot.stats() for name, shot in part.shots.items()}
        for part in parts
    ]
    for name, stats in of_parts[0].items():
        for key in stats:
            number = pa.int64() if key == "count" else pa.float64()
            is_nested = name in parts[0].shots and key != "count"
            kind = pa.list_(pa.list_(pa.list_(number))) if is_nested else pa.list_(number)
            columns[f"stats/{name}/{key}"] = pa.array(
                [part_stats[name][key] for part_stats in of_parts], kind
            )
    return pa.table(columns)


def _tasks(tasks: Sequence[str]) -> pyarrow.Table:
    """Return the tasks as pandas would write them, with the words as the index of the rows."""
    import pyarrow as pa

    table = pa.table(
        {"task_index": pa.array(np.arange(len(tasks))), "task": pa.array(tasks, pa.string())}
    )
    column = {"field_name": "task_index", "name": "task_index", "pandas_type": "int64",
              "numpy_type": "int64", "metadata": None}  # fmt: skip
    index = {**column, "field_name": "task", "name": "task", "pandas_type": "unicode",
             "numpy_type": "object"}  # fmt: skip
    pandas_index = {"index_columns": ["task"], "column_indexes": [], "columns": [column, index],
            "creator": {"library": "pyarrow", "version": pa.__version__},
            "pandas_version": "2.0.0"}  # fmt: skip
    return table.replace_schema_metadata({b"pandas": json.dumps(pandas_index).encode()})


def _write_parquet(table: pyarrow.Table, path: Path) -> None:
    import pyarrow.parquet as pq

    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)
