"""Run the standards' own test suites against this checkout; one line each.

    python tests/conformance/report.py [FOLDER]

FOLDER holds the cases (`protocol_suite.py`, `sparql11/`); by default it is looked for beside the
checkout, or where `RTASK_SHARED_DATA` points. The report says "passes N of M cases of
w3c/rdf-tests"; it is no claim of conformance by the W3C.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.conformance.shacl_core import find_suites, quiet, run
from tests.servers import running_server

HERE = Path(__file__).resolve().parent
NAMES = {
    "protocol": "SPARQL 1.1 Protocol",
    "gsp-indirect": "Graph Store Protocol, indirect",
    "gsp-direct": "Graph Store Protocol, direct",
    "sd": "Service Description (checks not W3C's)",
    "bar": "further HTTP behaviour (checks not W3C's)",
}


def find_cases() -> Path:
    """Return the folder of the cases, or end with what to do."""
    if len(sys.argv) > 1:
        return Path(sys.argv[1])
    named = os.environ.get("RTASK_SHARED_DATA")
    root = HERE.parents[1].parent
    candidates = [Path(named).parent / "conformance"] if named else []
    candidates += [suite.parent for suite in root.glob("*/conformance/protocol_suite.py")]
    for folder in candidates:
        if (folder / "protocol_suite.py").is_file():
            return folder
    sys.exit("the cases are not here; name their folder, or set RTASK_SHARED_DATA")


def say(profile: str, name: str, passed: int, total: int, remark: str = "") -> None:
    """Write one line."""
    sys.stdout.write(f"{profile:6} {name:42} {passed} of {total}{remark}\n")
    sys.stdout.flush()


def protocol(url: str, cases: Path, groups: str) -> dict[str, dict[str, int]]:
    """Run the protocol cases; returns counts by group."""
    command = [sys.executable, str(cases / "protocol_suite.py"), "--erase", "--json", "-"]
    addresses = ["--query", f"{url}/sparql", "--update", f"{url}/sparql", "--gsp", f"{url}/store"]
    done = subprocess.run(
        [*command, *addresses, "--groups", groups], capture_output=True, text=True, check=False
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return dict(found["groups"])


def evaluation(url: str, cases: Path, folder: Path) -> dict[str, dict[str, Any]]:
    """Run the evaluation and syntax cases; returns counts by group."""
    out = folder / "sparql11.json"
    command = [sys.executable, str(HERE / "sparql11.py"), url, str(cases / "sparql11")]
    subprocess.run([*command, "--json", str(out)], check=True, capture_output=True)
    return dict(json.loads(out.read_text(encoding="utf-8")))


def shacl(folder: Path) -> None:
    """Report the SHACL suites of pySHACL's source package, or say that it could not be had."""
    quiet()
    suites = find_suites(folder)
    for name, place in suites.items():
        total, failed = run(place)
        say("", name, total - len(failed), total, ", ".join(["", *failed]).replace(",", ";", 1))
    if not suites:
        sys.stdout.write("SHACL: skipped, pip could not download pySHACL's source package\n")


def main() -> None:
    """Start a server of each profile and report."""
    cases = find_cases()
    with tempfile.TemporaryDirectory() as folder:
        with running_server(Path(folder) / "store") as full:
            groups = "protocol,gsp-indirect,gsp-direct,sd"
            for name, counts in protocol(full.url, cases, groups).items():
                say("full", NAMES[name], counts["pass"], sum(counts.values()))
        with running_server(None, "--profile", "plain", "--cors", "*") as plain:
            groups = "protocol,gsp-indirect,gsp-direct,sd,bar"
            for name, counts in protocol(plain.url, cases, groups).items():
                say("plain", NAMES[name], counts["pass"], sum(counts.values()))
            for name, found in evaluation(plain.url, cases, Path(folder)).items():
                exact = f" by value, {found['as_written']} with literals as written"
                say("plain", f"SPARQL 1.1 {name}", found["passed"], found["total"], exact)
        shacl(Path(folder))


if __name__ == "__main__":
    main()
