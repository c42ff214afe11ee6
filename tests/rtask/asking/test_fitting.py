"""Which properties could stand in a pattern, by what its ends are."""

from __future__ import annotations

import pytest

import ontology
from rtask.asking.check.checker import checker_of
from rtask.asking.check.evidence import Evidence
from rtask.asking.check.fitting import Fitting
from rtask.asking.check.syntax.outline import Node
from rtask.asking.check.syntax.reading import read_outline
from rtask.knowledge_base import KnowledgeBase

RT, XSD = ontology.NS, ontology.PREFIXES["xsd"]
ANYTHING = Node("variable", "o", 0, 0)


@pytest.fixture(scope="module")
def fitting(kb: KnowledgeBase) -> Fitting:
    outline = read_outline("SELECT ?o { ?o ?p ?v }", kb.base)
    return Fitting(checker_of(kb).vocabulary, Evidence(kb), outline)


def properties(fitting: Fitting, value: Node) -> set[str]:
    return set(fitting.fitting_properties(ANYTHING, value, {}))


@pytest.mark.parametrize(
    ("datatype", "fits", "fits_not"),
    [
        ("double", {"graspWidth"}, {"name", "stepNumber", "success", "hasGrasp", "reaches"}),
        ("integer", {"stepNumber"}, {"graspWidth", "name", "hasGrasp"}),
        ("string", {"name"}, {"graspWidth", "success", "hasGrasp"}),
        ("boolean", {"success"}, {"name", "stepNumber", "hasGrasp"}),
    ],
)
def test_a_literal_is_the_value_of_properties_with_such_values(
    fitting: Fitting, datatype: str, fits: set[str], fits_not: set[str]
) -> None:
    literal = Node("literal", "1", 0, 0, XSD + datatype)
    found = properties(fitting, literal)
    assert {RT + name for name in fits} <= found
    assert not {RT + name for name in fits_not} & found


def test_a_named_thing_is_the_value_of_properties_that_relate_things(fitting: Fitting) -> None:
    found = properties(fitting, Node("iri", "urn:lab/object/7", 0, 0))
    assert {RT + "hasGrasp", RT + "reaches"} <= found
    assert not {RT + "graspWidth", RT + "name"} & found


def test_a_variable_without_other_patterns_may_be_the_value_of_any(fitting: Fitting) -> None:
    found = properties(fitting, Node("variable", "v", 0, 0))
    assert {RT + "graspWidth", RT + "name", RT + "hasGrasp"} <= found
