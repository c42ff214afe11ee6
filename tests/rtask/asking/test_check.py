"""A query is checked before it is believed: faults with place, severity and repair."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

import ontology
import rtask
from rtask.asking.check.checker import checker_of
from rtask.asking.check.findings import Finding
from rtask.asking.check.unknown import shipped_terms
from rtask.asking.check.vocabulary import Vocabulary
from rtask.cli import cli
from rtask.errors import DataError, QuerySyntaxError
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import prologue
from tests.rtask.asking.valid_queries import of_schema, of_statements
from tests.rtask.asking.walks import walks

QUESTIONS = sorted((Path(ontology.__file__).parent / "queries").rglob("*.rq"))
HEAD = prologue(
    {name: ontology.PREFIXES[name] for name in ("rt", "prov", "cora", "xsd", "sosa", "rdfs", "owl")}
)
HEAD += "PREFIX kb: <urn:lab/>\n"


def only(kb: KnowledgeBase, body: str) -> Finding:
    (found,) = kb.check(HEAD + body)
    return found


def repaired(body: str, found: Finding) -> str:
    return found.repairs[0].apply(HEAD + body).removeprefix(HEAD)


def test_the_questions_of_the_ontology_raise_no_alarm(kb: KnowledgeBase) -> None:
    assert len(QUESTIONS) > 40
    alarms = {file.stem: kb.check(file.read_text("utf-8")) for file in QUESTIONS}
    assert {name: found for name, found in alarms.items() if found} == {}


@pytest.mark.parametrize(
    ("body", "rule", "severity", "right"),
    [
        ("SELECT ?a { ?a rt:executesGrsap ?g }", "unknown-term", "certain",
         "SELECT ?a { ?a rt:executesGrasp ?g }"),
        ("SELECT ?a { ?a a rt:GraspAtempt }", "unknown-term", "certain",
         "SELECT ?a { ?a a rt:GraspAttempt }"),
        ("SELECT ?o { ?o a rt:Carton }", "unknown-term", "certain",  # a label of the class
         "SELECT ?o { ?o a rt:Box }"),
        ("SELECT ?o ?n { ?o rt:hasName ?n }", "unknown-term", "certain",
         "SELECT ?o ?n { ?o rt:name ?n }"),
        ("SELECT ?o { ?a a rt:GraspAttempt ; ^rt:hasOutcome ?o . ?o rt:success true }",
         "reversed", "certain",
         "SELECT ?o { ?a a rt:GraspAttempt ; rt:hasOutcome ?o . ?o rt:success true }"),
        ("SELECT ?o { ?o a rt:Outcome ; rt:success \"true\" }", "wrong-datatype", "certain",
         "SELECT ?o { ?o a rt:Outcome ; rt:success true }"),
        ("SELECT ?o { ?o rt:extentX 3 }", "wrong-datatype", "certain",
         "SELECT ?o { ?o rt:extentX 3e0 }"),
        ("SELECT ?o { ?o rt:success rt:Mug }", "literal-expected", "certain", None),
        ("SELECT ?o { ?o rt:hasGrasp kb:grasp77 }", "unknown-thing", "certain", None),
        ("SELECT ?robot { ?attempt rt:performedBy ?robot . ?atempt rt:executesGrasp ?g }",
         "missing-bridge", "likely", None),
        ("SELECT ?grasp { { ?graps a rt:ProvenGrasp ; rt:triedIn ?a } UNION "
         "{ ?grasp a rt:GraspCandidate ; rt:triedIn ?a } }", "used-once", "likely",
         "SELECT ?grasp { { ?grasp a rt:ProvenGrasp ; rt:triedIn ?a } UNION "
         "{ ?grasp a rt:GraspCandidate ; rt:triedIn ?a } }"),
        ("SELECT ?reward { ?object rt:hasGrasp ?grasp . ?grasp rt:reward ?reward }",
         "wrong-type", "likely", None),
        ("SELECT ?held (COUNT(?a) AS ?n) { ?a rt:hasOutcome/rt:success ?helt } GROUP BY ?held",
         "unbound-variable", "likely",
         "SELECT ?held (COUNT(?a) AS ?n) { ?a rt:hasOutcome/rt:success ?held } GROUP BY ?held"),
        ("SELECT ?x { ?x rt:matches \"mug\" }", "needs-service", "certain", None),
        (f"SELECT ?x {{ ?x <{ontology.FUNCTIONS}near> ?y }}", "needs-service", "certain", None),
        ("SELECT ?r { ?r rt:Mug ?o }", "class-as-property", "certain", None),
        ("SELECT ?m { GRAPH rt:Mug { ?m a rt:Mug } }", "no-graph", "certain", None),
        ("SELECT ?m { OPTIONAL { GRAPH rt:name { ?m a rt:Mug } } }", "no-graph", "certain", None),
        ("SELECT ?r { ?r a rt:extentX }", "property-as-class", "certain", None),
        ("SELECT ?c { ?c rdfs:sublassOf rt:Mug }", "unknown-term", "certain",
         "SELECT ?c { ?c rdfs:subClassOf rt:Mug }"),
        ("SELECT ?c { ?c a owl:Clas ; rdfs:label ?name }", "unknown-term", "certain",
         "SELECT ?c { ?c a owl:Class ; rdfs:label ?name }"),
        ("SELECT ?c { ?c a owl:Class ; rt:foundConfidence ?name }", "wrong-type", "likely", None),
        ("SELECT ?c { ?thing a/rt:inState* ?c }", "wrong-type", "likely", None),
        ("SELECT ?o { ?o ^rt:name \"mug\" }", "reversed", "certain",
         "SELECT ?o { ?o rt:name \"mug\" }"),
        ("SELECT ?w { ?o rt:terminal ?w . ?h rt:maxPayload ?max FILTER(?w > ?max) }", "wrong-type",
         "likely", None),
        ("SELECT ?robot_iri { ?robot_iri a rt:GraspStatistics }", "unusual-name", "likely", None),
        ("SELECT ?h { ?x rt:priorBeta ?t BIND(HOURS(?t) AS ?h) }", "wrong-type", "likely", None),
        ("SELECT (AVG(?m) AS ?mean) { ?o rt:hasPose ?m }", "wrong-type", "likely", None),
        ("SELECT ?s { ?o rt:exemplarOf ?w . ?p ^rt:mass ?m FILTER(?m < ?w) }", "wrong-type",
         "likely", None),
        ("SELECT ?thing ?n { { SELECT ?thing (COUNT(?a) AS ?n) { ?a rt:graspOf ?thign } "
         "GROUP BY ?thing } ?thing rt:name ?name }", "unbound-variable", "likely",
         "SELECT ?thing ?n { { SELECT ?thing (COUNT(?a) AS ?n) { ?a rt:graspOf ?thing } "
         "GROUP BY ?thing } ?thing rt:name ?name }"),
        ("SELECT ?r { ?r ^rt:hasMatch ?a , ?b . ?a rt:rank 1 . ?b rt:rank 2 }", "reversed",
         "likely", "SELECT ?r { ?r rt:hasMatch ?a , ?b . ?a rt:rank 1 . ?b rt:rank 2 }"),
        ("SELECT ?h ?o { ?h ^rt:maxOpening ?w OPTIONAL { ?o rt:graspWidth ?g FILTER(?g < ?w) } }",
         "wrong-type", "likely",
         "SELECT ?h ?o { ?h rt:maxOpening ?w OPTIONAL { ?o rt:graspWidth ?g FILTER(?g < ?w) } }"),
        ("SELECT ?s { ?s a/rdfs:subClassOf* rt:Camera ; ^rt:sensorOf ?r }", "reversed", "likely",
         "SELECT ?s { ?s a/rdfs:subClassOf* rt:Camera ; rt:sensorOf ?r }"),
        ("SELECT ?f { <urn:lab/object/7> rt:parentFrame ?f }", "wrong-type", "likely", None),
        ("SELECT ?o { ?o ^rt:massBound ?m FILTER(?m < 2.0) }", "wrong-type", "likely", None),
        ("SELECT ?o { ?o a rt:Observation ; ^sosa:madeBySensor ?s }", "reversed", "likely",
         "SELECT ?o { ?o a rt:Observation ; sosa:madeBySensor ?s }"),
        ("SELECT ?width { ?o a rt:ManipulableObject ; rt:positionSigma ?width }", "unusual-name",
         "likely", "SELECT ?width { ?o a rt:ManipulableObject ; rt:graspWidth ?width }"),
        ("SELECT ?when { ?step rt:reward ?gain ; rt:nextState ?when }", "unusual-name",
         "likely", None),
        ("SELECT ?parent ?child { ?child ^rt:parentFrame ?parent }", "reversed", "likely",
         "SELECT ?parent ?child { ?child rt:parentFrame ?parent }"),
        ("SELECT ?robot { ?task a rt:PickAndPlace ; rt:positionSigma ?robot }", "unusual-name",
         "likely", "SELECT ?robot { ?task a rt:PickAndPlace ; rt:assignedTo ?robot }"),
        ("SELECT ?try { ?try rt:unit ?hand ; rt:performedBy ?user }", "reversed", "likely", None),
        ("SELECT ?u { <urn:lab/object/7> rt:precondition ?u }", "wrong-type", "likely", None),
        ("SELECT ?object { ?object rt:canGrasp ?robot ; rt:hasGrasp ?grasp }", "reversed",
         "likely", "SELECT ?object { ?object ^rt:canGrasp ?robot ; rt:hasGrasp ?grasp }"),
        ("SELECT ?capability { ?robot rt:segmentationTime ?capability }", "unusual-name", "likely",
         None),
        ("SELECT ?item { ?item rt:objectId* ?spot . ?spot a rt:SupportSurface }", "wrong-type",
         "likely", None),
        ("SELECT ?c { ?camera a/^rdfs:subClassOf* rt:Camera ; rt:name ?c }", "reversed", "likely",
         "SELECT ?c { ?camera a/rdfs:subClassOf* rt:Camera ; rt:name ?c }"),
        ("SELECT ?item { ?item rt:locatedOn* ?spot . ?spot a rt:BSplineContour . "
         "?item a rt:ManipulableObject }", "wrong-type", "certain", None),
        ("SELECT ?o ?mass { ?o ^rt:mass ?mass }", "reversed", "likely",
         "SELECT ?o ?mass { ?o rt:mass ?mass }"),
        # What a FILTER, a BIND or a count lets a variable be.
        ("SELECT ?o { ?o rt:mass ?m FILTER(?m = rt:Mug || ?m = rt:Cup) }", "wrong-type", "likely",
         None),
        ("SELECT ?o { ?o a ?t . FILTER(?t IN (rt:Mug, rt:Cup)) ?o rt:hasOutcome ?x }",
         "wrong-type", "certain", None),
        ("SELECT ?o { BIND(rt:Mug AS ?t) ?o a ?t ; rt:hasOutcome ?x }", "wrong-type", "certain",
         None),
        ("SELECT ?n { ?o rt:hasGrasp ?n { SELECT (COUNT(?x) AS ?n) { ?x a rt:Mug } } }",
         "wrong-type", "likely", None),
        ("SELECT ?k { ?o rt:name ?m BIND(CONCAT(?m, \"x\") AS ?k) ?k rt:locatedOn ?o }",
         "wrong-type", "likely", None),
        # Ways that cannot be meant.
        ("ASK { rt:ManipulableObject rdfs:subClassOf* rt:Mug }", "reversed", "likely",
         "ASK { rt:ManipulableObject ^rdfs:subClassOf* rt:Mug }"),
        ("SELECT ?c { ?i a ?c . ?c ^rdfs:subClassOf rt:Task }", "reversed", "likely",
         "SELECT ?c { ?i a ?c . ?c rdfs:subClassOf rt:Task }"),
        ("SELECT ?a ?b { ?a ^owl:disjointWith ?b }", "reversed", "likely",
         "SELECT ?a ?b { ?a owl:disjointWith ?b }"),
        ("SELECT ?o ?lbl { ?o ^rt:name ?lbl }", "reversed", "likely",
         "SELECT ?o ?lbl { ?o rt:name ?lbl }"),
        ("SELECT ?o ?v { ?o a owl:Ontology ; ^owl:versionInfo ?v }", "reversed", "likely",
         "SELECT ?o ?v { ?o a owl:Ontology ; owl:versionInfo ?v }"),
        ("SELECT ?activity ?inputs { ?activity ^prov:used ?inputs }", "reversed", "likely",
         "SELECT ?activity ?inputs { ?activity prov:used ?inputs }"),
        ("SELECT ?class ?parent { ?class ^rdfs:subClassOf ?parent }", "reversed", "likely",
         "SELECT ?class ?parent { ?class rdfs:subClassOf ?parent }"),
        ("SELECT ?top ?bottom { ?top ^rt:locatedOn+ ?bottom }", "reversed", "likely",
         "SELECT ?top ?bottom { ?top rt:locatedOn+ ?bottom }"),
        ("SELECT ?c { ?c rdfs:label 7 }", "wrong-datatype", "likely", None),
        ("SELECT ?c { ?c rdfs:label \"gripper\" }", "no-language", "likely",
         "SELECT ?c { ?c rdfs:label \"gripper\"@en }"),
    ],
)  # fmt: skip
def test_a_fault_is_found_with_its_repair(
    kb: KnowledgeBase, body: str, rule: str, severity: str, right: str | None
) -> None:
    found = next(one for one in kb.check(HEAD + body) if one.rule == rule)
    assert found.severity == severity
    assert body[found.start - len(HEAD) : found.end - len(HEAD)].strip()
    if right is not None:
        assert repaired(body, found) == right


def test_queries_made_of_statements_of_the_graph_raise_no_alarm() -> None:
    blamed = {}
    with rtask.open(":memory:") as sample:
        assert isinstance(sample, KnowledgeBase)
        sample.load(ontology.path("examples/sample.trig"))
        for text in walks(sample, checker_of(sample).vocabulary, 120, seed=1):
            assert len(sample.select(text)) > 0, text
            found = sample.check(text)
            if found:
                blamed[text] = found
    assert blamed == {}


@pytest.mark.parametrize("make", [of_statements, of_schema])
def test_sound_queries_in_many_forms_raise_no_alarm(
    make: Callable[[KnowledgeBase, Vocabulary, int, int], Iterator[str]],
) -> None:
    with rtask.open(":memory:") as sample:
        assert isinstance(sample, KnowledgeBase)
        sample.load(ontology.path("examples/sample.trig"))
        blamed = {}
        for text in make(sample, checker_of(sample).vocabulary, 150, 3):
            found = sample.check(text)  # raises for a text that is no query
            if found:
                blamed[text] = [finding.words for finding in found]
    assert blamed == {}


@pytest.mark.parametrize(
    "body",
    [
        # Named after what stands beside them, though it is like another name.
        "SELECT ?e (COUNT(?minOpening) AS ?n) { ?e rt:maxOpening ?maxOpening ; "
        "rt:minOpening ?minOpening } GROUP BY ?e",
        "SELECT ?w { ?p rt:x ?sizeX ; rt:y ?sizeY ; rt:z ?w }",
        "SELECT ?p ?n { { SELECT ?p (COUNT(?qy) AS ?n) { ?p rt:qw ?qw ; rt:qy ?qy } GROUP BY ?p } "
        "?p ^rt:estimatedPose ?e }",
        "SELECT * { ?joint rt:jointOf ?endEffector . ?endEffector rt:maxPayload ?maxPayload }",
        "SELECT ?b { ?v rt:hasEntry ?requiresResource . ?x rt:requiresResource ?requiresResource ; "
        "rt:hasBlob ?b }",
        # Named after the class at the end of a path.
        "SELECT * { ?ontology a/rdfs:subClassOf* rt:OntologyGraph ; rt:tripleCount ?n }",
        "SELECT ?ontology { ?ontology a ?k ; rt:commitNumber ?n . "
        "?k rdfs:subClassOf* rt:OntologyGraph }",
        # Words for any literal, and for whatever goes on.
        "SELECT ?g ?label { ?g a rt:TaskPlan ; rt:goalText ?label }",
        "SELECT ?action { ?goal rt:executedIn ?i . ?i ^rt:hasTimeWindow ?action }",
        "SELECT ?s { ?v rt:viewpoint ?pos . ?pos rt:x ?s }",
        # A restriction is a class.
        "SELECT ?c ?on { ?c rdfs:subClassOf ?r . ?r a owl:Restriction ; owl:onProperty ?on }",
        # What a filter rules out, or allows beside others, a variable need not be.
        "SELECT ?o { ?o a ?t ; rt:hasOutcome ?x FILTER(?t NOT IN (rt:Mug, rt:Cup)) }",
        "SELECT ?o { ?o a ?t ; rt:hasOutcome ?x FILTER(!(?t = rt:Mug)) }",
        "SELECT ?o { ?o a ?t ; rt:hasOutcome ?x FILTER(?t = rt:Mug || BOUND(?x)) }",
        "SELECT ?o { ?o rt:locatedOn ?x BIND(COALESCE(?x, ?o) AS ?y) ?y rt:locatedOn ?z }",
        "SELECT ?best { ?g rt:graspOf ?o { SELECT (SAMPLE(?o) AS ?best) { ?x rt:graspOf ?o } } "
        "?best rt:name ?n }",
        # Both ways, and back from a name that another pattern has bound.
        "SELECT ?a ?b { ?a owl:disjointWith|^owl:disjointWith ?b }",
        "SELECT ?o ?b { ?o rt:name ?n . ?n ^rt:name ?b }",
        "ASK { rt:Mug rdfs:subClassOf* rt:ManipulableObject }",
        "SELECT ?f (COUNT(?step) AS ?n) { ?f rt:parentFrame+ ?step } GROUP BY ?f",
        "SELECT ?top ?bottom { ?top rt:locatedOn+ ?bottom . ?bottom a ?kind }",
        # Letters in their order abbreviate nothing.
        "SELECT * { ?a rt:gripperType ?b . ?a rt:triedIn ?c }",
    ],
)
def test_sound_names_and_forms_raise_no_alarm(kb: KnowledgeBase, body: str) -> None:
    assert kb.check(HEAD + body) == []


def test_what_the_graph_holds_is_no_fault_whatever_an_axiom_says() -> None:
    with rtask.open(":memory:", base="urn:lab/") as graph:
        assert isinstance(graph, KnowledgeBase)
        graph.update(
            HEAD + 'INSERT DATA { kb:p rt:atTime "2026-01-01T09:00:00Z"^^xsd:dateTime . '
            'kb:w a rt:WriteActivity ; rt:changedGraph kb:g . kb:g rt:name "odd" }'
        )
        held = '"2026-01-01T09:00:00Z"^^xsd:dateTime'
        never = '"2027-01-01T09:00:00Z"^^xsd:dateTime'
        assert graph.check(HEAD + f"SELECT ?p {{ ?p rt:atTime {held} }}") == []
        assert [f.rule for f in graph.check(HEAD + f"SELECT ?p {{ ?p rt:atTime {never} }}")] == [
            "wrong-datatype"
        ]
        assert graph.check(HEAD + "SELECT * { VALUES ?g { kb:g } ?w rt:changedGraph ?g }") == []


def test_an_inherited_domain_and_an_open_vocabulary_are_no_faults(kb: KnowledgeBase) -> None:
    for body in (
        "SELECT ?o { ?o a rt:Mug ; rt:hasGrasp ?grasp ; rt:extentX ?x }",
        "SELECT ?s { ?s <urn:other:vocabulary> ?o ; a <urn:other:Class> }",
        "SELECT ?s { ?s prov:wasQuotedFrom ?o }",
        "SELECT ?c { ?o rt:objectId ?id ; a/rdfs:subClassOf* ?c }",
        'SELECT * { SERVICE <urn:rtask:text> { ?iri rt:matches "mug" ; rt:score ?score } }',
        f"SELECT * {{ SERVICE <urn:rtask:place> {{ ?a <{ontology.FUNCTIONS}near> ?b }} }}",
        "SELECT ?s ?t { { SELECT ?s { ?s rt:hasGrasp ?g } } UNION { ?t rt:reward ?g } }",
        "CONSTRUCT { ?a rt:notYetThere ?o } { ?a rt:hasOutcome ?o }",
        "DESCRIBE <urn:lab/object/7>",
        "SELECT ?plan ?step { ?plan a rt:TaskPlan ; rt:hasSubTask ?step }",
        "SELECT ?held { ?stay rt:placementOf ?held }",
        "SELECT ?next { ?step rt:feeds ?next }",
        "SELECT ?then { ?experience rt:nextState ?then }",
        "SELECT ?frame2 ?frame { ?frame rt:parentFrame ?frame2 }",
        "SELECT ?frame { ?frame rt:parentFrame ?frame2 }",
        "SELECT ?supportSurface { ?supportSurface rt:locatedOn ?object }",
        "SELECT ?place { ?place rt:subTaskOf ?task ; a rt:Place }",
        "SELECT ?root ?up { ?root a rt:Frame FILTER NOT EXISTS { ?root rt:parentFrame ?up } }",
        "SELECT ?day (COUNT(?a) AS ?n) { ?a rt:atTime ?t } GROUP BY (DAY(?t) AS ?day)",
        "SELECT ?traj (COUNT(?wp) AS ?points) { ?traj rt:hasWaypoint ?wp } GROUP BY ?traj",
    ):
        assert kb.check(HEAD + body) == [], body


@pytest.mark.parametrize(
    "body",
    [
        "SELECT ?x { ?x a rt:ManipulableObject ; rt:hasFunction ?task }",
        "SELECT ?s { ?robot rt:hasSensor ?s . ?s rt:name ?name }",
        "SELECT ?view { ?view prov:wasGeneratedBy ?attempt . ?attempt a rt:GraspAttempt }",
        "SELECT ?m { ?refusal a rt:GraspRefusal ; prov:startedAtTime ?m }",
        "SELECT ?f { <urn:lab/object/7> rt:hasGrasp ?f }",
        "SELECT ?part { ?task rt:hasSubTask ?part . ?part rt:hasSubTask ?deep }",
        "SELECT ?held { ?record rt:statisticsOf ?grasp ; rt:successes ?held }",
        "SELECT ?next { ?experience rt:inState ?state ; rt:nextState ?next }",
        "SELECT ?plan { ?plan rt:goalText ?goal }",
        "SELECT ?where { ?copy a rt:Exemplar ; rt:exemplarOf ?product ; rt:locatedOn ?where }",
        "SELECT ?u { ?property rt:unit ?u ; rdfs:label ?label }",
        "SELECT ?bar { ?refusal rt:requiredConfidence ?bar }",
        "SELECT ?root { ?f rt:parentFrame ?root FILTER NOT EXISTS { ?root rt:parentFrame ?up } }",
        "SELECT ?link ?offset { ?frame rt:parentFrame ?link . ?link rt:poseInParent ?offset . "
        "?offset rt:x ?x }",
        "SELECT ?o { ?refusal rt:refusedObject ?refused ; rt:refusedWith ?hand . ?refused a ?o }",
        "SELECT ?n { ?task rt:taskName ?n ; rt:precedes ?task2 . ?task2 a rt:Task ; rt:note ?m }",
    ],
)
def test_a_lack_of_data_and_an_odd_name_alone_are_no_faults(kb: KnowledgeBase, body: str) -> None:
    assert kb.check(HEAD + body) == []


def test_a_term_newer_than_the_graph_is_not_called_a_misspelling(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    newer = {ontology.NS + "executesGrsap": "grasp"}
    monkeypatch.setattr("rtask.asking.check.unknown.shipped_terms", lambda: newer)
    found = only(kb, "SELECT ?a { ?a rt:executesGrsap ?g }")
    assert (found.rule, found.severity, found.repairs) == ("unknown-term", "certain", ())
    assert "(module grasp), but not in that of the graph" in found.words


def test_all_shipped_terms_are_known_to_a_new_graph(kb: KnowledgeBase) -> None:
    terms = shipped_terms()
    assert len(terms) > 400
    unknown = [iri for iri in terms if kb.check(HEAD + f"SELECT ?s {{ ?s ?p <{iri}> }}")]
    assert unknown == []


def test_a_step_along_one_property_is_not_taken_for_a_step_back() -> None:
    """No surface lies on another here, and the pattern turned would repeat the first one."""
    body = (
        "SELECT ?below { ?object rt:locatedOn ?surface OPTIONAL { ?surface rt:locatedOn ?below } }"
    )
    graph = rtask.open(":memory:")
    assert isinstance(graph, KnowledgeBase)
    with graph:
        graph.update(
            HEAD + "INSERT DATA { <urn:mug> a rt:Mug ; rt:locatedOn <urn:table> . "
            "<urn:table> a rt:SupportSurface }"
        )
        assert graph.check(HEAD + body) == []
        turned = "SELECT ?o { ?o a rt:Mug ; ^rt:locatedOn ?table }"
        assert only(graph, turned).rule == "reversed"


def test_a_misspelt_property_is_one_finding(kb: KnowledgeBase) -> None:
    assert only(kb, "SELECT ?name { ?mug a rt:Mug ; rt:nmae ?name }").rule == "unknown-term"


def test_a_thing_that_is_nearly_called_so_is_suggested(kb: KnowledgeBase) -> None:
    found = only(kb, "SELECT ?o { <urn:lab/robot/panda-11> rt:canGrasp ?o }")
    assert (found.rule, found.severity) == ("unknown-thing", "certain")
    assert repaired("SELECT ?o { <urn:lab/robot/panda-11> rt:canGrasp ?o }", found) == (
        "SELECT ?o { <urn:lab/robot/panda-1> rt:canGrasp ?o }"
    )


@pytest.mark.parametrize(
    "body",
    [
        "SELECT DISTINCT ?p { ?x a rt:GraspAttempt ; ?p ?y . ?p a owl:DatatypeProperty }",
        "SELECT ?p { ?p a owl:ObjectProperty FILTER(STRSTARTS(STR(?p), STR(rt:))) }",
        "SELECT ?o ?m { { SELECT (MAX(?n) AS ?m) { ?any rt:mass ?n } } ?o rt:mass ?m }",
        "SELECT ?i { { rt:hasGrasp owl:inverseOf ?i } UNION { ?i owl:inverseOf rt:hasGrasp } }",
        "SELECT ?p { ?p a owl:ObjectProperty , owl:FunctionalProperty ; rdfs:range ?kind }",
        "SELECT ?o { ?o a ?kind . ?kind rdfs:subClassOf rt:Container }",
        "SELECT ?a { ?a rt:planningTime ?t ; rt:executionTime ?e FILTER(?t + ?e < 3) }",
        "SELECT ?d { ?c prov:startedAtTime ?s ; prov:endedAtTime ?e BIND(?e - ?s AS ?d) }",
    ],
)
def test_an_honest_query_raises_no_alarm(kb: KnowledgeBase, body: str) -> None:
    assert [found.words for found in kb.check(HEAD + body)] == []


def test_a_check_follows_the_commits() -> None:
    query = "SELECT ?o { ?o a <urn:t/class/kettle> }"
    with rtask.open(":memory:", base="urn:t/") as kb:
        assert isinstance(kb, KnowledgeBase)
        assert [found.rule for found in kb.check(query)] == ["unknown-term"]
        kb.update("INSERT DATA { <urn:t/1> a <urn:t/class/kettle> }")
        assert kb.check(query) == []


def test_a_group_that_was_sound_is_looked_at_again_after_a_commit() -> None:
    asked = HEAD + "SELECT ?tool { ?try rt:note ?tool ; rt:performedBy ?user }"
    with rtask.open(":memory:", base="urn:lab/") as graph:
        assert graph.check(asked) == graph.check(asked) == []
        graph.update(HEAD + 'INSERT DATA { rt:Mug rt:note "round" }')
        assert {found.rule for found in graph.check(asked)} == {"wrong-type"}


def test_a_text_that_does_not_parse_is_an_error_with_its_place(kb: KnowledgeBase) -> None:
    with pytest.raises(QuerySyntaxError, match="query 1:"):
        kb.check("SELECT ?s { ?s ?p }")


def test_the_command_says_beside_the_rows_what_is_certainly_wrong(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", base="urn:lab/") as kb:
        kb.update(HEAD + "INSERT DATA { <urn:lab/object/1> a rt:Mug }")
    run = CliRunner().invoke
    where = ["--data", str(tmp_path / "kb")]
    asked = "SELECT ?o { ?o a rt:Mug OPTIONAL { ?o rt:hasGrsap ?g } }"
    done = run(cli, ["query", asked, "--json", *where])
    assert done.exit_code == 0
    assert len(json.loads(done.stdout)["results"]["bindings"]) == 1
    assert done.stderr.splitlines() == [
        "certain: 1:39: there is no property rt:hasGrsap; did you mean rt:hasGrasp?",
        "  repair: write rt:hasGrasp",
    ]
    assert run(cli, ["query", asked, "--json", "--no-check", *where]).stderr == ""


def test_a_function_that_the_store_lacks_is_an_error_as_in_evaluation(kb: KnowledgeBase) -> None:
    query = "SELECT ?x { ?x ?p ?o FILTER(<urn:f>(?x)) }"
    for ask in (kb.check, kb.select):
        with pytest.raises(DataError, match="function <urn:f> is not supported"):
            ask(query)


@pytest.mark.parametrize(
    ("body", "rule", "words"),
    [
        ("SELECT ?c ?t { ?c a rt:SharedGraph ; prov:endedAtTime ?t }", "wrong-type",
         "shared graph"),
        ("SELECT ?o ?s { ?o a rt:ManipulableObject ; sosa:madeBySensor ?s }", "wrong-type",
         "manipulable object"),
        ("SELECT ?robotA { ?robotA a rt:NamedGraph }", "unusual-name", "named graph"),
        ("SELECT ?robot { ?robot a rt:GraspEvaluation }", "unusual-name", "grasp evaluation"),
    ],
)  # fmt: skip
def test_a_class_that_is_no_activity_sensor_or_agent_is_blamed(
    kb: KnowledgeBase, body: str, rule: str, words: str
) -> None:
    """PROV-O and SOSA say what their terms are for, although the ontology repeats no axiom."""
    found = only(kb, body)
    assert (found.rule, found.severity) == (rule, "likely")
    assert words in found.words


@pytest.mark.parametrize(
    "body",
    [
        "SELECT ?try ?t { ?try a rt:GraspAttempt ; prov:endedAtTime ?t }",
        "SELECT ?view { ?view a sosa:Observation ; sosa:madeBySensor ?cam }",
        "SELECT ?p ?t { ?p a rt:Placement ; time:hasBeginning/time:inXSDDateTimeStamp ?t }",
        "SELECT ?poseA ?poseX { ?poseA a rt:Pose ; rt:x ?poseX }",
        "SELECT ?v ?from { ?v a rt:View ; rt:viewpoint ?from }",
        "CONSTRUCT { ?o a ?c } WHERE { ?o a rt:Mug . rt:Mug rdfs:subClassOf+ ?c }",
        "ASK { ?x a rt:Mug, rt:Box }",
        "SELECT * { { SELECT (COUNT(?a) AS ?n) { ?a a rt:View } } "
        "{ SELECT (COUNT(?b) AS ?m) { ?b a rt:Mug } } }",
        "SELECT ?w { ?w prov:wasAssociatedWith ?a , ?b . ?a a rt:Human . ?b a cora:Robot }",
    ],
)
def test_terms_of_the_standards_are_used_as_they_are_meant(kb: KnowledgeBase, body: str) -> None:
    assert kb.check(prologue(ontology.PREFIXES) + body) == []


def test_sub_selects_of_many_rows_still_need_a_bridge(kb: KnowledgeBase) -> None:
    part = "{ SELECT ?%s (COUNT(?a%s) AS ?n%s) { ?%s rt:hasGrasp ?a%s } GROUP BY ?%s }"
    found = only(kb, f"SELECT * {{ {part % tuple('xxxxxx')} {part % tuple('yyyyyy')} }}")
    assert found.rule == "missing-bridge"


def test_a_graph_is_no_fault_whatever_else_its_name_stands_for() -> None:
    with rtask.open(":memory:", base="urn:lab/") as kb:
        kb.update(HEAD + "INSERT DATA { <urn:both> a owl:Class . <urn:empty> a rt:NamedGraph }")
        body = "SELECT ?m { GRAPH %s { ?m a rt:Mug } }"
        assert only(kb, body % "<urn:both>").rule == "no-graph"
        kb.update(HEAD + "INSERT DATA { GRAPH <urn:both> { <urn:m> a rt:Mug } }")
        for name in ("<urn:both>", "<urn:empty>", "?g"):
            assert kb.check(HEAD + body % name) == [], name
