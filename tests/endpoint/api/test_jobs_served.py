"""Jobs of a running server: accepted, asked about, followed as events, cancelled."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from tests.servers import running_server

pytestmark = pytest.mark.slow  # starts a server


@pytest.fixture(scope="module")
def http() -> Iterator[httpx.Client]:
    with (
        running_server(None, "--service", "tests.rtask.services.lab") as server,
        httpx.Client(base_url=server.url, timeout=60) as client,
    ):
        yield client


def test_a_job_is_accepted_followed_and_cancelled(http):
    body = {"steps": 400, "pause_s": 0.1}
    made = http.post("/services/lab/Arm/count", json=body, headers={"Prefer": "respond-async"})
    assert made.status_code == 202
    place = made.headers["Location"]
    assert place == f"/jobs/{made.json()['id']}"
    assert made.json()["id"] in [one["id"] for one in http.get("/jobs").json()["jobs"]]
    deadline = time.monotonic() + 60
    while not (events := http.get(f"{place}?after=1").json()["events"]):
        assert time.monotonic() < deadline
        waited = http.get(f"{place}?wait=0.1").json()
        assert waited["state"] in ("queued", "running")
    assert http.get(place).json()["message"].startswith("step")
    assert events[0] == {"number": 2, "state": "running", "progress": 0.0025, "message": "step 1"}
    for wrong in ("x", "9" * 5000):
        assert http.get(f"{place}?after={wrong}").status_code == 400
    assert http.delete(place).json()["state"] == "cancelled"
    assert http.get(place).json()["problem"]["type"] == "/errors/cancelled"
    short = {"steps": 2, "pause_s": 0.0}
    made = http.post("/services/lab/Arm/count", json=short, headers={"Prefer": "respond-async"})
    done = http.get(f"{made.headers['Location']}?wait=30").json()
    assert (done["state"], done["answer"]) == ("succeeded", {"result": 2})
    assert http.get("/jobs/none").status_code == 404


def test_a_job_is_followed_as_server_sent_events(http):
    body = {"steps": 30, "pause_s": 0.02}
    made = http.post("/services/lab/Arm/count", json=body, headers={"Prefer": "respond-async"})
    place = made.headers["Location"]
    told = _events(http, place)
    *progress, (_, name, ended) = told
    assert progress
    assert {kind for _, kind, _ in progress} == {"progress"}
    shares = [said["progress"] for _, _, said in progress]
    assert shares == sorted(set(shares))
    assert (name, ended["state"], ended["answer"]) == ("ended", "succeeded", {"result": 30})
    numbers = [number for number, _, _ in told]
    assert numbers == sorted(set(numbers))
    # Whoever comes back is told the end again, and nothing that it has.
    ((again, name, ended),) = _events(http, place, **{"Last-Event-ID": str(numbers[-1])})
    assert (again, name, ended["state"]) == (numbers[-1], "ended", "succeeded")

    stuck = {"steps": 400, "pause_s": 0.1}
    made = http.post("/services/lab/Arm/count", json=stuck, headers={"Prefer": "respond-async"})
    assert http.delete(made.headers["Location"]).json()["state"] == "cancelled"
    ((_, name, ended),) = _events(http, made.headers["Location"])
    assert (name, ended["problem"]["type"]) == ("ended", "/errors/cancelled")
    headers = {"Accept": "text/event-stream"}
    assert http.get("/jobs/none", headers=headers).status_code == 404
    assert http.get(f"{place}?after=x", headers=headers).status_code == 400


def _events(http: httpx.Client, place: str, **fields: str) -> list[tuple[int, str, Any]]:
    """Return id, name and data of the events that follow a job to its end."""
    found = []
    with http.stream("GET", place, headers={"Accept": "text/event-stream", **fields}) as answer:
        assert answer.headers["Content-Type"] == "text/event-stream"
        said: dict[str, str] = {}
        for line in answer.iter_lines():
            key, _, value = line.partition(": ")
            if line:
                said[key] = value
            elif "event" in said:
                found.append((int(said["id"]), said["event"], json.loads(said["data"])))
                said = {}
    return found
