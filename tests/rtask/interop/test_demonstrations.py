"""Data sets of LeRobot that others recorded: read as attempts, chosen by a query, written again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rtask
from rtask.errors import DataError, ForbiddenError
from rtask.interop.episodes.episode import episodes_of
from rtask.interop.episodes.lerobot import write_lerobot
from rtask.interop.episodes.motion import Motion
from rtask.interop.episodes.reading import read_episodes
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
pytestmark = pytest.mark.slow

JOINTS = ["waist", "elbow", "gripper"]
GROUPED = {"motors": JOINTS}
TASKS = ["open the drawer", "pick up the red mug"]
COUNTED = ("timestamp", "frame_index", "episode_index", "index", "task_index")
LENGTHS, OF_TASK, HELD = (4, 6, 5), (1, 0, 1), (True, True, False)


def foreign(
    folder: Path, version: str = "v3.0", *, success: str = "next.success", action: int = 3,
    scale: float = 1, names: Any = GROUPED, **changed: Any,
) -> Path:  # fmt: skip
    """Write three episodes as the package of LeRobot does: two files, names by group, pictures.

    Parameters
    ----------
    success
        Name of the feature that tells it; empty = none.
    changed
        Features that differ, by their names with ``_`` for ``.``; None = left out.
    """
    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    vector = {"dtype": "float32", "shape": [3], "names": names}
    counter = {"dtype": "int64", "shape": [1], "names": None}
    features: dict[str, Any] = {
        "observation.state": vector,
        "action": {**vector, "shape": [action]},
        "observation.images.top": {"dtype": "video", "shape": [480, 640, 3], "names": None},
        **dict.fromkeys(COUNTED, counter),
        **({success: {"dtype": "bool", "shape": [1], "names": None}} if success else {}),
    }
    for name in features:
        part = changed.get(name.replace(".", "_"), {})
        features[name] = None if part is None else {**features[name], **part}
    info: dict[str, Any] = {
        "codebase_version": version,
        "robot_type": "so101_follower",
        "fps": 10,
        "features": {name: part for name, part in features.items() if part is not None},
    }
    (folder / "meta/info.json").write_text(json.dumps(info), "utf-8")
    words = pa.table({"task_index": [0, 1], "__index_level_0__": TASKS})
    pq.write_table(words, folder / "meta/tasks.parquet")
    tables = []
    for number, (length, task, held) in enumerate(zip(LENGTHS, OF_TASK, HELD, strict=True)):
        state = scale * (number + np.arange(length)[:, None] / 10 + np.arange(3))
        done = np.arange(length) == length - 1
        columns = {
            "observation.state": pa.array(state.tolist(), pa.list_(pa.float32())),
            "action": pa.array((state[:, :action] + 1).tolist(), pa.list_(pa.float32())),
            "timestamp": pa.array(np.arange(length) / 10, pa.float64()),
            "episode_index": pa.array([number] * length),
            "task_index": pa.array([task] * length),
            success: pa.array(done & held),
        }
        kept = {name: column for name, column in columns.items() if name in info["features"]}
        tables.append(pa.table(kept))
    pq.write_table(pa.concat_tables(tables[:2]), folder / "data/chunk-000/file-000.parquet")
    pq.write_table(tables[2], folder / "data/chunk-000/file-001.parquet")
    return folder


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:") as opened:
        yield opened


def test_joints_beyond_any_angle_are_said_to_be_in_another_unit(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    read = read_episodes(kb, foreign(tmp_path / "shares", scale=20))
    assert read.episodes == 3
    assert read.doubts[0].startswith("its joints go to 88, read as rad or m: are they in degrees")


def test_each_episode_is_an_attempt_with_its_task_joints_and_success(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    read = read_episodes(kb, foreign(tmp_path / "so101 mugs"))
    assert (read.episodes, read.blobs) == (3, 3)
    found = episodes_of(kb)
    assert [one.held for one in found] == list(HELD)
    assert {one.robot_name for one in found} == {"so101_follower"}
    motion = Motion.from_bytes(kb.blobs.read(found[1].motion))
    assert motion.joints == tuple(JOINTS)
    assert motion.positions[0] == pytest.approx([1, 2, 3])
    assert motion.commands[5] == pytest.approx([2.5, 3.5, 4.5])
    assert not kb.contradictions()
    before = kb.seq
    assert read.doubts == ["not read: observation.images.top"]
    assert read_episodes(kb, tmp_path / "so101 mugs").statements == 0
    assert (kb.seq, len(episodes_of(kb))) == (before, 3), "what is known changes nothing"


def test_a_query_over_the_graph_selects_episodes_and_writes_a_set_of_just_these(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    read_episodes(kb, foreign(tmp_path / "mugs"))
    failed = """SELECT ?attempt { ?task rt:through ?attempt ; rt:taskName ?words .
  ?attempt rt:hasOutcome/rt:success false FILTER(CONTAINS(?words, "mug")) }"""
    found = episodes_of(kb, query=failed)
    assert write_lerobot(kb, found, tmp_path / "lost", rate_hz=10).episodes == 1
    info = json.loads((tmp_path / "lost/meta/info.json").read_text("utf-8"))
    assert (info["robot_type"], info["total_frames"]) == ("so101_follower", 5)
    assert info["features"]["action"]["names"] == JOINTS
    rows = pq.read_table(tmp_path / "lost/data/chunk-000/file-000.parquet").to_pydict()
    assert rows["observation.state"][1] == pytest.approx([2.1, 3.1, 4.1])
    assert rows["action"][1] == pytest.approx([3.1, 4.1, 5.1])
    assert not any(rows["next.success"])
    tasks = pq.read_table(tmp_path / "lost/meta/tasks.parquet").to_pydict()
    assert tasks["task"] == ["pick up the red mug"]


def test_a_set_that_tells_no_success_leaves_it_unjudged(kb: KnowledgeBase, tmp_path: Path) -> None:
    read_episodes(kb, foreign(tmp_path / "mugs", success=""))
    assert [one.held for one in episodes_of(kb)] == [None] * 3
    write_lerobot(kb, episodes_of(kb), tmp_path / "again")
    info = json.loads((tmp_path / "again/meta/info.json").read_text("utf-8"))
    assert "next.success" not in info["features"]


def test_an_older_format_or_a_damaged_file_is_named_and_changes_nothing(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    before = kb.seq
    with pytest.raises(DataError, match=r"has format v2\.1, expected v3; convert it"):
        read_episodes(kb, foreign(tmp_path / "old", "v2.1"))
    data = foreign(tmp_path / "cut") / "data/chunk-000/file-001.parquet"
    data.write_bytes(data.read_bytes()[:-20])
    with pytest.raises(DataError, match="damaged"):
        read_episodes(kb, tmp_path / "cut")
    twice = foreign(tmp_path / "twice") / "data/chunk-000"
    (twice / "file-002.parquet").write_bytes((twice / "file-001.parquet").read_bytes())
    with pytest.raises(DataError, match="episode 2 is in another file as well"):
        read_episodes(kb, tmp_path / "twice")
    assert kb.seq == before


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"action": 2}, "not a command for each joint"),
        ({"observation_state": None}, "it has no feature observation.state"),
        ({"observation_state": {"names": {"x": 0, "y": 1, "z": 2}}}, "about other things than"),
    ],
)
def test_actions_that_command_no_joints_leave_attempts_without_joints_and_say_so(
    kb: KnowledgeBase, tmp_path: Path, changed: dict[str, Any], words: str
) -> None:
    read = read_episodes(kb, foreign(tmp_path / "poses", **changed))
    assert (read.episodes, read.blobs) == (3, 0)
    assert words in read.doubts[0]
    found = episodes_of(kb)
    assert [(one.held, one.motion) for one in found] == [(held, "") for held in HELD]
    before = kb.seq
    read_episodes(kb, tmp_path / "poses")
    assert kb.seq == before, "what is known changes nothing"


@pytest.mark.parametrize("names", [{"waist": 0, "gripper": 2, "elbow": 1}, [JOINTS], JOINTS, None])
def test_joints_have_their_names_however_a_set_gives_them(
    kb: KnowledgeBase, tmp_path: Path, names: Any
) -> None:
    read_episodes(kb, foreign(tmp_path / "set", names=names))
    motion = Motion.from_bytes(kb.blobs.read(episodes_of(kb)[0].motion))
    assert list(motion.joints) == (JOINTS if names else ["joint_0", "joint_1", "joint_2"])


def test_a_set_without_tasks_or_times_leaves_them_unknown(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    folder = foreign(tmp_path / "bare", timestamp=None)
    (folder / "meta/tasks.parquet").unlink()
    read = read_episodes(kb, folder)
    assert read.doubts[0].startswith("no task is in words")
    motion = Motion.from_bytes(kb.blobs.read(episodes_of(kb)[0].motion))
    assert motion.times.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3])  # by the rate of the set
    write_lerobot(kb, episodes_of(kb), tmp_path / "again", rate_hz=10)
    tasks = pq.read_table(tmp_path / "again/meta/tasks.parquet").to_pydict()
    assert tasks["task"] == ["unknown task"]


def test_an_episode_of_several_tasks_has_them_in_their_order(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    file = foreign(tmp_path / "both") / "data/chunk-000/file-001.parquet"
    table = pq.read_table(file)
    column = pa.array([1, 1, 0, 0, 0])
    pq.write_table(
        table.set_column(table.column_names.index("task_index"), "task_index", column), file
    )
    assert "1 episodes have several tasks" in read_episodes(kb, tmp_path / "both").doubts[0]
    (words,) = kb.select(
        f'{PREFIXES} SELECT ?words {{ ?task rt:taskName ?words FILTER(CONTAINS(?words, "then")) }}'
    )
    assert str(words.value("words")) == "pick up the red mug; then open the drawer"


def test_success_is_known_only_where_a_row_tells_it(kb: KnowledgeBase, tmp_path: Path) -> None:
    file = foreign(tmp_path / "droid", success="is_episode_successful") / (
        "data/chunk-000/file-001.parquet"
    )
    table = pq.read_table(file)
    unsaid = pa.nulls(table.num_rows, pa.bool_())
    place = table.column_names.index("is_episode_successful")
    pq.write_table(table.set_column(place, "is_episode_successful", unsaid), file)
    read_episodes(kb, tmp_path / "droid")
    assert [one.held for one in episodes_of(kb)] == [True, True, None]


def test_a_robot_imports_no_episodes_of_others(kb: KnowledgeBase, tmp_path: Path) -> None:
    with pytest.raises(ForbiddenError, match="robot nao-1 may not write"):
        read_episodes(kb, foreign(tmp_path / "mugs"), Access("nao-1", "robot"))
    assert not episodes_of(kb)
