"""Queries that explain themselves, aggregates over groups, and notes on statements."""

from __future__ import annotations

import datetime as dt
import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import rtask
from rtask.errors import UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.model import RTASK, FieldError, Session, avg, count, maximum, total
from rtask.model.query import compile as compiled

pytestmark = pytest.mark.slow

G = RTASK.GraspConfiguration
THING = RTASK.ManipulableObject
_late = itertools.count()


# Numbers


def test_numbers_of_one_path_do_not_multiply_those_of_another(still_lab: KnowledgeBase) -> None:
    """The mug has two grasps and one name: its mass must not be summed twice."""
    with still_lab.session() as s:
        (row,) = (
            s.query(RTASK.Mug)
            .group_by(RTASK.Mug.name)
            .aggregate(
                n=count(),
                mass=total(RTASK.Mug.mass),
                grasps=count(RTASK.Mug.has_grasp),
                best=maximum(RTASK.Mug.has_grasp.grasp_quality),
                mean=avg(RTASK.Mug.has_grasp.grasp_quality),
            )
        )
    assert row == {"name": "mug", "n": 1, "mass": 0.3, "grasps": 2, "best": 0.9, "mean": 0.75}


def test_columns_may_have_any_name(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        numbers = (
            s.query(G).where(G.grasp_quality > 0.1).aggregate(group0=count(), _1=count(G.name))
        )
    assert numbers == {"group0": 3, "_1": 0}


def test_a_path_of_another_class_has_no_numbers(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s, pytest.raises(UsageError, match="does not begin"):
        s.query(RTASK.Mug).aggregate(n=count(RTASK.Frame.frame_id))


# Explaining, caching


def test_explain_shows_where_nothing_is_left(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        query = s.query(G).where(G.grasp_quality > 0.7).where(G.grasp_of.name == "spoon")
        lines = query.prefetch(G.grasp_of).limit(3).explain().splitlines()
        assert "then all of them from number 2 on" in s.query(G).offset(2).explain()
    counts = [int(line.split()[0]) for line in lines[:3]]
    assert counts == [3, 2, 0]
    assert "GraspConfiguration.grasp_of.name" in lines[2]
    assert any("grasp_of: a ManipulableObject" in line for line in lines)
    assert "SELECT DISTINCT ?root" in "\n".join(lines)


def test_a_question_about_another_value_is_not_compiled_again(
    still_lab: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    with still_lab.session() as s:
        texts = [
            s.query(G).where(G.grasp_of.name == n, G.grasp_quality > 0.1).sparql() for n in "ab"
        ]
        monkeypatch.setattr(compiled, "_object_text", lambda plan: pytest.fail("compiled again"))
        third = s.query(G).where(G.grasp_of.name == 'c"', G.grasp_quality > 0.2).sparql()
    assert texts[0].replace('"a"', '"b"') == texts[1]
    assert '"c\\""' in third
    assert "0.2" in third


def test_other_shapes_are_compiled_anew(still_lab: KnowledgeBase) -> None:
    name = THING.name
    with still_lab.session() as s:
        query = s.query(THING)
        texts = {
            query.where(condition).sparql()
            for condition in (
                name == "x",
                name != "x",
                ~(name == "x"),
                (name == "x") | (name == "y"),
                (name == "x") & (name == "y"),
                name.in_(["x"]),
                name.in_(["x", "y"]),
                name.contains("x"),
                name.contains("x", ignore_case=True),
                name.matches("x"),
                name.is_none(),
                THING.surface_material == "x",
            )
        }
        assert len(texts) == 12
        assert query.limit(1).sparql() != query.limit(2).sparql()


def test_a_class_that_comes_later_is_seen(kb: KnowledgeBase) -> None:
    """The cache of a class is renewed when another class is made below it."""
    number = next(_late)  # classes outlive a test, which runs more than once in a process
    late, teeth = f"urn:late{number}", f"teeth{number}"
    with kb.session() as s:
        before = s.query(RTASK.Tool).sparql()
        kb.load(
            f"@prefix o: <http://www.w3.org/2002/07/owl#> . "
            f"@prefix s: <http://www.w3.org/2000/01/rdf-schema#> . "
            f"<{late}> a o:Ontology . <{late}#Saw> a o:Class ; s:subClassOf "
            f"<https://w3id.org/rtask-kg/ns#Tool> . <{late}#{teeth}> a o:DatatypeProperty ; "
            f"s:domain <{late}#Saw> .".encode(),
            "turtle",
            graph=late,
        )
        model = kb.model(late)
        assert teeth not in before
        assert teeth in s.query(RTASK.Tool).sparql()
    with kb.session("ann") as s:
        s.add(model.Saw(**{"object_id": "lab/saw", teeth: [40]}))
    with kb.session() as s:
        assert list(getattr(s.query(RTASK.Tool).one(), teeth)) == [40]


# Notes on statements


def test_a_statement_carries_confidence(lab: KnowledgeBase) -> None:
    until = dt.datetime(2030, 1, 1, tzinfo=dt.UTC)
    with lab.session("nao-1") as s:
        mug = s.get(RTASK.Mug, lab.base + "object/1")
        s.annotate(mug, "mass", confidence=0.6, valid_until=until)
        s.annotate(mug, "name", "mug", confidence=1.0)
        assert mug.annotations("mass") == []
    with lab.session() as s:
        mug = s.get(RTASK.Mug, lab.base + "object/1")
        (note,) = mug.annotations("mass")
        assert (note.value, note.confidence, note.notes["valid_until"]) == (0.3, 0.6, [until])
        assert [n.confidence for n in mug.annotations("name")] == [1.0]
        assert mug.annotations("grasp_width") == []
        assert mug.mass == 0.3


def test_a_note_belongs_to_the_agent_and_says_of_what(lab: KnowledgeBase) -> None:
    with lab.session("pr2") as s:
        mug = s.get(RTASK.Mug, lab.base + "object/1")
        s.annotate(mug, "mass", confidence=0.2)
        mug.name.add("cup")
        with pytest.raises(UsageError, match="say which"):
            s.annotate(mug, "name", confidence=0.2)
        with pytest.raises(UsageError, match="no field 'masss'"):
            s.annotate(mug, "masss", confidence=0.2)
        with pytest.raises(FieldError, match="takes a number"):
            s.annotate(mug, "mass", confidence="high")
    quads = lab.match(graph=lab.graphs.agent("pr2"))
    assert any(quad.predicate.value.endswith("reifies") for quad in quads)


# Text that attacks


@pytest.fixture(scope="module")
def store() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", reason=False) as kb:
        yield kb


HOSTILE = st.one_of(
    st.text(alphabet=st.characters(exclude_categories=["Cs", "Cc"]), max_size=60),
    st.sampled_from(
        [
            '"',
            "\\",
            '" } # ',
            "'''",
            '"""',
            "?root",
            "<urn:x>",
            "\\u0022",
            "\u2028",
            "${x}",
            "{0}",
            "a\tb",
            "\ufeff",
            "\U0010ffff",
            '" ) } ; DROP ALL ; INSERT { ?s ?p "',
        ]
    ),
)


@settings(
    max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(text=HOSTILE, number=st.integers(0, 10**9))
def test_hostile_text_is_written_and_found_again(
    store: KnowledgeBase, text: str, number: int
) -> None:
    """Written, read, compared, searched and deleted as what it is, and nothing else changes."""
    iri = f"urn:t:{number}"
    before = len(store.store)
    with Session(store, "ann", check_required=False) as s:
        s.add(THING(iri=iri, name=[text], surface_material=text or "none"))
    name = THING.name
    with Session(store, "ann") as s:
        found = s.query(THING).where(name == text, name.contains(text), name.in_([text, "?"]))
        assert found.ids() == [iri]
        thing = s.get(THING, iri)
        assert list(thing.name) == [text]
        thing.surface_material = "clean"
        s.flush()
        s.delete(thing)
    assert store.match(iri) == []
    assert len(store.store) >= before  # provenance grows, data do not


TYPED = """
from __future__ import annotations

from collections.abc import Iterator
from typing import Any, assert_type

import rtask
from rtask.model import RTASK, Path, avg, count

with rtask.open(":memory:") as kb, kb.session("nao-1") as s:
    mug = RTASK.Mug(object_id="lab/mug-1", mass=0.3)
    s.add(mug)
    mass: float | None = mug.mass
    for grasp in s.query(RTASK.PlanarGrasp).where(RTASK.PlanarGrasp.grasp_quality > 0.5):
        quality: float | None = grasp.grasp_quality
        for thing in grasp.grasp_of:
            held: float | None = thing.mass
    best: RTASK.PlanarGrasp | None = s.query(RTASK.PlanarGrasp).first()
    G = RTASK.GraspConfiguration
    pairs = s.query(G).values(G.grasp_quality, G.name)
    assert_type(pairs, Iterator[tuple[float | None, str | None]])
    assert_type(next(s.query(G).values(G.grasp_of, batch=10)), tuple[str | None])
    far: Path[float] = G.grasp_of.mass
    assert_type(next(s.query(G).values(far, G.grasp_of.name)), tuple[float | None, Any | None])
    heavy = s.query(G).where(far == 1, far != 2.5, far.in_([1, 2.5]), G.name == "spoon")
    of_mug = s.query(G).where(G.grasp_of == mug, G.grasp_of != "urn:x", G.grasp_of == mug.iri)
    nine = (far, far, far, far, far, far, far, far, far)
    assert_type(next(s.query(G).values(*nine)), tuple[Any, ...])
    rows = s.query(RTASK.Mug).group_by(RTASK.Mug.name).aggregate(n=count(), m=avg(RTASK.Mug.mass))
"""
WRONG = {
    'mug.mass = "heavy"': "Incompatible types in assignment",
    'RTASK.Mug(mass="heavy")': 'has incompatible type "str"',
    "text: str = mug.mass": "Incompatible types in assignment",
    "mug.masss": 'has no attribute "masss"',
    "RTASK.Mug(masss=1.0)": 'Unexpected keyword argument "masss"',
    "words: str = next(s.query(G).values(G.name, G.grasp_quality))[1]": "Incompatible types",
    "for one, two, three in s.query(G).values(G.name, far): pass": "Need more than 2 values",
    "s.query(G).values('grasp_quality')": "No overload variant",
    's.query(G).where(far < "heavy")': "Unsupported operand types",
    's.query(RTASK.Mug).where(RTASK.Mug.mass < "x")': 'for < ("Path[float]" and "str")',
    's.query(RTASK.Mug).where("x" > RTASK.Mug.mass)': 'for > ("str" and "Path[float]")',
    's.query(RTASK.Mug).where(RTASK.Mug.mass == "x")': 'has incompatible type "bool"',
    's.query(G).where(far == "heavy")': 'has incompatible type "bool"; expected "Condition"',
    's.query(G).where((far != "x") | (far > 1.0))': 'No overload variant of "__or__" of "bool"',
    's.query(G).where(far.in_(["heavy"]))': 'has incompatible type "str"',
    's.query(G).where(far.between(0, "heavy"))': 'has incompatible type "str"',
    "s.query(G).filter()": 'has no attribute "filter"',
    "s.get(RTASK.Mug, 'urn:x').tried_in": 'has no attribute "tried_in"',
}


def test_a_checker_knows_every_field(tmp_path: Path) -> None:
    """Right lines pass mypy --strict; each wrong one is an error before it runs."""
    import subprocess
    import sys

    lines = [*TYPED.splitlines(), *(f"    {wrong}" for wrong in WRONG)]
    (tmp_path / "typed.py").write_text("\n".join(lines) + "\n")
    command = [sys.executable, "-m", "mypy", str(tmp_path / "typed.py")]
    root = Path(rtask.__file__).parents[1]
    done = subprocess.run(command, capture_output=True, text=True, cwd=root, check=False)
    found = {
        int(line.split(":")[1]): line for line in done.stdout.splitlines() if ": error:" in line
    }
    first = len(TYPED.splitlines()) + 1
    assert set(found) == set(range(first, first + len(WRONG))), done.stdout
    for number, message in enumerate(WRONG.values(), first):
        assert message in found[number]
