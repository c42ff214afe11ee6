"""The whole house at once: real processes, a real port, real physics, real failures."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import httpx
import pytest

import ontology
import rtask
from rtask.interop.episodes.episode import episodes_of
from rtask.interop.episodes.lerobot import write_lerobot
from rtask.interop.episodes.motion import Motion
from tests.commands import run_command
from tests.servers import running_server

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

_DEMO = [sys.executable, "-m", "rtask", "demo", "--products", "plain"]


def _run(
    *arguments: str, timeout: float = 1500, environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    return run_command(*_DEMO[3:], *arguments, timeout=timeout, environment=environment)


def _start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*_DEMO, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def _children(pid: int) -> dict[int, str]:
    """Return the living children of a process and their command lines (Linux)."""
    found = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
                if parent == pid:
                    command = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
                    found[int(entry.name)] = command
    return found


def _wait_for_line(process: subprocess.Popen[str], text: str, timeout_s: float = 240) -> None:
    """Read the progress until a line holds ``text``."""
    assert process.stderr is not None
    deadline = time.monotonic() + timeout_s
    for line in process.stderr:
        if text in line:
            return
        assert time.monotonic() < deadline, f"no line with {text!r} in {timeout_s} s"
    raise AssertionError(f"the demo ended before it said {text!r}")


def _gone(pids: list[int], timeout_s: float = 30) -> bool:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if not any(Path(f"/proc/{pid}").exists() for pid in pids):
            return True
        time.sleep(0.1)  # other processes end in their own time; nothing signals us
    return False


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return the folder and the table of a run at the size a newcomer gets."""
    folder = tmp_path_factory.mktemp("demo") / "run"
    done = _run("--seed", "3", "--json", "--data", str(folder))
    assert done.returncode == 0, done.stderr[-3000:]
    return folder, json.loads(done.stdout)


@pytest.mark.deep
def test_the_second_robot_recognises_what_the_first_one_stored(finished: Any) -> None:
    _, result = finished
    first, second = result["robots"]
    assert first["objects_on_table"] >= 6
    assert len({met["product"].split("-")[0] for met in result["objects"]}) >= 4
    # At least 4 of 5 of the products that the first robot stored, and nothing taken for another.
    assert second["recognised"] >= 0.8 * second["known_before"]
    assert first["false_identities"] == second["false_identities"] == 0
    seen = {met["product"] for met in result["objects"] if met["robot"] == second["name"]} - {""}
    assert len(seen) + len(second["never_seen"]) == second["objects_on_table"]


@pytest.mark.deep
def test_every_product_that_was_met_has_its_name_and_kind_and_most_a_colour(finished: Any) -> None:
    folder, result = finished
    met = {one["product"] for one in result["objects"] if one["object_iri"]} - {""}
    with rtask.open(folder / "store", mode="r") as kb:
        rows = kb.select(
            """PREFIX rt: <https://w3id.org/rtask-kg/ns#>
            PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
            SELECT DISTINCT ?name (BOUND(?c) AS ?coloured) { ?object rt:name ?name ; a ?kind .
              ?kind rdfs:subClassOf rt:ManipulableObject FILTER(?kind != rt:ManipulableObject)
              OPTIONAL { ?object rt:hasColour ?c } }"""
        ).to_dicts()
    assert met <= {str(row["name"]) for row in rows}
    coloured = {str(row["name"]) for row in rows if row["coloured"]}
    # Of some motley prints no colour covers a fifth, and then none is stated.
    assert len(met & coloured) >= 0.6 * len(met)


@pytest.mark.deep
def test_questions_about_what_happened_are_answered_on_its_store(finished: Any) -> None:
    folder, result = finished
    with rtask.open(folder / "store", mode="r") as kb:
        answers = {
            file.stem: kb.select(file.read_text("utf-8")).to_dicts()
            for file in ontology.episode_queries()
        }
    assert len(answers) == len(ontology.episode_queries())
    names = {robot["name"] for robot in result["robots"]}
    assert {row["robot"] for row in answers["eq01"]} == names
    tried = sum(int(row["attempts"]) for row in answers["eq01"])
    # A robot makes one attempt at a time.
    assert len({(row["robot"], row["time"]) for row in answers["eq02"]}) == tried
    assert len({(row["robot"], row["ended"]) for row in answers["eq20"]}) == tried
    # Each attempt is a part of what its robot set out to do, and says what came then.
    told = answers["eq23"]
    assert len({(row["robot"], row["object"], row["number"], row["grasp"]) for row in told}) >= 1
    assert {row["robot"] for row in told} == names
    again = [row for row in told if not row["held"] and row["then"] is not None]
    assert all(row["reason"] != "ok" for row in again)
    in_box = {row["object"] for row in told if row["placed"] and row["place"]}
    where = {row["object"]: str(row["place"]) for row in answers["eq22"] if row["place"]}
    assert where.keys() <= in_box
    assert where
    assert set(where.values()) <= {"left box", "right box"}
    for question in ("eq05", "eq06", "eq08", "eq09", "eq11", "eq14", "eq17", "eq19"):
        assert answers[question], question


@pytest.mark.deep
def test_the_joints_of_its_attempts_make_data_sets(finished: Any, tmp_path: Path) -> None:
    folder, result = finished
    tried = sum(met["tries"] for met in result["objects"])  # attempts in which something moved
    with rtask.open(folder / "store", mode="r") as kb:
        found = [one for one in episodes_of(kb) if one.motion]
        motions = [Motion.from_bytes(kb.blobs.read(one.motion)) for one in found]
        assert {motion.joints[-1] for motion in motions} <= {"nao_left_hand", "nao_right_hand"}
        hand = motions[0].joints[-1]
        written = write_lerobot(kb, found, tmp_path / "set", hand=hand)
    assert len(found) == tried >= len(result["robots"])
    assert written.episodes == sum(motion.joints[-1] == hand for motion in motions)
    info = json.loads((tmp_path / "set/meta/info.json").read_text("utf-8"))
    assert info["total_frames"] > 20 * written.episodes  # a second each, at least


@pytest.mark.deep
def test_most_objects_in_reach_are_held(finished: Any) -> None:
    """One seed is a sample of six; the figures over five are those of ``bench_demo.py``.

    The expected share is above .8 (there); half of them is three standard deviations below.
    """
    _, result = finished
    for robot in result["robots"]:
        assert robot["held"] >= 0.5 * robot["objects_in_reach"], robot


@pytest.mark.deep
def test_the_second_robot_starts_from_what_the_first_one_learned(finished: Any) -> None:
    _, result = finished
    first, second = result["robots"]
    assert first["known_before"] == first["from_memory"] == 0
    assert second["known_before"] > 0
    assert second["from_memory"] > 0
    assert second["mean_attempts_to_first_success"] is not None


@pytest.mark.deep
def test_the_report_has_table_pictures_and_queries(finished: Any) -> None:
    folder, result = finished
    report = (folder / "report" / "report.md").read_text(encoding="utf-8")
    assert "SELECT" in report
    assert "| nao-2 |" in report
    pictures = {p.stem.split("-")[-1] for p in (folder / "report").glob("nao-*/*.png")}
    assert {"pre_grasp", "closed", "held", "placed"} <= pictures
    assert all(p.stat().st_size > 1000 for p in (folder / "report").glob("nao-*/*.png"))
    assert json.loads((folder / "report" / "report.json").read_text()) == result
    held = [try_ for met in result["objects"] for try_ in met["attempts"] if try_["held"]]
    assert all(abs(try_["hand"]["across_m"]) < try_["hand"]["opening_m"] for try_ in held)


@pytest.mark.deep
def test_two_naos_and_a_panda_end_with_what_sharing_gained_in_this_run(tmp_path: Path) -> None:
    """The demo as a newcomer starts it, with half of its products."""
    done = subprocess.run(
        [*_DEMO[:4], "--objects", "2", "--data", str(tmp_path / "run")],
        capture_output=True, text=True, timeout=1500, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    result = json.loads((tmp_path / "run/report/report.json").read_text("utf-8"))
    assert [robot["name"] for robot in result["robots"]] == ["nao-1", "nao-2", "panda-3"]
    assert {met["product"].split("-")[0] for met in result["objects"]} - {""} == {"carton"}
    with rtask.open(tmp_path / "run/store", mode="r") as kb:
        named = {row["name"].value for row in kb.query(
            "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "
            "SELECT ?name { ?object rt:objectId ?id ; rt:name ?name }"
        )}  # fmt: skip
    assert {met["product"] for met in result["objects"]} - {""} <= named
    opening, *_ = done.stderr.splitlines()
    assert "hide what decides a grasp" in opening
    last = [line for line in done.stdout.splitlines() if line]
    assert [gain["robot"] for gain in result["gains"]] == ["nao-2", "panda-3"]
    assert result["gain"] == result["gains"][-1]
    for gain in result["gains"]:
        assert gain["attempts"] >= gain["products"]
        assert gain["sentence"] in last
        assert last.index(gain["sentence"]) < [line.split()[0] for line in last].index("pages")


@pytest.mark.deep
def test_outcomes_and_their_provenance_are_read_from_the_kept_store(finished: Any) -> None:
    """With two clients that nobody here wrote: curl and SPARQLWrapper."""
    from SPARQLWrapper import JSON, SPARQLWrapper

    folder, result = finished
    query = """
        PREFIX rt: <https://w3id.org/rtask-kg/ns#> PREFIX prov: <http://www.w3.org/ns/prov#>
        SELECT ?robot ?code ?agent WHERE {
            ?attempt rt:performedBy/rt:name ?robot ; rt:hasOutcome ?outcome .
            ?outcome rt:hasReason/rt:code ?code .
            GRAPH ?graph { ?attempt rt:hasOutcome ?outcome }
            ?activity a rt:WriteActivity ; rt:changedGraph ?graph ;
                      prov:wasAssociatedWith ?agent }"""
    # An attempt for which the server had no grasp to offer has nothing to report.
    tried = sum(a["source"] != "none" for met in result["objects"] for a in met["attempts"])
    with running_server(folder / "store") as server:
        url = server.url
        client = SPARQLWrapper(f"{url}/sparql")
        client.setQuery(
            "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "
            "SELECT (COUNT(DISTINCT ?o) AS ?n) { ?a rt:hasOutcome ?o }"
        )
        client.setReturnFormat(JSON)
        counted = client.queryAndConvert()["results"]["bindings"][0]["n"]["value"]
        curl = subprocess.run(
            ["curl", "-sf", f"{url}/sparql", "-H", "Accept: text/csv",
             "--data-urlencode", f"query={query}"],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        home = httpx.get(f"{url}/", headers={"Accept": "text/html"})
    assert int(counted) == tried
    lines = curl.stdout.split()
    assert lines[0] == "robot,code,agent"
    assert {line.split(",")[0] for line in lines[1:]} == {"nao-1", "nao-2"}
    assert home.status_code == 200
    assert "nao-2" in home.text


def _without_times(result: dict[str, Any]) -> Any:
    """Return the table as the two runs must share it: no seconds, no addresses, no new IRIs."""
    dropped = {"seconds", "url", "store"}
    if isinstance(result, dict):
        return {k: _without_times(v) for k, v in result.items() if k not in dropped}
    if isinstance(result, list):
        return [_without_times(v) for v in result]
    if isinstance(result, str) and result.startswith("http"):
        return result.rsplit("/", 1)[-1]
    return result


@pytest.mark.deep
@pytest.mark.night
def test_the_same_seed_gives_the_same_table(finished: Any, tmp_path: Path) -> None:
    _, first = finished
    done = _run("--seed", "3", "--json", "--data", str(tmp_path / "again"))
    assert done.returncode == 0, done.stderr[-3000:]
    assert _without_times(json.loads(done.stdout)) == _without_times(first)


@pytest.mark.deep
def test_ctrl_c_ends_every_process_and_leaves_a_whole_store(tmp_path: Path) -> None:
    process = _start("--data", str(tmp_path / "run"), "--objects", "1")
    _wait_for_line(process, "nao-1: meets ")
    children = list(_children(process.pid))
    assert len(children) == 3
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode not in (0, None)
    assert _gone(children)
    verified = run_command("verify", "-d", str(tmp_path / "run" / "store"))
    assert verified.returncode == 0, verified.stdout + verified.stderr


@pytest.mark.deep
def test_a_killed_demo_takes_its_children_along(tmp_path: Path) -> None:
    process = _start("--data", str(tmp_path / "run"), "--objects", "1")
    _wait_for_line(process, "nao-1 faces")
    children = list(_children(process.pid))
    process.kill()
    process.communicate(timeout=60)
    assert _gone(children)


@pytest.mark.deep
def test_a_robot_that_disappears_is_named_and_ends_the_demo(tmp_path: Path) -> None:
    process = _start("--data", str(tmp_path / "run"), "--objects", "1")
    _wait_for_line(process, "nao-1: meets ")
    (robot,) = [pid for pid, line in _children(process.pid).items() if '"index": 0' in line]
    os.kill(robot, signal.SIGKILL)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 3
    last = said.strip().splitlines()[-1]
    assert "nao-1 disappeared while" in last
    assert "SIGKILL" in last
    assert "Traceback" not in said


@pytest.mark.deep
def test_an_endpoint_that_goes_away_is_named_and_ends_the_demo(tmp_path: Path) -> None:
    process = _start("--data", str(tmp_path / "run"), "--objects", "1")
    _wait_for_line(process, "nao-1: meets ")
    (server,) = [pid for pid, line in _children(process.pid).items() if " serve " in line]
    os.kill(server, signal.SIGKILL)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 3
    assert "Traceback" not in said
    assert "nao-1" in said.strip().splitlines()[-1]


def test_a_port_in_use_is_one_line(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        done = _run("--data", str(tmp_path / "run"), "--port", port)
    assert done.returncode == 3
    assert port in done.stderr.strip().splitlines()[-1]
    assert "Traceback" not in done.stderr


def test_a_folder_with_other_things_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    done = _run("--data", str(tmp_path))
    assert done.returncode == 2
    assert "is not a demo's folder" in done.stderr
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


def test_a_window_without_a_display_is_refused(tmp_path: Path) -> None:
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = _run("--gui", "--data", str(tmp_path / "run"), environment=env, timeout=60)
    assert done.returncode == 3
    assert "display" in done.stderr
