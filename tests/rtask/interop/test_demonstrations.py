"""Data sets of LeRobot that others recorded: read as attempts, chosen by a query, written again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

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

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
pytestmark = pytest.mark.slow

JOINTS = ["waist", "elbow", "gripper"]
TASKS = ["open the drawer", "pick up the red mug"]
COUNTED = ("timestamp", "frame_index", "episode_index", "index", "task_index")
LENGTHS, OF_TASK, HELD = (4, 6, 5), (1, 0, 1), (True, True, False)


def foreign(
    folder: Path, version: str = "v3.0", *, success: bool = True, action: int = 3, scale: float = 1
) -> Path:
    """Write three episodes as the package of LeRobot does: two files, names by group, pictures."""
    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    vector = {"dtype": "float32", "shape": [3], "names": {"motors": JOINTS}}
    number = {"dtype": "int64", "shape": [1], "names": None}
    info = {
        "codebase_version": version,
        "robot_type": "so101_follower",
        "fps": 10,
        "features": {
            "observation.state": vector,
            "action": {**vector, "shape": [action]},
            "observation.images.top": {"dtype": "video", "shape": [480, 640, 3], "names": None},
            **dict.fromkeys(COUNTED, number),
            **({"next.success": {"dtype": "bool", "shape": [1], "names": None}} if success else {}),
        },
    }  # fmt: skip
    (folder / "meta/info.json").write_text(json.dumps(info), "utf-8")
    words = pa.table({"task_index": [0, 1], "__index_level_0__": TASKS})
    pq.write_table(words, folder / "meta/tasks.parquet")
    tables = []
    for number, (length, task, held) in enumerate(zip(LENGTHS, OF_TASK, HELD, strict=True)):
        state = scale * (number + np.arange(length)[:, None] / 10 + np.arange(3))
        columns = {
            "observation.state": pa.array(state.tolist(), pa.list_(pa.float32())),
            "action": pa.array((state[:, :action] + 1).tolist(), pa.list_(pa.float32())),
            "timestamp": pa.array(np.arange(length) / 10, pa.float32()),
            "episode_index": pa.array([number] * length),
            "task_index": pa.array([task] * length),
        }
        if success:
            done = np.arange(length) == length - 1
            columns["next.success"] = pa.array(done & held)
        tables.append(pa.table(columns))
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
    assert read.doubts[0].startswith("its joints go to 46, read as rad or m: are they in degrees")
    assert len(read.doubts) == 1


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
    assert not read.doubts
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
    read_episodes(kb, foreign(tmp_path / "mugs", success=False))
    assert [one.held for one in episodes_of(kb)] == [None] * 3


def test_an_older_format_or_too_few_commands_is_named_and_changes_nothing(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    before = kb.seq
    for folder, message in (
        (foreign(tmp_path / "old", "v2.1"), r"has format v2\.1, expected v3; convert it"),
        (foreign(tmp_path / "few", action=2), "a command for each joint"),
    ):
        with pytest.raises(DataError, match=message):
            read_episodes(kb, folder)
    data = foreign(tmp_path / "cut") / "data/chunk-000/file-001.parquet"
    data.write_bytes(data.read_bytes()[:-20])
    with pytest.raises(DataError, match="damaged"):
        read_episodes(kb, tmp_path / "cut")
    assert kb.seq == before


def test_a_robot_imports_no_episodes_of_others(kb: KnowledgeBase, tmp_path: Path) -> None:
    with pytest.raises(ForbiddenError, match="robot nao-1 may not write"):
        read_episodes(kb, foreign(tmp_path / "mugs"), Access("nao-1", "robot"))
    assert not episodes_of(kb)
