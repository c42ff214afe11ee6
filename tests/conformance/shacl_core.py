"""Run cases of SHACL through RTASK: the W3C's test suite, and DASH test cases such as pySHACL's.

    python shacl_core.py [FOLDER] [--json FILE]

FOLDER holds ``data-shapes-test-suite/tests/core`` of the W3C, or ``*.test.ttl`` files such as
``test/resources/dash_tests/core`` of pySHACL's source package. Without it, that package, which
carries both, is taken from the folder that ``RTASK_SHACL_CASES`` names, or downloaded with pip in
the version installed here; each of its suites gives one line. The graph of each case is loaded
into a new graph without ontology or reasoner and checked by ``kb.validate()``; focus node, value,
severity and number of results are compared, blank nodes aside. A case that passes in pySHACL alone
and not here would be a fault of ours.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import subprocess
import sys
import tarfile
import tempfile
import warnings
from collections import Counter
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pyoxigraph as ox

import rtask
from rtask.errors import DataError, RtaskError
from rtask.rdf.terms import stored

RESULTS = """PREFIX sh: <http://www.w3.org/ns/shacl#> PREFIX dash: <http://datashapes.org/dash#>
PREFIX sht: <http://www.w3.org/ns/shacl-test#>
PREFIX mf: <http://www.w3.org/2001/sw/DataAccess/tests/test-manifest#>
SELECT ?result ?focus ?value ?severity {
  { ?case a dash:GraphValidationTestCase ; dash:expectedResult/sh:result ?result }
  UNION { ?case a sht:Validate ; mf:result/sh:result ?result }
  ?result sh:focusNode ?focus ; sh:resultSeverity ?severity OPTIONAL { ?result sh:value ?value }
}"""
CASE = """PREFIX dash: <http://datashapes.org/dash#> PREFIX sht: <http://www.w3.org/ns/shacl-test#>
PREFIX mf: <http://www.w3.org/2001/sw/DataAccess/tests/test-manifest#>
SELECT ?case ?data ?shapes ?result {
  { ?case a dash:GraphValidationTestCase }
  UNION {
    ?case a sht:Validate ; mf:result ?result
    OPTIONAL { ?case mf:action/sht:dataGraph ?data }
    OPTIONAL { ?case mf:action/sht:shapesGraph ?shapes }
  }
}"""
FAILURE = "http://www.w3.org/ns/shacl-test#Failure"
"""Result of a case whose shapes a processor must refuse."""

SUITES = {
    "SHACL core, W3C": "sht_tests/core",
    "SHACL with SPARQL, W3C": "sht_tests/sparql",
    "SHACL core, pySHACL's own": "dash_tests/core",
}
"""Folders of cases in pySHACL's source package, below ``test/resources``."""

Result = tuple[str, str | None, str]


def written(term: object) -> str:
    """Return a term as text; blank nodes are all alike, also those that were given an IRI."""
    return "_:" if str(term).startswith("_:") or "/.well-known/genid/" in str(term) else str(term)


@dataclass(frozen=True)
class Case:
    """What one file asks for."""

    data: list[Path]
    """The files of its data and shapes."""
    results: Counter[Result]
    is_failure: bool


def case_of(path: Path) -> Case | None:
    """Return the case of a file, or None if it holds none."""
    store = ox.Store()
    store.load(path=path, format=ox.RdfFormat.TURTLE, base_iri=path.as_uri())
    cases = list(store.query(CASE))  # type: ignore[arg-type]
    if not cases:
        return None
    graphs = {
        row[name].value for row in cases for name in ("data", "shapes") if row[name] is not None
    }
    files = sorted(Path(unquote(urlsplit(graph).path)) for graph in graphs - {path.as_uri()})
    results: Counter[Result] = Counter()
    for row in store.query(RESULTS):  # type: ignore[union-attr]
        value = None if row["value"] is None else written(stored(row["value"]))
        severity = row["severity"].value.removeprefix("http://www.w3.org/ns/shacl#")
        results[written(stored(row["focus"])), value, severity] += 1
    is_failure = any(str(row["result"]) == f"<{FAILURE}>" for row in cases)
    own = [path] if path.as_uri() in graphs or not graphs else []
    return Case([*own, *files], results, is_failure)


def actual(case: Case) -> Counter[Result]:
    """Return the results of RTASK."""
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        for path in case.data:
            kb.load(path, base=path.as_uri(), missing_imports="ignore")
        report = kb.validate()
        if case.is_failure and report.left_out:
            raise DataError("; ".join(report.left_out))
        if not any(name.startswith("file:") or "(" in name for name in report.shapes):
            raise AssertionError("no shape of the case was applied")
    return Counter(
        (written(v.focus), None if v.value is None else written(v.value), v.severity)
        for v in report
    )


def why_failed(case: Case) -> str | None:
    """Return why a case fails, or None if it passes."""
    try:
        got = actual(case)
    except Exception as error:  # noqa: BLE001 - one case must not end the run
        if case.is_failure and isinstance(error, RtaskError):
            return None
        return f"{type(error).__name__}: {error}"[:300]
    if case.is_failure:
        return "its shapes should have been refused"
    if case.results != got:
        return f"missing {[*(case.results - got)]}, surplus {[*(got - case.results)]}"
    return None


def run(folder: Path) -> tuple[int, dict[str, str]]:
    """Run all cases of a folder; return their number, and why each one that fails does."""
    cases = {path: case_of(path) for path in sorted(folder.rglob("*.ttl"))}
    reasons = {
        str(path.relative_to(folder)): why_failed(case)
        for path, case in cases.items()
        if case is not None
    }
    return len(reasons), {name: why for name, why in reasons.items() if why is not None}


def find_suites(download_to: Path | None = None) -> dict[str, Path]:
    """Return the folders of cases by name; empty if the package is not here and cannot be had.

    Parameters
    ----------
    download_to
        Where pip puts pySHACL's source package if ``RTASK_SHACL_CASES`` names no folder of it.
    """
    named = os.environ.get("RTASK_SHACL_CASES")
    root = Path(named) if named else None
    if root is None and download_to is not None:
        wanted = f"pyshacl=={metadata.version('pyshacl')}"
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps"]
        options = ["--no-binary", "pyshacl", "--dest", str(download_to), wanted]
        subprocess.run([*command, *options], check=False, capture_output=True, timeout=300)
        for archive in download_to.glob("*.tar.gz"):
            with tarfile.open(archive) as packed:
                packed.extractall(download_to, filter="data")
            root = next(path for path in download_to.iterdir() if path.is_dir())
    if root is None:
        return {}
    folders = {name: root / "test" / "resources" / below for name, below in SUITES.items()}
    return {name: folder for name, folder in folders.items() if folder.is_dir()}


def quiet() -> None:
    """Keep the remarks of rdflib and pySHACL on ill-typed literals, which some cases are about."""
    logging.getLogger("rdflib.term").setLevel(logging.CRITICAL)
    warnings.simplefilter("ignore")


def main() -> int:
    """Run the cases and print the count; the exit code is 1 if there are none."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    quiet()
    counts: dict[str, dict[str, object]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        suites = {"SHACL": options.folder} if options.folder else find_suites(Path(scratch))
        for name, folder in suites.items():
            total, failed = run(folder.resolve())
            sys.stdout.write(f"{name}: {total - len(failed)} of {total}\n")
            for case, why in failed.items():
                sys.stdout.write(f"  {case}: {why}\n")
            counts[name] = {"passed": total - len(failed), "total": total, "failed": failed}
    if not suites:
        sys.stderr.write(
            "no cases: pip could not download pySHACL's source package; name a FOLDER\n"
        )
        return 1
    if options.json:
        options.json.write_text(json.dumps(counts, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
