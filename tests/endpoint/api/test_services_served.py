"""Services of a running server: HTTP, rosbridge, client, command line, description."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from click.testing import CliRunner
from jsonschema import Draft202012Validator
from openapi_spec_validator import validate
from websockets.sync.client import connect

import rtask
from rtask.cli import cli
from rtask.errors import CallFailedError
from rtask.services.outward.frames import pack, unpack
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow  # starts a server


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    with running_server(None, "--service", "tests.rtask.services.lab") as running:
        yield running


@pytest.fixture(scope="module")
def http(server: RunningServer) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=server.url, timeout=60) as client:
        yield client


def test_the_list_and_the_descriptions_fit_their_calls(http):
    listed = {one["name"]: one for one in http.get("/services").json()["services"]}
    assert listed["lab/Arm"]["versions"] == ["1.2.0", "1.1.9"]
    assert {"rtask/Engine", "rtask/Segmentation", "example/Grasping"} <= listed.keys()
    described = http.get("/services/lab/Arm").json()
    forward = described["methods"]["forward"]
    Draft202012Validator.check_schema(forward["request"])
    request = {"joints": [0, 0], "scale": 2}
    Draft202012Validator(forward["request"]).validate(request)
    answer = http.post(forward["href"], json=request)
    Draft202012Validator(forward["answer"]).validate(answer.json())
    assert answer.json()["pose"]["position"]["x"] == 4.0
    assert answer.headers["RTASK-Service"] == "lab/Arm@1.2.0"
    assert answer.headers["Server-Timing"].startswith("queue;dur=")
    assert http.get("/services/lab/Arm@1.1.9").json()["version"] == "1.1.9"


@pytest.mark.parametrize(
    ("path", "body", "status", "slug", "words"),
    [
        ("/services/lab/Arn/forward", {}, 404, "not-found", "did you mean lab/Arm?"),
        ("/services/lab/Arm/foward", {}, 404, "not-found", "did you mean 'forward'"),
        ("/services/lab/Arm@9.*/forward", {}, 404, "not-found", "has no version 9.*"),
        ("/services/lab/Arm/forward", {"joints": "x"}, 400, "usage", "joints: expected a list"),
        ("/services/lab/Arm/fail", {"kind": "refuse"}, 422, "service", "out of reach"),
        ("/services/lab/Arm/fail", {"kind": "crash"}, 500, "service-failed", "ZeroDivisionError"),
        ("/services/lab/Broken/use", {}, 503, "startup-failed", "no such device"),
        ("/services/lab/Reader/read", {}, 422, "missing-data", "needs a dataset for 'model'"),
        ("/services/lab/Reader/read?data=model", {}, 400, "usage", "data=<resource>:<names"),
        ("/services/lab/Arm/forward", [1], 400, "usage", "one JSON object"),
    ],
)
def test_problems_say_what_was_wrong(http, path, body, status, slug, words):
    answer = http.post(path, json=body)
    problem = answer.json()
    assert (answer.status_code, problem["type"]) == (status, f"/errors/{slug}")
    assert words in problem["detail"]
    assert "Traceback" not in answer.text


def test_calls_may_be_cbor_with_arrays_and_bytes_as_they_are(http):
    both = {"Content-Type": "application/cbor", "Accept": "application/cbor"}
    given = {"joints": np.zeros(2), "scale": 2}
    answer = http.post("/services/lab/Arm/forward", content=pack(given), headers=both)
    assert answer.headers["Content-Type"] == "application/cbor"
    pose = unpack(answer.content)["pose"]
    assert pose.shape == (4, 4)
    assert pose[0, 3] == 4.0
    broken = http.post("/services/lab/Arm/forward", content=b"\xff", headers=both)
    assert broken.status_code == 400
    assert "not CBOR" in broken.json()["detail"]


def test_calls_may_be_forms_with_files(http):
    array = io.BytesIO()
    np.save(array, np.zeros(2))
    files = {"joints": ("zero.npy", array.getvalue())}
    answer = http.post("/services/lab/Arm/forward", data={"scale": "2"}, files=files)
    assert answer.json()["pose"]["position"]["x"] == 4.0
    image = http.post("/services/lab/Arm/weigh", files={"image": ("mug.jpg", b"\xff\0\x01")})
    assert image.json() == {"size": 3}
    text = http.post("/services/lab/Arm/stretch", files={"joints": (None, "[1, 2]")})
    assert text.json()["distance"] == 2.0
    pickled = io.BytesIO()
    np.save(pickled, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    huge = array.getvalue().replace(b"(2,)", b"(9000000000000,)").replace(b" " * 12, b"", 1)
    for wrong, words in (
        ([("joints", ("evil.npy", pickled.getvalue()))], "evil.npy is no array"),
        ([("joints", ("cut.npy", array.getvalue()[:-1]))], "cut.npy is no array"),
        ([("joints", ("huge.npy", huge))], "huge.npy is no array"),
        ([("joints", (None, b"\xff"))], "not UTF-8"),
        ([("joints", (None, "[1]")), ("joints", (None, "[2]"))], "of its own name"),
        ([("joints", (None, "far"))], "joints: expected a list of numbers"),
    ):
        refused = http.post("/services/lab/Arm/forward", files=wrong)
        assert refused.status_code == 400
        assert words in refused.json()["detail"]
    none = {"Content-Type": "multipart/form-data; boundary=x"}
    assert http.post("/services/lab/Arm/forward", content=b"", headers=none).status_code == 400
    foreign = {"Origin": "http://elsewhere.example"}
    assert http.post("/services/lab/Arm/weigh", files=files, headers=foreign).status_code == 403


def test_a_failed_start_says_when_to_come_back(http):
    http.post("/services/lab/Broken/use", json={})
    assert int(http.post("/services/lab/Broken/use", json={}).headers["Retry-After"]) >= 1


def test_other_methods_are_refused(http):
    answer = http.get("/services/lab/Arm/forward")
    assert (answer.status_code, answer.headers["Allow"]) == (405, "POST, OPTIONS")
    assert http.post("/services").status_code == 405
    assert http.post("/services/lab/Arm/forward", content=b"x").status_code == 415
    assert http.options("/services/lab/Arm/forward").headers["Allow"] == "POST, OPTIONS"


def test_a_deadline_is_kept_while_the_server_answers_others(http):
    slow = {"steps": 500, "pause_s": 0.01}
    answer = http.post("/services/lab/Arm/count?timeout=0.1", json=slow)
    assert (answer.status_code, answer.json()["type"]) == (504, "/errors/deadline")


def test_rosbridge_offers_methods_as_services_with_types_and_as_actions(server):
    def call(service: str, /, **args: Any) -> Any:
        socket.send(json.dumps({"op": "call_service", "service": service, "args": args}))
        return json.loads(socket.recv(60))

    with connect(server.websocket) as socket:
        assert "/services/lab/Arm/forward" in call("/rosapi/services")["values"]["services"]
        type_ = call("/rosapi/service_type", service="/services/lab/Arm/forward")["values"]["type"]
        assert type_ == "lab/ArmForward"
        text = call("/rosapi/service_request_text", type=type_)["values"]["text"]
        assert text == "float64[] joints\nfloat64[] scale"
        # A typed client sends every field: an empty list is a field left out.
        moved = call("/services/lab/Arm/forward", joints=[0.0], scale=[])
        assert moved["values"]["pose"]["position"]["x"] == 1.0
        refused = call("/services/lab/Arm/forward", joints=[0.0], scale=[11])
        assert (refused["result"], refused["status"]) == (False, 400)
        goal = {"op": "send_action_goal", "id": "g", "action": "/services/lab/Arm/count"}
        goal |= {"action_type": "lab/ArmCount", "feedback": True}
        socket.send(json.dumps({**goal, "args": {"steps": 3, "pause_s": 0.01}}))
        said = [json.loads(socket.recv(60))]
        while said[-1]["op"] != "action_result":
            said.append(json.loads(socket.recv(60)))
        assert said[0]["op"] == "action_feedback"
        assert said[-1]["values"] == {"result": 3}
        socket.send(json.dumps({**goal, "args": {"steps": 1000, "pause_s": 0.01}}))
        json.loads(socket.recv(60))
        socket.send(json.dumps({**goal, "op": "cancel_action_goal"}))
        while (last := json.loads(socket.recv(60)))["op"] != "action_result":
            pass
        assert last["status"] == 5


def test_the_client_calls_by_proxy_with_arrays_and_bytes(server):
    with rtask.connect(server.url) as client:
        arm = client.service("lab/Arm@1.*")
        assert arm.forward(np.zeros(2))[0, 3] == 2.0
        assert arm.weigh(b"abc") == 3
        assert arm.stretch([1.0])["distance"] == 1.0
        assert [pose[0, 3] for pose in arm.map.forward([[0], [0, 0]])] == [1.0, 2.0]
        assert arm.submit.weigh(b"ab").result(60) == 2
        with pytest.raises(CallFailedError, match="scale: 11 is above 10"):
            arm.forward([0], scale=11)
        with pytest.raises(CallFailedError, match="did you mean lab/Arm"):
            client.service("lab/Arn")


def test_the_command_line_calls_a_server(server):
    run = CliRunner().invoke
    shown = run(cli, ["service", "show", "lab/Arm", "--server", server.url])
    assert "joints : float64[]  Angles from the base to the hand (rad)" in shown.output
    called = run(
        cli,
        [
            "service",
            "call",
            "lab/Arm",
            "stretch",
            "joints=[1, 2]",
            "--server",
            server.url,
            "--json",
        ],
    )
    assert json.loads(called.output) == {"distance": 2.0, "joints": [1.0, 2.0]}
    listed = run(cli, ["service", "list", "--server", server.url])
    assert "lab/Arm@1.2.0  A planar arm" in listed.output


def test_a_pipeline_moves_a_small_part_of_the_bytes_of_its_calls(http):
    points = np.random.default_rng(3).uniform(0, 1, (30_000, 3)).astype(np.float32)
    moved = 0

    def call(method: str, **request: Any) -> dict[str, Any]:
        nonlocal moved
        answer = http.post(f"/services/{method}", json=request).raise_for_status()
        moved += len(answer.request.content) + len(answer.content)
        return answer.json()

    data = base64.b64encode(points.tobytes()).decode()
    read = call("lab/Scan/read", data=data)
    shifted = call("lab/Scan/move", points=read["points"], by=[1, 0, 0])
    one_by_one, apart = call("lab/Scan/centre", points=shifted["points"])["centre"], moved
    moved = 0
    steps = [
        {"id": "read", "call": "lab/Scan/read", "inputs": {"data": {"$input": "data"}}},
        {
            "id": "shifted",
            "call": "lab/Scan/move",
            "inputs": {"points": {"$ref": "read.points"}, "by": [1, 0, 0]},
        },
        {
            "id": "mean",
            "call": "lab/Scan/centre",
            "inputs": {"points": {"$ref": "shifted.points"}},
        },
    ]
    output = {"centre": {"$ref": "mean.centre"}}
    found = call("rtask/Pipeline/run", inputs={"data": data}, steps=steps, output=output)
    assert found["output"]["centre"] == one_by_one
    assert moved < 0.15 * apart


def test_a_pipeline_is_saved_from_a_file_and_called_like_a_service(server, http, tmp_path):
    run = CliRunner().invoke
    steps = [
        {
            "id": "stretched",
            "call": "lab/Arm/stretch",
            "inputs": {"joints": {"$input": "joints"}},
        },
        {
            "id": "reached",
            "call": "lab/Arm/forward",
            "inputs": {"joints": {"$ref": "stretched.joints"}},
        },
    ]
    output = {"pose": {"$ref": "reached.pose"}, "all": {"$ref": "stretched"}}
    file = tmp_path / "pipeline.json"
    file.write_text(json.dumps({"pipeline": "lab/Reach", "steps": steps, "output": output}))
    words = ["service", "save", str(file), "--json"]
    assert "--server" in str(run(cli, words).exception or run(cli, words).output)
    saved = json.loads(run(cli, [*words, "--server", server.url]).output)
    assert (saved["name"], saved["version"]) == ("lab/Reach", "1.0.0")
    answer = http.post("/services/lab/Reach/run", json={"joints": [0, 0]})
    assert answer.headers["RTASK-Service"] == "lab/Reach@1.0.0"
    assert set(answer.json()) == {"pose", "all"}
    with rtask.connect(server.url) as client:
        assert client.service("lab/Reach").run(np.zeros(2)) == answer.json()
    described = http.get("/openapi.json").json()
    validate(described)
    assert "/services/lab/Reach/run" in described["paths"]
    gone = {"pipeline": "lab/Reach", "version": "1.0.0"}
    assert http.post("/services/rtask/Pipeline/remove", json=gone).is_success
    assert http.post("/services/lab/Reach/run", json={"joints": [0, 0]}).status_code == 404


def test_records_are_merged_and_pruned_over_http_and_by_commands(http, server, tmp_path):
    def run(*command: str) -> str:
        done = CliRunner().invoke(cli, ["dataset", *command, "--server", server.url])
        assert done.exception is None, done.exception
        return done.stdout

    file = tmp_path / "outcomes.jsonl"
    start = [{"id": f"o{n}", "robot": "nao", "width_m": 0.05 + 0.001 * n} for n in range(9)]
    run("create", "lab/Tries", "--key", "id")
    for name, more in (("lab/Tries", []), ("panda/Tries", [("p1", 0.06), ("p2", 55.0)])):
        if more:
            run("create", name, "--fork", "lab/Tries@1")
        added = [{"id": one, "robot": "panda", "width_m": width} for one, width in more]
        file.write_text("".join(json.dumps(one) + "\n" for one in (*start, *added)))
        run("put", name, str(file))
        run("snapshot", name)
    merged = run("merge", "lab/Tries", "panda/Tries")
    assert merged == (
        "lab/Tries@2\nplease check outcomes.jsonl#p2: width_m = 55 is far from all others\n"
    )
    described = http.get("/datasets/lab/Tries").json()
    assert (described["key"], len(described["doubts"])) == ("id", 1)
    page = http.get("/datasets/lab/Tries", headers={"Accept": "text/html"}).text
    assert "outcomes.jsonl#p2" in page
    assert run("prune", "lab/Tries", "--where", "robot=panda") == "lab/Tries@3\n"
    assert len(http.get("/datasets/lab/Tries/files/outcomes.jsonl").text.splitlines()) == 9
    for body, words in (
        ({"paths": "x"}, "paths"),
        ({"where": 3}, "where"),
        ({"paths": ["x"]}, "x"),
    ):
        answer = http.post("/datasets/lab/Tries/prune", json=body)
        assert answer.status_code in (400, 404)
        assert words in answer.json()["detail"]
    wrong = http.put("/datasets/lab/Wrong", json={"key": 3})
    assert (wrong.status_code, "key" in wrong.json()["detail"]) == (400, True)


def test_services_are_compared_and_the_results_kept_as_a_version(server, http, tmp_path):
    (tmp_path / "cases.jsonl").write_text('{"joints": [0, 0]}\n{"joints": "x"}\n')
    file = tmp_path / "reach.toml"
    file.write_text(
        'method = "stretch"\nservices = ["lab/Arm@1.*"]\ncases = "cases.jsonl"\n'
        'measures = ["distance"]\nresults = "lab/Results"\n'
    )
    command = ["service", "benchmark", str(file), "--server", server.url]
    done = CliRunner().invoke(cli, command)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("lab/Arm@1.2.0\n    2 calls, 1 failed; median ")
    distance, failed, kept = done.stdout.splitlines()[-3:]
    assert (distance, kept) == ("    distance: mean 2 [2, 2]", "results: lab/Results@1")
    assert failed.startswith("    failed 1 time: joints: expected a list")
    again = json.loads(CliRunner().invoke(cli, [*command, "--json"]).stdout)
    assert [row["failed"] for row in again["rows"]] == [1]
    files = http.get("/datasets/lab/Results").json()["files"]
    assert 1 <= len(files) <= 2  # one for each second in which a benchmark began
    text = http.get(f"/datasets/lab/Results/files/{min(files)}").text
    records = [json.loads(line) for line in text.splitlines()]
    assert [one["service"] for one in records] == ["lab/Arm@1.2.0"] * 2
    assert "joints: expected a list" in records[1]["error"]
    file.write_text(file.read_text().replace("1.*", "1.1.9"))
    for wrong, words in (
        (command[:3], "name it by --server"),
        (command, "has no method 'stretch'"),
    ):
        assert words in str(CliRunner().invoke(cli, wrong).exception)


def test_the_description_covers_services(http):
    described = http.get("/openapi.json").json()
    validate(described)
    call = described["paths"]["/services/lab/Arm/forward"]["post"]
    assert call["operationId"] == "lab_Arm_forward"
    schema = call["requestBody"]["content"]["application/json"]["schema"]["$ref"]
    wanted = described["components"]["schemas"][schema.rpartition("/")[2]]
    assert wanted["properties"]["joints"]["x-unit"] == "rad"


def test_the_operations_of_the_engine_are_a_service_too(http):
    answer = http.post("/services/rtask/Engine/recall_grasps", json={"object": "urn:none"})
    same = http.post("/engine/recall_grasps", json={"object": "urn:none"})
    assert (answer.status_code, answer.json()["detail"]) == (
        same.status_code,
        same.json()["detail"],
    )


def test_grasps_are_planned_by_the_built_in_service(http):
    outline = [[0, 0], [0.1, 0], [0.1, 0.05], [0, 0.05]]
    body = {"polygon": outline, "grasps": 3, "samples": 20, "rotation_std": 0.1}
    found = http.post("/services/example/Grasping/plan", json=body).json()
    chances = [one["probability"] for one in found["grasps"]]
    assert len(chances) == 3
    assert chances == sorted(chances, reverse=True)
    assert chances[0] > 0.5
    contact, end = (np.array(found["grasps"][0][name]) for name in ("contact", "whisker_end"))
    radius = np.hypot(0.05, 0.025)
    assert np.linalg.norm(end - contact) == pytest.approx(0.6 * radius)  # the best is the longest
    assert found["vertex_std"] == pytest.approx(0.045 * radius)
    crossed = {**body, "polygon": [[0, 0], [1, 1], [1, 0], [0, 1]]}
    refused = http.post("/services/example/Grasping/plan", json=crossed)
    assert (refused.status_code, refused.json()["type"]) == (422, "/errors/service")


def test_datasets_are_made_written_versioned_forked_and_merged(http):
    base = "/datasets/lab/Parts"
    assert http.put(base).status_code == 201
    assert http.put(base).json()["type"] == "/errors/conflict"
    assert http.put(f"{base}/files/a/cup.stl", content=b"cup").status_code == 204
    read = http.get(f"{base}/files/a/cup.stl")
    assert (read.content, read.headers["Content-Disposition"]) == (b"cup", "attachment")
    tag = read.headers["ETag"]
    again = http.get(f"{base}/files/a/cup.stl", headers={"If-None-Match": tag})
    assert again.status_code == 304
    assert http.post(f"{base}/snapshot", json={"message": "first"}).json()["version"] == 1
    guarded = {"If-Match": tag}
    url = f"{base}/files/a/cup.stl"
    assert http.put(url, content=b"new cup", headers=guarded).status_code == 204
    assert http.put(url, content=b"late cup", headers=guarded).status_code == 412
    assert http.get(f"{base}@1/files/a/cup.stl").content == b"cup"
    assert http.put(f"{base}@1/files/a/cup.stl", content=b"x").status_code == 405
    assert http.get(f"{base}/diff?from=1&to=head").json()["changed"] == ["a/cup.stl"]
    assert http.put("/datasets/lab/Fork", json={"fork_of": "lab/Parts@1"}).status_code == 201
    http.put("/datasets/lab/Fork/files/a/cup.stl", content=b"other cup")
    http.post("/datasets/lab/Fork/snapshot")
    wanted = {"source": "lab/Fork@1"}
    refused = http.post(f"{base}/merge", json=wanted)
    assert refused.status_code == 409
    assert refused.json()["conflicts"] == [{"path": "a/cup.stl", "kind": "both_changed"}]
    merged = http.post(f"{base}/merge", json={**wanted, "rules": {"a/": "theirs"}}).json()
    assert merged["parents"] == ["lab/Parts@2", "lab/Fork@1"]
    assert http.get(f"{base}/files/a/cup.stl").content == b"other cup"
    assert http.delete(f"{base}/files/a").status_code == 204
    assert http.get(f"{base}@head").json()["files"] == {}


@pytest.mark.parametrize("path", ["..%2f..%2fsecret", "a//b", "%2e%2e/%2e%2e/tokens.sqlite"])
def test_a_path_that_leads_out_of_a_dataset_is_refused(http, path):
    http.put("/datasets/lab/Safe")
    assert http.put(f"/datasets/lab/Safe/files/{path}", content=b"x").status_code in (400, 404, 405)
    assert http.get(f"/datasets/lab/Safe/files/{path}").status_code in (400, 404)


def test_a_service_reads_the_dataset_that_its_caller_names(http):
    http.put("/datasets/lab/Models")
    http.put("/datasets/lab/Models/files/model", content=b"seven joints")
    http.post("/datasets/lab/Models/snapshot")
    by_address = http.post("/services/lab/Reader/read?data=model:lab/Models@1", json={})
    in_body = http.post("/services/lab/Reader/read", json={"$data": {"model": "lab/Models"}})
    assert by_address.json() == in_body.json() == {"text": "seven joints"}


def test_a_missing_dataset_is_asked_for_in_the_words_of_the_callers_protocol(server, http):
    missing = "lab/Reader@0.1.0 needs a dataset for 'model'; give it as"
    refused = http.post("/services/lab/Reader/read", json={}).json()
    assert refused["detail"].endswith('give it as "$data": {"model": "<namespace>/<name>"}')
    params = {"name": "lab_Reader_read", "arguments": {}}
    message = {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": params}
    told = http.post("/mcp/services", json=message).json()["result"]["content"][0]["text"]
    assert told.endswith('give it as "data_resources": {"model": "<namespace>/<name>"}')
    words = ["service", "call", "lab/Reader", "read", "--server", server.url]
    called = CliRunner().invoke(cli, words)
    assert "give it as --dataset model=<namespace>/<name>" in str(called.exception)
    with rtask.connect(server.url) as client, pytest.raises(CallFailedError) as raised:
        client.service("lab/Reader").read()
    assert str(raised.value) == f"{missing} data={{'model': '<namespace>/<name>'}}"


def test_an_agent_lists_tools_calls_one_and_reads_what_was_wrong(http):
    def ask(method: str, **params: Any) -> Any:
        message = {"jsonrpc": "2.0", "id": 7, "method": method, "params": params}
        answer = http.post("/mcp/services", json=message).json()
        assert (answer["jsonrpc"], answer["id"]) == ("2.0", 7)
        return answer

    greeted = ask("initialize", protocolVersion="2025-06-18", capabilities={}, clientInfo={})
    assert greeted["result"]["protocolVersion"] == "2025-06-18"
    note = {"jsonrpc": "2.0", "method": "notifications/initialized"}
    assert http.post("/mcp/services", json=note).status_code == 202
    assert http.get("/mcp/services").status_code == 405
    tools = {one["name"]: one for one in ask("tools/list")["result"]["tools"]}
    Draft202012Validator.check_schema(tools["lab_Arm_forward"]["inputSchema"])
    assert tools["lab_Arm_forward"]["inputSchema"]["required"] == ["joints"]
    assert "rtask_Engine_recall_grasps" in tools
    hints = {name: one["annotations"]["readOnlyHint"] for name, one in tools.items()}
    assert hints["lab_Arm_forward"]
    assert not hints["lab_Arm_store"]
    assert not hints["rtask_Pipeline_run"], "its steps may write"
    moved = ask("tools/call", name="lab_Arm_forward", arguments={"joints": [0]})["result"]
    assert moved["structuredContent"]["pose"]["position"]["x"] == 1.0
    wrong = ask("tools/call", name="lab_Arm_forward", arguments={"joints": [0], "scale": 11})
    assert wrong["result"]["isError"]
    assert wrong["result"]["content"][0]["text"] == "scale: 11 is above 10"
    assert ask("tools/call", name="lab_Arm_fly")["error"]["code"] == -32602
    assert ask("resources/list")["error"]["code"] == -32601
