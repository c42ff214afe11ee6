"""What changed is answered by beliefs of two states, also by those that are no longer held."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.asking.questions import answer
from rtask.errors import UnsupportedError

_PREFIX = "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "


def test_beliefs_of_yesterday_are_compared_with_those_of_today(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", base="urn:lab/", reason=False) as kb:
        kb.load(ontology.path("examples/sample.trig"))
        kb.update(_PREFIX + 'INSERT DATA { <urn:lab/object/9> a rt:ManipulableObject ; '
                  'rt:objectId "x/9" ; rt:name "tin" }')  # fmt: skip
        before = dt.datetime.now(dt.UTC)
        since = f"what has changed since {before.isoformat()}?"
        assert answer(kb, since).sentence.startswith("No belief changed since 20")
        (cause,) = kb.match(None, ontology_term("causeProbability"))
        with kb.transaction() as tx:
            tx.remove_quads([cause])
            tx.add(cause.subject, cause.predicate, 0.8, graph=cause.graph_name)
        kb.update(_PREFIX + 'DELETE { ?o rt:name "tin" } INSERT { ?o rt:name "red tin" } '
                  'WHERE { ?o rt:name "tin" }')  # fmt: skip
        found = answer(kb, since)
        assert found.sentence == (
            "Mug is slippery from -40 to 10 mm: 62 % before, 80 % now; object 9 is called: tin "
            "before, red tin now."
        )
        assert found.why[1] == "/resource?iri=urn%3Alab%2Fobject%2F9"
        new = answer(kb, "what changed today?", now=before + dt.timedelta(minutes=1))
        assert "mug is slippery from -40 to 10 mm: 80 %, which is new" in new.sentence.lower()
        with kb.transaction() as tx:
            tx.remove_quads(list(kb.match(cause.subject, None, None)))
        assert "no longer believed (it was 62 %)" in answer(kb, since).sentence


def ontology_term(name: str) -> str:
    return ontology.NS + name


def test_a_graph_without_earlier_states_says_so() -> None:
    with rtask.open(":memory:") as kb, pytest.raises(UnsupportedError, match="keeps no journal"):
        answer(kb, "what changed since yesterday?")
