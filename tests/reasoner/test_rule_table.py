"""Each rule of OWL 2 Profiles 4.3, tables 4 to 9: what it derives, or what it forbids."""

from __future__ import annotations

import pytest

from reasoner import Closure
from tests.reasoner.ttl import triple, triples

RESTRICTION = ":r owl:onProperty :p ; "

DERIVES = {
    "eq-sym": (":a owl:sameAs :b", ":b owl:sameAs :a"),
    "eq-trans": (":a owl:sameAs :b . :b owl:sameAs :c", ":a owl:sameAs :c"),
    "eq-rep-s": (":a owl:sameAs :b . :a :p :x", ":b :p :x"),
    "eq-rep-p": (":p owl:sameAs :q . :a :p :x", ":a :q :x"),
    "eq-rep-o": (":a owl:sameAs :b . :x :p :a", ":x :p :b"),
    "eq-rep-o, class": (":C owl:sameAs :D . :x a :C", ":x a :D"),
    "eq-rep-s, schema": (":C owl:sameAs :D . :C rdfs:subClassOf :E . :x a :D", ":x a :E"),
    "prp-dom": (":p rdfs:domain :C . :a :p :b", ":a a :C"),
    "prp-rng": (":p rdfs:range :C . :a :p :b", ":b a :C"),
    "prp-fp": (":p a owl:FunctionalProperty . :a :p :b, :c", ":b owl:sameAs :c"),
    "prp-ifp": (":p a owl:InverseFunctionalProperty . :a :p :c . :b :p :c", ":a owl:sameAs :b"),
    "prp-ifp, literals of one value": (
        ':p a owl:InverseFunctionalProperty . :a :p "1"^^xsd:byte . :b :p 1.0',
        ":a owl:sameAs :b",
    ),
    "prp-symp": (":p a owl:SymmetricProperty . :a :p :b", ":b :p :a"),
    "prp-trp": (":p a owl:TransitiveProperty . :a :p :b . :b :p :c", ":a :p :c"),
    "prp-spo1": (":p rdfs:subPropertyOf :q . :a :p :b", ":a :q :b"),
    "prp-spo1, type": (":p rdfs:subPropertyOf rdf:type . :a :p :C", ":a a :C"),
    "prp-spo1, schema": (
        ":p rdfs:subPropertyOf rdfs:subClassOf . :C :p :D . :x a :C",
        ":x a :D",
    ),
    "prp-spo2, one link": (":p owl:propertyChainAxiom (:q) . :a :q :b", ":a :p :b"),
    "prp-spo2, two links": (":p owl:propertyChainAxiom (:q :r) . :a :q :b . :b :r :c", ":a :p :c"),
    "prp-spo2, four links": (
        ":p owl:propertyChainAxiom (:q :r :q :r) . :a :q :b . :b :r :c . :c :q :d . :d :r :e",
        ":a :p :e",
    ),
    "prp-eqp1": (":p owl:equivalentProperty :q . :a :p :b", ":a :q :b"),
    "prp-eqp2": (":p owl:equivalentProperty :q . :a :q :b", ":a :p :b"),
    "prp-inv1": (":p owl:inverseOf :q . :a :p :b", ":b :q :a"),
    "prp-inv2": (":p owl:inverseOf :q . :a :q :b", ":b :p :a"),
    "prp-key": (
        ':C owl:hasKey (:k :l) . :a a :C ; :k "1", "3" ; :l :x . :b a :C ; :k "3" ; :l :x',
        ":a owl:sameAs :b",
    ),
    "cls-int1": (":C owl:intersectionOf (:D :E) . :a a :D, :E", ":a a :C"),
    "cls-int2": (":C owl:intersectionOf (:D :E) . :a a :C", ":a a :E"),
    "cls-uni": (":C owl:unionOf (:D :E) . :a a :E", ":a a :C"),
    "cls-svf1": (RESTRICTION + "owl:someValuesFrom :C . :a :p :b . :b a :C", ":a a :r"),
    "cls-svf1, datatype": (RESTRICTION + "owl:someValuesFrom xsd:byte . :a :p 7", ":a a :r"),
    "cls-svf2": (RESTRICTION + "owl:someValuesFrom owl:Thing . :a :p :b", ":a a :r"),
    "cls-avf": (RESTRICTION + "owl:allValuesFrom :C . :a a :r ; :p :b", ":b a :C"),
    "cls-hv1": (RESTRICTION + "owl:hasValue :v . :a a :r", ":a :p :v"),
    "cls-hv2": (RESTRICTION + "owl:hasValue :v . :a :p :v", ":a a :r"),
    "cls-hv2, by value": (
        RESTRICTION + "owl:hasValue true . :a :p '1'^^xsd:boolean",
        ":a a :r",
    ),
    "cls-maxc2": (
        RESTRICTION + 'owl:maxCardinality "1"^^xsd:int . :a a :r ; :p :b, :c',
        ":b owl:sameAs :c",
    ),
    "cls-maxqc3": (
        RESTRICTION + "owl:maxQualifiedCardinality 1 ; owl:onClass :C . "
        ":a a :r ; :p :b, :c . :b a :C . :c a :C",
        ":b owl:sameAs :c",
    ),
    "cls-maxqc4": (
        RESTRICTION + "owl:maxQualifiedCardinality 1 ; owl:onClass owl:Thing . :a a :r ; :p :b, :c",
        ":b owl:sameAs :c",
    ),
    "cls-oo": (":C owl:oneOf (:a :b)", ":b a :C"),
    "cax-sco": (":C rdfs:subClassOf :D . :a a :C", ":a a :D"),
    "cax-eqc1": (":C owl:equivalentClass :D . :a a :C", ":a a :D"),
    "cax-eqc2": (":C owl:equivalentClass :D . :a a :D", ":a a :C"),
    "scm-sco": (":C rdfs:subClassOf :D . :D rdfs:subClassOf :E", ":C rdfs:subClassOf :E"),
    "scm-eqc1": (":C owl:equivalentClass :D", ":D rdfs:subClassOf :C"),
    "scm-eqc2": (
        ":C rdfs:subClassOf :D . :D rdfs:subClassOf :C",
        ":C owl:equivalentClass :D",
    ),
    "scm-spo": (":p rdfs:subPropertyOf :q . :q rdfs:subPropertyOf :r", ":p rdfs:subPropertyOf :r"),
    "scm-eqp1": (":p owl:equivalentProperty :q", ":q rdfs:subPropertyOf :p"),
    "scm-eqp2": (
        ":p rdfs:subPropertyOf :q . :q rdfs:subPropertyOf :p",
        ":p owl:equivalentProperty :q",
    ),
    "scm-dom1": (":p rdfs:domain :C . :C rdfs:subClassOf :D", ":p rdfs:domain :D"),
    "scm-dom2": (":q rdfs:domain :C . :p rdfs:subPropertyOf :q", ":p rdfs:domain :C"),
    "scm-rng1": (":p rdfs:range :C . :C rdfs:subClassOf :D", ":p rdfs:range :D"),
    "scm-rng2": (":q rdfs:range :C . :p rdfs:subPropertyOf :q", ":p rdfs:range :C"),
    "scm-hv": (
        ":c owl:hasValue :v ; owl:onProperty :p . :d owl:hasValue :v ; owl:onProperty :q . "
        ":p rdfs:subPropertyOf :q",
        ":c rdfs:subClassOf :d",
    ),
    "scm-svf1": (
        ":c owl:someValuesFrom :C ; owl:onProperty :p . "
        ":d owl:someValuesFrom :D ; owl:onProperty :p . :C rdfs:subClassOf :D",
        ":c rdfs:subClassOf :d",
    ),
    "scm-svf2": (
        ":c owl:someValuesFrom :C ; owl:onProperty :p . "
        ":d owl:someValuesFrom :C ; owl:onProperty :q . :p rdfs:subPropertyOf :q",
        ":c rdfs:subClassOf :d",
    ),
    "scm-avf1": (
        ":c owl:allValuesFrom :C ; owl:onProperty :p . "
        ":d owl:allValuesFrom :D ; owl:onProperty :p . :C rdfs:subClassOf :D",
        ":c rdfs:subClassOf :d",
    ),
    "scm-avf2": (
        ":c owl:allValuesFrom :C ; owl:onProperty :p . "
        ":d owl:allValuesFrom :C ; owl:onProperty :q . :p rdfs:subPropertyOf :q",
        ":d rdfs:subClassOf :c",
    ),
    "scm-int": (":C owl:intersectionOf (:D :E)", ":C rdfs:subClassOf :D"),
    "scm-uni": (":C owl:unionOf (:D :E)", ":D rdfs:subClassOf :C"),
}

FORBIDS = {
    "eq-diff1": ":a owl:sameAs :b ; owl:differentFrom :b",
    "eq-diff2": "_:x a owl:AllDifferent ; owl:members (:a :b :c) . :a owl:sameAs :c",
    "eq-diff3": "_:x a owl:AllDifferent ; owl:distinctMembers (:a :b :c) . :a owl:sameAs :c",
    "prp-fp": ":p a owl:FunctionalProperty . :a :p 1, 2",
    "prp-irp": ":p a owl:IrreflexiveProperty . :a :p :a",
    "prp-asyp": ":p a owl:AsymmetricProperty . :a :p :b . :b :p :a",
    "prp-pdw": ":p owl:propertyDisjointWith :q . :a :p :b ; :q :b",
    "prp-adp": "_:x a owl:AllDisjointProperties ; owl:members (:p :q :r) . :a :p :b ; :r :b",
    "prp-npa1": "_:x owl:sourceIndividual :a ; owl:assertionProperty :p ; "
    "owl:targetIndividual :b . :a :p :b",
    "prp-npa2": "_:x owl:sourceIndividual :a ; owl:assertionProperty :p ; "
    "owl:targetValue 1 . :a :p '1.0'^^xsd:decimal",
    "cls-nothing2": ":a a owl:Nothing",
    "cls-com": ":C owl:complementOf :D . :a a :C, :D",
    "cls-maxc1": RESTRICTION + "owl:maxCardinality 0 . :a a :r ; :p :b",
    "cls-maxc2": RESTRICTION + "owl:maxCardinality 1 . :a a :r ; :p 1, 2",
    "cls-maxqc1": RESTRICTION + "owl:maxQualifiedCardinality 0 ; owl:onClass :C . "
    ":a a :r ; :p :b . :b a :C",
    "cls-maxqc2": RESTRICTION + "owl:maxQualifiedCardinality 0 ; owl:onClass owl:Thing . "
    ":a a :r ; :p :b",
    "cax-dw": ":C owl:disjointWith :D . :a a :C, :D",
    "cax-adc": "_:x a owl:AllDisjointClasses ; owl:members (:C :D :E) . :a a :C, :E",
    "dt-not-type": ":p rdfs:range xsd:byte . :a :p 300",
}

# What is not known is no contradiction: a datatype that nobody here knows may hold the value.
ALLOWS = {
    "dt-not-type": ":p rdfs:range xsd:string . :a :p '0 0 1'^^:vector",
    "dt-not-type, equivalent": ":vector owl:equivalentClass xsd:string . "
    ":p rdfs:range :vector . :a :p '0 0 1'^^:vector",
    "dt-not-type, only": RESTRICTION
    + "owl:allValuesFrom xsd:double . :a a :r ; :p '1/2'^^owl:rational",
    "prp-fp": ":p a owl:FunctionalProperty . :a :p '1/2'^^owl:rational, '2/4'^^owl:rational, .5",
    "cls-maxc2": RESTRICTION + "owl:maxCardinality 1 . :a a :r ; :p 'a'^^:vector, 'b'^^:vector",
}


VIRTUAL = {
    "eq-ref": ":a owl:sameAs :a",
    "cls-thing": "owl:Thing rdfs:subClassOf owl:Thing",
    "cls-nothing1": "owl:Nothing rdfs:subClassOf owl:Thing",
    "scm-cls": ":C rdfs:subClassOf :C",
    "scm-cls, top": ":C rdfs:subClassOf owl:Thing",
    "scm-cls, bottom": "owl:Nothing rdfs:subClassOf :C",
    "scm-cls, equivalent": ":C owl:equivalentClass :C",
    "scm-op": ":p rdfs:subPropertyOf :p",
    "scm-dp": ":d owl:equivalentProperty :d",
    "dt-type1": "xsd:byte a rdfs:Datatype",
    "dt-eq": ":a :d '1'^^xsd:integer",
}
DECLARATIONS = ":C a owl:Class . :p a owl:ObjectProperty . :d a owl:DatatypeProperty . :a :d 1.0"


@pytest.mark.parametrize("rule", ALLOWS)
def test_what_is_not_known_contradicts_nothing(rule):
    facts = triples(ALLOWS[rule] + " .")
    assert not Closure.build(facts, []).contradictions()
    staged = Closure.build([], []).stage(facts, [])
    assert not staged.contradictions


def test_a_date_is_known_to_be_no_text_and_xml_no_number():
    for value in ("'2026-01-01'^^xsd:date", "'<a/>'^^rdf:XMLLiteral"):
        facts = triples(f":p rdfs:range xsd:string . :a :p {value} .")
        assert [c.rule for c in Closure.build(facts, []).contradictions()] == ["dt-not-type"]


@pytest.mark.parametrize("rule", DERIVES)
def test_rule_derives(rule):
    premise, conclusion = DERIVES[rule]
    closure = Closure.build(triples(premise + " ."), [])
    assert closure.contains(triple(conclusion))
    assert triple(conclusion) in set(closure.inferred())
    assert not closure.contradictions()


@pytest.mark.parametrize("rule", DERIVES)
def test_every_premise_is_needed(rule):
    premise, conclusion = DERIVES[rule]
    facts = triples(premise + " .")
    closure = Closure.build(facts, [])
    for fact in facts:
        # A value that is one of several may be there for nothing but the rule's generality.
        if str(fact[2]) == '"1"' or fact[0] == fact[2]:
            continue
        staged = closure.stage(remove=[fact])
        if triple(conclusion) in staged.inferred_removed:
            staged.discard()
            continue
        assert "oneOf" in premise or "intersectionOf" in premise or "unionOf" in premise
        staged.discard()


@pytest.mark.parametrize("rule", FORBIDS)
def test_rule_forbids(rule):
    closure = Closure.build(triples(FORBIDS[rule] + " ."), [])
    assert [c.rule for c in closure.contradictions()] == [rule]


@pytest.mark.parametrize("rule", FORBIDS)
def test_a_clash_appears_with_its_last_premise_and_goes_with_it(rule):
    facts = triples(FORBIDS[rule] + " .")
    last = facts[-1]
    closure = Closure.build(facts[:-1], [])
    assert not closure.contradictions()
    staged = closure.stage(add=[last])
    assert [c.rule for c in staged.contradictions] == [rule]
    staged.apply()
    assert closure.contradictions()
    closure.stage(remove=[last]).apply()
    assert not closure.contradictions()


@pytest.mark.parametrize("rule", VIRTUAL)
def test_what_is_true_of_everything_is_known_and_not_stored(rule):
    closure = Closure.build(triples(DECLARATIONS + " ."), [])
    assert closure.contains(triple(VIRTUAL[rule]))
    assert triple(VIRTUAL[rule]) not in set(closure.inferred())


@pytest.mark.parametrize(
    "not_derived",
    [":a owl:sameAs :b", ":C rdfs:subClassOf :D", ":C rdfs:subClassOf owl:Nothing", ":a :d 2"],
)
def test_what_does_not_follow_is_not_known(not_derived):
    closure = Closure.build(triples(DECLARATIONS + " . :D a owl:Class . :b :d 1 ."), [])
    assert not closure.contains(triple(not_derived))


def test_literals_never_become_subjects():
    closure = Closure.build(
        triples(
            ":p owl:inverseOf :q . :s a owl:SymmetricProperty . :p rdfs:range :C . :a :p 1 ; :s 2 ."
        ),
        [],
    )
    assert list(closure.inferred()) == []


def test_types_as_anonymous_classes_stay_inside():
    closure = Closure.build(
        triples("[ owl:onProperty :p ; owl:someValuesFrom :C ] rdfs:subClassOf :D ."),
        triples(":a :p :b . :b a :C ."),
    )
    assert list(closure.inferred()) == [triple(":a a :D")]


def test_an_axiom_about_everything_reaches_all_individuals():
    closure = Closure.build(
        triples("owl:Thing rdfs:subClassOf :D . :C a owl:Class . :p a owl:ObjectProperty ."),
        triples(":a a :C . :b :p :c ."),
    )
    assert all(closure.contains(triple(f":{x} a :D")) for x in "abc")


@pytest.mark.parametrize(
    ("bad_list", "message"),
    [
        ("_:l rdf:first :D", "0 rdf:rest"),
        ("_:l rdf:first :D, :E ; rdf:rest rdf:nil", "2 rdf:first"),
        ("_:l rdf:first :D ; rdf:rest _:l", "circle"),
    ],
)
def test_an_axiom_with_a_bad_list_is_ignored_and_reported(bad_list, message):
    closure = Closure.build(triples(f":C owl:unionOf _:l . {bad_list} . :x a :D, :E ."), [])
    assert not closure.contains(triple(":x a :C"))
    (problem,) = closure.stats()["problems"]
    assert message in problem
    assert "urn:t:C" in problem
