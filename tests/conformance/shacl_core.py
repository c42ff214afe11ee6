"""Run SHACL cases written as DASH test cases (the W3C core suite, pySHACL's tests) through RTASK.

    python shacl_core.py FOLDER [--json FILE]

FOLDER holds ``*.test.ttl`` files, such as ``test/resources/dash_tests/core`` of pySHACL's source
package. Each file is loaded into a new graph without ontology or reasoner and checked by
``kb.validate()``; focus node, value, severity and number of results are compared, blank nodes
aside. A case that passes in pySHACL alone and not here would be a fault of ours.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

import pyoxigraph as ox

import rtask
from rtask.rdf.terms import stored

EXPECTED = """PREFIX sh: <http://www.w3.org/ns/shacl#> PREFIX dash: <http://datashapes.org/dash#>
SELECT ?result ?focus ?value ?severity {
  ?case a dash:GraphValidationTestCase ; dash:expectedResult/sh:result ?result .
  ?result sh:focusNode ?focus ; sh:resultSeverity ?severity OPTIONAL { ?result sh:value ?value }
}"""

Result = tuple[str, str | None, str]


def written(term: object) -> str:
    """Return a term as text; blank nodes are all alike."""
    return "_:" if str(term).startswith("_:") else str(term)


def expected(path: Path) -> Counter[Result]:
    """Return the results that a case lists."""
    store = ox.Store()
    store.load(path=path, format=ox.RdfFormat.TURTLE, base_iri=path.as_uri())
    found: Counter[Result] = Counter()
    for row in store.query(EXPECTED):  # type: ignore[union-attr]
        value = None if row["value"] is None else written(stored(row["value"]))
        severity = row["severity"].value.removeprefix("http://www.w3.org/ns/shacl#")
        found[written(stored(row["focus"])), value, severity] += 1
    return found


def actual(path: Path) -> Counter[Result]:
    """Return the results of RTASK."""
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        kb.load(path, base=path.as_uri(), missing_imports="ignore")
        report = kb.validate()
        if not any(str(path.as_uri()) in name or "(" in name for name in report.shapes):
            raise AssertionError("no shape of the case was applied")
    return Counter(
        (written(v.focus), None if v.value is None else written(v.value), v.severity)
        for v in report
    )


def run(folder: Path) -> dict[str, str]:
    """Run all cases of a folder; return why each one that fails does."""
    failed = {}
    for path in sorted(folder.rglob("*.test.ttl")):
        try:
            wanted, got = expected(path), actual(path)
        except Exception as error:  # noqa: BLE001 - one case must not end the run
            failed[str(path.relative_to(folder))] = f"{type(error).__name__}: {error}"[:300]
            continue
        if wanted != got:
            missing, more = wanted - got, got - wanted
            failed[str(path.relative_to(folder))] = f"missing {[*missing]}, surplus {[*more]}"
    return failed


def main() -> int:
    """Run the cases and print the count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    total = sum(1 for _ in options.folder.rglob("*.test.ttl"))
    failed = run(options.folder)
    sys.stdout.write(f"SHACL: {total - len(failed)} of {total}\n")
    for name, why in failed.items():
        sys.stdout.write(f"  {name}: {why}\n")
    if options.json:
        counts = {"passed": total - len(failed), "total": total, "failed": failed}
        options.json.write_text(json.dumps(counts, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
