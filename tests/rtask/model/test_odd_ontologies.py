"""Any ontology gets classes, typed ones too, however strange its names and hierarchy are."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import ontology
import rtask
from rtask.cli import main
from rtask.knowledge_base import KnowledgeBase
from rtask.model import RTASK, FieldError, LazyLoadError
from rtask.model.dynamic import Vocabulary

pytestmark = pytest.mark.slow

ODD = r"""
@prefix : <http://example.org/odd#> .
@prefix x: <http://example.org/other#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix rt: <NS> .
<http://example.org/odd> a owl:Ontology .
:Item a owl:Class ; rdfs:comment "An \"\"\"odd\"\"\" \\ item." .
x:Item a owl:Class ; rdfs:subClassOf :Item .
:class a owl:Class, owl:NamedIndividual, :Item .
:Link a owl:Class ; rdfs:subClassOf rt:Container .
:A a owl:Class ; rdfs:subClassOf :B . :B a owl:Class ; rdfs:subClassOf :A .
:1st a owl:Class . <http://example.org/odd#%C3%9C%20> a owl:Class .
:import a owl:DatatypeProperty ; rdfs:domain :Item ; rdfs:range xsd:decimal .
:iri a owl:DatatypeProperty ; rdfs:domain :Item .
:mass a owl:DatatypeProperty ; rdfs:domain :Item .
x:mass a owl:DatatypeProperty ; rdfs:domain :Item .
:annotations a owl:ObjectProperty ; rdfs:domain :Item ; rdfs:range :Link .
:steps a owl:ObjectProperty, owl:FunctionalProperty ; rdfs:domain :Item ; rdfs:range rdf:List .
:colour a owl:DatatypeProperty ; rdfs:domain rt:ManipulableObject ; rdfs:range xsd:string .
:Par a owl:Class . :Temp a owl:Class ; rdfs:subClassOf :Par .
:Lim a owl:Class ; rdfs:subClassOf :Par . :MaxLim a owl:Class ; rdfs:subClassOf :Lim .
:TempLim a owl:Class ; rdfs:subClassOf :Temp, :Lim .
:MaxTemp a owl:Class ; rdfs:subClassOf :MaxLim, :Temp .
:MaxTempLim a owl:Class ; rdfs:subClassOf :MaxTemp, :TempLim .
:None a owl:NamedIndividual, :Item . :true a owl:NamedIndividual, :Item .
""".replace("NS", ontology.NS)


@pytest.fixture
def odd(kb: KnowledgeBase) -> Vocabulary:
    kb.load(ODD.encode(), "turtle", graph="http://example.org/odd")
    return kb.model("http://example.org/odd")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("odd")
    (folder / "odd.ttl").write_text(ODD)
    with pytest.raises(SystemExit) as caught:
        main(["model", "generate", str(folder / "odd.ttl"), "--out", str(folder / "odd.py")])
    assert not caught.value.code
    return folder / "odd.py"


@pytest.fixture(scope="module")
def module(source: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("odd_classes", source)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def test_clashing_names_keywords_and_strange_ones_are_told_apart(odd: Vocabulary) -> None:
    names = set(odd.Item.__fields__)
    assert {"mass", "other_mass", "odd_import", "odd_iri", "odd_annotations", "steps"} <= names
    assert (odd.Item.__iri__, odd.OtherItem.__iri__) == (
        "http://example.org/odd#Item",
        "http://example.org/other#Item",
    )
    assert odd["http://example.org/odd#1st"].__name__.isidentifier()
    assert issubclass(odd.A, odd.B) != issubclass(odd.B, odd.A)  # a cycle is cut


def test_a_class_can_be_an_individual_too(kb: KnowledgeBase, odd: Vocabulary) -> None:
    with kb.session() as s:
        thing = s.get(odd.Item, "http://example.org/odd#class")
        assert isinstance(thing, odd.Item)
    assert odd["http://example.org/odd#class"].__name__ == "Class"


def test_generated_classes_are_those_of_rtask(module: ModuleType) -> None:
    assert issubclass(module.OddLink, RTASK.Container)
    assert "colour" in module.OddLink.__fields__
    assert "colour" not in RTASK.Container.__fields__
    assert issubclass(module.MaxTempLim, module.TempLim)  # in no order that Python knows


@pytest.mark.deep
def test_generated_classes_are_typed(source: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mypy", str(source)],
        capture_output=True,
        text=True,
        cwd=Path(rtask.__file__).parents[1],
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_generating_twice_gives_the_same_bytes(source: Path, tmp_path: Path) -> None:
    for name in ("again.py", "bundled.py"):
        given = str(source.with_name("odd.ttl")) if name == "again.py" else "bundled"
        with pytest.raises(SystemExit):
            main(["model", "generate", given, "--out", str(tmp_path / name)])
    assert (tmp_path / "again.py").read_bytes() == source.read_bytes()
    assert (tmp_path / "bundled.py").read_text() == Path(str(RTASK.__file__)).read_text()


def test_lists_keep_their_order_and_are_replaced_as_a_whole(
    kb: KnowledgeBase, odd: Vocabulary
) -> None:
    with kb.session(agent="ann") as s:
        first, second = odd.Item(iri="urn:1", mass=[1]), odd.Item(iri="urn:2", mass=[2])
        plan = odd.Item(iri="urn:plan", steps=[second, first, second, 3, "wait"])
        assert plan.steps == (second, first, second, 3, "wait")
        s.add(plan)
    with kb.session(agent="ann") as s:
        plan = s.get(odd.Item, "urn:plan")
        steps = plan.steps
        assert [getattr(step, "iri", step) for step in steps] == [
            "urn:2",
            "urn:1",
            "urn:2",
            3,
            "wait",
        ]
        assert list(steps[0].mass) == [2]
        assert s.query(odd.Item).where(odd.Item.steps == s.get(odd.Item, "urn:1")).one() is plan
        before = len(kb.match(graph=kb.graphs.agent("ann")))
        plan.steps = steps[:2]
        commit = s.flush()
        assert commit is not None
        assert plan.steps == steps[:2]
        assert len(kb.match(graph=kb.graphs.agent("ann"))) == before - 6  # three cells less
        plan.steps = []
        s.flush()
        assert plan.steps == ()
    with pytest.raises(FieldError, match="takes a list"):
        odd.Item(steps="abc")


def test_lists_of_other_files_are_read_and_broken_ones_end(
    kb: KnowledgeBase, odd: Vocabulary
) -> None:
    kb.update(
        "PREFIX : <http://example.org/odd#> PREFIX rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#>"
        " INSERT DATA { <urn:a> a :Item ; :steps (1 2 3) . <urn:b> a :Item ; :steps <urn:c> ."
        " <urn:c> rdf:first 1 ; rdf:rest <urn:c> . <urn:d> a :Item ; :steps <urn:e> }"
    )
    with kb.session() as s:
        assert s.get(odd.Item, "urn:a").steps == (1, 2, 3)
        assert s.get(odd.Item, "urn:b").steps == (1,)
        assert s.get(odd.Item, "urn:d").steps == ()
        items = s.query(odd.Item).where(odd.Item.steps == 2).all()
        assert [item.iri for item in items] == ["urn:a"]
        many = s.query(odd.Item).all()
        unread = next(item for item in many if item.iri == "urn:a")
        s.refresh(unread)
        assert unread.steps == (1, 2, 3)
    with kb.session() as s:
        first = next(item for item in s.query(odd.Item).all() if item.iri == "urn:a")
        with pytest.raises(LazyLoadError, match="steps"):
            _ = first.steps


def test_a_deep_hierarchy_has_classes(tmp_path: Path) -> None:
    from rtask.model.dynamic import build
    from rtask.model.schema import read_schema
    from rtask.ontology_docs import read_source

    lines = ["@prefix o: <http://www.w3.org/2002/07/owl#> ."]
    lines += ["@prefix s: <http://www.w3.org/2000/01/rdf-schema#> ."]
    lines += [f"<urn:C{n}> a o:Class ; s:subClassOf <urn:C{n + 1}> ." for n in range(150)]
    (tmp_path / "deep.ttl").write_text("\n".join([*lines, "<urn:C150> a o:Class ."]))
    (module,) = read_source(str(tmp_path / "deep.ttl"))
    onto = build(read_schema(module.triples))
    assert issubclass(onto["urn:C0"], onto["urn:C150"])
