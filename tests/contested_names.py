"""Statements about names of others, and what the owners of the names state afterwards."""

from __future__ import annotations

BASE = "urn:lab/"
PREFIXES = (
    "PREFIX owl: <http://www.w3.org/2002/07/owl#> "
    "PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> "
    "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "
    "PREFIX cora: <http://purl.org/ieee1872-owl/cora-bare#> "
    "PREFIX lab: <urn:lab:> "
)
AXIOMS = """
lab:One a owl:Restriction ; owl:onProperty lab:p ; owl:maxCardinality 1 .
lab:Boxed rdfs:subClassOf lab:One .
lab:None a owl:Restriction ; owl:onProperty lab:q ; owl:maxCardinality 0 .
lab:Sealed rdfs:subClassOf lab:None .
lab:Keyed owl:hasKey (lab:code) .
lab:inv a owl:InverseFunctionalProperty, owl:ObjectProperty .
lab:fun a owl:FunctionalProperty, owl:ObjectProperty .
lab:num a owl:FunctionalProperty, owl:DatatypeProperty .
lab:r rdfs:range lab:Process . lab:d rdfs:domain lab:Process . lab:Process owl:disjointWith rt:Mug .
lab:as a owl:AsymmetricProperty . lab:ir a owl:IrreflexiveProperty .
lab:pd1 owl:propertyDisjointWith lab:pd2 . lab:A owl:complementOf lab:B .
"""
ME = "its:self"
CONTRADICTED = {
    "functional data": (f"{ME} rt:serialNumber 'fake'", f"{ME} rt:serialNumber 'X1'"),
    "functional number": ("its:a lab:num 1", "its:a lab:num 2"),
    "functional object": (
        "its:a lab:fun my:b . my:b a rt:Grasp",
        "its:a lab:fun its:b . its:b a rt:Mug",
    ),
    "disjoint class": ("its:o a rt:Grasp", "its:o a rt:Mug"),
    "class of the robot": (f"{ME} a rt:Grasp", f"{ME} a cora:Robot"),
    "complement": ("its:a a lab:A", "its:a a lab:B"),
    "domain": ("its:c lab:d my:b", "its:c a rt:Mug"),
    "range": ("my:b lab:r its:c", "its:c a rt:Mug"),
    "range of an own property": ("my:r rdfs:range rt:Grasp . my:b my:r its:c", "its:c a rt:Mug"),
    "shipped range": ("its:m rt:bestMatch my:z", "its:m a rt:Mug"),
    "cardinality 1": (
        "its:a lab:p my:v . my:v a rt:Grasp",
        "its:a a lab:Boxed ; lab:p its:v . its:v a rt:Mug",
    ),
    "cardinality 0": ("its:a lab:q my:v", "its:a a lab:Sealed"),
    "asymmetric": ("its:a lab:as its:b", "its:b lab:as its:a"),
    "disjoint properties": ("its:a lab:pd1 its:b", "its:a lab:pd2 its:b"),
    "irreflexive": ("my:f lab:fun its:i1 , its:i2", "its:i1 lab:ir its:i2"),
    "irreflexive of merged": (
        "its:f lab:fun its:i2",
        "its:i1 lab:ir its:i2 . its:f lab:fun its:i1",
    ),
    "identity through a function": (
        "my:f lab:fun my:w , its:o . my:w a rt:Grasp",
        "its:o a rt:Mug",
    ),
}
"""What another states first, and what the owner of the names states then."""
MERGED = {
    "key": ("its:y a lab:Keyed ; lab:code 'Z'", "its:z a lab:Keyed ; lab:code 'Z'"),
    "id": ("its:y a rt:Mug ; rt:objectId '7'", "its:z a rt:Mug ; rt:objectId '7'"),
    "inverse functional": ("its:a lab:inv its:c", "its:b lab:inv its:c"),
    "function, before the name is used": ("my:f lab:fun my:w , its:o", "its:o rdfs:label 'o'"),
}
