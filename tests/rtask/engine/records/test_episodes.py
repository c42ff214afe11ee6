"""Episodes go out as recordings and come back into another graph with nothing lost."""

from __future__ import annotations

import datetime as dt
import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import ontology
import rtask
from features.codec import decode
from features.geometry import Frame
from features.imaging.recordings import views_of
from rtask.cli.episodes import episodes as command
from rtask.errors import ConflictError, DataError, ForbiddenError, MissingBlobError, UsageError
from rtask.interop.episodes.episode import blobs_of, episodes_of, statements_of
from rtask.interop.episodes.reading import read_episodes
from rtask.interop.episodes.recording import write_episodes
from rtask.interop.episodes.situation import situations_of
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PROV, RT, reason
from rtask.rdf.terms import NamedNode, Quad, literal, moment


def fill_store(bench, robots):
    """Let two robots try one object: lost by the first, held by the second."""
    seen = bench.sight(bench.CAN)
    reports = (
        ("nao-1", bench.missed(images=[{"phase": "lift", "data": bench.png(1)}])),
        ("nao-2", bench.held()),
    )
    for name, outcome in reports:
        robot = robots(name)
        answer = robot.recognise(seen)
        stored = robot.insert(
            seen, grasp=answer["grasps"][0], outcome=outcome, task_id=answer["task_id"]
        )
        thing = stored["objects"][0]["object"]
    return thing


@pytest.fixture
def told(filled):
    """An object that two robots tried: lost by the first, held by the second."""
    return filled


def same(one, other):
    return [a.to_json() for a in one] == [b.to_json() for b in other]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["all.mcap", "all.bag"])
def test_what_robots_did_comes_back_whole(told, kb, tmp_path, name):
    found = episodes_of(kb)
    assert [(one.robot_name, one.held, one.reason) for one in found] == [
        ("nao-1", False, "missed"),
        ("nao-2", True, "ok"),
    ]
    written = write_episodes(kb, found, tmp_path / name)
    assert (written.episodes, written.pictures, written.views) == (2, 1, 1)
    with rtask.open(":memory:", reason=False) as other:
        read = read_episodes(other, tmp_path / name)
        assert read.blobs == written.blobs
        assert same(episodes_of(other), found)
        for one in found:
            for quad in statements_of(kb, one):
                owner = kb.graphs.owner(quad.graph_name)
                there = other.graphs.agent(owner)
                assert other.match(quad.subject, quad.predicate, quad.object, there), quad
            for blob in blobs_of(statements_of(kb, one)):
                assert other.blobs.read(blob) == kb.blobs.read(blob)
        before = other.seq
        assert read_episodes(other, tmp_path / name).episodes == 2
        assert other.seq == before  # nothing was new


@pytest.mark.slow
def test_any_reader_of_recordings_sees_the_views_with_depth(told, kb, tmp_path):
    found = episodes_of(kb)
    blobs = [b for one in found for b in blobs_of(statements_of(kb, one))]
    frames = []
    for blob in dict.fromkeys(blobs):
        try:
            seen = decode(kb.blobs.read(blob))
        except ValueError:
            continue
        frames += [seen] if isinstance(seen, Frame) else []
    for name in ("a.mcap", "a.bag"):
        write_episodes(kb, found, tmp_path / name)
        (view,) = views_of(tmp_path / name)
        np.testing.assert_array_equal(view.depth_m, frames[0].depth_m)
        deep = view.depth_m > 0  # the reader keeps colours where there is depth
        np.testing.assert_array_equal(view.rgb[deep], frames[0].rgb[deep])
        assert view.intrinsics.fx == frames[0].intrinsics.fx
        assert view.intrinsics.cx == frames[0].intrinsics.cx - frames[0].x0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.mcap", "a.bag"])
def test_a_viewer_finds_frames_that_are_frames_the_robot_and_where_the_object_was(
    told, kb, tmp_path, name
):
    found = episodes_of(kb, robot="nao-1")
    situations = situations_of(kb, found)
    write_episodes(kb, found, tmp_path / name, urdf="<robot name='nao'/>")
    read: dict[str, list] = {}
    with AnyReader([tmp_path / name], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
        for link, _, raw in bag.messages():
            read.setdefault(link.topic, []).append(bag.deserialize(raw, link.msgtype))
    assert [said.data for said in read["/nao_1/robot_description"]] == ["<robot name='nao'/>"]
    (picture,) = read["/nao_1/attempt/lift/compressed"]
    assert picture.header.frame_id == "optical"
    (shown,) = [situation for situation in situations.values() if situation.pose is not None]
    (message,) = read["/tf"]
    (transform,) = message.transforms
    assert (transform.header.frame_id, transform.child_frame_id) == (
        "base_footprint", found[0].thing_name,
    )  # fmt: skip
    place = transform.transform.translation
    assert [place.x, place.y, place.z] == pytest.approx(shown.pose[:3])
    if name == "a.mcap":
        data = (tmp_path / name).read_bytes()
        assert b"\x04\x00\x00\x00zstd" in data, "chunks say how they are compressed"
    with pytest.raises(UsageError, match="a description is that of one robot, and there are nao-1"):
        write_episodes(kb, episodes_of(kb), tmp_path / f"b-{name}", urdf="<robot/>")


@pytest.mark.slow
def test_one_robots_episode_brings_no_other_attempt_along(told, kb, tmp_path):
    (only,) = episodes_of(kb, robot="nao-2")
    write_episodes(kb, [only], tmp_path / "two.mcap")
    with rtask.open(":memory:", reason=False) as other:
        read_episodes(other, tmp_path / "two.mcap")
        assert same(episodes_of(other), [only])
        assert other.match(None, RT.objectId, None)  # the object came along
    late = only.ended + dt.timedelta(seconds=1)
    assert episodes_of(kb, since=late) == []
    assert episodes_of(kb, since=only.ended)[-1] == only
    with pytest.raises(UsageError, match="time zone"):
        episodes_of(kb, since=dt.datetime(2026, 1, 1))


@pytest.mark.slow
def test_files_that_are_damaged_or_of_another_kind_change_nothing(told, kb, tmp_path):
    found = episodes_of(kb)
    path = tmp_path / "all.mcap"
    write_episodes(kb, found, path)
    with pytest.raises(UsageError, match="exists"):
        write_episodes(kb, found, path)
    with pytest.raises(UsageError, match="expected a file"):
        write_episodes(kb, found, tmp_path / "all.zip")
    whole = path.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.mcap").write_bytes(b"no recording")
    with rtask.open(":memory:", reason=False) as other:
        before = other.seq
        for name in ("cut.mcap", "text.mcap"):
            with pytest.raises(DataError, match=name):
                read_episodes(other, tmp_path / name)
        with pytest.raises(UsageError, match="no such file"):
            read_episodes(other, tmp_path / "none.mcap")
        assert other.seq == before
    blob = blobs_of(statements_of(kb, found[0]))[0]
    kb.blobs.path(blob).unlink()
    with pytest.raises(MissingBlobError):
        write_episodes(kb, found, tmp_path / "lacking.mcap")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["all.mcap", "cut.mcap", "text.mcap"]


def counts(graph):
    """Return the successes and attempts that the graph states of each grasp, by robot."""
    rows = graph.select(
        f"SELECT ?grasp ?hand ?won ?n {{ ?s <{RT.statisticsOf.value}> ?grasp ; "
        f"<{RT.gripperType.value}> ?hand ; "
        f"<{RT.successes.value}> ?won ; <{RT.attempts.value}> ?n }}"
    )
    return sorted(tuple(row.values()) for row in rows.to_dicts())


@pytest.mark.slow
def test_the_command_lists_writes_and_reads(told, kb, tmp_path, shares):
    found = episodes_of(kb)
    write_episodes(kb, found, tmp_path / "all.bag")
    folder = str(tmp_path / "graph")

    def run(*words):
        done = CliRunner().invoke(command, [*words, "-d", folder, "--json"])
        if done.exception and not isinstance(done.exception, SystemExit):
            raise done.exception
        return json.loads(done.stdout)

    read = run("import", str(tmp_path / "all.bag"))
    assert read["episodes"] == 2
    with rtask.open(folder, mode="r") as other:
        assert counts(other) == counts(kb) != []
        seq = other.seq
    run("import", str(tmp_path / "all.bag"))
    with rtask.open(folder, mode="r") as other:
        assert other.seq == seq  # nothing was new
    assert run("list") == json.loads(json.dumps([one.to_json() for one in found]))
    assert [one["robot_name"] for one in run("list", "--agent", "nao-2")] == ["nao-2"]
    out = run("export", str(tmp_path / "again.mcap"))
    assert (out["episodes"], out["pictures"]) == (2, 1)
    assert shares == [(1, 2), (2, 2)]
    words = ("export", str(tmp_path / "none.mcap"), "--agent", "nobody", "-d", folder)
    done = CliRunner().invoke(command, words)
    assert (done.exit_code, done.stderr.splitlines()[-1]) == (
        1, "no attempt fits; see `rtask episodes list`"
    )  # fmt: skip


@pytest.mark.slow
def test_questions_about_what_happened_are_answered(told, kb, tmp_path):
    files = ontology.episode_queries()
    assert [file.stem for file in files] == [f"eq{n:02}" for n in range(1, 31)]
    answers = {file.stem: kb.select(file.read_text("utf-8")).to_dicts() for file in files}
    assert all(file.read_text("utf-8").splitlines()[0].endswith("?") for file in files)
    who = [(row["robot"], int(row["attempts"]), int(row["successes"])) for row in answers["eq01"]]
    assert who == [("nao-1", 1, 0), ("nao-2", 1, 1)]
    assert [row["held"] for row in answers["eq02"]] == [False, True]
    assert answers["eq03"] == []  # nobody tried twice
    ((reason, count),) = [(row["reason"], row["attempts"]) for row in answers["eq04"]]
    assert (reason.rpartition("#")[2], int(count)) == ("reason_missed", 1)
    assert [(row["robot"], row["phase"]) for row in answers["eq06"]] == [("nao-1", "lift")]
    (failing,) = answers["eq25"]
    assert (failing["robot"], failing["failures"], failing["attempts"]) == ("nao-1", 1, 1)
    assert failing["reasons"] == "missed"
    (picture,) = answers["eq06"]
    assert kb.blobs.has(f"urn:sha256:{picture['digest']}")
    (met,) = answers["eq08"]
    assert (met["first"], met["others"]) == ("nao-1", "nao-2")
    assert [row["robot"] for row in answers["eq09"]] == ["nao-2"]
    assert [(row["robot"], int(row["held"])) for row in answers["eq30"]] == [("nao-2", 1)]
    ((needed, tries),) = [(row["robot"], row["attempts"]) for row in answers["eq11"]]
    assert (needed, int(tries)) == ("nao-2", 1)
    assert answers["eq12"] == []
    assert {row["robot"] for row in answers["eq14"]} <= {"nao-1", "nao-2"}
    assert [row["held"] for row in answers["eq17"]] == [False, True]
    assert [row["task"] for row in answers["eq20"]] == ["pick", "pick"]
    assert [(row["robot"], row["observed"] is None) for row in answers["eq07"]] == [
        ("nao-2", False)
    ]
    shown = CliRunner().invoke(command, ["ask", "--json"])
    assert len(json.loads(shown.stdout)) == len(files)
    with pytest.raises(UsageError, match="1 to 30"):
        CliRunner().invoke(command, ["ask", "31"], catch_exceptions=False)


@pytest.mark.slow
def test_a_recognition_is_told_also_where_the_view_was_not_kept(told, bench, robots, kb):
    robot = robots("nao-3")
    answer = robot.recognise(bench.sight(bench.CAN, bench.Eye(noise_seed=3)))
    robot.call(
        "report_outcome", task_id=answer["task_id"], object=told, grasp=answer["grasps"][0],
        outcome=bench.held(), gripper_id="right_hand",
    )  # fmt: skip
    (query,) = [file for file in ontology.episode_queries() if file.stem == "eq07"]
    rows = kb.select(query.read_text("utf-8")).to_dicts()
    (row,) = [row for row in rows if row["robot"] == "nao-3"]
    assert row["confidence"] >= 0.7
    assert row["observed"] is None


def _tampered(path, kb, episodes, swap):
    """Write episodes whose statements were changed on the way."""
    from rtask.interop.episodes import recording

    def changed(kb, episode, stated=statements_of):
        return [part for quad in stated(kb, episode) for part in swap(quad)]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "statements_of", changed)
        write_episodes(kb, episodes, path)


@pytest.mark.slow
@pytest.mark.parametrize("base", ["https://example.org/kb/", "urn:other/"])
def test_a_file_cannot_speak_for_another_robot(told, kb, tmp_path, base):
    one = kb.graphs.agent_iri("nao-1")
    own, stranger = kb.graphs.agent("nao-1"), kb.graphs.agent("nao-2")
    (only,) = episodes_of(kb, robot="nao-1")

    def in_the_graph_of_another(quad):
        is_own = quad.graph_name == own
        return [Quad(*tuple(quad)[:3], stranger) if is_own else quad]

    def in_a_graph_of_nobody(quad):
        return [Quad(*tuple(quad)[:3], NamedNode(f"{kb.graphs.base}graph/import/lab"))]

    for name, swap in (("a", in_the_graph_of_another), ("b", in_a_graph_of_nobody)):
        _tampered(tmp_path / f"{name}.mcap", kb, [only], swap)
    with rtask.open(":memory:", reason=False, base=base) as other:
        before = other.seq
        with pytest.raises(ForbiddenError, match=rf"'nao-2': it cannot state .*{one.value}"):
            read_episodes(other, tmp_path / "a.mcap")
        assert other.seq == before
        write_episodes(kb, episodes_of(kb), tmp_path / f"all-{len(base)}.mcap")
        with pytest.raises(ForbiddenError, match="robot nao-2 may not write"):
            read_episodes(other, tmp_path / f"all-{len(base)}.mcap", Access("nao-2", "robot"))
        assert other.seq == before
        read_episodes(other, tmp_path / f"all-{len(base)}.mcap")
        with pytest.raises(ForbiddenError, match=r"an unsigned graph cannot state .*'nao-[12]'"):
            read_episodes(other, tmp_path / "b.mcap")


OTHERWISE = (
    (PROV.endedAtTime, "2099-01-01T00:00:00Z", DataError, "s ahead of the clock here"),
    (RT.atTime, "2099-01-01T00:00:00Z", DataError, "s ahead of the clock here"),
    (PROV.endedAtTime, "1970-01-01T00:00:01Z", ConflictError, "one attempt has one outcome"),
    (RT.success, True, DataError, "does not fit a success"),
    (RT.hasReason, reason("ok"), DataError, "not fit a failure"),
    (RT.x, 5.0, DataError, "more than 4 m from the object"),
    (RT.x, float("nan"), DataError, "expected a finite number"),
    (RT.contactWidth, 3.0, DataError, "expected 0 to 1 m"),
    (RT.jawOpening, -0.1, DataError, "expected 0 to 1 m"),
)


@pytest.mark.slow
def test_a_file_that_says_what_cannot_be_so_or_contradicts_what_is_stored_changes_nothing(
    told, kb, tmp_path
):
    found = episodes_of(kb, robot="nao-1")
    for number, (predicate, value, error, words) in enumerate(OTHERWISE):
        given = moment(value) if isinstance(value, str) else value
        said = given if isinstance(given, NamedNode) else literal(given)

        def swap(quad, predicate=predicate, said=said):
            return [Quad(quad[0], quad[1], said, quad[3]) if quad[1] == predicate else quad]

        _tampered(tmp_path / f"{number}.mcap", kb, found, swap)
        before = kb.seq
        with pytest.raises(error, match=words):
            read_episodes(kb, tmp_path / f"{number}.mcap")
        assert kb.seq == before, predicate


@pytest.mark.slow
def test_an_attempt_at_a_time_that_no_header_can_state_is_named(told, kb, tmp_path):
    late = [replace(one, ended=moment("2099-01-01T00:00:00Z")) for one in episodes_of(kb)]
    with pytest.raises(DataError, match="times of a recording are from 1970 to 2038"):
        write_episodes(kb, late, tmp_path / "late.mcap")
    assert not (tmp_path / "late.mcap").exists()
