"""The vocabulary of RTASK: data files, and where to find them.

The room holds OWL modules over CORA (IEEE 1872-2015), SPARQL rules, SHACL shapes, competency
queries and a sample. It imports nothing and computes nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

__all__ = [
    "BASE",
    "FUNCTIONS",
    "NS",
    "ONTOLOGY",
    "PREFIXES",
    "episode_queries",
    "graph_shapes",
    "modules",
    "patches",
    "path",
    "queries",
    "rules",
    "shapes",
]

NS: Final = "https://w3id.org/rtask-kg/ns#"
"""Namespace of every term, whichever module declares it."""

ONTOLOGY: Final = "https://w3id.org/rtask-kg/onto"
"""IRI of the root ontology; a module's IRI is this, a slash and the module's name."""

FUNCTIONS: Final = "https://w3id.org/rtask-kg/functions#"
"""Namespace of the place functions in queries, which the engine computes and no graph holds."""

BASE: Final = "https://w3id.org/rtask-kg/kb/"
"""What the instance IRIs of a store begin with: this, the store's id and a slash."""

PREFIXES: Final[dict[str, str]] = {
    "rt": NS,
    "cora": "http://purl.org/ieee1872-owl/cora-bare#",
    "corax": "http://purl.org/ieee1872-owl/corax#",
    "rparts": "http://purl.org/ieee1872-owl/rparts#",
    "pos": "http://purl.org/ieee1872-owl/pos#",
    "sumo": "http://purl.org/ieee1872-owl/sumo-cora#",
    "prov": "http://www.w3.org/ns/prov#",
    "sosa": "http://www.w3.org/ns/sosa/",
    "time": "http://www.w3.org/2006/time#",
    "skos": "http://www.w3.org/2004/02/skos/core#",
    "dcterms": "http://purl.org/dc/terms/",
    "unit": "http://qudt.org/vocab/unit/",
    "sh": "http://www.w3.org/ns/shacl#",
    "owl": "http://www.w3.org/2002/07/owl#",
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "rdfs": "http://www.w3.org/2000/01/rdf-schema#",
    "xsd": "http://www.w3.org/2001/XMLSchema#",
}
"""Prefixes of the vocabularies in use, for queries and for serialisations."""

_ROOM: Final = Path(__file__).resolve().parent
_MODULES: Final = (
    "cora/sumo-cora.ttl",
    "cora/corax.ttl",
    "cora/cora-bare.ttl",
    "cora/rparts.ttl",
    "cora/pos.ttl",
    "external.ttl",
    "rtask/core.ttl",
    "rtask/task.ttl",
    "rtask/robot.ttl",
    "rtask/object.ttl",
    "rtask/category.ttl",
    "rtask/pose.ttl",
    "rtask/feature.ttl",
    "rtask/observation.ttl",
    "rtask/grasp.ttl",
    "rtask/learning.ttl",
    "rtask/service.ttl",
    "rtask/graph.ttl",
    "rtask/world.ttl",
    "rtask/rules.ttl",
    "rtask/plan.ttl",
    "rtask.ttl",
)


def path(name: str) -> Path:
    """Return the file ``name``, such as ``"rtask/grasp.ttl"`` or ``"catalog.toml"``.

    Raises
    ------
    FileNotFoundError
        If the room has no such file.

    Examples
    --------
    >>> path("rtask/grasp.ttl").name
    'grasp.ttl'
    """
    file = _ROOM / name
    if not file.is_file():
        raise FileNotFoundError(f"the ontology has no file {name!r}; see {_ROOM / 'catalog.toml'}")
    return file


def modules() -> list[Path]:
    """Return the modules that a new knowledge base loads, in order; the root comes last."""
    return [path(name) for name in _MODULES]


def rules() -> list[Path]:
    """Return the SPARQL rules: one CONSTRUCT query a file."""
    return sorted((_ROOM / "rules").glob("*.rq"))


def shapes() -> list[Path]:
    """Return the SHACL shapes for the union of all graphs, asserted and inferred."""
    return sorted((_ROOM / "shapes").glob("*.ttl"))


def graph_shapes() -> list[Path]:
    """Return the SHACL shapes for each agent's graph alone: one value a graph.

    Two robots may measure the mass of one object differently; one robot states one mass.
    """
    return sorted((_ROOM / "shapes" / "graph").glob("*.ttl"))


def patches() -> Path:
    """Return the list of known faults of published ontologies, which the loader mends."""
    return path("patches.toml")


def queries() -> list[Path]:
    """Return the competency queries; each begins with its question and its expected answer."""
    return sorted((_ROOM / "queries").glob("*.rq"))


def episode_queries() -> list[Path]:
    """Return the questions about what robots did; each file begins with its question."""
    return sorted((_ROOM / "queries" / "episodes").glob("*.rq"))
