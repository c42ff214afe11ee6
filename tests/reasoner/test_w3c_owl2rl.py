"""The OWL 2 RL cases of the W3C OWL Working Group's test catalogue, where they are present."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pyoxigraph as ox
import pytest

from reasoner import Closure
from reasoner.dl.profile import check_profile
from reasoner.entail import entails

BESIDE = os.environ.get(
    "RTASK_SHARED_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"
)
FOLDER = Path(BESIDE).parent / "conformance" / "owl2rl"
TOTALS = {
    "PositiveEntailmentTest": 32,
    "NegativeEntailmentTest": 7,
    "ConsistencyTest": 79,
    "InconsistencyTest": 14,
}
INAPPLICABLE = {
    "WebOnt-imports-013": "identifies a profile; nothing is to be entailed and consistency is not "
    "asked (see test_a_case_that_only_identifies_the_profile)",
}
"""Cases of profile RL that are not run, by name, each with the reason. The other 398 of the 492
cases of the catalogue are not of this profile.
"""


def cases() -> Iterator[tuple[dict, str]]:
    manifest = FOLDER / "manifest.json"
    if not manifest.exists():
        return
    for case in json.loads(manifest.read_text()):
        if case["id"] not in INAPPLICABLE:
            for kind in case["types"]:
                yield case, kind


CASES = list(cases())


def triples(case: dict, part: str) -> list:
    text = (FOLDER / case["dir"] / f"{part}.nt").read_bytes()
    return [
        (q.subject, q.predicate, q.object) for q in ox.parse(text, format=ox.RdfFormat.N_TRIPLES)
    ]


@pytest.fixture(scope="module")
def closures() -> dict[str, Closure]:
    return {}


@pytest.mark.skipif(not CASES, reason="the OWL 2 RL cases are not beside the checkout")
@pytest.mark.parametrize(("case", "kind"), CASES, ids=[f"{c['id']}-{k}" for c, k in CASES])
def test_case(case, kind, closures):
    name = case["id"]
    if name not in closures:
        closures[name] = Closure.build(triples(case, "premise"), [])
    closure = closures[name]
    is_consistent = not closure.contradictions()
    if kind == "ConsistencyTest":
        assert is_consistent
    elif kind == "InconsistencyTest":
        assert not is_consistent
    else:
        positive = kind == "PositiveEntailmentTest"
        goal = triples(case, "conclusion" if positive else "nonconclusion")
        semantics = "direct" if "DIRECT" in case["semantics"] else "rl"
        assert (entails(closure, goal, semantics).answer is True) is positive


@pytest.mark.skipif(not CASES, reason="the OWL 2 RL cases are not beside the checkout")
def test_every_applicable_case_is_run():
    kinds = [kind for _, kind in CASES]
    assert {kind: kinds.count(kind) for kind in TOTALS} == TOTALS
    present = {path.name for path in (FOLDER / "cases").iterdir()}
    assert present == {Path(case["dir"]).name for case, _ in CASES} | INAPPLICABLE.keys()


@pytest.mark.skipif(not CASES, reason="the OWL 2 RL cases are not beside the checkout")
@pytest.mark.parametrize("name", INAPPLICABLE)
def test_a_case_that_only_identifies_the_profile(name):
    assert check_profile(triples({"dir": f"cases/{name}"}, "premise")) == []
