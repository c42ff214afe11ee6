"""SHACL and the profile checker on small inputs."""

from __future__ import annotations

import pytest

from reasoner.dl.profile import check_profile
from reasoner.shacl import ShapesError, validate
from tests.reasoner.ttl import triple, triples

SHAPES = """
@prefix sh: <http://www.w3.org/ns/shacl#> .
:MugShape a sh:NodeShape ; sh:targetClass :Mug ;
  sh:property [ sh:path :width ; sh:minCount 1 ; sh:datatype xsd:double ;
                sh:message "a mug has a width" ] .
"""


def test_shacl_reports_focus_path_and_message():
    data = triples(":good a :Mug ; :width 0.08e0 . :bad a :Mug .")
    report = validate(data, triples(SHAPES))
    assert not report.conforms
    (finding,) = report.findings
    assert finding.focus == triple(":bad a :x")[0]
    assert finding.path == "<urn:t:width>"
    assert (finding.message, finding.severity) == ("a mug has a width", "Violation")


def test_shacl_validates_only_the_focus_nodes():
    data = triples(":good a :Mug ; :width 0.08e0 . :bad a :Mug .")
    good, bad = data[0][0], data[2][0]
    shapes = triples(SHAPES)
    assert validate(data, shapes, focus=[good]).conforms
    assert validate(data, shapes, focus=[bad]).findings == validate(data, shapes).findings
    assert validate(data, shapes, focus=[]).conforms


def test_neither_ill_typed_data_nor_bad_shapes_print_anything(capfd):
    data = triples(':bad a :Mug ; :width "wide"^^xsd:integer, "2020-13-45"^^xsd:date .')
    assert not validate(data, triples(SHAPES)).conforms
    bad = SHAPES.replace("sh:minCount 1", 'sh:minCount "1"')
    with pytest.raises(ShapesError, match="minCount"):
        validate(data, triples(bad))
    assert capfd.readouterr() == ("", "")


QUERY_SHAPES = """
@prefix sh: <http://www.w3.org/ns/shacl#> .
:prefixes sh:declare [ sh:prefix "t" ; sh:namespace "urn:t:"^^xsd:anyURI ] .
:FitShape a sh:NodeShape ; sh:targetClass :Mug ;
  sh:sparql [ sh:message "it fits" ; sh:prefixes :prefixes ;
              sh:select "SELECT $this ?value { $this t:fits ?value FILTER(?value != $this) }" ] ,
            [ sh:message "it is too wide" ; sh:prefixes :prefixes ;
              sh:select "SELECT $this { $this t:width ?w FILTER(?w > 1) }" ] .
"""


def test_a_query_of_a_shape_answers_for_each_focus_node_and_is_parsed_once(monkeypatch):
    from rdflib.plugins import sparql

    parsed = []
    prepare = sparql.prepareQuery
    monkeypatch.setattr(
        sparql, "prepareQuery", lambda text, **more: parsed.append(text) or prepare(text, **more)
    )
    mugs = "".join(f":m{n} a :Mug ; :fits :m{n}, :m{n - n % 2} ; :width {n} ." for n in range(9))
    report = validate(triples(mugs), triples(QUERY_SHAPES))
    found = {(one.focus.value, one.message, str(one.value)) for one in report.findings}
    assert found == {
        *((f"urn:t:m{n}", "it fits", f"<urn:t:m{n - 1}>") for n in (1, 3, 5, 7)),
        *((f"urn:t:m{n}", "it is too wide", f"<urn:t:m{n}>") for n in range(2, 9)),
    }
    assert len(parsed) == len(set(parsed)) == 2


RESTRICTION = "[ a owl:Restriction ; owl:onProperty :p ; {} ]"


@pytest.mark.parametrize(
    ("axiom", "construct"),
    [
        (f":C rdfs:subClassOf {RESTRICTION.format('owl:someValuesFrom :D')}", "someValuesFrom"),
        (f"{RESTRICTION.format('owl:allValuesFrom :D')} rdfs:subClassOf :C", "allValuesFrom"),
        (f":C rdfs:subClassOf {RESTRICTION.format('owl:maxCardinality 2')}", "maxCardinality"),
        (":C rdfs:subClassOf [ owl:unionOf (:D :E) ]", "unionOf"),
        (":C owl:equivalentClass [ owl:unionOf (:D :E) ]", "unionOf"),
        (":C owl:unionOf (:D :E)", "unionOf"),
        (":C owl:disjointUnionOf (:D :E)", "disjointUnionOf"),
        (":p a owl:ReflexiveProperty", "ReflexiveProperty"),
        ("owl:Thing rdfs:subClassOf :C", "Thing"),
        (":p rdfs:range xsd:duration", "datatype"),
        (":p a owl:TransitiveProperty, owl:FunctionalProperty", "non-simple property"),
        (
            ":p a owl:AsymmetricProperty . :q rdfs:subPropertyOf :p ; "
            "owl:propertyChainAxiom (:r :r)",
            "non-simple property",
        ),
        (
            ":p owl:propertyChainAxiom (:q :r) . :q owl:propertyChainAxiom (:p :r)",
            "irregular chain",
        ),
        (":p a owl:ObjectProperty, owl:DatatypeProperty", "declaration"),
    ],
)
def test_what_leaves_the_profile_is_named(axiom, construct):
    found = check_profile(triples(axiom + " ."))
    assert construct in {violation.construct for violation in found}


@pytest.mark.parametrize(
    "axiom",
    [
        f"{RESTRICTION.format('owl:someValuesFrom :D')} rdfs:subClassOf :C",
        f":C rdfs:subClassOf {RESTRICTION.format('owl:allValuesFrom xsd:byte')}",
        f":C rdfs:subClassOf {RESTRICTION.format('owl:maxCardinality 1')}",
        ":C rdfs:subClassOf [ owl:complementOf :D ]",
        "[ owl:unionOf (:D :E) ] rdfs:subClassOf :C",
        ":C owl:equivalentClass [ owl:intersectionOf (:D :E) ]",
        ":p owl:propertyChainAxiom (:p :q)",
        ":p owl:propertyChainAxiom (:q :p)",
        ":p a owl:TransitiveProperty ; owl:inverseOf :q",
    ],
)
def test_what_the_profile_allows_is_not_reported(axiom):
    assert check_profile(triples(axiom + " .")) == []


def test_cora_has_the_violations_that_are_known(ontologies_dir):
    import pyoxigraph as ox

    store = ox.Store()
    for path in sorted((ontologies_dir / "cora").glob("*.owl")):
        if "fullaxiom" not in path.name:
            store.load(path=str(path), format=ox.RdfFormat.RDF_XML)
    found = check_profile([(q.subject, q.predicate, q.object) for q in store])
    positions = [violation.position for violation in found]
    # 34 superclass expressions, 6 disjoint unions, 1 equivalence with a union
    assert {p: positions.count(p) for p in positions} == {
        "superclass": 34,
        "axiom": 6,
        "equivalent class": 1,
    }
