"""Other engines for OWL 2 RL, each run in a process of its own with bounds on time and memory."""

from __future__ import annotations

import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, parse, serialize
from pyoxigraph import Triple as RdfTriple

from reasoner import Closure
from reasoner.terms.datatypes import value_of
from tests.benchmarks.reasoner.kitchens import OWL, RDF, RDFS, XSD, Triple

MEMORY = 8 << 30
Key = tuple[Any, ...]


@dataclass
class Run:
    """Result of one run.

    Attributes
    ----------
    seconds, cpu : float
        From the parsed triples to all derived triples in the hands of Python.
    triples : frozenset
        Asserted and derived triples without blank nodes, literals by value.
    failure : str
        Why there is no result.
    """

    seconds: float = 0.0
    cpu: float = 0.0
    triples: frozenset[tuple[Key, Key, Key]] = field(default_factory=frozenset)
    failure: str = ""


def key(term: Any) -> Key:
    """Return what a term of pyoxigraph or rdflib is compared by.

    >>> key(NamedNode("urn:a")), key(Literal("1.0")) == key(Literal("1.0"))
    (('iri', 'urn:a'), True)
    """
    if isinstance(term, NamedNode):
        return "iri", term.value
    if isinstance(term, Literal):
        return value_of(term.value, term.datatype.value, term.language).key
    if isinstance(term, BlankNode) or type(term).__name__ == "BNode":
        return ()
    if type(term).__name__ == "URIRef":
        return "iri", str(term)
    datatype = str(term.datatype) if term.datatype else XSD + "string"
    return value_of(str(term), datatype, term.language).key


def ours(triples: list[Triple]) -> tuple[float, float, list[Any]]:
    """Close with this reasoner."""
    start, cpu = time.perf_counter(), time.process_time()
    closure = Closure.build(triples, [])
    derived = list(closure.inferred())
    return time.perf_counter() - start, time.process_time() - cpu, [*triples, *derived]


def reasonable(triples: list[Triple]) -> tuple[float, float, list[Any]]:
    """Close with `reasonable`; its loading is not counted, its answer is."""
    from reasonable import PyReasoner  # type: ignore[import-not-found]

    engine = PyReasoner()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.ttl"
        path.write_bytes(_text(triples))
        engine.load_file(str(path))
    start, cpu = time.perf_counter(), time.process_time()
    closed = engine.reason()
    return time.perf_counter() - start, time.process_time() - cpu, closed


def owlrl(triples: list[Triple]) -> tuple[float, float, list[Any]]:
    """Close with `owlrl`."""
    from owlrl import DeductiveClosure, OWLRL_Semantics
    from rdflib import Graph

    graph = Graph()
    graph.parse(data=_text(triples), format="nt")
    start, cpu = time.perf_counter(), time.process_time()
    DeductiveClosure(OWLRL_Semantics).expand(graph)
    return time.perf_counter() - start, time.process_time() - cpu, list(graph)


def run(
    engine: Callable[[list[Triple]], Any], triples: list[Triple], limit_s: float = 120.0
) -> Run:
    """Run an engine in a process of its own, with 8 GiB and a time limit."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=_work, args=(engine, _text(triples), there))
    child.start()
    there.close()
    try:
        found = here.recv() if here.poll(limit_s) else Run(failure=f"over {limit_s:g} s")
    except EOFError:
        found = Run(failure="out of memory (8 GiB)")
    child.kill()
    child.join()
    assert isinstance(found, Run)
    return found


@dataclass
class Closed:
    """The closure that another engine derived.

    Attributes
    ----------
    cpu : float
        CPU seconds of deriving and of handing the triples over.
    triples : list
        Terms of pyoxigraph; without triples that no RDF store takes.
    failure : str
        Why there is no result.
    """

    cpu: float = 0.0
    triples: list[Any] = field(default_factory=list)
    failure: str = ""


def closed(engine: Callable[[list[Triple]], Any], triples: list[Any], limit_s: float) -> Closed:
    """Close triples with an engine in a process of its own; return the closure's triples."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=_close, args=(engine, _text(triples), there))
    child.start()
    there.close()
    try:
        found = here.recv() if here.poll(limit_s) else (0.0, b"", f"over {limit_s:g} s")
    except EOFError:
        found = (0.0, b"", "out of memory (8 GiB)")
    child.kill()
    child.join()
    cpu, text, failure = found
    quads = parse(text, format=RdfFormat.N_TRIPLES) if text else ()
    return Closed(cpu, [(q.subject, q.predicate, q.object) for q in quads], failure)


def _close(engine: Callable[[list[Triple]], Any], text: bytes, pipe: Any) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    triples: list[Any] = [
        (q.subject, q.predicate, q.object) for q in parse(text, format=RdfFormat.N_TRIPLES)
    ]
    try:
        _, cpu, found = engine(triples)
    except ImportError as error:
        pipe.send((0.0, b"", f"skipped: pip install {error.name}"))
        return
    except MemoryError:
        pipe.send((0.0, b"", "out of memory (8 GiB)"))
        return
    lines = (" ".join(map(_n3, triple)) + " .\n" for triple in found if _is_storable(triple))
    pipe.send((cpu, "".join(lines).encode(), ""))


def _is_storable(triple: Any) -> bool:
    return type(triple[0]).__name__ != "Literal" and type(triple[1]).__name__ in (
        "NamedNode",
        "URIRef",
    )


def _n3(term: Any) -> str:
    """Return a term of pyoxigraph or rdflib in N-Triples syntax."""
    return str(term.n3()) if hasattr(term, "n3") else str(term)


def _work(engine: Callable[[list[Triple]], Any], text: bytes, pipe: Any) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    quads = parse(text, format=RdfFormat.N_TRIPLES)
    triples: list[Any] = [(quad.subject, quad.predicate, quad.object) for quad in quads]
    try:
        seconds, cpu, closed = engine(triples)
    except ImportError as error:
        pipe.send(Run(failure=f"skipped: pip install {error.name}"))
        return
    except MemoryError:
        pipe.send(Run(failure="out of memory (8 GiB)"))
        return
    keys = (tuple(map(key, triple)) for triple in closed)
    pipe.send(Run(seconds, cpu, frozenset(k for k in keys if () not in k)))


def _text(triples: list[Triple]) -> bytes:
    lines = [RdfTriple(*triple) for triple in triples]  # type: ignore[arg-type]
    return serialize(lines, format=RdfFormat.N_TRIPLES) or b""


def reason_for(triple: tuple[Key, Key, Key]) -> str:
    """Name the rules behind a triple that only one engine has, as far as its shape tells.

    >>> reason_for((("iri", "urn:a"), ("iri", RDF + "type"), ("iri", OWL + "Thing")))
    'true of everything: cls-thing, scm-cls, eq-ref, dt-type1'
    """
    s, p, o = triple
    name = p[-1].rsplit("#", 1)[-1]
    is_built_in = (
        s[0] != "iri"
        or s[-1].startswith((OWL, RDF, RDFS, XSD))
        or (o[0] == "iri" and o[-1] in (OWL + "Thing", RDFS + "Resource", RDFS + "Literal"))
    )
    if s == o or is_built_in:
        return "true of everything: cls-thing, scm-cls, eq-ref, dt-type1"
    if p[-1].startswith((RDFS, OWL)):
        return f"schema: {name} (scm-*)"
    return f"data: {name}"
