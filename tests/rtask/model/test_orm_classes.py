"""The generated classes follow the ontology, and any ontology gets classes like them."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pyoxigraph as ox
import pytest

import ontology
import rtask
from rtask.errors import UnknownTermError
from rtask.knowledge_base import KnowledgeBase
from rtask.model import RTASK, FieldError, load_model
from rtask.model.dynamic import build
from rtask.model.generate import generate_rtask
from rtask.model.instance import required
from rtask.model.limits import Limits
from rtask.model.schema import read_schema

pytestmark = pytest.mark.slow

SHOP = """
@prefix : <http://example.org/shop#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix rt: <NS> .

<http://example.org/shop> a owl:Ontology .
:Article a owl:Class ; rdfs:comment "Something for sale." .
:Toy a owl:Class ; rdfs:subClassOf :Article, rt:ManipulableObject .
:class a owl:Class .
:price a owl:DatatypeProperty, owl:FunctionalProperty ; rdfs:domain :Article ;
    rdfs:range xsd:decimal .
:soldBy a owl:ObjectProperty ; rdfs:domain :Article ; rdfs:range :Shop ; owl:inverseOf :sells .
:sells a owl:ObjectProperty .
:Shop a owl:Class .
:colour a owl:DatatypeProperty ; rdfs:domain rt:ManipulableObject .
:tag a owl:DatatypeProperty ; rdfs:domain [ a owl:Class ; owl:unionOf ( :Article :Shop ) ] .
""".replace("NS", ontology.NS)


@pytest.fixture
def shop(kb: KnowledgeBase) -> KnowledgeBase:
    with kb.transaction() as tx:
        tx.load(SHOP.encode(), "text/turtle", graph="http://example.org/shop")
    return kb


def test_generated_classes_are_current() -> None:
    path = Path(str(RTASK.__file__))
    advice = "run python -c 'from rtask.model.generate import write_rtask; write_rtask()'"
    assert path.read_text(encoding="utf-8") == generate_rtask(), advice


def test_every_class_of_the_vocabulary_is_there() -> None:
    quads = [q for path in ontology.modules() for q in ox.parse(path=str(path))]
    owl_class = ox.NamedNode(ontology.PREFIXES["owl"] + "Class")
    iris = {
        q.subject.value
        for q in quads
        if q.object == owl_class and isinstance(q.subject, ox.NamedNode)
    }
    public = {iri for iri in iris if "#_" not in iri}
    made = {model.__iri__ for model in RTASK.REGISTRY}
    assert made == public | {ontology.PREFIXES["owl"] + "Thing"}


def test_bases_are_the_superclasses() -> None:
    assert issubclass(RTASK.Mug, RTASK.DrinkingVessel)
    assert issubclass(RTASK.Mug, RTASK.Container)
    assert issubclass(RTASK.GraspAttempt, RTASK.Activity)
    assert not issubclass(RTASK.Pen, RTASK.Container)


def test_equal_names_get_the_prefix_of_their_vocabulary() -> None:
    assert RTASK.Observation.__iri__ == ontology.NS + "Observation"
    assert issubclass(RTASK.Observation, RTASK.SosaObservation)
    assert RTASK.ProvAgent.__iri__ == ontology.PREFIXES["prov"] + "Agent"
    assert issubclass(RTASK.Agent, RTASK.ProvAgent)


def test_docstrings_carry_comment_iri_and_units() -> None:
    text = RTASK.ManipulableObject.__doc__ or ""
    assert "Gatto 2016" in text
    assert "``rt:ManipulableObject``" in text
    assert "The mass of the object. [KiloGM]" in text


def test_cardinalities_come_from_ontology_and_shapes() -> None:
    fields = RTASK.ManipulableObject.__fields__
    assert fields["object_id"].functional
    assert fields["mass"].single
    assert not fields["mass"].functional
    assert not fields["name"].single
    assert required(RTASK.Mug) == {"object_id"}
    assert fields["mass"].limits.above == 0.0
    assert fields["mass"].unit == "KiloGM"


def test_a_dynamic_class_behaves_like_a_generated_one(shop: KnowledgeBase) -> None:
    onto = load_model(shop, "http://example.org/shop")
    with shop.session(agent="clerk") as s:
        toy = onto.Toy(iri="urn:toy", object_id="shop/toy-1", price=3, tag=["new"], mass=0.2)
        toy.colour = "red"
        s.add(onto.Shop(iri="urn:shop", sells=toy))
    with shop.session() as s:
        found = s.query(onto.Article).where(onto.Article.sold_by == "urn:shop").one()
        assert isinstance(found, onto.Toy)
        assert isinstance(found, RTASK.ManipulableObject)
        assert (found.price, list(found.tag), found.mass) == (3, ["new"], 0.2)
        assert list(found.colour) == ["red"]
        assert s.query(RTASK.ManipulableObject).count() == 1
    with shop.session() as s:
        assert isinstance(s.query(RTASK.ManipulableObject).one(), onto.Toy)
    with pytest.raises(FieldError, match="takes a Decimal"):
        onto.Article(price="cheap")


def test_decimals_are_sorted_as_numbers(shop: KnowledgeBase) -> None:
    onto = load_model(shop, "http://example.org/shop")
    prices = [Decimal("10.5"), Decimal("9.5"), Decimal("100")]
    with shop.session(agent="clerk") as s:
        for number, price in enumerate(prices):
            s.add(onto.Toy(object_id=f"shop/toy-{number}", price=price))
    with shop.session() as s:
        toys = s.query(onto.Toy).order_by(onto.Toy.price).all()
        assert [toy.price for toy in toys] == sorted(prices)


def test_a_decimal_is_finite_and_within_its_limits(shop: KnowledgeBase) -> None:
    onto = load_model(shop, "http://example.org/shop")
    with pytest.raises(FieldError, match="takes a finite Decimal"):
        onto.Article(price=Decimal("NaN"))
    assert Limits(least=0.0).complaint(Decimal("-0.01")) == "0.0 or more"
    assert Limits(least=0.0).complaint(Decimal("0.01")) is None


def test_dynamic_classes_are_found_by_name_and_iri(shop: KnowledgeBase) -> None:
    onto = load_model(shop, "http://example.org/shop")
    assert onto["http://example.org/shop#Toy"] is onto.Toy
    assert onto["http://example.org/shop#class"].__name__ == "Class"
    assert "Something for sale." in onto.Article.__doc__
    with pytest.raises(AttributeError, match="did you mean 'Toy'"):
        _ = onto.Toys
    with pytest.raises(UnknownTermError, match="no class"):
        _ = onto["urn:nothing"]
    with pytest.raises(UnknownTermError, match="load"):
        load_model(shop, "http://example.org/nothing")


def test_terms_of_the_vocabulary_are_its_own_classes(shop: KnowledgeBase) -> None:
    onto = load_model(shop, "http://example.org/shop")
    assert onto[ontology.NS + "Mug"] is RTASK.Mug


def test_an_object_of_unrelated_classes_is_an_instance_of_both(lab: KnowledgeBase) -> None:
    with lab.session(agent="nao-1") as s:
        robot = lab.base + "robot/nao-1"
        found = s.get(RTASK.Robot, robot)
        assert isinstance(found, RTASK.ManipulatorRobot)


@pytest.mark.parametrize(
    "name", ["cora/cora-bare.owl", "w3c/time.ttl", "w3c/ssn.ttl", "rtask2020/pos.owl"]
)
def test_real_ontologies_give_classes(name: str, ontologies_dir: Path) -> None:
    path = ontologies_dir / name
    form = ox.RdfFormat.RDF_XML if path.suffix == ".owl" else ox.RdfFormat.TURTLE
    triples = [(q.subject, q.predicate, q.object) for q in ox.parse(path.read_bytes(), form)]
    vocabulary = build(read_schema(triples))
    assert len(list(vocabulary)) > 5


def test_circular_hierarchies_do_not_stop_it() -> None:
    text = """
    @prefix : <http://example.org/o#> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
    @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
    :A a owl:Class ; rdfs:subClassOf :B, :A . :B a owl:Class ; rdfs:subClassOf :C .
    :C a owl:Class ; rdfs:subClassOf :A . :D a owl:Class ; rdfs:subClassOf :A, :B, :C .
    """
    triples = [
        (q.subject, q.predicate, q.object) for q in ox.parse(text, format=ox.RdfFormat.TURTLE)
    ]
    onto = build(read_schema(triples, primary="http://example.org/o#"))
    assert {"A", "B", "C", "D"} <= set(dir(onto))


def test_classes_that_order_their_bases_differently_can_be_combined() -> None:
    """Python's own method resolution order (C3) refuses Q: B is before C in one base only."""
    text = """
    @prefix : <http://example.org/o#> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
    @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
    :B a owl:Class . :C a owl:Class .
    :X1 a owl:Class ; rdfs:subClassOf :C . :X2 a owl:Class ; rdfs:subClassOf :B .
    :Y1 a owl:Class ; rdfs:subClassOf :B . :Y2 a owl:Class ; rdfs:subClassOf :C .
    :P1 a owl:Class ; rdfs:subClassOf :X1, :X2 . :P2 a owl:Class ; rdfs:subClassOf :Y1, :Y2 .
    :Q a owl:Class ; rdfs:subClassOf :P1, :P2 .
    """
    triples = [
        (q.subject, q.predicate, q.object) for q in ox.parse(text, format=ox.RdfFormat.TURTLE)
    ]
    onto = build(read_schema(triples, primary="http://example.org/o#"))
    assert issubclass(onto.Q, onto.B)
    assert issubclass(onto.Q, onto.C)


def test_importing_loads_nothing_heavy() -> None:
    import subprocess
    import sys

    code = "import rtask.model, sys; print([m for m in ('rdflib', 'numba') if m in sys.modules])"
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "[]"


def test_sessions_come_from_the_knowledge_base() -> None:
    with rtask.open(":memory:") as kb, kb.session(agent="nao-1") as s:
        assert s.query(RTASK.Robot).count() == 0
