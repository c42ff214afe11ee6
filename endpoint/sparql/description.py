"""The service description: SPARQL 1.1 Service Description, in RDF at the endpoint's own address."""

from __future__ import annotations

from collections.abc import Iterable

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, serialize

from endpoint.http.messages import Response
from endpoint.sparql.negotiation import content_type

SD = "http://www.w3.org/ns/sparql-service-description#"
VOID = "http://rdfs.org/ns/void#"
FORMATS = "http://www.w3.org/ns/formats/"
_RDF_TYPE = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
_RL_PROFILE = NamedNode("http://www.w3.org/ns/owl-profile/RL")
_RL_REGIME = NamedNode("http://www.w3.org/ns/entailment/OWL-RDF-Based")
_SIMPLE_REGIME = NamedNode("http://www.w3.org/ns/entailment/Simple")

_RESULTS = ("SPARQL_Results_JSON", "SPARQL_Results_XML", "SPARQL_Results_CSV", "SPARQL_Results_TSV")
_RDF = ("Turtle", "N-Triples", "RDF_XML", "JSON-LD", "TriG", "N-Quads")
MAX_NAMED_GRAPHS = 1_000
_RDFS = "http://www.w3.org/2000/01/rdf-schema#"
_CUT = (
    f"Of the named graphs, the first {MAX_NAMED_GRAPHS} are listed here; all of them: "
    "SELECT ?g WHERE { GRAPH ?g {} }"
)


def describe(
    endpoint: NamedNode,
    media_type: str,
    *,
    plain: bool,
    updates: bool,
    graphs: Iterable[str] = (),
    base: str = "",
) -> Response:
    """Write the description of a service.

    Parameters
    ----------
    endpoint
        The requested URL as the client wrote it, without its query.
    media_type
        One of the graph types.
    plain
        Whether the default graph is a graph of its own, without inference.
    updates
        Whether updates are accepted here.
    graphs
        Named graphs that the caller may read; of more than :data:`MAX_NAMED_GRAPHS`, the first
        are listed, and the description says so.
    base
        IRI that starts all instances and the graphs of agents; empty if there is none.
    """
    triples = [*_service(endpoint, plain, updates), *_dataset(plain, graphs)]
    if base:
        triples.append(Triple(_DATASET, NamedNode(VOID + "uriSpace"), Literal(base)))
    rdf_format = RdfFormat.from_media_type(media_type)
    assert rdf_format is not None
    body = serialize(triples, format=rdf_format, prefixes={"sd": SD, "void": VOID})
    assert body is not None
    return Response(200, body, content_type(media_type))


_SERVICE, _DATASET, _DEFAULT = BlankNode("service"), BlankNode("dataset"), BlankNode("default")


def _sd(name: str) -> NamedNode:
    return NamedNode(SD + name)


def _service(endpoint: NamedNode, plain: bool, updates: bool) -> Iterable[Triple]:
    languages = ["SPARQL10Query", "SPARQL11Query", *(["SPARQL11Update"] if updates else [])]
    features = ["EmptyGraphs", *([] if plain else ["UnionDefaultGraph"])]
    yield Triple(_SERVICE, _RDF_TYPE, _sd("Service"))
    yield Triple(_SERVICE, _sd("endpoint"), endpoint)
    for language in languages:
        yield Triple(_SERVICE, _sd("supportedLanguage"), _sd(language))
    for feature in features:
        yield Triple(_SERVICE, _sd("feature"), _sd(feature))
    for name in (*_RESULTS, *_RDF):
        yield Triple(_SERVICE, _sd("resultFormat"), NamedNode(FORMATS + name))
    for name in _RDF:
        yield Triple(_SERVICE, _sd("inputFormat"), NamedNode(FORMATS + name))
    if plain:
        yield Triple(_SERVICE, _sd("defaultEntailmentRegime"), _SIMPLE_REGIME)
    else:
        yield Triple(_SERVICE, _sd("defaultEntailmentRegime"), _RL_REGIME)
        yield Triple(_SERVICE, _sd("defaultSupportedEntailmentProfile"), _RL_PROFILE)


def _dataset(plain: bool, graphs: Iterable[str]) -> Iterable[Triple]:
    yield Triple(_SERVICE, _sd("defaultDataset"), _DATASET)
    yield Triple(_SERVICE, _sd("availableGraphs"), _DATASET)
    yield Triple(_DATASET, _RDF_TYPE, _sd("Dataset"))
    yield Triple(_DATASET, _RDF_TYPE, _sd("GraphCollection"))
    yield Triple(_DATASET, _sd("defaultGraph"), _DEFAULT)
    yield Triple(_DEFAULT, _RDF_TYPE, _sd("Graph"))
    names = list(graphs)
    if len(names) > MAX_NAMED_GRAPHS:
        yield Triple(_DATASET, NamedNode(_RDFS + "comment"), Literal(_CUT, language="en"))
    for number, name in enumerate(names[:MAX_NAMED_GRAPHS]):
        node = BlankNode(f"graph{number}")
        yield Triple(_DATASET, _sd("namedGraph"), node)
        yield Triple(node, _RDF_TYPE, _sd("NamedGraph"))
        yield Triple(node, _sd("name"), NamedNode(name))
