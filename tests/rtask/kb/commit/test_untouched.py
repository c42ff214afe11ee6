"""Updates that change nothing say why, where the reason is the graph they look at."""

from __future__ import annotations

import pytest

from rtask.knowledge_base import KnowledgeBase

NAMED = "INSERT DATA { GRAPH <urn:g> { <urn:s> <urn:p> 1 } }"


@pytest.mark.parametrize(
    "text",
    [
        "DELETE WHERE { ?s <urn:p> ?o }",
        "DELETE DATA { <urn:s> <urn:p> 1 }",
        "DELETE { ?s <urn:p> ?o } WHERE { GRAPH ?g { ?s <urn:p> ?o } }",
    ],
)
def test_a_delete_that_looks_at_one_graph_names_it(memory: KnowledgeBase, text: str) -> None:
    memory.update(NAMED)
    done = memory.update(text)
    assert done.removed == 0
    assert str(memory.graphs.shared) in str(done.remark)


@pytest.mark.parametrize(
    "text",
    [
        "DELETE WHERE { GRAPH ?g { ?s <urn:p> ?o } }",
        "DELETE WHERE { GRAPH <urn:h> { ?s <urn:p> ?o } }",
        "WITH <urn:g> DELETE { ?s <urn:q> ?o } WHERE { ?s <urn:q> ?o }",
        "DELETE { ?s <urn:q> ?o } INSERT { <urn:s> <urn:q> 2 } WHERE { OPTIONAL { ?s <urn:q> ?o }}",
        "INSERT DATA { GRAPH <urn:g> { <urn:s> <urn:p> 1 } }",
    ],
)
def test_other_updates_have_no_remark(memory: KnowledgeBase, text: str) -> None:
    memory.update(NAMED)
    assert memory.update(text).remark is None
