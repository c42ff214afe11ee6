"""The vocabularies that ontologies are written in: their terms, and what these are said of.

RDF, RDF Schema, OWL 2 and XML Schema are closed: their specifications list every name. They say of
few of them what subject and value are in a form that a check could read, so it stands here; and
so do the domains and ranges of PROV-O, SOSA and OWL-Time, as their recommendations state them. The
ontology declares the terms that it uses of these, and repeats none of their axioms, because more
would then follow from each statement. Sources: W3C, PROV-O, 2013, section 4; Semantic Sensor
Network Ontology, 2017, section 4.3; Time Ontology in OWL, 2022, section 4.
"""

from __future__ import annotations

import re

import ontology
from rtask.rdf.terms import XSD

__all__ = [
    "CLASS", "KINDS", "MUTUAL", "OF_RULES", "OF_STANDARDS", "ONTOLOGY", "PROPERTIES", "PROPERTY",
    "is_reserved", "is_shacl", "reserved_terms", "shacl_terms",
]  # fmt: skip

_RDF, _RDFS = ontology.PREFIXES["rdf"], ontology.PREFIXES["rdfs"]
_OWL = ontology.PREFIXES["owl"]
CLASS, PROPERTY = _OWL + "Class", _RDF + "Property"
ONTOLOGY, LIST = _OWL + "Ontology", _RDF + "List"
KINDS: dict[str, str] = {
    CLASS: "", PROPERTY: "", ONTOLOGY: "", LIST: "",
    _RDFS + "Class": CLASS, _RDFS + "Datatype": CLASS, _OWL + "Restriction": CLASS,
    **{
        _OWL + name: PROPERTY
        for name in (
            "ObjectProperty", "DatatypeProperty", "AnnotationProperty", "OntologyProperty",
            "TransitiveProperty", "SymmetricProperty", "AsymmetricProperty", "ReflexiveProperty",
            "IrreflexiveProperty", "FunctionalProperty", "InverseFunctionalProperty",
            "DeprecatedProperty",
        )
    },
}  # fmt: skip
"""Kinds of terms, each with the kind that it is one of."""
PROPERTIES: dict[str, tuple[str, str]] = {
    _RDFS + "subClassOf": (CLASS, CLASS), _RDFS + "subPropertyOf": (PROPERTY, PROPERTY),
    _RDFS + "domain": (PROPERTY, CLASS), _RDFS + "range": (PROPERTY, CLASS),
    _RDF + "first": (LIST, ""), _RDF + "rest": (LIST, LIST),
    _OWL + "inverseOf": (PROPERTY, PROPERTY), _OWL + "equivalentProperty": (PROPERTY, PROPERTY),
    _OWL + "propertyDisjointWith": (PROPERTY, PROPERTY),
    _OWL + "propertyChainAxiom": (PROPERTY, LIST),
    _OWL + "equivalentClass": (CLASS, CLASS), _OWL + "disjointWith": (CLASS, CLASS),
    _OWL + "complementOf": (CLASS, CLASS), _OWL + "disjointUnionOf": (CLASS, LIST),
    _OWL + "unionOf": (CLASS, LIST), _OWL + "intersectionOf": (CLASS, LIST),
    _OWL + "oneOf": (CLASS, LIST), _OWL + "onProperty": (CLASS, PROPERTY),
    _OWL + "someValuesFrom": (CLASS, CLASS), _OWL + "allValuesFrom": (CLASS, CLASS),
    _OWL + "onClass": (CLASS, CLASS), _OWL + "hasKey": (CLASS, LIST),
    _OWL + "imports": (ONTOLOGY, ONTOLOGY), _OWL + "versionIRI": (ONTOLOGY, ""),
    _OWL + "priorVersion": (ONTOLOGY, ONTOLOGY),
}  # fmt: skip
"""Properties that relate terms, with the kinds of subject and value; empty for any."""
MUTUAL = frozenset(
    _OWL + name
    for name in (
        "inverseOf", "disjointWith", "equivalentClass", "equivalentProperty",
        "propertyDisjointWith", "complementOf",
    )
)  # fmt: skip
"""Properties of terms that hold both ways by their meaning, and which a graph states one way."""
_PROV, _SOSA, _TIME = (ontology.PREFIXES[name] for name in ("prov", "sosa", "time"))
_ACTIVITY, _AGENT = _PROV + "Activity", _PROV + "Agent"
_OBSERVATION, _SENSOR = _SOSA + "Observation", _SOSA + "Sensor"
_INSTANT, _INTERVAL = _TIME + "Instant", _TIME + "ProperInterval"

OF_STANDARDS: dict[str, tuple[str, str]] = {
    _PROV + "used": (_ACTIVITY, ""),
    _PROV + "wasGeneratedBy": ("", _ACTIVITY),
    _PROV + "wasAssociatedWith": (_ACTIVITY, _AGENT),
    _PROV + "wasAttributedTo": ("", _AGENT),
    _PROV + "wasInformedBy": (_ACTIVITY, _ACTIVITY),
    _PROV + "startedAtTime": (_ACTIVITY, ""),
    _PROV + "endedAtTime": (_ACTIVITY, ""),
    _SOSA + "madeBySensor": (_OBSERVATION, _SENSOR),
    _SOSA + "hasFeatureOfInterest": (_OBSERVATION, ""),
    _SOSA + "hasResult": (_OBSERVATION, ""),
    _SOSA + "resultTime": (_OBSERVATION, ""),
    _SOSA + "phenomenonTime": (_OBSERVATION, ""),
    _TIME + "hasBeginning": (_INTERVAL, _INSTANT),
    _TIME + "hasEnd": (_INTERVAL, _INSTANT),
    _TIME + "inXSDDateTimeStamp": (_INSTANT, ""),
}
"""Classes of subject and value by property; empty where anything may stand. What a recommendation
calls an entity may be anything here, so that prov:Entity is left out."""
_RT, _ROBOT = ontology.NS, ontology.PREFIXES["cora"] + "Robot"
_OBJECT, _TASK, _HAND = _RT + "ManipulableObject", _RT + "Task", _RT + "EndEffector"
OF_RULES: dict[str, tuple[str, str]] = {
    _RT + "canGrasp": (_ROBOT, _OBJECT),
    _RT + "canPerform": (_ROBOT, _TASK),
    _RT + "beyondReachOf": ("", _HAND),
    _RT + "massBound": (_OBJECT, ""),
    _RT + "effectiveMass": (_OBJECT, ""),
    _RT + "effectiveGraspWidth": (_OBJECT, ""),
    _RT + "currentPlacement": ("", _RT + "Placement"),
    _RT + "openPlacementOf": (_RT + "Placement", ""),
    _RT + "currentPose": ("", _RT + "Pose"),
    _RT + "unit": (PROPERTY, ""),
}
"""The same for properties whose statements rules derive from things of these classes. The ontology
gives them no domain or range, from which the types would follow once more with each statement."""
_NAMES = {
    _RDF: """type Property Statement subject predicate object Bag Seq Alt value List nil first rest
        XMLLiteral HTML JSON langString dirLangString PlainLiteral CompoundLiteral direction
        language reifies""",
    _RDFS: """Resource Class Literal Datatype range domain subClassOf subPropertyOf label comment
        Container ContainerMembershipProperty member seeAlso isDefinedBy""",
    _OWL: """AllDifferent AllDisjointClasses AllDisjointProperties Annotation AnnotationProperty
        AsymmetricProperty Axiom Class DataRange DatatypeProperty DeprecatedClass DeprecatedProperty
        FunctionalProperty InverseFunctionalProperty IrreflexiveProperty NamedIndividual
        NegativePropertyAssertion Nothing ObjectProperty Ontology OntologyProperty
        ReflexiveProperty Restriction SymmetricProperty Thing TransitiveProperty allValuesFrom
        annotatedProperty annotatedSource annotatedTarget assertionProperty backwardCompatibleWith
        bottomDataProperty bottomObjectProperty cardinality complementOf datatypeComplementOf
        deprecated differentFrom disjointUnionOf disjointWith distinctMembers equivalentClass
        equivalentProperty hasKey hasSelf hasValue imports incompatibleWith intersectionOf
        inverseOf maxCardinality maxQualifiedCardinality members minCardinality
        minQualifiedCardinality onClass onDataRange onDatatype onProperties onProperty oneOf
        priorVersion propertyChainAxiom propertyDisjointWith qualifiedCardinality rational real
        sameAs someValuesFrom sourceIndividual targetIndividual targetValue topDataProperty
        topObjectProperty unionOf versionIRI versionInfo withRestrictions""",
    XSD: """string boolean decimal integer double float date time dateTime dateTimeStamp gYear
        gMonth gDay gYearMonth gMonthDay duration yearMonthDuration dayTimeDuration byte short int
        long unsignedByte unsignedShort unsignedInt unsignedLong positiveInteger nonNegativeInteger
        negativeInteger nonPositiveInteger hexBinary base64Binary anyURI language
        normalizedString token NMTOKEN Name NCName QName NOTATION ENTITY ID IDREF anySimpleType
        anyAtomicType anyType length minLength maxLength pattern minInclusive maxInclusive
        minExclusive maxExclusive totalDigits fractionDigits""",
}
_SH = ontology.PREFIXES["sh"]
_SHACL = frozenset(
    re.findall(
        r"\w+",
        """
    AbstractResult BlankNode BlankNodeOrIRI BlankNodeOrLiteral IRI IRIOrLiteral Literal Info
    NodeShape Parameter Parameterizable PrefixDeclaration PropertyGroup PropertyShape
    ResultAnnotation SPARQLAskExecutable SPARQLAskValidator SPARQLConstraint
    SPARQLConstructExecutable SPARQLExecutable SPARQLFunction SPARQLRule SPARQLSelectExecutable
    SPARQLSelectValidator SPARQLTarget SPARQLTargetType SPARQLUpdateExecutable Severity Shape
    Target TargetType TripleRule Rule Rules Function ValidationReport ValidationResult Validator
    Violation Warning alternativePath and annotationProperty annotationValue annotationVarName ask
    class closed condition conforms construct datatype deactivated declare defaultValue
    description detail disjoint entailment equals expression expressionShape filterShape flags
    focusNode group hasValue ignoredProperties in intersection inversePath labelTemplate
    languageIn lessThan lessThanOrEquals maxCount maxExclusive maxInclusive maxLength memberShape
    message minCount minExclusive minInclusive minLength name namespace node nodeKind nodeShape
    nodes nodeValidator not object oneOrMorePath optional or order parameter path pattern
    predicate prefix prefixes property propertyValidator qualifiedMaxCount qualifiedMinCount
    qualifiedValueShape qualifiedValueShapesDisjoint result resultAnnotation resultMessage
    resultPath resultSeverity returnType rule select severity shapesGraph shapesGraphWellFormed
    sourceConstraint sourceConstraintComponent sourceShape sparql subject suggestedShapesGraph
    target targetClass targetNode targetObjectsOf targetSubjectsOf this union uniqueLang update
    validator value values xone zeroOrMorePath zeroOrOnePath
        """,
    )
)
"""Terms of the Shapes Constraint Language (W3C, 2017) and of SHACL Advanced Features."""
_TERMS = {space: frozenset(names.split()) for space, names in _NAMES.items()}


def is_reserved(iri: str) -> bool | None:
    """Return whether a closed vocabulary has a term; None for one of no such vocabulary.

    >>> is_reserved("http://www.w3.org/2002/07/owl#Class")
    True
    >>> is_reserved("http://www.w3.org/2002/07/owl#Clas"), is_reserved("urn:x")
    (False, None)
    """
    for space, names in _TERMS.items():
        if iri.startswith(space):
            name = iri[len(space) :]
            return name in names or (space == _RDF and name[:1] == "_" and name[1:].isdigit())
    return None


def is_shacl(iri: str) -> bool | None:
    """Return whether SHACL has a term of its namespace; None for one of another namespace.

    >>> is_shacl(_SH + "path"), is_shacl(_SH + "pth"), is_shacl("urn:x")
    (True, False, None)
    """
    if not iri.startswith(_SH):
        return None
    name = iri[len(_SH) :]
    return name in _SHACL or name.endswith("ConstraintComponent") or name.startswith("js")


def shacl_terms() -> list[str]:
    """Return the terms of SHACL."""
    return [_SH + name for name in sorted(_SHACL)]


def reserved_terms(iri: str) -> list[str]:
    """Return the terms of the closed vocabulary that an IRI belongs to."""
    space = next((space for space in _TERMS if iri.startswith(space)), "")
    return [space + name for name in sorted(_TERMS.get(space, ()))]
