"""What the labels of a demo's products say, stated in its graph."""

from __future__ import annotations

import rtask
from rtask.rdf.namespaces import PREFIXES
from simulate.demo.products import state_kinds
from simulate.demo.queries import QUESTIONS, with_prefixes

NAMES = {"urn:lab/object/1": "carton-6", "urn:lab/object/2": "rod-3", "urn:lab/object/3": "flask-1"}


def test_each_product_has_the_kind_of_its_label_in_place_of_a_guess() -> None:
    stored = " ".join(f'<{iri}> a rt:ManipulableObject ; rt:objectId "{name}" ; rt:name "{name}" .'
                      for iri, name in {**NAMES, "urn:lab/object/4": ""}.items())  # fmt: skip
    with rtask.open(":memory:", base="urn:lab/") as kb:
        kb.update(f"{PREFIXES} INSERT DATA {{ {stored} <urn:lab/object/2> a rt:Pen }}")
        with rtask.connect(kb) as client:
            state_kinds(client, {**NAMES, "urn:lab/object/4": ""})
        rows = kb.select(f"""{PREFIXES} SELECT ?object ?kind {{ ?object a ?class .
            ?class rdfs:subClassOf rt:ManipulableObject ; rdfs:label ?kind
            FILTER(?class != rt:ManipulableObject) }} ORDER BY ?object""").to_dicts()
    assert [(str(row["object"]), str(row["kind"])) for row in rows] == [
        ("urn:lab/object/1", "box"), ("urn:lab/object/2", "bar"), ("urn:lab/object/3", "flask"),
    ]  # fmt: skip


def test_the_questions_of_a_demo_name_products_and_count_each_once() -> None:
    """Two robots tried a carton, of which the graph also knows a single thing."""
    attempts = " ".join(
        f"""<urn:lab/grasp/1> rt:triedIn <urn:lab/try/{n}> . <urn:lab/try/{n}> a rt:GraspAttempt ;
        rt:executesGrasp <urn:lab/grasp/1> ; rt:performedBy <urn:lab/robot/{n}> ;
        rt:activates <urn:lab/hand> ; rt:hasOutcome <urn:lab/out/{n}> .
        <urn:lab/robot/{n}> a cora:Robot ; rt:name "nao-{n}" .
        <urn:lab/out/{n}> rt:judgedSuccess {held} ."""
        for n, held in ((1, "false"), (2, "true"))
    )
    with rtask.open(":memory:", base="urn:lab/", reason=False) as kb:
        kb.update(f"""{PREFIXES} INSERT DATA {{ {attempts}
            <urn:lab/hand> rt:gripperType "nao_hand" .
            <urn:lab/object/1> a rt:ManipulableObject, rt:Box ; rt:name "carton-6" ;
              rt:objectId "nao-1/1" ; rt:hasGrasp <urn:lab/grasp/1> .
            GRAPH <urn:lab/inferred> {{ <urn:lab/robot/1> rt:canGrasp <urn:lab/object/1>,
              <urn:lab/thing/1> }}
            <urn:lab/thing/1> a rt:ManipulableObject, rt:Exemplar, rt:Box ; rt:name "carton-6" ;
              rt:hasGrasp <urn:lab/grasp/1> . <urn:lab/inferred> a rt:InferredGraph }}""")
        known, kinds, robots, _ = (
            kb.select(with_prefixes(question.sparql)).to_dicts() for question in QUESTIONS
        )
    assert [(row["product"], row["robot"], row["held"]) for row in known] == [
        ("carton-6", "nao-1", 0), ("carton-6", "nao-2", 1),
    ]  # fmt: skip
    (kind,) = kinds
    assert (kind["kind"], kind["hand"], kind["attempts"], kind["percentHeld"]) == (
        "box", "nao_hand", 2, 50,
    )  # fmt: skip
    assert [row["value"] for row in robots if "number" in str(row["property"])] == [1]
