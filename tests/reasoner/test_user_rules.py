"""Rules of the user: what a CONSTRUCT text may say, what it derives, what is refused."""

from __future__ import annotations

import pyoxigraph as ox
import pytest
from hypothesis import given, settings

from reasoner import Closure, LabelledRule, RuleError, StratificationError
from tests.reasoner.naive import consequences
from tests.reasoner.ttl import triple, triples
from tests.reasoner.worlds import NARROW

PREFIX = "PREFIX : <urn:t:> PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>\n"


def derived(rule: str, data: str, schema: str = "") -> list[str]:
    closure = Closure.build(triples(schema), triples(data), [PREFIX + rule])
    return sorted(
        " ".join(getattr(x, "value", "").removeprefix("urn:t:") for x in t)
        for t in closure.inferred()
    )


@pytest.mark.parametrize(
    ("where", "data", "expected"),
    [
        ("?a :p ?b", ":a :p :b .", ["a out b"]),
        ("?a :p/:q ?b", ":a :p :x . :x :q :b .", ["a out b"]),
        ("?a ^:p ?b", ":b :p :a .", ["a out b"]),
        ("?a (:p|:q)/^:r ?b", ":a :p :x . :c :q :x . :b :r :x .", ["a out b", "c out b"]),
        ("{ ?a :p ?b } UNION { ?a :q ?b }", ":a :p :b . :c :q :d .", ["a out b", "c out d"]),
        ("?a :p ?b FILTER (?b > 3)", ":a :p 3, 4, 5.5e0 .", ["a out 4", "a out 5.5e0"]),
        ("?a :p ?b FILTER (?b <= 4 && ?b != 3)", ":a :p 3, 4, 5 .", ["a out 4"]),
        ("?a :p ?b FILTER (?b = 3 || ?b >= 5)", ":a :p 3, 4, 5 .", ["a out 3", "a out 5"]),
        ("?a :p ?b FILTER (!(?b = 3))", ":a :p 3, 4 .", ["a out 4"]),
        ("?a :p ?b FILTER (?b IN (3, :x))", ":a :p 3, 4, :x .", ["a out 3", "a out x"]),
        ("?a :p ?b FILTER (?b NOT IN (3, :x))", ":a :p 3, 4, :x .", ["a out 4"]),
        ("?a :p ?b FILTER (STR(?b) = 'urn:t:x')", ":a :p 3, :x .", ["a out x"]),
        ("?a :p ?b FILTER (DATATYPE(?b) = xsd:integer)", ":a :p 3, '3' .", ["a out 3"]),
        ("?a :p ?x BIND (?x * 2 + 1 AS ?b)", ":a :p 3 .", ["a out 7"]),
        ("?a :p ?x BIND (ABS(1.5 - ?x) AS ?b)", ":a :p 3 .", ["a out 1.5"]),
        ("?a :p ?x BIND (-?x AS ?b)", ":a :p 3.5e0 .", ["a out -3.5"]),
        ("?a :p ?x BIND (IF(?x > 2, 'big', 'small') AS ?b)", ":a :p 3 .", ["a out big"]),
        (
            "?a :p ?b FILTER (?b < '2026-01-01T10:00:00+01:00'^^xsd:dateTime)",
            ":a :p '2026-01-01T08:59:00Z'^^xsd:dateTime, '2026-01-01T09:01:00Z'^^xsd:dateTime .",
            ["a out 2026-01-01T08:59:00Z"],
        ),
        ("?a :p ?b FILTER EXISTS { ?b :q ?any }", ":a :p :b, :c . :b :q :x .", ["a out b"]),
        ("?a :p ?b FILTER NOT EXISTS { ?b :q ?any }", ":a :p :b, :c . :b :q :x .", ["a out c"]),
        ("?a :p ?b FILTER (!EXISTS { ?b :q ?any })", ":a :p :b, :c . :b :q :x .", ["a out c"]),
        ("?a :p ?b MINUS { ?b :q ?any }", ":a :p :b, :c . :b :q :x .", ["a out c"]),
        ("?a :p ?b MINUS { ?x :q ?any }", ":a :p :b . :b :q :x .", ["a out b"]),
        (
            "?a :p ?b FILTER NOT EXISTS { { ?b :q :x } UNION { ?b :r :x } }",
            ":a :p :b, :c, :d . :b :q :x . :c :r :x .",
            ["a out d"],
        ),
        ("?a :p [ :q ?b ]", ":a :p :x . :x :q :b .", ["a out b"]),
    ],
)
def test_pattern_derives(where, data, expected):
    assert derived(f"CONSTRUCT {{ ?a :out ?b }} WHERE {{ {where} }}", data) == expected


def test_an_error_in_a_filter_is_false_unless_the_other_side_decides():
    rule = "CONSTRUCT { ?a :out ?b } WHERE { ?a :p ?b FILTER (?b > 2 || ?b = :x) }"
    assert derived(rule, ":a :p 3, :x, :y .") == ["a out 3", "a out x"]


def test_several_template_triples_are_all_derived():
    rule = "CONSTRUCT { ?a :out ?b . ?b a :C } WHERE { ?a :p ?b }"
    assert derived(rule, ":a :p :b .") == [
        "a out b",
        "b http://www.w3.org/1999/02/22-rdf-syntax-ns#type C",
    ]


def test_a_variable_that_a_pattern_repeats_is_one_term_at_first_and_later():
    rule = PREFIX + "CONSTRUCT { ?a :out ?a } WHERE { ?a :p ?a }"
    closure = Closure.build([], triples(":a :p :a, :b ."), [rule])
    assert list(closure.inferred()) == [triple(":a :out :a")]
    staged = closure.stage(add=triples(":b :p :b . :c :p :d ."))
    assert staged.inferred_added == [triple(":b :out :b")]


def test_rules_and_ontology_feed_each_other():
    rule = "CONSTRUCT { ?a :near ?b } WHERE { ?a a :Robot ; :beside ?b }"
    schema = (
        ":near a owl:TransitiveProperty . :Arm rdfs:subClassOf :Robot . :near rdfs:range :Robot ."
        ":beside a owl:SymmetricProperty ."
    )
    found = derived(rule, ":a a :Arm ; :beside :b . :b :beside :c .", schema)
    assert {"a near c", "c near a"} <= set(found)


def test_negation_sees_what_the_ontology_derives():
    rule = "CONSTRUCT { ?a :out :none } WHERE { ?a a :C FILTER NOT EXISTS { ?a :q ?x } }"
    schema = ":p rdfs:subPropertyOf :q ."
    assert derived(rule, ":a a :C ; :p :x . :b a :C .", schema) == [
        "a q x",
        "b out none",
    ]


ALONE = PREFIX + "CONSTRUCT { ?a :alone true } WHERE { ?a a :C FILTER NOT EXISTS { ?a :p ?x } }"


def test_a_derived_fact_goes_when_its_absence_is_filled_and_comes_back():
    closure = Closure.build([], triples(":a a :C ."), [ALONE])
    filled = closure.stage(add=[triple(":a :p :b")])
    assert filled.inferred_removed == [triple(":a :alone true")]
    filled.apply()
    assert closure.stage(remove=[triple(":a :p :b")]).inferred_added == [triple(":a :alone true")]


COVERS = PREFIX + (
    "CONSTRUCT { ?x :covers ?y } WHERE { ?x a :C . ?y a :D "
    "FILTER NOT EXISTS { ?y :p ?z FILTER NOT EXISTS { ?x :q ?z } } }"
)


def test_what_a_group_within_a_group_excuses_goes_and_comes_back_with_the_excuse():
    data = ":x a :C . :y a :D ; :p :z ."
    closure = Closure.build([], triples(data), [COVERS])
    excused = closure.stage(add=[triple(":x :q :z")])
    assert excused.inferred_added == [triple(":x :covers :y")]
    excused.apply()
    staged = closure.stage(remove=[triple(":x :q :z")])
    assert (staged.inferred_added, staged.inferred_removed) == ([], [triple(":x :covers :y")])


def test_negation_through_a_circle_is_refused_and_shown():
    rules = [
        PREFIX + "CONSTRUCT { ?x a :P } WHERE { ?x a :Q FILTER NOT EXISTS { ?x a :R } }",
        PREFIX + "CONSTRUCT { ?x a :R } WHERE { ?x a :Q ; a :P }",
    ]
    with pytest.raises(StratificationError, match=r"urn:t:P <- class urn:t:R <- class urn:t:P"):
        Closure.build([], [], rules)


def test_negation_that_feeds_equality_is_refused():
    rule = PREFIX + "CONSTRUCT { ?x :p ?y } WHERE { ?x :q ?y FILTER NOT EXISTS { ?x :r ?y } }"
    with pytest.raises(StratificationError, match="sameAs"):
        Closure.build(triples(":p a owl:FunctionalProperty ."), [], [rule])


@pytest.mark.parametrize(
    ("rule", "message", "line"),
    [
        ("CONSTRUCT { ?a :p ?b } WHERE { ?a ?q ?b }", "predicate", 2),
        ("CONSTRUCT { ?a :p ?b }\nWHERE { ?a :q* ?b }", "transitive", 3),
        ("CONSTRUCT { ?a :p ?b }\nWHERE { ?a :q ?b\n OPTIONAL { ?b :r ?c } }", "OPTIONAL", 4),
        ("CONSTRUCT { ?a :p ?b } WHERE { GRAPH ?g { ?a :q ?b } }", "GRAPH", 2),
        ("CONSTRUCT { ?a :p ?b } WHERE { VALUES ?a { :x } ?a :q ?b }", "VALUES", 2),
        ("CONSTRUCT { ?a :p ?b } WHERE { ?a :q ?b } LIMIT 3", "LIMIT", 2),
        ("CONSTRUCT { ?a :p [] } WHERE { ?a :q ?b }", "blank node", 1),
        ("CONSTRUCT { ?a :p ?b } WHERE { ?a :q ?x BIND (NOW() AS ?b) }", "NOW", 2),
        ("CONSTRUCT { ?a :p ?b } WHERE { ?a :p ?x BIND (?x + 1 AS ?b) }", "would not end", 2),
        ("SELECT ?a WHERE { ?a :p ?b }", "CONSTRUCT", 1),
        ("CONSTRUCT { ?a :p ?b } WHERE { ?a :q ", "not a SPARQL query", 2),
        ("CONSTRUCT { ?a nope:p ?b } WHERE { ?a :q ?b }", "not a SPARQL query", None),
    ],
)
def test_what_a_rule_cannot_say_is_refused_with_its_line(rule, message, line):
    with pytest.raises(RuleError, match=message) as caught:
        Closure.build([], [], [PREFIX + rule])
    assert caught.value.line == line


ORACLE_RULES = (
    "CONSTRUCT { ?x <urn:t:lonely> ?x } WHERE { ?x a <urn:t:C0> "
    "FILTER NOT EXISTS { ?x <urn:t:p0> ?y . ?y a <urn:t:C1> } }",
    "CONSTRUCT { ?x <urn:t:covers> ?y } WHERE { ?x a <urn:t:C0> . ?y a <urn:t:C1> "
    "FILTER NOT EXISTS { ?y <urn:t:p0> ?z FILTER NOT EXISTS { ?x <urn:t:p1> ?z } } }",
    "CONSTRUCT { ?x <urn:t:largest> ?v } WHERE { ?x <urn:t:d0> ?v "
    "FILTER NOT EXISTS { ?x <urn:t:d0> ?w FILTER (?w > ?v) } }",
    "CONSTRUCT { ?x <urn:t:either> ?y } WHERE { { ?x <urn:t:p0> ?y } UNION "
    "{ ?x <urn:t:p1>/<urn:t:p0> ?y MINUS { ?x a <urn:t:C1> } } }",
)


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(NARROW.worlds(12))
def test_rules_derive_what_sparql_constructs_from_the_closure(world):
    schema, data = world
    closed, _ = consequences([*schema, *data])
    store = ox.Store()
    store.extend(ox.Quad(*t) for t in closed)
    constructed = [tuple(t) for rule in ORACLE_RULES for t in store.query(rule)]
    closure = Closure.build(schema, data, ORACLE_RULES)
    expected, _ = consequences([*closed, *constructed])

    def own(found):
        heads = {"lonely", "covers", "largest", "either"}
        return {t for t in found if t[1].value.removeprefix("urn:t:") in heads}

    assert own(closure.match()) == own(expected)


def test_a_proof_names_a_rule_by_its_label():
    rule = LabelledRule(PREFIX + "CONSTRUCT { ?a :out ?b } WHERE { ?a :p ?b }", "what p leads to")
    closure = Closure.build([], triples(":a :p :b ."), [rule])
    proof = closure.explain(triple(":a :out :b"))
    assert proof is not None
    assert proof.rule == "rule:what p leads to"


def test_a_rule_with_negation_that_comes_later_withdraws_nothing_and_sees_what_was_derived():
    old = PREFIX + "CONSTRUCT { ?a :q ?b } WHERE { ?a :p ?b }"
    new = PREFIX + "CONSTRUCT { ?a :r ?b } WHERE { ?b :p ?a FILTER NOT EXISTS { ?a :q ?x } }"
    closure = Closure.build([], triples(":a :p :b . :b :p :c ."), [old])
    staged = closure.stage(rules=[old, new])
    assert staged.inferred_added == [triple(":c :r :b")]
    assert staged.inferred_removed == []
    staged.apply()
    assert closure.stage(rules=[new]).inferred_removed == triples(":a :q :b . :b :q :c .")


def test_a_rule_that_cannot_be_used_changes_nothing():
    closure = Closure.build([], triples(":a :p :b ."))
    with pytest.raises(RuleError):
        closure.stage(rules=[PREFIX + "CONSTRUCT { ?a :q ?b } WHERE { ?a :p* ?b }"])
    assert list(closure.inferred()) == []
    assert closure.stage(add=[triple(":b :p :c")]).inferred_added == []


def test_an_error_tells_line_and_column():
    prefix, head = "PREFIX : <urn:t:OPTIONAL>\n", "CONSTRUCT { ?a :q ?b }\n"
    text = prefix + head + "WHERE { ?a :p ?b OPTIONAL { ?b :p ?c } }"
    with pytest.raises(RuleError, match="line 3, column 18: OPTIONAL cannot be used"):
        Closure.build([], [], [text])
