"""The questions that the vocabulary exists to answer."""

from __future__ import annotations

import shlex
from pathlib import Path

import pyoxigraph as ox
import pytest

import ontology

pytestmark = pytest.mark.slow

QUERIES = ontology.queries()


def _header(text: str, word: str) -> str:
    lines = [line for line in text.splitlines() if line.startswith(f"# {word}: ")]
    assert len(lines) == 1, f"a query has one '# {word}:' line"
    return lines[0].removeprefix(f"# {word}: ")


def test_the_questions_are_numbered() -> None:
    assert [path.name for path in QUERIES] == [f"cq{n:02}.rq" for n in range(1, 31)]


@pytest.fixture(scope="module", params=["engine", pytest.param("owlrl", marks=pytest.mark.deep)])
def sample_closed(request: pytest.FixtureRequest):  # type: ignore[no-untyped-def]
    return request.getfixturevalue(f"closed_by_{request.param}")


@pytest.mark.parametrize("path", QUERIES, ids=lambda path: path.stem)
def test_question_has_its_answer(path: Path, sample_closed) -> None:  # type: ignore[no-untyped-def]
    text = path.read_text()
    assert _header(text, "question").endswith("?")
    expected = sorted(tuple(shlex.split(row)) for row in _header(text, "expected").split("; "))
    assert sorted(sample_closed.rows(text)) == expected


def test_a_hidden_cause_of_no_known_kind_is_told_as_a_zone() -> None:
    store = ox.Store()
    store.load(
        b"""@prefix : <https://w3id.org/rtask-kg/kb/sample/> .
        @prefix rt: <https://w3id.org/rtask-kg/ns#> . @prefix prov: <http://www.w3.org/ns/prov#> .
        :mug rt:hasHiddenCause :c . :c a rt:GraspZone ; rt:zoneStart -0.04e0 ; rt:zoneEnd 0.01e0 ;
          rt:causeProbability 0.5e0 ; prov:wasDerivedFrom :attempt .""",
        ox.RdfFormat.TURTLE,
    )
    (query,) = [path for path in QUERIES if path.stem == "cq23"]
    rows = store.query(query.read_text())
    assert isinstance(rows, ox.QuerySolutions)
    (row,) = rows
    assert [str(row[name]) for name in ("what", "attempts")] == [
        str(ox.Literal("zone")),
        str(ox.Literal(1)),
    ]


@pytest.mark.deep
def test_two_engines_derive_the_same_about_the_sample(closed_by_engine, closed_by_owlrl) -> None:  # type: ignore[no-untyped-def]
    """Apart from what only owlrl writes down: sameAs itself, owl:Thing, nameless classes."""
    owl = ontology.PREFIXES["owl"]
    base = ontology.BASE + "sample/"

    def about_individuals(closed) -> set[str]:  # type: ignore[no-untyped-def]
        return {
            f"{s} {p} {o}"
            for s, p, o in closed.triples()
            if getattr(s, "value", "").startswith(base)
            and p.value != owl + "sameAs"
            and getattr(o, "value", "") != owl + "Thing"
            and not isinstance(o, ox.BlankNode)
        }

    assert about_individuals(closed_by_engine) == about_individuals(closed_by_owlrl)
