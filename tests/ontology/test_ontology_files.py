"""Every file is well formed, declared, documented and where the catalogue says."""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections import Counter
from pathlib import Path

import pyoxigraph as ox
import pytest
import rdflib
from rdflib.namespace import OWL, RDF, RDFS, XSD

import ontology

ROOM = Path(ontology.__file__).parent
ROOT = ROOM.parent
RT = rdflib.Namespace(ontology.NS)
TURTLE = sorted(ROOM.rglob("*.ttl"))
OWN = sorted((ROOM / "rtask").glob("*.ttl"))
KINDS = {
    OWL.Class,
    OWL.ObjectProperty,
    OWL.DatatypeProperty,
    OWL.AnnotationProperty,
    OWL.NamedIndividual,
}


def _name(path: Path) -> str:
    return path.relative_to(ROOM).as_posix()


@pytest.fixture(scope="module")
def graphs() -> dict[str, rdflib.Graph]:
    return {_name(path): rdflib.Graph().parse(path) for path in TURTLE}


@pytest.fixture(scope="module")
def whole(graphs: dict[str, rdflib.Graph]) -> rdflib.Graph:
    union = rdflib.Graph()
    for graph in graphs.values():
        union += graph
    return union


@pytest.fixture(scope="module")
def declared(graphs: dict[str, rdflib.Graph]) -> Counter[str]:
    """Count in how many files each of our terms is declared."""
    counts: Counter[str] = Counter()
    for graph in graphs.values():
        terms = {s for kind in KINDS for s in graph.subjects(RDF.type, kind)}
        counts.update(str(t) for t in terms if str(t).startswith(ontology.NS))
    return counts


@pytest.mark.parametrize("path", TURTLE, ids=_name)
def test_two_parsers_agree_on_a_file(path: Path) -> None:
    by_rdflib = len(rdflib.Graph().parse(path))
    assert by_rdflib == len({*ox.parse(path=str(path))}) > 0


def test_catalogue_lists_every_file_with_its_digest(graphs: dict[str, rdflib.Graph]) -> None:
    catalogue = tomllib.loads((ROOM / "catalog.toml").read_text())["ontology"]
    assert sorted(entry["file"] for entry in catalogue) == sorted(graphs)
    for entry in catalogue:
        graph, iri = graphs[entry["file"]], rdflib.URIRef(entry["iri"])
        digest = hashlib.sha256((ROOM / entry["file"]).read_bytes()).hexdigest()
        assert entry["sha256"] == digest, f"catalog.toml is stale: {entry['file']} is {digest}"
        assert list(graph.subjects(RDF.type, OWL.Ontology)) == [iri]
        assert str(graph.value(iri, OWL.versionInfo)) == entry["version"]
        assert str(graph.value(iri, OWL.versionIRI)).endswith("/" + entry["version"])
        assert sorted(map(str, graph.objects(iri, OWL.imports))) == entry["imports"]


def test_every_import_is_in_the_catalogue() -> None:
    catalogue = tomllib.loads((ROOM / "catalog.toml").read_text())["ontology"]
    known = {entry["iri"] for entry in catalogue}
    assert {iri for entry in catalogue for iri in entry["imports"]} <= known


def test_root_imports_what_a_knowledge_base_loads(graphs: dict[str, rdflib.Graph]) -> None:
    root = rdflib.URIRef(ontology.ONTOLOGY)
    loaded = [_name(path) for path in ontology.modules()]
    headers = {next(graphs[name].subjects(RDF.type, OWL.Ontology)) for name in loaded}
    assert set(graphs["rtask.ttl"].objects(root, OWL.imports)) == headers - {root}
    assert "rtask/dl.ttl" not in loaded


@pytest.mark.parametrize("path", OWN, ids=_name)
def test_module_imports_what_it_uses(path: Path, graphs: dict[str, rdflib.Graph]) -> None:
    """So that an editor that opens one module sees every term with its declaration."""
    home = {
        str(term): str(defined)
        for graph in graphs.values()
        for term, defined in graph.subject_objects(RDFS.isDefinedBy)
    }
    graph = graphs[_name(path)]
    iri = next(graph.subjects(RDF.type, OWL.Ontology))
    imports = {str(i) for i in graph.objects(iri, OWL.imports)} | {str(iri)}
    if ontology.ONTOLOGY in imports:
        return
    about = [triple for triple in graph if triple[0] != iri]
    used = {home[str(t)] for triple in about for t in triple if str(t) in home}
    external = ontology.ONTOLOGY + "/external"
    used = {external if u.startswith("http://www.w3.org/") else u for u in used}
    assert used - {str(iri)} <= imports


def test_a_term_is_declared_once(declared: Counter[str]) -> None:
    assert [term for term, n in declared.items() if n != 1] == []


def test_terms_used_in_data_files_are_declared(declared: Counter[str], whole: rdflib.Graph) -> None:
    texts = [*(ROOM / "rules").glob("*.rq"), *(ROOM / "queries").rglob("*.rq")]
    used = {str(term) for triple in whole for term in triple if str(term).startswith(RT)}
    for path in [*texts, *TURTLE, ROOM / "examples" / "sample.trig"]:
        used |= {ontology.NS + name for name in re.findall(r"\brt:([A-Za-z]\w*)", path.read_text())}
    assert used - {ontology.NS} - set(declared) == set()


PYTHON = [
    path
    for room in ("reasoner", "features", "grasp", "rtask", "simulate", "endpoint", "ontology")
    for path in sorted((ROOT / room).rglob("*.py"))
]


# a prefixed name, `NS + "name"`, or an attribute of a namespace object; an ellipsis, a placeholder
# in braces or a trailing `<` ends a family of names, not a name
MENTION = re.compile(
    r"\brt:([A-Za-z]\w*)(?![\w{<]|\.\.\.)|\b_?(?:RT|NS) \+ \"(\w+)\"(?! \+)|\bRT\.([A-Za-z]\w*)"
)


def test_terms_used_in_python_are_declared(declared: Counter[str]) -> None:
    names = {term.removeprefix(ontology.NS) for term in declared}
    unknown = {
        (path.relative_to(ROOT).as_posix(), name)
        for path in PYTHON
        for line in path.read_text().splitlines()
        if ">>>" not in line  # an example may make up individuals
        for found in MENTION.findall(line)
        for name in found
        if name and name not in names
    }
    assert unknown == set()


def test_the_namespace_is_spelled_in_one_place() -> None:
    """Python takes it from ``ontology.NS``, so that it can change."""
    assert [p.relative_to(ROOT).as_posix() for p in PYTHON if ontology.NS in p.read_text()] == [
        "ontology/__init__.py"
    ]


def test_foreign_terms_are_declared(whole: rdflib.Graph) -> None:
    prefixes = ("prov", "sosa", "time", "skos", "dcterms", "cora", "corax", "rparts", "pos", "sumo")
    spaces = tuple(ontology.PREFIXES[p] for p in prefixes)
    declared = {str(s) for kind in KINDS for s in whole.subjects(RDF.type, kind)}
    used = {
        str(t)
        for triple in whole
        for t in triple
        if isinstance(t, rdflib.URIRef) and str(t).startswith(spaces) and str(t) not in spaces
    }
    ontologies = {str(s) for s in whole.subjects(RDF.type, OWL.Ontology)}
    homes = {str(o) for o in whole.objects(None, RDFS.isDefinedBy)}
    assert used - declared - ontologies - homes == set()


def test_every_term_is_documented(graphs: dict[str, rdflib.Graph]) -> None:
    for name, graph in graphs.items():
        if name.startswith("shapes/"):
            continue
        header = next(graph.subjects(RDF.type, OWL.Ontology))
        for term in {s for kind in KINDS for s in graph.subjects(RDF.type, kind)}:
            if isinstance(term, rdflib.BNode):
                continue
            labels, comments = graph.objects(term, RDFS.label), graph.objects(term, RDFS.comment)
            assert [label.language for label in labels] == ["en"], term
            (comment,) = list(comments)
            assert comment.language == "en", term
            assert str(comment)[-1] in ".!", f"{term}: a comment is a sentence"
            if str(term).startswith(ontology.NS):
                assert graph.value(term, RDFS.isDefinedBy) == header, term


def test_no_comment_only_repeats_the_label(whole: rdflib.Graph) -> None:
    repeated = [
        term
        for term, label in whole.subject_objects(RDFS.label)
        if str(whole.value(term, RDFS.comment)).lower().strip(" .") == str(label).lower()
    ]
    assert repeated == []


def test_every_number_has_a_unit(whole: rdflib.Graph) -> None:
    numeric = {XSD.double, XSD.positiveInteger, XSD.nonNegativeInteger}
    for term in whole.subjects(RDF.type, OWL.DatatypeProperty):
        if str(term).startswith(ontology.NS):
            units = list(whole.objects(term, RT.unit))
            is_number = whole.value(term, RDFS.range) in numeric
            assert len(units) == (1 if is_number else 0), term
            assert all(str(u).startswith(ontology.PREFIXES["unit"]) for u in units), term


def test_rule_results_have_no_domain_and_no_range(graphs: dict[str, rdflib.Graph]) -> None:
    """An axiom would feed the keys' sameAs and close a cycle through the rules' negation."""
    graph = graphs["rtask/rules.ttl"]
    assert not set(graph.subject_objects(RDFS.domain))
    ranges = set(graph.objects(None, RDFS.range))
    assert ranges <= {XSD.double, XSD.boolean}


def test_reason_codes_match_their_iris(whole: rdflib.Graph) -> None:
    reasons = list(whole.subjects(RDF.type, RT.OutcomeReason))
    assert len(reasons) == 35
    for reason in reasons:
        assert reason == RT["reason_" + str(whole.value(reason, RT.code))]
        assert whole.value(reason, RT.phase) is not None


def test_coded_values_are_different_from_each_other(whole: rdflib.Graph) -> None:
    lists = [set(whole.items(members)) for members in whole.objects(None, OWL.distinctMembers)]
    for kind in (
        RT.OutcomeReason,
        RT.ObjectFunction,
        RT.Capability,
        RT.ClosureMode,
        RT.AngleSector,
    ):
        assert set(whole.subjects(RDF.type, kind)) in lists, kind


def test_one_value_shapes_follow_the_vocabulary(
    graphs: dict[str, rdflib.Graph], whole: rdflib.Graph
) -> None:
    """One shape for each property that is functional or measured, and no other."""
    sh = rdflib.Namespace(ontology.PREFIXES["sh"])
    shapes = graphs["shapes/graph/single-values.ttl"]
    wanted = set(whole.subjects(RDF.type, OWL.FunctionalProperty)) | set(
        whole.subjects(RT.unit, None)
    )
    # a statement has as many confidences as reifiers, a mass a bound from each that lifted it
    wanted = {p for p in wanted if str(p).startswith(ontology.NS)} - {RT.confidence, RT.massBound}
    assert {o for _, o in shapes.subject_objects(sh.targetSubjectsOf)} == wanted


def test_files_are_found_by_name() -> None:
    assert ontology.path("catalog.toml") == ROOM / "catalog.toml"
    with pytest.raises(FileNotFoundError, match=r"no file 'nonsense\.ttl'"):
        ontology.path("nonsense.ttl")


def test_prefixes_name_namespaces() -> None:
    assert ontology.PREFIXES["rt"] == ontology.NS
    assert all(iri[-1] in "#/" for iri in ontology.PREFIXES.values())
