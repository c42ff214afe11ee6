"""Hostile requests: texts and bodies that are small to send and dear to read, plan, derive or store.

Unlike :mod:`tests.hostile_writes`, whose statements mean much, these are hostile by their form.
"""
# ruff: noqa: E501 - texts as they are sent

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["REQUESTS", "HostileRequest"]

_OWL = "PREFIX owl: <http://www.w3.org/2002/07/owl#> PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> "
_RDF = "PREFIX rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> "


@dataclass(frozen=True)
class HostileRequest:
    """A request.

    Parameters
    ----------
    method, path, content_type
        Of the request; ``{own}`` in the path is the graph of the caller.
    body
        Returns its bytes.
    encoding
        ``Content-Encoding``; none if empty.
    """

    method: str
    path: str
    content_type: str
    body: Callable[[], bytes]
    encoding: str = ""


def _update(make: Callable[[], str]) -> HostileRequest:
    return HostileRequest("POST", "/update", "application/sparql-update", lambda: make().encode())


def _query(make: Callable[[], str]) -> HostileRequest:
    return HostileRequest("POST", "/query", "application/sparql-query", lambda: make().encode())


def _store(content_type: str, make: Callable[[], bytes], encoding: str = "") -> HostileRequest:
    return HostileRequest("POST", "/store?graph={own}", content_type, make, encoding)


def _insert(lines: str) -> str:
    return f"{_OWL}{_RDF}INSERT DATA {{ {lines} }}"


def _cells(name: str, items: list[str]) -> str:
    rests = [*(f"<urn:{name}{i}>" for i in range(1, len(items))), "rdf:nil"]
    return " ".join(
        f"<urn:{name}{i}> rdf:first {item} ; rdf:rest {rest} ."
        for i, (item, rest) in enumerate(zip(items, rests, strict=True))
    )


def _bombed_xml() -> bytes:
    entities = "".join(f'<!ENTITY e{i + 1} "{f"&e{i};" * 10}">' for i in range(9))
    return (
        f'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY e0 "lol">{entities}]>'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        '<rdf:Description rdf:about="urn:x"><p xmlns="urn:">&e9;</p></rdf:Description></rdf:RDF>'
    ).encode()


def _nested_json(depth: int) -> bytes:
    return (b'{"urn:p":' * depth) + b'{"@id":"urn:x"}' + b"}" * depth


PAIRS = "?a ?b ?c . ?d ?e ?f . ?g ?h ?i"

REQUESTS: dict[str, HostileRequest] = {
    "10,000 tiny graphs": _update(
        lambda: _insert(
            " ".join(f"GRAPH <urn:g{i}> {{ <urn:a> <urn:p> {i} }}" for i in range(10_000))
        )
    ),
    "10,000 graphs created": _update(
        lambda: " ; ".join(f"CREATE SILENT GRAPH <urn:e{i}>" for i in range(10_000))
    ),
    "long IRI, 2 MB": _update(lambda: _insert(f"<urn:{'a' * 2_000_000}> <urn:p> 1")),
    "5,000 IRIs of 2 kB": _update(
        lambda: _insert(" ".join(f"<urn:{i}/{'b' * 2_000}> <urn:p> {i} ." for i in range(5_000)))
    ),
    "100,000 prefixes": _update(
        lambda: (
            "\n".join(f"PREFIX p{i}: <urn:{i}/>" for i in range(100_000))
            + " INSERT DATA { p1:a p2:b p3:c }"
        )
    ),
    "prefix of 30 kB used 500 times": _update(
        lambda: (
            f"PREFIX p: <urn:{'x' * 30_000}> "
            + _insert(" ".join(f"p:{i} <urn:p> {i} ." for i in range(500)))
        )
    ),
    "50,000 operations": _update(
        lambda: " ; ".join(["DELETE DATA { <urn:a> <urn:b> 1 }"] * 50_000)
    ),
    "nested groups": _update(
        lambda: "DELETE { ?s ?p ?o } WHERE " + "{" * 5_000 + "?s ?p ?o" + "}" * 5_000
    ),
    "nested parentheses": _query(
        lambda: "SELECT * { ?s ?p ?o FILTER(" + "(" * 20_000 + "1" + ")" * 20_000 + ") }"
    ),
    "nested negations": _query(lambda: "SELECT * { ?s ?p ?o FILTER(" + "!" * 50_000 + "true) }"),
    "nested NOT EXISTS": _query(
        lambda: "SELECT * { ?s ?p ?o " + "FILTER NOT EXISTS { ?s ?p ?o " * 500 + "}" * 501
    ),
    "nested subqueries": _query(lambda: "SELECT * { " * 1_000 + "?s ?p ?o" + " }" * 1_000),
    "nested paths": _query(
        lambda: "SELECT * { ?s " + "(" * 5_000 + "<urn:p>" + "*)" * 5_000 + " ?o }"
    ),
    "nested triple terms": _update(
        lambda: _insert("<urn:a> <urn:p> " + "<<( <urn:a> <urn:p> " * 2_000 + "1" + ")>>" * 2_000)
    ),
    "sum of 50,000": _query(lambda: "SELECT (" + "+".join(["1"] * 50_000) + " AS ?x) {}"),
    "IN with 100,000": _query(
        lambda: "SELECT * { ?s ?p ?o FILTER(?o IN (" + ",".join(map(str, range(100_000))) + ")) }"
    ),
    "regular expression, nested counts": _query(
        lambda: (
            'SELECT * { ?s ?p ?o FILTER REGEX(STR(?o), "((((a{1,99}){1,99}){1,99}){1,99}){1,99}") }'
        )
    ),
    "a replacement that grows": _update(
        lambda: (
            'INSERT { <urn:s> <urn:p> ?x5 } WHERE { BIND("aaaaaaaaaaaaaaaaaaaa" AS ?x0) '
            + " ".join(
                f'BIND(REPLACE(?x{i}, "a", "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa") AS ?x{i + 1})'
                for i in range(5)
            )
            + " }"
        )
    ),
    "cross product deleted and inserted": _update(
        lambda: f"DELETE {{ ?a ?b ?c }} INSERT {{ ?a ?e ?i }} WHERE {{ {PAIRS} }}"
    ),
    "VALUES times VALUES": _update(
        lambda: (
            "INSERT { ?x <urn:v> ?y } WHERE { "
            f"VALUES ?x {{ {' '.join(f'<urn:{i}>' for i in range(3_000))} }} "
            f"VALUES ?y {{ {' '.join(map(str, range(3_000)))} }} }}"
        )
    ),
    "1,000 variables": _update(
        lambda: (
            "INSERT { <urn:s> <urn:p> ?x } WHERE { "
            + " ".join(f"OPTIONAL {{ ?x <urn:p{i}> ?v{i} }}" for i in range(1_000))
            + " }"
        )
    ),
    "everything copied": _update(
        lambda: " ; ".join(f"COPY DEFAULT TO <urn:copy{i}>" for i in range(20))
    ),
    "everything moved": _update(lambda: "MOVE DEFAULT TO <urn:moved>"),
    "cleared": _update(lambda: "CLEAR ALL ; DROP ALL"),
    "LOAD of itself": _update(
        lambda: "LOAD <http://127.0.0.1:{port}/store?default> INTO GRAPH <urn:l>"
    ),
    "LOAD of a file": _update(lambda: "LOAD <file:///etc/passwd> INTO GRAPH <urn:l>"),
    "SERVICE to itself": _update(
        lambda: (
            "INSERT { ?s <urn:q> ?o } WHERE { SERVICE <http://127.0.0.1:{port}/query> { ?s ?p ?o } }"
        )
    ),
    "200 SERVICE clauses": _query(
        lambda: (
            "SELECT * { "
            + " ".join(
                f"SERVICE SILENT <http://10.255.255.{i}/q> {{ ?s{i} ?p ?o }}" for i in range(200)
            )
            + " }"
        )
    ),
    "sameAs with literals": _update(
        lambda: _insert(
            " ".join(f'<urn:l{i}> owl:sameAs "{i}" , {i} , <urn:l{i + 1}> .' for i in range(500))
        )
    ),
    "key of 300 properties": _update(
        lambda: _insert(
            f"<urn:K> owl:hasKey <urn:k0> . {_cells('k', [f'<urn:kp{i}>' for i in range(300)])} "
            + " ".join(
                f"<urn:i{n}> a <urn:K> ; {' ; '.join(f'<urn:kp{i}> {i}' for i in range(300))} ."
                for n in range(10)
            )
        )
    ),
    "300 keys over 100 things": _update(
        lambda: _insert(
            " ".join(
                f"<urn:K> owl:hasKey <urn:z{i}> . <urn:z{i}> rdf:first <urn:zp{i}> ; rdf:rest rdf:nil ."
                for i in range(300)
            )
            + " ".join(
                f"<urn:zi{n}> a <urn:K> ; {' ; '.join(f'<urn:zp{i}> {n}' for i in range(50))} ."
                for n in range(100)
            )
        )
    ),
    "property chain of 1,000 steps": _update(
        lambda: _insert(
            f"<urn:c> owl:propertyChainAxiom <urn:c0> . {_cells('c', ['<urn:step>'] * 1_000)} "
            + " ".join(f"<urn:n{i}> <urn:step> <urn:n{i + 1}> ." for i in range(1_000))
        )
    ),
    "list that is a ring": _update(
        lambda: _insert(
            "<urn:R> owl:unionOf <urn:r0> , <urn:r1> . <urn:r0> rdf:first <urn:A> , <urn:B> ; rdf:rest <urn:r1> , <urn:r0> . "
            "<urn:r1> rdf:first <urn:R> ; rdf:rest <urn:r0> , rdf:nil . <urn:x> a <urn:A> , <urn:R> ."
        )
    ),
    "ladder of intersections": _update(
        lambda: _insert(
            " ".join(
                f"<urn:I{i}> owl:intersectionOf <urn:li{i}> . <urn:li{i}> rdf:first <urn:I{i + 1}> ; "
                f"rdf:rest <urn:lj{i}> . <urn:lj{i}> rdf:first <urn:I{i + 2}> ; rdf:rest rdf:nil ."
                for i in range(700)
            )
            + " <urn:x> a <urn:I0> ."
        )
    ),
    "subproperties of everything": _update(
        lambda: _insert(
            " ".join(
                f"<urn:sp{i}> rdfs:subPropertyOf <urn:sp{j}> ."
                for i in range(40)
                for j in range(40)
            )
            + " ".join(f"<urn:u{i}> <urn:sp{i % 40}> <urn:u{i + 1}> ." for i in range(400))
        )
    ),
    "cardinalities that are none": _update(
        lambda: _insert(
            '<urn:Z> owl:maxCardinality "many" , -1 , 1e400 , "99999999999999999999"^^<http://www.w3.org/2001/XMLSchema#integer> ; '
            "owl:onProperty <urn:p> , <urn:Z> , rdf:type . <urn:x> a <urn:Z> ; <urn:p> 1 , 2 ."
        )
    ),
    "numbers beyond all types": _update(
        lambda: _insert(
            f"<urn:x> <urn:p> 1e999999999 , {'9' * 100_000} , 0.{'0' * 100_000}1 , "
            '"P99999999999999Y"^^<http://www.w3.org/2001/XMLSchema#duration> , '
            '"999999999999-13-45T99:99:99Z"^^<http://www.w3.org/2001/XMLSchema#dateTime> , "x"@'
            + "-".join(["aaaaaaaa"] * 2_000)
        )
    ),
    "10,000 reifiers": _update(
        lambda: _insert(
            " ".join(
                f"<urn:a> <urn:p> {i} ~ <urn:r{i}> {{| <urn:q> {i} |}} ." for i in range(10_000)
            )
        )
    ),
    "XML with entities in entities": _store("application/rdf+xml", _bombed_xml),
    "JSON-LD, nested": _store("application/ld+json", lambda: _nested_json(50_000)),
    "JSON-LD, context elsewhere": _store(
        "application/ld+json",
        lambda: json.dumps(
            {"@context": ["http://10.255.255.1/c"] * 50, "@id": "urn:x", "p": 1}
        ).encode(),
    ),
    "gzip of 200 MB": _store("text/turtle", lambda: gzip.compress(b"#" * (200 << 20)), "gzip"),
    "gzip in gzip": _store(
        "text/turtle", lambda: gzip.compress(gzip.compress(b"#" * (64 << 20))), "gzip"
    ),
    "Turtle, 60,000 blank nodes": _store(
        "text/turtle",
        lambda: "\n".join(f"[] <urn:p> {i} ; <urn:q> [] ." for i in range(30_000)).encode(),
    ),
    "Turtle, one subject, 60,000 objects": _store(
        "text/turtle",
        lambda: ("<urn:one> <urn:p> " + ",".join(map(str, range(60_000))) + " .").encode(),
    ),
    "Turtle, a line without an end": _store(
        "text/turtle", lambda: b'<urn:a> <urn:p> "' + b"x" * (30 << 20)
    ),
    "Turtle, prefixes in a chain": _store(
        "text/turtle",
        lambda: (
            "\n".join(f"@base <x{'y' * 20}/> ." for _ in range(20_000)).encode() + b"<a> <b> <c> ."
        ),
    ),
    "TriG, 20,000 graphs": _store(
        "application/trig",
        lambda: "\n".join(f"<urn:t{i}> {{ <urn:a> <urn:b> {i} }}" for i in range(20_000)).encode(),
    ),
    "N-Triples, one byte each line wrong": _store(
        "application/n-triples", lambda: b"<urn:a> <urn:b> <urn:c> .\n" * 200_000 + b"<urn:a"
    ),
}
"""Requests by what is hostile in them."""
