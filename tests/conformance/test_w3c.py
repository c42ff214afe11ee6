"""The W3C's own cases (w3c/rdf-tests) against a real server, over HTTP."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
W3C_GROUPS = {"protocol": 34, "gsp-indirect": 9, "gsp-direct": 4, "sd": 3}


@pytest.fixture(scope="module")
def plain(conformance_dir: Path) -> Iterator[RunningServer]:
    """A bare SPARQL 1.1 dataset."""
    with running_server(None, "--profile", "plain", "--cors", "*") as running:
        yield running


def protocol_suite(
    server: RunningServer, conformance_dir: Path, groups: str, *options: str
) -> dict[str, Any]:
    """Run the protocol cases; returns counts by group and the cases."""
    url = server.url
    command = [sys.executable, str(conformance_dir / "protocol_suite.py"), "--erase", "--json", "-"]
    addresses = ["--query", f"{url}/sparql", "--update", f"{url}/sparql", "--gsp", f"{url}/store"]
    done = subprocess.run(
        [*command, *addresses, "--groups", groups, *options],
        capture_output=True,
        text=True,
        timeout=120,
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def failures(result: dict[str, Any]) -> list[str]:
    return [f"{c['id']}: {c['why']}" for c in result["cases"] if c["result"] != "pass"]


def test_protocol_graph_store_and_description_pass_on_a_server_as_people_start_it(
    conformance_dir: Path, tmp_path: Path
) -> None:
    with running_server(tmp_path / "store") as full:
        result = protocol_suite(full, conformance_dir, ",".join(W3C_GROUPS))
    assert failures(result) == []
    assert {name: counts["pass"] for name, counts in result["groups"].items()} == W3C_GROUPS


def test_protocol_graph_store_description_and_the_further_bar_pass_on_a_plain_dataset(
    plain: RunningServer, conformance_dir: Path
) -> None:
    result = protocol_suite(plain, conformance_dir, ",".join([*W3C_GROUPS, "bar"]))
    assert failures(result) == []
    assert result["groups"]["bar"]["pass"] == 51


@pytest.fixture(scope="module")
def evaluation(
    plain: RunningServer, conformance_dir: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, dict[str, Any]]:
    """Counts and failed cases of the evaluation and syntax suites."""
    out = tmp_path_factory.mktemp("sparql11") / "result.json"
    command = [sys.executable, str(HERE / "sparql11.py"), plain.url]
    subprocess.run(
        [*command, str(conformance_dir / "sparql11"), "--json", str(out)],
        check=True,
        capture_output=True,
        timeout=200,
    )
    found: dict[str, dict[str, Any]] = json.loads(out.read_text(encoding="utf-8"))
    return found


def test_query_evaluation_deviates_exactly_where_we_know(
    evaluation: dict[str, dict[str, Any]],
) -> None:
    listed = tomllib.loads((HERE / "known_deviations.toml").read_text(encoding="utf-8"))
    known = [case for cases in listed["query_evaluation"].values() for case in cases]
    found = evaluation["query evaluation"]
    assert sorted(found["failed"]) == sorted(known), found["why"]
    assert found["total"] == 232


@pytest.mark.parametrize(
    ("group", "total"),
    [("update evaluation", 94), ("CSV results", 3), ("query syntax", 114), ("update syntax", 55)],
)
def test_the_other_groups_pass_wholly(
    evaluation: dict[str, dict[str, Any]], group: str, total: int
) -> None:
    found = evaluation[group]
    assert found["failed"] == [], found["why"]
    assert found["total"] == total
