"""The SHACL cases of the W3C and of pySHACL through `kb.validate()`."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from tests.conformance.shacl_core import SUITES, find_suites, quiet, run

pytestmark = pytest.mark.deep

TOTALS = {"SHACL core, W3C": 98, "SHACL with SPARQL, W3C": 23, "SHACL core, pySHACL's own": 85}


@pytest.fixture(scope="module")
def suites(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    found = find_suites(tmp_path_factory.mktemp("shacl"))
    if not found:
        pytest.skip("pip could not download pySHACL's source package; RTASK_SHACL_CASES names one")
    return found


@pytest.mark.parametrize("name", SUITES)
def test_the_cases_deviate_exactly_where_we_know(name: str, suites: dict[str, Path]) -> None:
    quiet()
    listed = tomllib.loads(
        Path(__file__).with_name("known_deviations.toml").read_text(encoding="utf-8")
    )
    known = [case for cases in listed["shacl"][name].values() for case in cases]
    total, failed = run(suites[name])
    assert total == TOTALS[name]
    assert sorted(failed) == sorted(known), failed
