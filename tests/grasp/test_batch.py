"""Batches of objects and pose maps are the same wherever they run; what fails is said, no more."""

from __future__ import annotations

import dataclasses
import json
import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from grasp.batch import BatchPlan, MeshFile, Planned
from grasp.push import PushTest, as_part, open_executor
from grasp.push.parts import stand_in
from grasp.push.pose import PoseMap, centred_grasp, pose_map
from grasp.push.shards import Executor, Serial
from grasp.spatial.grasp_plan import SpatialOptions
from grasp.spatial.gripper import panda_hand
from rtask.cli import cli
from rtask.client.trials import ServerExecutor
from rtask.errors import RemoteUnavailableError, ServiceError, UsageError
from rtask.services import ServiceHost
from rtask.services.builtin import PushTrials, SpacePlans
from rtask.services.builtin.space_plans import request_for
from tests.commands import run_command
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

RANGES = [(0, 1), (1, 2), (3, 2)]


def file_of(name: str, shape: trimesh.Trimesh) -> MeshFile:
    return MeshFile(name, "ply", shape.export(file_type="ply"))


@pytest.fixture(scope="module")
def task() -> BatchPlan:
    box, can = trimesh.creation.box((0.04, 0.06, 0.1)), trimesh.creation.cylinder(0.02, 0.08)
    wall = trimesh.creation.box((0.5, 0.5, 0.5))
    files = (
        file_of("box", box),
        file_of("can", can),
        MeshFile("broken", "ply", b"no mesh"),
        file_of("wall", wall),
        MeshFile("scene", "glb", b"glTF"),
    )
    return BatchPlan(files, panda_hand(), SpatialOptions(samples=20, tries=200))


@pytest.fixture(scope="module")
def serial(task: BatchPlan) -> list[Planned]:
    return task(0, 5)


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    with running_server(None) as running:
        yield running


@pytest.fixture(scope="module", params=["threads", "processes", "server"])
def executor(request: pytest.FixtureRequest, server: RunningServer) -> Iterator[Executor]:
    if request.param == "server":
        with ServerExecutor(server.url, workers=2) as made:
            yield made
    else:
        with open_executor(request.param, 2) as opened:
            yield opened


def assert_same(one: Planned, other: Planned) -> None:
    """Fail unless two plans are equal to the last bit."""
    assert (one.name, one.error, one.proposals.reason) == (
        other.name,
        other.error,
        other.proposals.reason,
    )
    assert dict(one.proposals.counts) == dict(other.proposals.counts)
    assert one.proposals.notes == other.proposals.notes
    assert len(one.proposals) == len(other.proposals)
    for mine, theirs in zip(one.proposals, other.proposals, strict=True):
        np.testing.assert_array_equal(mine.frame_from_gripper, theirs.frame_from_gripper)
        assert dict(mine.scores) == dict(theirs.scores)
        assert (mine.width, mine.depth, mine.opening) == (
            theirs.width,
            theirs.depth,
            theirs.opening,
        )
        for name in ("contacts", "normals", "features"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))


def test_a_batch_is_the_same_on_every_executor(task, serial, executor):
    found = [one for _, part in sorted(executor.finished(task, RANGES)) for one in part]
    for one, other in zip(serial, found, strict=True):
        assert_same(one, other)
    assert len(serial[0].proposals) > 0
    assert "no PLY mesh" in serial[2].error
    assert not serial[3].proposals
    assert "a mesh ends in .stl" in serial[4].error


def test_a_mesh_without_a_face_has_no_grasp_and_a_reason(task):
    (empty,) = dataclasses.replace(task, meshes=(MeshFile("empty", "obj", b""),))(0, 1)
    assert (len(empty.proposals), empty.error) == (0, "")
    assert empty.proposals.reason == "the mesh has no face"


def test_a_pose_map_is_the_same_on_every_executor(executor):
    part = as_part(stand_in("A"))
    test = PushTest(0.25 * part.diameter)

    def mapped(run: Executor) -> PoseMap:
        grasp = centred_grasp(part, (1.0, 0.0), test.jaw_width)
        spans = ([0.1 * part.diameter, 0.3 * part.diameter], [0.1, 0.5, 1.0])
        return pose_map(part, grasp, test, *spans, samples=7, seed=4, executor=run)

    np.testing.assert_array_equal(mapped(executor).quality, mapped(Serial()).quality)


def test_a_pose_map_tells_how_far_it_is_and_is_not_given_in_part():
    part = as_part(stand_in("A"))
    test = PushTest(0.25 * part.diameter)
    grasp = centred_grasp(part, (1.0, 0.0), test.jaw_width)
    told = []
    pose_map(part, grasp, test, [0.1], [0.1, 0.2], samples=8, progress=lambda *at: told.append(at))
    assert told == [(2 * k, 16) for k in range(1, 9)]
    with pytest.raises(TimeoutError, match="2 of 16 simulations ended within 1e-09 s"):
        pose_map(part, grasp, test, [0.1], [0.1, 0.2], samples=8, deadline_s=1e-9)


def test_results_come_as_they_are_ready_and_the_rest_is_given_up(task, executor):
    coming = executor.finished(task, [(i, 1) for i in range(4)])
    number, (one,) = next(coming)
    assert one.name == task.meshes[number].name
    coming.close()


def test_a_server_that_cannot_be_reached_is_told_before_any_plan():
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        made = ServerExecutor(f"http://127.0.0.1:{bound.getsockname()[1]}", timeout_s=1.0)
        with pytest.raises(RemoteUnavailableError, match="cannot be reached"), made:
            pytest.fail("it was opened")


def test_a_server_says_what_it_cannot_carry_out(server, task):
    with ServerExecutor(server.url) as made, pytest.raises(UsageError, match="not function"):
        list(made.finished(lambda first, count: first, [(0, 1)]))
    asked = BatchPlan(task.meshes, task.gripper, SpatialOptions(reachable=lambda pose: True))
    with pytest.raises(ServiceError, match="reachable, quality and weighting cannot be sent"):
        request_for(asked, task.meshes[0])


@pytest.mark.parametrize(
    "options",
    [{"mass": -1.0}, {"mass": float("nan")}, {"samples": 0}, {"tries": 0}, {"most": 0}],
)
def test_options_that_suit_no_plan_are_refused(options):
    with pytest.raises(ValueError, match="expected"):
        SpatialOptions(**options)


@pytest.mark.parametrize("scale", [float("nan"), 0.0])
def test_a_scale_that_suits_no_mesh_is_refused_once(task, scale):
    with pytest.raises(ValueError, match="expected"):
        dataclasses.replace(task, scale=scale)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gripper": {"name": "x"}}, "gripper: "),
        ({"kind": "dxf"}, "kind"),
        ({"samples": 0}, "samples: 0 is below 1"),
        ({"scale": 0}, "scale: 0 is not above 0"),
        ({"colour": 1}, "colour"),
    ],
)
def test_a_request_that_cannot_be_planned_says_why(task, changes, words):
    given = {**request_for(task, task.meshes[0]), **changes}
    with ServiceHost([SpacePlans]) as host, pytest.raises((ServiceError, UsageError), match=words):
        host.call("rtask/SpacePlans", "plan", given)


def test_a_pose_shard_beyond_the_grid_is_refused():
    from grasp.push.pose import PoseTrials
    from grasp.push.trials import Trials
    from rtask.services.builtin.push_trials import request_of

    part = as_part(stand_in("A"))
    test = PushTest(0.25 * part.diameter, method="simulation")
    from grasp.push import Tolerance

    grasp = centred_grasp(part, (1.0, 0.0), test.jaw_width)
    trials = PoseTrials(
        Trials.of(part, grasp, test, Tolerance(0.0), 0), np.array([0.1]), np.array([0.1]), 5
    )
    given = {"shard": request_of(trials.trials), "position_std": [0.1], "rotation_std": [0.1]}
    with ServiceHost([PushTrials]) as host, pytest.raises(ServiceError, match="trials below 5"):
        host.call("rtask/PushTrials", "pose", {**given, "samples": 5, "first": 3, "count": 3})


@pytest.fixture
def files(task: BatchPlan, tmp_path: Path) -> list[str]:
    paths = []
    for mesh in task.meshes[:4]:
        path = tmp_path / f"{mesh.name}.ply"
        path.write_bytes(mesh.contents)
        paths.append(str(path))
    return paths


def run(*args: str) -> tuple[int, dict[str, list[dict[str, object]]]]:
    done = CliRunner().invoke(cli, ["grasp", "batch", *args, "--samples", "10", "--json"])
    return done.exit_code, json.loads(done.stdout)


def test_the_command_plans_on_a_server_as_here_and_names_what_failed(files, server, tmp_path):
    code, here = run(*files, "--save-grasps", str(tmp_path / "out"))
    there = run(*files, "--executor", "server", "--server", server.url)[1]
    assert here["objects"] == there["objects"]
    assert code == 1
    reasons = [bool(one["reason"]) for one in here["objects"]]
    assert reasons == [False, False, True, True]
    assert sorted(one.name for one in (tmp_path / "out").iterdir()) == ["box.h5", "can.h5"]
    assert run(files[0])[0] == 0


@pytest.mark.parametrize("hand", ["suction:0.01", "three:0.1"])
def test_cups_and_three_fingers_plan_in_batches_and_read_their_own_files(
    hand, files, server, tmp_path
):
    words = (*files[:2], "--gripper", hand, "--limit", "3")
    code, here = run(*words, "--save-grasps", str(tmp_path / "out"))
    there = run(*words, "--executor", "server", "--server", server.url)[1]
    assert (code, here["objects"]) == (0, there["objects"])
    stored = str(tmp_path / "out" / "box.h5")
    again = ["grasp", "space", files[0], "--samples", "10", "--grasps", stored, "--json"]
    done = CliRunner().invoke(cli, [*again, "--gripper", hand])
    found = json.loads(done.stdout)["grasps"]
    assert found
    assert {round(one["confidence"], 9) for one in found} <= {
        round(one["confidence"], 9) for one in here["objects"][0]["grasps"]
    }
    refused = CliRunner().invoke(cli, again)
    assert refused.exit_code != 0
    assert "and panda_hand holds by jaws" in refused.output + str(refused.exception)


def test_the_command_ends_at_its_deadline_and_says_what_is_not_planned(files, shares):
    code, found = run(*files, "--deadline", "0.001")
    assert shares == [(1, 4)]
    assert code == 1
    assert [one["planned"] for one in found["objects"]] == [True, False, False, False]


def test_two_files_of_one_name_are_refused_before_anything_is_planned(files, tmp_path):
    other = tmp_path / "more" / "box.ply"
    other.parent.mkdir()
    other.write_bytes(Path(files[0]).read_bytes())
    out = tmp_path / "out"
    words = ["grasp", "batch", files[0], str(other), "--save-grasps", str(out)]
    done = run_command(*words)
    assert done.returncode in (2, 3)
    assert "two meshes have the same name" in done.stderr
    assert not out.exists()
