"""Joints of an attempt: reported, kept as one binary object, and exported as LeRobot reads them."""

from __future__ import annotations

import json
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from rosbags.highlevel import AnyReader

import rtask
from rtask.cli.episodes import episodes as command
from rtask.engine.records import places
from rtask.errors import DataError, UsageError
from rtask.interop.episodes.episode import episodes_of
from rtask.interop.episodes.lerobot import write_lerobot
from rtask.interop.episodes.motion import Motion
from rtask.interop.episodes.reading import read_episodes
from rtask.interop.episodes.recording import write_episodes
from rtask.rdf.namespaces import RT

pq = pytest.importorskip("pyarrow.parquet")
pytestmark = pytest.mark.slow

JOINTS = ["shoulder", "elbow", "hand"]


def motion(samples=4, joints=JOINTS, **changed):
    """Return a motion whose first joint tells the sample and whose commands are one ahead."""
    count = len(joints)
    rows = np.arange(samples)[:, None] + np.arange(count) / 10
    given = {
        "joints": list(joints),
        "times": (0.1 * np.arange(samples)).tolist(),
        "positions": rows.ravel().tolist(),
        "commands": (rows + 1).ravel().tolist(),
    }
    return {**given, **changed}


def fill_store(bench, robots):
    """Store two attempts whose joints were recorded, lost and held, and one without."""
    seen = bench.sight(bench.CAN)
    reports = (
        ("nao-1", bench.missed(motion=motion(4), images=[{"phase": "lift", "data": bench.png(1)}])),
        ("nao-2", bench.held(motion=motion(6), comment="opening .7 -> .6", preset="real")),
        ("nao-3", bench.held()),
    )
    for name, outcome in reports:
        robot = robots(name)
        answer = robot.recognise(seen)
        if name == "nao-2":  # it knows when it began: after it had looked
            outcome |= {"started": time.time(), "ended": time.time() + 0.5}
        if name == "nao-3":  # after that, however soon it is told
            outcome |= {"ended": time.time() + 1.0}
        robot.insert(seen, grasp=answer["grasps"][0], outcome=outcome, task_id=answer["task_id"])


@pytest.fixture
def told(filled):
    """Two attempts whose joints were recorded, lost and held, and one without, are stored."""


def test_the_joints_of_an_attempt_are_kept_as_they_were_told(told, kb):
    found = episodes_of(kb)
    assert [bool(one.motion) for one in found] == [True, True, False]
    assert [len(one.pictures) for one in found] == [1, 0, 0]
    kept = Motion.from_bytes(kb.blobs.read(found[1].motion))
    assert kept.joints == tuple(JOINTS)
    assert kept.times.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    assert kept.positions[2].tolist() == [2.0, 2.1, 2.2]
    assert kept.commands[2].tolist() == [3.0, 3.1, 3.2]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"positions": [0.0] * 11}, r"motion.positions: expected 4 samples of 3 joints"),
        ({"commands": []}, r"motion.commands: expected 4 samples"),
        ({"times": [0.0, 0.1, 0.1, 0.2]}, r"motion.times: expected rising seconds"),
        ({"times": []}, r"motion.times: expected 1 to"),
        ({"joints": ["a", "a", "b"]}, r"motion.joints: expected 1 to 64 different names"),
    ],
)
def test_a_motion_that_does_not_fit_is_refused_and_nothing_stored(
    bench, robots, kb, changed, words
):
    robot, seen = robots("nao-1"), bench.sight(bench.CAN)
    answer = robot.recognise(seen)
    before = kb.seq
    with pytest.raises(UsageError, match=words):
        robot.insert(
            seen,
            grasp=answer["grasps"][0],
            outcome=bench.held(motion=motion(**changed)),
            task_id=answer["task_id"],
        )
    assert kb.seq == before


def test_bytes_that_are_no_motion_are_said_to_be_none():
    good = Motion.of_rows(*motion().values(), where="motion").to_bytes()
    for data in (b"", b"rubbish", good[:-9]):
        with pytest.raises(DataError, match="no motion of an attempt"):
            Motion.from_bytes(data)
    assert Motion.from_bytes(good).to_bytes() == good


def test_at_another_rate_joints_lie_between_their_samples():
    there = Motion.of_rows(*motion().values(), where="motion").at_rate(20)
    assert there.times.tolist() == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3])
    assert there.positions[:, 0].tolist() == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0])


def test_a_recording_shows_the_joints_at_their_times(told, kb, tmp_path):
    found = episodes_of(kb)
    assert write_episodes(kb, found, tmp_path / "all.mcap").motions == 2
    with AnyReader([tmp_path / "all.mcap"]) as reader:
        heard = [
            (time, reader.deserialize(raw, connection.msgtype))
            for connection, time, raw in reader.messages()
            if connection.topic == "/nao_2/joint_states"
        ]
    assert [list(state.name) for _, state in heard] == [JOINTS] * 6
    assert [state.position[0] for _, state in heard] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    started = found[1].started.timestamp()
    assert [time / 1e9 - started for time, _ in heard] == pytest.approx(
        [0.0, 0.1, 0.2, 0.3, 0.4, 0.5],
        abs=1e-4,  # seconds since 1970 in a double
    )


def test_motions_of_a_simulation_that_outran_the_clock_do_not_mix(bench, robots, kb, tmp_path):
    robot, seen = robots("nao-1"), bench.sight(bench.CAN)
    for number in (1, 2, 3):  # 0.5 s of simulation in 0.1 s each; when the third began is not known
        start = {} if number == 3 else {"started": 1e9 + 0.2 * number}
        told = bench.missed(motion=motion(6), attempt_number=number, ended=1e9 + 0.2 * number + 0.1)
        answer = robot.recognise(seen)
        robot.insert(
            seen, grasp=answer["grasps"][0], outcome={**told, **start}, task_id=answer["task_id"]
        )
    write_episodes(kb, episodes_of(kb), tmp_path / "all.mcap")
    with AnyReader([tmp_path / "all.mcap"]) as reader:
        times = [
            time - 10**18
            for connection, time, _ in reader.messages()
            if connection.topic == "/nao_1/joint_states"
        ]
    # The third takes the time since the second ended. Doubles hold such times to 0.2 us.
    expected = [0.2 + 0.02 * k for k in range(6)] + [0.4 + 0.02 * k for k in range(6)]
    expected += [0.5 + 0.04 * k for k in range(6)]
    assert [time / 1e9 for time in times] == pytest.approx(expected, abs=1e-5)
    kept = [Motion.from_bytes(kb.blobs.read(one.motion)).times[-1] for one in episodes_of(kb)]
    assert kept == [0.5] * 3  # simulated seconds stay as they were told


def test_a_data_set_has_the_files_and_columns_of_lerobot_3(told, bench, kb, tmp_path):
    out = tmp_path / "set"
    assert write_lerobot(kb, episodes_of(kb), out, rate_hz=10).episodes == 2
    info = json.loads((out / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"]) == ("v3.0", 10)
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (2, 10, 1)
    assert info["features"]["action"] == {"dtype": "float32", "shape": [3], "names": JOINTS}
    frames = pq.read_table(out / info["data_path"].format(chunk_index=0, file_index=0)).to_pydict()
    assert set(frames) == set(info["features"])
    assert frames["episode_index"] == [0] * 4 + [1] * 6
    assert frames["frame_index"] == [*range(4), *range(6)]
    assert frames["index"] == list(range(10))
    assert frames["observation.state"][5] == pytest.approx([1.0, 1.1, 1.2])
    # What was commanded from this row to the next; the arm has come to the row's own command.
    assert frames["action"][5] == pytest.approx([3.0, 3.1, 3.2])
    assert frames["action"][8] == frames["action"][9] == pytest.approx([6.0, 6.1, 6.2])
    assert [k for k, done in enumerate(frames["next.done"]) if done] == [3, 9]
    assert [k for k, held in enumerate(frames["next.success"]) if held] == [9]
    kept = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pydict()
    assert (kept["dataset_from_index"], kept["dataset_to_index"]) == ([0, 4], [4, 10])
    ((task,), other) = kept["tasks"]
    assert other == [task]
    assert re.fullmatch(r"pick up cylinder 1, an? [a-z ]+ cylinder, and put it into the box", task)
    assert kept["rtask/held"] == [False, True]
    assert kept["rtask/reason"] == ["missed", "ok"]
    assert kept["rtask/evidence"] == ["", "opening .7 -> .6"]
    assert kept["stats/action/max"][1] == pytest.approx([6.0, 6.1, 6.2])
    state = frames["observation.environment_state"]
    names = info["features"]["observation.environment_state"]["names"]
    assert names == [f"base_footprint/{part}" for part in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    assert all(row == state[0] for row in state[:4])
    assert state[0][:2] == pytest.approx(bench.CAN.position, abs=0.01)
    assert info["robot_type"] == "nao-h25-v5"
    stats = json.loads((out / "meta/stats.json").read_text())
    assert stats["observation.state"]["mean"][0] == pytest.approx((6 + 15) / 10)
    tasks = pq.read_table(out / "meta/tasks.parquet")
    assert tasks.schema.pandas_metadata["index_columns"] == ["task"]


def test_a_set_has_where_the_object_was_also_when_the_graph_has_forgotten_it(
    bench, robots, kb, tmp_path, monkeypatch
):
    monkeypatch.setattr(places, "MAX_ESTIMATES", 1)
    robot, spots = robots("nao-1"), [(0.16, -0.06), (0.12, -0.06), (0.14, -0.03)]
    for spot in spots:
        seen = bench.sight(bench.BOX.at(*spot, 0.3))
        answer = robot.recognise(seen)
        robot.insert(seen, grasp=answer["grasps"][0], outcome=bench.held(motion=motion(4)))
    assert len(list(kb.match(None, RT.poseOf))) < len(spots)
    write_lerobot(kb, episodes_of(kb), tmp_path / "set", rate_hz=10)
    rows = pq.read_table(tmp_path / "set/data/chunk-000/file-000.parquet").to_pydict()
    poses = rows["observation.environment_state"][::4]
    assert [pose[:2] for pose in poses] == [pytest.approx(spot, abs=0.01) for spot in spots]


def test_a_set_with_attempts_that_nobody_judged_calls_none_of_them_lost(told, kb, tmp_path):
    found = [replace(one, held=None) if one.held else one for one in episodes_of(kb)]
    write_lerobot(kb, found, tmp_path / "set")
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert "next.success" not in info["features"]
    kept = pq.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pydict()
    assert kept["rtask/held"] == [False, None]


def test_a_data_set_comes_back_into_another_graph_whole(told, kb, tmp_path):
    out, found = tmp_path / "set", episodes_of(kb)
    write_lerobot(kb, found, out)
    with rtask.open(":memory:", reason=False) as other:
        assert read_episodes(other, out).episodes == 2
        back = episodes_of(other)
        assert [one.to_json() for one in back] == [one.to_json() for one in found[:2]]
        assert other.blobs.read(back[0].motion) == kb.blobs.read(found[0].motion)
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match=r"is no data set: neither"):
        read_episodes(kb, tmp_path / "empty")


def test_hands_are_not_mixed_in_one_data_set(told, bench, robots, kb, tmp_path):
    robot, seen = robots("nao-1"), bench.sight(bench.CAN)
    answer = robot.recognise(seen)
    other = bench.held(motion=motion(joints=["wrist", "other_hand"]), attempt_number=2)
    robot.insert(seen, grasp=answer["grasps"][0], outcome=other, task_id=answer["task_id"])
    found = episodes_of(kb)
    with pytest.raises(UsageError, match="joints of one hand, and there are hand, other_hand"):
        write_lerobot(kb, found, tmp_path / "set")
    with pytest.raises(UsageError, match="no attempt with the hand 'foot'"):
        write_lerobot(kb, found, tmp_path / "set", hand="foot")
    assert not list(tmp_path.iterdir())
    written = write_lerobot(kb, found, tmp_path / "set", hand="other_hand")
    assert written.episodes == 1
    assert written.left_out == [
        "1 of 4 left out: without recorded joints (`motion` of an outcome)",
        "2 of 4 left out: with another hand than other_hand",
    ]


def test_a_query_says_which_attempts_make_a_data_set(told, kb, tmp_path):
    lost = "SELECT ?attempt { ?attempt rt:hasOutcome/rt:hasReason rt:reason_missed }"
    (only,) = episodes_of(kb, query=lost)
    assert (only.held, only.reason) == (False, "missed")
    first = episodes_of(kb, query="SELECT ?a ?x { ?a a rt:GraspAttempt ; rt:performedBy ?x }")
    assert first == episodes_of(kb)
    written = write_lerobot(kb, [only], tmp_path / "lost")
    assert (written.episodes, written.left_out) == (1, [])
    held = 'SELECT ?attempt { ?attempt rt:hasOutcome/rt:success true ; rt:activates/rt:name "%s" }'
    by_right_hand = episodes_of(kb, query=held % "right_hand")
    assert [one.robot_name for one in by_right_hand] == ["nao-2", "nao-3"]
    assert not episodes_of(kb, query=held % "third_hand")


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("ASK { ?a ?b ?c }", "chosen by a SELECT"),
        ("SELECT * { }", "has no variable"),
        ("SELECT ?task { ?task rt:through ?x }", r"the \?task of this one is no attempt .*/task/"),
        ("SELECT ?attempt { ?x rt:name ?attempt }", r"the \?attempt of this one is no attempt"),
    ],
)
def test_a_query_of_something_else_than_attempts_is_refused(told, kb, query, words):
    with pytest.raises(UsageError, match=words):
        episodes_of(kb, query=query)


def test_robots_of_two_types_are_not_mixed_in_one_data_set(told, kb, tmp_path):
    found = [one for one in episodes_of(kb) if one.motion]
    assert len({one.robot for one in found}) == 2  # of one model
    other = replace(found[1], robot="urn:robot/two", robot_name="panda-1")
    with pytest.raises(UsageError, match=r"robots of one type, and there are nao.*, panda-1"):
        write_lerobot(kb, [found[0], other], tmp_path / "set")


def test_without_recorded_joints_there_is_no_data_set(told, kb, tmp_path):
    with pytest.raises(UsageError, match="no attempt has its joints recorded"):
        write_lerobot(kb, episodes_of(kb, robot="nao-3"), tmp_path / "set")


def test_the_command_writes_a_folder_and_reads_it(told, kb, tmp_path, shares):
    data, out = str(tmp_path / "data"), str(tmp_path / "set")
    with rtask.open(data, reason=False) as stored:
        write_episodes(kb, episodes_of(kb), tmp_path / "all.mcap")
        read_episodes(stored, tmp_path / "all.mcap")
    wrong = CliRunner().invoke(command, ["export", out, "--data", data, "--format", "mcap"])
    assert "ends in .mcap" in str(wrong.exception)
    done = CliRunner().invoke(
        command, ["export", out, "--data", data, "--format", "lerobot", "--json"]
    )
    assert done.exit_code == 0, (done.output, done.exception)
    assert json.loads(done.stdout)["motions"] == 2
    assert shares == [(1, 2), (2, 2)]
    words = ["export", out + "-2", "--data", data, "--format", "lerobot"]
    assert "1 of 3 left out: without recorded joints" in CliRunner().invoke(command, words).stderr
    done = CliRunner().invoke(command, ["import", out, "--data", str(tmp_path / "new"), "--json"])
    assert json.loads(done.stdout)["episodes"] == 2
