"""`rtask robot`: a robot from its URDF file to grasps, without a line of Python."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from rtask.errors import RobotError
from simulate.grasping.executor import Workcell
from simulate.onboarding.commands import robot as command
from simulate.onboarding.guess import NoHandError, guess_robot
from simulate.robots import check_robot, describe, known_robots
from simulate.robots.robot_files import load_robot, set_aside
from simulate.robots.srdf import read_srdf, srdf_text
from tests.simulate.onboarding.test_hand_topologies import sliding_fingers, turning_jaw


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("robots")


@pytest.fixture(autouse=True)
def robots(folder, monkeypatch):
    monkeypatch.setenv("RTASK_ROBOTS", str(folder))


def data(name: str) -> str:
    import pybullet_data

    return str(Path(pybullet_data.getDataPath()) / name)


def run(*words: str):
    """Return the exit code and the JSON that a command printed."""
    done = CliRunner().invoke(command, [*words, "--json"])
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, json.loads(done.stdout)


@pytest.fixture(scope="module")
def added(folder):
    """Two robots: an arm that gets plain jaws, and one whose fingers are a linkage."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RTASK_ROBOTS", str(folder))
        return {
            "iiwa": run(
                "add", data("kuka_iiwa/model.urdf"), "--name", "iiwa", "--gripper", "jaw:0.085"
            ),
            "xarm": run("add", data("xarm/xarm6_with_gripper.urdf"), "--name", "xarm"),
        }


@pytest.mark.slow
def test_an_added_robot_is_known_by_its_name(added, folder):
    code, answer = added["iiwa"]
    assert code == 0
    assert answer["arms"][0]["joints"] == 7
    assert answer["arms"][0]["opening_m"] == pytest.approx(0.085, abs=1e-4)
    assert answer["reach"] >= 0.8
    assert {"iiwa", "nao", "panda"} <= set(known_robots())
    assert describe("iiwa") == load_robot(folder / "iiwa.toml")
    assert "# guessed" in (folder / "iiwa.toml").read_text("utf-8")
    code, rows = run("list")
    assert {"name": "iiwa", "from": str(folder / "iiwa.toml")} in rows
    check_robot("iiwa")
    with pytest.raises(RobotError, match="iiwa"):
        check_robot("iwia")


def test_a_removed_or_replaced_robot_is_brought_back(tmp_path, monkeypatch):
    monkeypatch.setenv("RTASK_ROBOTS", str(tmp_path))
    path = tmp_path / "arm.toml"
    path.write_text("first")
    assert run("remove", "arm")[0] == 0
    assert not path.exists()
    assert run("list")[0] == 0
    assert run("restore", "arm")[1] == {"name": "arm", "settings": str(path)}
    assert path.read_text() == "first"
    with pytest.raises(RobotError, match="removed or replaced"):
        run("restore", "arm")
    set_aside(path)
    path.write_text("second")
    run("restore", "arm")
    assert path.read_text() == "first"
    run("restore", "arm")
    assert path.read_text() == "second"


@pytest.mark.slow
def test_its_settings_can_be_edited_and_errors_name_the_key(added, folder):
    path = folder / "iiwa.toml"
    text = path.read_text("utf-8")
    (folder / "heavy.toml").write_text(text.replace("max_payload = 1.0", "max_payload = 2.5"))
    assert describe("heavy").arm("arm").max_payload == 2.5
    for before, after, says in (
        ("max_payload", "max_playload", "max_playload"),
        ('wrist = "lbr_iiwa_link_7"', 'wrist = "hand"', "no link 'hand'"),
        ("[workplace]", "[workspace]", "workplace is missing"),
        ("urdf = ", "urdf = 3 #", "not TOML|No such file|Is a directory|3"),
    ):
        (folder / "broken.toml").write_text(text.replace(before, after, 1))
        with pytest.raises(RobotError, match=says) as refused:
            load_robot(folder / "broken.toml")
        assert "broken.toml" in str(refused.value) or "3" in str(refused.value)
    (folder / "broken.toml").unlink()


@pytest.mark.slow
def test_fingers_that_follow_another_stay_with_it_under_load(added):
    described = describe("xarm")
    arm = described.arm("arm")
    with Workcell(described, preset="fast") as cell:
        cell.robot.move_fingers(arm.name, 0.3, arm.close_effort)
        cell.world.step(1.0)
        values = cell.robot.joint_values()
        fingers = np.array([values[name] for name in arm.fingers])
        # The gears of the physics engine are soft: a tenth of the range between the joints.
        assert np.ptp(fingers) < 0.085
        assert cell.robot.finger_opening(arm.name) == pytest.approx(0.3, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "grasps"),
    [
        ("xarm", "0"),  # that the body is checked; what it grasps takes six seconds
        pytest.param("xarm", "2", marks=pytest.mark.deep),
        pytest.param("iiwa", "2", marks=pytest.mark.deep),
    ],
)
def test_the_check_passes_from_the_file_to_grasps(added, name, grasps):
    code, answer = run("check", name, "--grasps", grasps, "--preset", "fast", "--workers", "1")
    by_name = {finding["name"]: finding for finding in answer["findings"]}
    assert by_name["reach"]["passed"], by_name
    assert by_name["home"]["passed"], by_name
    assert by_name["close"]["passed"], by_name
    assert any(row["held"] for row in answer["grasps"]) == (grasps != "0"), answer
    assert answer["passed"] == (code == 0)


@pytest.mark.slow
def test_an_srdf_goes_out_and_comes_back_in(added, folder, tmp_path):
    described = describe("xarm")
    path = tmp_path / "xarm.srdf"
    path.write_text(srdf_text(described), encoding="utf-8")
    read = read_srdf(path)
    arm = described.arm("arm")
    home = [read.homes[joint] for joint in arm.joints]
    np.testing.assert_allclose(home, arm.home, atol=1e-5)
    assert set(described.may_touch) <= set(read.may_touch)
    code, answer = run("srdf", "xarm")
    assert (code, answer["srdf"]) == (0, path.read_text("utf-8"))
    code, _ = run(
        "add", data("xarm/xarm6_with_gripper.urdf"), "--name", "again", "--srdf", str(path)
    )
    assert code == 0
    np.testing.assert_allclose(describe("again").arm("arm").home, arm.home, atol=1e-4)
    assert set(read.may_touch) >= set(describe("again").may_touch)


@pytest.mark.slow
def test_nothing_is_written_for_a_robot_that_cannot_be_made(added, folder, tmp_path):
    before = sorted(folder.iterdir())
    for words, says in (
        (("add", data("kuka_iiwa/model.urdf"), "--name", "bare"), "--gripper"),
        (("add", data("cartpole.urdf")), "no arm"),
        (("add", data("kuka_iiwa/model.urdf"), "--name", "iiwa"), "--replace"),
        (("add", data("kuka_iiwa/model.urdf"), "--name", "../x"), "--name"),
        (("add", data("kuka_iiwa/model.urdf"), "--name", "panda"), "built-in"),
        (("add", str(tmp_path / "none.urdf")), "No such file"),
        (
            ("add", data("kuka_iiwa/model.urdf"), "--name", "w", "--gripper", "jaw:wide"),
            "jaw:STROKE",
        ),
        (("remove", "nobody"), "there are: "),
    ):
        with pytest.raises(Exception, match=says):
            run(*words)
    assert sorted(folder.iterdir()) == before


@pytest.mark.slow
def test_a_removed_robot_is_forgotten(added, folder):
    text = (folder / "iiwa.toml").read_text("utf-8")
    (folder / "short.toml").write_text(text)
    code, answer = run("remove", "short")
    assert (code, answer["removed"]) == (0, str(folder / "short.toml"))
    assert "short" not in known_robots()


def test_a_survey_tells_why_a_file_cannot_be_read(tmp_path):
    (tmp_path / "bad.urdf").write_text("<robot")
    code, rows = run("survey", str(tmp_path), data("franka_panda/panda.urdf"))
    assert code == 1
    assert "not XML" in rows[0]["error"]
    assert rows[1]["hands"] == ["panda_link7"]


def test_a_survey_that_was_cut_goes_on_where_it_was(tmp_path):
    found = tmp_path / "found.jsonl"
    panda = data("franka_panda/panda.urdf")
    assert run("survey", panda, "--out", str(found))[0] == 0
    whole = found.read_text("utf-8")
    found.write_text(whole + '{"path": "cut in the mid', "utf-8")
    code, rows = run("survey", panda, data("pr2_gripper.urdf"), "--out", str(found))
    assert (code, [row["hands"] for row in rows]) == (0, [["panda_link7"], ["gripper_pole"]])
    lines = found.read_text("utf-8").splitlines()
    assert [json.loads(line) for line in lines] == rows
    assert lines[0] == whole.strip()


def test_a_survey_counts_by_maker_the_files_that_name_a_hand_and_those_where_it_was_found(tmp_path):
    for maker, jaws in (("good_description", '<box size="0.02 0.01 0.05"/>'), ("bare_models", "")):
        (tmp_path / maker / "urdf").mkdir(parents=True)
        write_gripper(tmp_path / maker / "urdf" / "gripper.urdf", jaws)
    done = CliRunner().invoke(command, ["survey", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "hands in   1 of   1 files: good_description" in done.output
    assert "hands in   0 of   1 files, 1 not measurable: bare_models" in done.output
    assert "hands in 1 of 2 files that name one (0.50), not measurable in 1, and" in done.output
    assert "no hand found, but finger_left, finger_right: no shapes" in done.output
    limited = run("survey", str(tmp_path), "--limit", "1")[1]
    assert (len(limited["rows"]), limited["not_shown"]) == (1, 1)


def test_where_no_hand_is_found_both_jaws_are_asked_for(tmp_path, monkeypatch):
    path = sliding_fingers("a4").write(tmp_path, "toes")
    path.write_text(path.read_text("utf-8").replace('"p1"', '"toe1"').replace('"p2"', '"toe2"'))
    with pytest.raises(NoHandError, match="--jaws LINK LINK"):
        run("add", str(path))
    given = []

    def noted(*args, jaws=None, **options):
        given.append(jaws)
        if jaws is None:
            return guess_robot(*args, jaws=jaws, **options)
        raise RobotError("enough is known")

    monkeypatch.setattr("simulate.onboarding.guess.guess_robot", noted)
    monkeypatch.setattr("simulate.onboarding.commands._can_ask", lambda: True)
    done = CliRunner().invoke(command, ["add", str(path)], input="toe9\ntoe1\ntoe2\n")
    assert str(done.exception) == "enough is known"
    assert given == [None, ("toe1", "toe2")]
    assert "links: a3, a4, toe1, toe2" in done.stderr


@pytest.mark.slow
def test_an_arm_of_five_joints_with_one_moving_jaw_becomes_a_robot(tmp_path, monkeypatch):
    monkeypatch.setenv("RTASK_ROBOTS", str(tmp_path))
    code, answer = run("add", str(turning_jaw("a5").write(tmp_path, "small")))
    assert code == 0
    assert answer["closing"][0]["passed"], answer["closing"]
    assert answer["arms"][0]["fingers"] == ["part_joint"]
    says = " ".join(answer["cannot"])
    assert "5 joints" in says
    assert "a single jaw moves" in says
    assert describe("small").arm("arm").has_single_jaw


def write_gripper(path: Path, shape: str) -> None:
    """Write a palm with two sliding fingers of a shape."""
    collision = f"<collision><geometry>{shape}</geometry></collision>" if shape else ""
    fingers = "".join(
        f'<link name="finger_{side}">{collision}</link>'
        f'<joint name="finger_{side}_joint" type="prismatic"><parent link="palm"/>'
        f'<child link="finger_{side}"/><axis xyz="0 {sign} 0"/><origin xyz="0 {sign * 0.006} 0.1"/>'
        '<limit lower="0" upper="0.04" velocity="1" effort="10"/></joint>'
        for side, sign in (("left", 1), ("right", -1))
    )
    path.write_text(f'<robot name="two"><link name="palm"/>{fingers}</robot>', "utf-8")


def test_first_grasps_name_a_file_that_is_no_robot(tmp_path, folder):
    before = sorted(folder.iterdir())
    bad = tmp_path / "bad.urdf"
    bad.write_text("<robot", "utf-8")
    code, rows = run("first-grasps", str(bad), "--grasps", "1", "--workers", "1")
    assert (code, len(rows)) == (1, 1)
    assert "not XML" in rows[0]["error"]
    assert sorted(folder.iterdir()) == before


@pytest.mark.slow
@pytest.mark.deep
def test_first_grasps_tell_what_becomes_of_each_file_and_keep_nothing(tmp_path, folder):
    before = sorted(folder.iterdir())
    bad = tmp_path / "bad.urdf"
    bad.write_text("<robot", "utf-8")
    good = sliding_fingers("a4").write(tmp_path, "good")
    words = ("--grasps", "1", "--preset", "fast", "--workers", "1")
    code, rows = run("first-grasps", str(bad), str(good), *words)
    assert "not XML" in rows[0]["error"]
    assert (rows[1]["error"], rows[1]["joints"], rows[1]["hand"]) == ("", [4], "a4")
    assert rows[1]["closes"]
    assert (rows[1]["grasps"], rows[1]["held"] <= 1) == (1, True)
    assert code == 1  # one of the files is no robot
    assert sorted(folder.iterdir()) == before
