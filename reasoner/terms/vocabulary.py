"""The fixed part of every dictionary: ids of the RDF, RDFS, OWL and XSD terms in rules."""

from __future__ import annotations

RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
RDFS = "http://www.w3.org/2000/01/rdf-schema#"
OWL = "http://www.w3.org/2002/07/owl#"
XSD = "http://www.w3.org/2001/XMLSchema#"

LITERAL = 1 << 31
"""Ids at and above this are literals; below are IRIs and blank nodes."""

RESERVED = 256
"""Ids below this belong to the vocabulary in every dictionary."""

_iris: list[str] = []


def _term(iri: str) -> int:
    _iris.append(iri)
    return len(_iris) - 1


TYPE = _term(RDF + "type")
FIRST = _term(RDF + "first")
REST = _term(RDF + "rest")
NIL = _term(RDF + "nil")
REIFIES = _term(RDF + "reifies")
PROPERTY = _term(RDF + "Property")
LIST = _term(RDF + "List")
LANG_STRING = _term(RDF + "langString")
XML_LITERAL = _term(RDF + "XMLLiteral")
PLAIN_LITERAL = _term(RDF + "PlainLiteral")

SUB_CLASS = _term(RDFS + "subClassOf")
SUB_PROPERTY = _term(RDFS + "subPropertyOf")
DOMAIN = _term(RDFS + "domain")
RANGE = _term(RDFS + "range")
RDFS_CLASS = _term(RDFS + "Class")
DATATYPE = _term(RDFS + "Datatype")
RESOURCE = _term(RDFS + "Resource")
RDFS_LITERAL = _term(RDFS + "Literal")
LABEL = _term(RDFS + "label")
COMMENT = _term(RDFS + "comment")
SEE_ALSO = _term(RDFS + "seeAlso")
IS_DEFINED_BY = _term(RDFS + "isDefinedBy")

SAME = _term(OWL + "sameAs")
DIFFERENT = _term(OWL + "differentFrom")
THING = _term(OWL + "Thing")
NOTHING = _term(OWL + "Nothing")
CLASS = _term(OWL + "Class")
RESTRICTION = _term(OWL + "Restriction")
DATA_RANGE = _term(OWL + "DataRange")
ONTOLOGY = _term(OWL + "Ontology")
NAMED_INDIVIDUAL = _term(OWL + "NamedIndividual")
OBJECT_PROPERTY = _term(OWL + "ObjectProperty")
DATATYPE_PROPERTY = _term(OWL + "DatatypeProperty")
ANNOTATION_PROPERTY = _term(OWL + "AnnotationProperty")
FUNCTIONAL = _term(OWL + "FunctionalProperty")
INVERSE_FUNCTIONAL = _term(OWL + "InverseFunctionalProperty")
TRANSITIVE = _term(OWL + "TransitiveProperty")
SYMMETRIC = _term(OWL + "SymmetricProperty")
ASYMMETRIC = _term(OWL + "AsymmetricProperty")
REFLEXIVE = _term(OWL + "ReflexiveProperty")
IRREFLEXIVE = _term(OWL + "IrreflexiveProperty")
ALL_DIFFERENT = _term(OWL + "AllDifferent")
ALL_DISJOINT_CLASSES = _term(OWL + "AllDisjointClasses")
ALL_DISJOINT_PROPERTIES = _term(OWL + "AllDisjointProperties")
NEGATIVE_ASSERTION = _term(OWL + "NegativePropertyAssertion")

EQUIVALENT_CLASS = _term(OWL + "equivalentClass")
EQUIVALENT_PROPERTY = _term(OWL + "equivalentProperty")
INVERSE_OF = _term(OWL + "inverseOf")
CHAIN = _term(OWL + "propertyChainAxiom")
DISJOINT_CLASS = _term(OWL + "disjointWith")
DISJOINT_PROPERTY = _term(OWL + "propertyDisjointWith")
DISJOINT_UNION = _term(OWL + "disjointUnionOf")
COMPLEMENT = _term(OWL + "complementOf")
INTERSECTION = _term(OWL + "intersectionOf")
UNION = _term(OWL + "unionOf")
ONE_OF = _term(OWL + "oneOf")
ON_PROPERTY = _term(OWL + "onProperty")
ON_CLASS = _term(OWL + "onClass")
SOME = _term(OWL + "someValuesFrom")
ALL = _term(OWL + "allValuesFrom")
HAS_VALUE = _term(OWL + "hasValue")
MAX = _term(OWL + "maxCardinality")
MAX_QUALIFIED = _term(OWL + "maxQualifiedCardinality")
HAS_KEY = _term(OWL + "hasKey")
MEMBERS = _term(OWL + "members")
DISTINCT_MEMBERS = _term(OWL + "distinctMembers")
SOURCE = _term(OWL + "sourceIndividual")
ASSERTION_PROPERTY = _term(OWL + "assertionProperty")
TARGET_INDIVIDUAL = _term(OWL + "targetIndividual")
TARGET_VALUE = _term(OWL + "targetValue")
TOP_OBJECT = _term(OWL + "topObjectProperty")
BOTTOM_OBJECT = _term(OWL + "bottomObjectProperty")
TOP_DATA = _term(OWL + "topDataProperty")
BOTTOM_DATA = _term(OWL + "bottomDataProperty")

# OWL 2 Profiles 4.2: the datatypes of the RL profile, in an order that gives each its mask bit.
DATATYPE_NAMES = (
    "string", "normalizedString", "token", "language", "Name", "NCName", "NMTOKEN",
    "boolean", "decimal", "integer", "nonNegativeInteger", "nonPositiveInteger",
    "positiveInteger", "negativeInteger", "long", "int", "short", "byte",
    "unsignedLong", "unsignedInt", "unsignedShort", "unsignedByte",
    "float", "double", "hexBinary", "base64Binary", "anyURI", "dateTime", "dateTimeStamp",
)  # fmt: skip
DATATYPES: dict[str, int] = {XSD + name: _term(XSD + name) for name in DATATYPE_NAMES}
STRING = DATATYPES[XSD + "string"]

IRIS: tuple[str, ...] = tuple(_iris)
"""IRI of each vocabulary id, in order."""

LITERAL_CLASSES = frozenset(
    {*DATATYPES.values(), RDFS_LITERAL, LANG_STRING, XML_LITERAL, PLAIN_LITERAL, DATA_RANGE}
)
"""Terms that denote sets of literals: as ranges they are checks, never types of resources."""

SCHEMA_PREDICATES = frozenset(
    {FIRST, REST, SUB_CLASS, SUB_PROPERTY, DOMAIN, RANGE, EQUIVALENT_CLASS,
     EQUIVALENT_PROPERTY, INVERSE_OF, CHAIN, DISJOINT_CLASS, DISJOINT_PROPERTY, COMPLEMENT,
     INTERSECTION, UNION, ONE_OF,
     ON_PROPERTY, ON_CLASS, SOME, ALL, HAS_VALUE, MAX, MAX_QUALIFIED, HAS_KEY, MEMBERS,
     DISTINCT_MEMBERS, SOURCE, ASSERTION_PROPERTY, TARGET_INDIVIDUAL, TARGET_VALUE}
)  # fmt: skip
"""Predicates whose triples the compiler turns into rules."""

SCHEMA_CLASSES = frozenset(
    {CLASS, RDFS_CLASS, DATATYPE, OBJECT_PROPERTY, DATATYPE_PROPERTY, FUNCTIONAL,
     INVERSE_FUNCTIONAL, TRANSITIVE, SYMMETRIC, ASYMMETRIC, REFLEXIVE, IRREFLEXIVE, RESTRICTION,
     ALL_DIFFERENT, ALL_DISJOINT_CLASSES, ALL_DISJOINT_PROPERTIES, NEGATIVE_ASSERTION}
)  # fmt: skip
"""Classes whose members the compiler reads."""

REFLEXIVE_PREDICATES = frozenset(
    {SUB_CLASS, SUB_PROPERTY, EQUIVALENT_CLASS, EQUIVALENT_PROPERTY, SAME}
)
"""Predicates that hold between a term and itself without saying anything (scm-cls, scm-op, ...)."""


def is_schema(p: int, o: int) -> bool:
    """Tell whether a triple with this predicate and object can change the compiled rules.

    >>> is_schema(SUB_CLASS, 400), is_schema(TYPE, TRANSITIVE), is_schema(TYPE, 400)
    (True, True, False)
    """
    return p in SCHEMA_PREDICATES or (p == TYPE and o in SCHEMA_CLASSES)
