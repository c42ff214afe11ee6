"""The shapes accept the sample and report every planted fault, with shape and place."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pyoxigraph as ox
import pyshacl
import pytest
import rdflib

import ontology

pytestmark = pytest.mark.slow

SAMPLE = rdflib.Namespace(ontology.BASE + "sample/")
SHAPES = rdflib.Namespace("https://w3id.org/rtask-kg/shapes#")
SH = rdflib.Namespace(ontology.PREFIXES["sh"])
PREFIXES = "".join(f"PREFIX {p}: <{iri}>\n" for p, iri in ontology.PREFIXES.items())
PREFIXES += f"PREFIX : <{SAMPLE}>\n"


def _graph(triples: Iterable[tuple[object, object, object]]) -> rdflib.Graph:
    lines = "\n".join(f"{s} {p} {o} ." for s, p, o in triples)
    return rdflib.Graph().parse(data=lines, format="nt")


def _shapes(paths: list[Path]) -> rdflib.Graph:
    graph = rdflib.Graph()
    for path in paths:
        graph.parse(path)
    return graph


@pytest.fixture(scope="module")
def shapes() -> rdflib.Graph:
    return _shapes(ontology.shapes())


@pytest.fixture(scope="module")
def individuals(closed, sample: list[ox.Quad]) -> rdflib.Graph:  # type: ignore[no-untyped-def]
    """Statements of the closed sample about its own individuals."""
    known = {quad.subject for quad in sample}
    return _graph(triple for triple in closed.triples() if triple[0] in known)


def _violations(
    data: rdflib.Graph, shapes: rdflib.Graph, use: list[rdflib.URIRef] | None = None
) -> set[tuple[str, str]]:
    """Return (local name of the focus node, local name of the shape) of each result."""
    _, report, _ = pyshacl.validate(
        data, shacl_graph=shapes, inference="none", advanced=True, use_shapes=use
    )
    assert isinstance(report, rdflib.Graph)
    found = set()
    for result in report.subjects(rdflib.RDF.type, SH.ValidationResult):
        source = report.value(result, SH.sourceShape)
        while isinstance(source, rdflib.BNode):  # a property shape belongs to a node shape
            source = next(s for s, p in shapes.subject_predicates(source))
        focus = str(report.value(result, SH.focusNode)).rsplit("/", 1)[-1]
        found.add((focus, str(source).removeprefix(str(SHAPES))))
    return found


def test_the_sample_is_valid(individuals: rdflib.Graph, shapes: rdflib.Graph) -> None:
    assert _violations(individuals, shapes) == set()


def test_each_graph_of_the_sample_has_one_value_each(sample: list[ox.Quad]) -> None:
    one_value = _shapes(ontology.graph_shapes())
    for name in {quad.graph_name for quad in sample}:
        inside = [(q.subject, q.predicate, q.object) for q in sample if q.graph_name == name]
        assert _violations(_graph(inside), one_value) == set()


def test_two_masses_in_one_graph_are_a_fault() -> None:
    data = rdflib.Graph()
    data.update(PREFIXES + "INSERT DATA { :mug rt:mass 0.3e0, 0.4e0 }")
    assert _violations(data, _shapes(ontology.graph_shapes())) == {("mug", "one-mass")}


def drop(path: str) -> str:
    """SPARQL that removes the values of ``":node rt:property"``."""
    return f"DELETE WHERE {{ {path} ?v }}"


def put(path: str, value: str) -> str:
    """SPARQL that replaces the values of ``":node rt:property"`` by one."""
    return (
        f"DELETE {{ {path} ?v }} INSERT {{ {path} {value} }} WHERE {{ OPTIONAL {{ {path} ?v }} }}"
    )


def add(turtle: str) -> str:
    """SPARQL that adds statements."""
    return f"INSERT DATA {{ {turtle} }}"


POSE = ":p0 rt:"
WAYPOINTS = ":g1 rt:graspPosture :tr . :tr rt:hasWaypoint :w0, :w1 . :w0 rt:waypointIndex 0 . "
PLACED = ":w a rt:Placement ; rt:placementOf :th ; time:hasBeginning :i1e . "
PLACEMENT_FAULTS = [
    ":w time:hasEnd :i1b",
    ":w time:hasBeginning :i1b",
    ":w rt:placementOf :mug",
    ":w rt:placementPose :p0, :p1",
    ":w rt:placementConfidence 1.5e0",
]
CLAIMED = ":cl a rt:TaskClaim ; prov:wasAssociatedWith :nao1 ; "
UNTIL = 'rt:claimedUntil "2026-01-01T10:00:00Z"^^xsd:dateTime'
ASKED = (
    ":q a rt:Question ; rt:asksAbout :t1 ; prov:wasAttributedTo :nao1 ; "
    'rt:answerableUntil "2026-01-01T10:00:00Z"^^xsd:dateTime ; rt:hasAnswerChoice :c1, :c2'
)
LEGIBLE = (
    "rt:readingScore 0.9e0 ; rt:wordU 4.0e0 ; rt:wordV 4.0e0 ; rt:wordLength 9.0e0 ; "
    "rt:wordHeight 3.0e0 ; rt:wordAngle 0.0e0"
)
WORD = ":w a rt:PrintedWord ; "

FAULTS = [
    ("q", "Question", add(ASKED + ' ; rt:questionText "well?"')),
    ("q", "Question", add(ASKED + " ; rt:choiceOtherwise :c1")),
    ("a", "HumanAnswer", add(":a a rt:HumanAnswer ; rt:answersQuestion :q ; rt:chosenAnswer :c1")),
    ("a", "HumanAnswer", add(":a a rt:HumanAnswer ; prov:wasAttributedTo :ann")),
    ("cl", "TaskClaim", add(CLAIMED + UNTIL)),
    ("cl", "TaskClaim", add(CLAIMED + "rt:claims :t1")),
    ("cl", "TaskClaim", add(CLAIMED + UNTIL + ' ; rt:claims :t1 ; rt:claimResult "perhaps"')),
    ("cl", "TaskClaim", add(":cl a rt:TaskClaim ; rt:claims :t1 ; " + UNTIL)),
    ("mug", "Object", drop(":mug rt:objectId")),
    ("mug", "Object", add(':mug rt:objectId "lab/mug-9"')),
    ("mug", "Object", put(":mug rt:objectId", '"no slash"')),
    ("mug", "Object", put(":mug rt:graspWidth", "0.0e0")),
    ("mug", "Object", put(":mug rt:mass", "-1.0e0")),
    ("mug", "Object", add(":mug rt:extentX 0.0e0")),
    ("mug", "Object", add(":mug rt:extentY 0.0e0")),
    ("mug", "Object", add(":mug rt:extentZ 0.0e0")),
    ("mug", "Object", add(":mug rt:roundness 1.1e0")),
    ("naoHand", "EndEffector", add(":naoHand rt:endEffectorOf :rover")),
    ("naoHand", "Gripper", drop(":naoHand rt:gripperType")),
    ("naoHand", "Gripper", drop(":naoHand rt:minOpening")),
    ("naoHand", "Gripper", put(":naoHand rt:minOpening", "0.06e0")),
    ("naoHand", "Gripper", drop(":naoHand rt:maxPayload")),
    ("naoHand", "Gripper", put(":naoHand rt:maxPayload", "0.0e0")),
    *(
        ("p0", "Pose", drop(POSE + name))
        for name in ["x", "y", "z", "qx", "qy", "qz", "qw", "inFrame"]
    ),
    ("p0", "Pose", put(":p0 rt:qw", "0.999e0")),
    *(("gp2", "PlanarPose", drop(":gp2 rt:" + n)) for n in ["x", "y", "theta", "inFrame"]),
    ("gp2", "PlanarPose", put(":gp2 rt:theta", "6.2832e0")),
    ("gp2", "PlanarPose", put(":gp2 rt:theta", "-0.1e0")),
    ("d", "Direction", add(":d a rt:Direction ; rt:dirX 1.0e0 ; rt:dirY 0.0e0")),
    ("d", "Direction", add(":d a rt:Direction ; rt:dirX 1e0 ; rt:dirY 1e0 ; rt:dirZ 0e0")),
    ("camF", "Frame", drop(":camF rt:frameId")),
    ("camF", "Frame", add(":camF rt:ancestorFrame :camF")),
    ("b", "Blob", add(':b a rt:Blob ; rt:byteLength 3 ; rt:sha256 "ABC"')),
    ("b", "Blob", add(f':b a rt:Blob ; rt:byteLength 3 ; rt:sha256 "{"0" * 64}"')),
    ("0" * 64, "Blob", add(f'<urn:x/{"0" * 64}> a rt:Blob ; rt:sha256 "{"0" * 64}"')),
    ("mugCloud", "Bytes", drop(":mugCloud rt:hasBlob")),
    ("i", "Bytes", add(":i a rt:Image2D")),
    ("i", "Bytes", add(":i a rt:TriangleMesh")),
    ("i", "ReconstructedMesh", add(":i a rt:TriangleMesh ; rt:seenShare 0.5e0")),
    (
        "i",
        "ReconstructedMesh",
        add(
            ":i a rt:TriangleMesh ; rt:seenShare 1.5e0 ; rt:medianResidual 0.001e0 ; "
            'rt:residual90 0.002e0 ; rt:isWatertight true ; rt:reconstructionMethod "m" ; '
            "prov:wasDerivedFrom :m"
        ),
    ),
    ("v1", "View", drop(":v1 rt:viewOf")),
    ("v1", "View", drop(":v1 rt:viewContent")),
    ("r1", "RecognitionResult", drop(":r1 rt:recognitionConfidence")),
    ("r1", "RecognitionResult", put(":r1 rt:recognitionConfidence", "1.5e0")),
    ("r1", "RecognitionResult", drop(":r1 rt:matchCount")),
    ("r1", "RecognitionResult", put(":r1 rt:bestMatch", ":m2")),
    ("m1", "Match", drop(":m1 rt:rank")),
    ("m2", "Match", drop(":m2 rt:matchedObject")),
    ("pe0", "PoseEstimate", drop(":pe0 rt:poseOf")),
    ("pe0", "PoseEstimate", drop(":pe0 rt:estimatedPose")),
    ("pe0", "PoseEstimate", put(":pe0 rt:poseConfidence", "1.1e0")),
    ("pe0", "PoseEstimate", add(":pe0 rt:violation -0.1e0")),
    ("pe0", "PoseEstimate", add(":pe0 rt:coverage 1.1e0")),
    ("g1", "Grasp", drop(":g1 rt:graspPose")),
    ("g1", "Grasp", drop(":g1 rt:gripperType")),
    ("g1", "Grasp", drop(":g1 rt:graspOf")),
    ("g1", "Grasp", add(":g1 a rt:PlanarGrasp")),
    ("g1", "Grasp", "DELETE DATA { :g1 a rt:SpatialGrasp }"),
    ("tr", "Posture", add(WAYPOINTS + ":w0 rt:timeFromStart 0e0 . :w1 rt:waypointIndex 1")),
    (
        "tr",
        "Posture",
        add(WAYPOINTS + ":w0 rt:timeFromStart 1e0 . :w1 rt:waypointIndex 1 ; rt:timeFromStart 1e0"),
    ),
    (
        "tr",
        "Posture",
        add(
            WAYPOINTS + ":w0 rt:timeFromStart -1e0 . :w1 rt:waypointIndex 1 ; rt:timeFromStart 1e0"
        ),
    ),
    ("e1", "GraspEvaluation", drop(":e1 rt:evaluates")),
    ("e1", "GraspEvaluation", put(":e1 rt:graspConfidence", "1.5e0")),
    ("e1", "GraspEvaluation", add(":e1 rt:sampleCount 100")),
    ("s", "GraspStatistics", add(':s a rt:GraspStatistics ; rt:gripperType "nao_hand"')),
    (
        "s",
        "GraspStatistics",
        add(
            ":s a rt:GraspStatistics ; rt:statisticsOf :g1 ; rt:attempts 2 ; rt:successes 3 ;"
            ' rt:gripperType "nao_hand"'
        ),
    ),
    ("a1", "GraspAttempt", drop(":a1 rt:performedBy")),
    ("a1", "GraspAttempt", add(":a1 rt:performedBy :nao")),
    ("a1", "GraspAttempt", drop(":a1 rt:executesGrasp")),
    ("a1", "GraspAttempt", drop(":a1 rt:activates")),
    (
        "a1",
        "GraspAttempt",
        add(
            ':a1 prov:startedAtTime "2026-01-01T10:00:01Z"^^xsd:dateTime ;'
            ' prov:endedAtTime "2026-01-01T10:00:00Z"^^xsd:dateTime'
        ),
    ),
    ("o1", "Outcome", drop(":o1 rt:success")),
    ("o1", "Outcome", drop(":o1 rt:hasReason")),
    ("o1", "Outcome", drop(":o1 rt:hasFeedback")),
    ("o1", "Outcome", put(":o1 rt:hasReason", "rt:reason_missed")),
    ("o2", "Outcome", put(":o2 rt:hasReason", "rt:reason_ok")),
    ("f4", "HumanFeedback", drop(":f4 rt:atTime")),
    ("f4", "HumanFeedback", drop(":f4 rt:verdict")),
    ("f4", "HumanFeedback", put(":f4 prov:wasAttributedTo", ":pr2")),
    ("t1", "Task", drop(":t1 rt:assignedTo")),
    *(("w", "Placement", add(PLACED + fault)) for fault in PLACEMENT_FAULTS),
    ("w", "Placement", add(":w a rt:Placement ; rt:placementOf :th")),
    ("w", "Placement", add(":w a rt:Placement ; time:hasBeginning :i1b")),
    ("th", "OnePlace", add(PLACED + ":th a rt:Exemplar . :w2 rt:placementOf :th")),
    ("i1", "Interval", drop(":i1 time:hasBeginning")),
    ("i1", "Interval", drop(":i1 time:hasEnd")),
    ("i1", "Interval", put(":i1 time:hasEnd", ":i1b")),
    *(
        ("x1", "Experience", drop(":x1 rt:" + name))
        for name in ["inState", "choseAction", "reward", "ofAttempt"]
    ),
    ("s1", "LearningState", add(":s1 rt:projectedBy :pca . :pca rt:outputDimension 4")),
    ("ds", "Qualified", put(":ds rt:qualifiedName", '"PR2"')),
    ("svc", "Qualified", drop(":svc rt:qualifiedName")),
    ("svc", "Service", drop(":svc rt:version")),
    ("dsv", "DatasetVersion", put(":dsv rt:versionNumber", "0")),
    ("dsv", "DatasetVersion", drop(":dsv rt:contentDigest")),
    ("pr2", "AgentGraph", drop("<" + SAMPLE + "graph/agent/pr2> rt:graphOwner")),
    ("w1", "WriteActivity", drop(":w1 rt:commitNumber")),
    ("w1", "WriteActivity", drop(":w1 prov:endedAtTime")),
    ("w1", "Retraction", add(":w1 a rt:Retraction")),
    ("q", "QuarantineGraph", add(":q a rt:QuarantineGraph ; rt:quarantinedFrom :w")),
    ("q", "QuarantineGraph", add(':q a rt:QuarantineGraph ; rt:quarantineReason "clash"')),
    ("r", "Confidence", add(":r rt:confidence 1.5e0")),
    ("p", "StateProjection", add(":p a rt:StateProjection")),
    (
        "p",
        "StateProjection",
        add(":p a rt:StateProjection ; rt:inputDimension 3 ; rt:outputDimension 5"),
    ),
    (
        "p",
        "StateProjection",
        add(":p a rt:StateProjection ; rt:outputDimension 5 ; rt:explainedVariance 1.1e0"),
    ),
    ("hc1", "HiddenCause", put(":hc1 rt:causeProbability", "1.2e0")),
    ("hc1", "HiddenCause", drop(":hc1 prov:wasDerivedFrom")),
    ("hc1", "GraspZone", put(":hc1 rt:zoneEnd", "-0.05e0")),
    (
        "hc2",
        "MassOffCentre",
        add(
            ":pen rt:hasHiddenCause :hc2 . :hc2 a rt:MassOffCentre ; rt:causeProbability 0.5e0 ; "
            "rt:centreAlongX 0.02e0 ; prov:wasDerivedFrom :a3"
        ),
    ),
    (
        "map",
        "ScoreCalibration",
        add(
            ':map a rt:ScoreCalibration ; rt:calibratesHand :naoHand ; rt:calibratedScore "x" ; '
            "rt:calibrationOffset 0e0 ; rt:calibrationSlope -0.1e0 ; rt:offsetVariance 0.1e0 ; "
            "rt:slopeVariance 0.1e0 ; rt:offsetSlopeCovariance 0e0 ; rt:outcomeCount 3"
        ),
    ),
    *(
        ("refused", "GraspRefusal", add(f":refused a rt:GraspRefusal ; {told}"))
        for told in [
            'rt:lackingConfidence "grasp" ; rt:foundConfidence 0.2e0 ; rt:requiredConfidence 0.3e0',
            'prov:wasAssociatedWith :nao ; rt:lackingConfidence "hunger" ; '
            "rt:foundConfidence 0.2e0 ; rt:requiredConfidence 0.3e0",
            'prov:wasAssociatedWith :nao ; rt:lackingConfidence "grasp" ; '
            "rt:foundConfidence 1.2e0 ; rt:requiredConfidence 0.3e0",
        ]
    ),
    ("l", "LearnerSnapshot", add(":l a rt:LearnerSnapshot ; rt:hasBlob :b")),
    ("l", "LearnerSnapshot", add(':l a rt:LearnerSnapshot ; rt:algorithm "beta/1"')),
    *(
        ("d", "DecisionPolicy", add(f":d a rt:DecisionPolicy ; rt:{name} 1.1e0"))
        for name in [
            "recognitionThreshold",
            "poseThreshold",
            "graspThreshold",
            "explorationRate",
        ]
    ),
    ("z", "AngleSector", add(":z a rt:AngleSector ; rt:lowerAngle 2e0 ; rt:upperAngle 1e0")),
    ("z", "AngleSector", add(":z a rt:AngleSector ; rt:lowerAngle 2e0")),
    ("plan", "ServiceMethod", drop(":plan rt:methodName")),
    ("m", "ServiceMethod", add(':m a rt:ServiceMethod ; rt:methodName "m"')),
    ("m", "MethodParameter", add(':m a rt:MethodParameter ; rt:parameterName "m"')),
    ("slot1", "DataResource", put(":slot1 rt:resourceKind", '"file"')),
    ("slot1", "DataResource", drop(":slot1 rt:resourceName")),
    ("call1", "ServiceCall", drop(":call1 rt:calledMethod")),
    ("bind1", "ResourceBinding", drop(":bind1 rt:bindsDataset")),
    ("m", "PipelineStep", add(":m a rt:PipelineStep")),
    ("obs1", "Observation", drop(":obs1 sosa:madeBySensor")),
    ("obs1", "Observation", drop(":obs1 sosa:resultTime")),
    ("pr2Cam", "Camera", add(":pr2Cam rt:focalX 0.0e0")),
    ("pr2Cam", "Camera", add(":pr2Cam rt:imageWidth 0")),
    ("j", "Joint", add(":j a rt:Joint")),
    ("j", "Joint", add(':j a rt:Joint ; rt:jointName "j" ; rt:jointKind "ball"')),
    ("m", "RobotModel", add(":m a rt:RobotModel")),
    ("f", "SIFTFeatureSet", add(":f a rt:SIFTFeatureSet ; rt:descriptorLength 64")),
    ("f", "FPFHFeatureSet", add(":f a rt:FPFHFeatureSet ; rt:descriptorLength 125")),
    (
        "b",
        "BSplineModel",
        add(":b a rt:BSplineModel ; rt:degree 3 ; rt:controlPointCount 3"),
    ),
    ("b", "BSplineModel", add(":b a rt:BSplineModel ; rt:degree 3")),
    ("t", "TextReading", add(":t a rt:TextReading")),
    ("w", "PrintedWord", add(WORD + LEGIBLE)),
    ("w", "PrintedWord", add(f'{WORD} rt:wordText "a\\nb" ; {LEGIBLE}')),
    ("w", "PrintedWord", add(f'{WORD} rt:wordText "a\\u202Eb" ; {LEGIBLE}')),
    ("w", "PrintedWord", add(f'{WORD} rt:wordText "{81 * "a"}" ; {LEGIBLE}')),
    ("w", "PrintedWord", add(f'{WORD} rt:wordText "a" ; {LEGIBLE.replace("0.9e0", "1.9e0")}')),
    ("w", "PrintedWord", add(f'{WORD} rt:wordText "a" ; {LEGIBLE.replace("3.0e0", "0.0e0")}')),
    ("y", "Symmetry", add(":y a rt:Symmetry ; rt:symmetryOrder 4")),
    ("f1", "PhysicsFeedback", drop(":f1 rt:verdict")),
    ("f1", "PhysicsFeedback", add(":f1 rt:holdTime -1.0e0")),
    ("v", "JointValue", add(":v a rt:JointValue ; rt:angle 0.5e0")),
    ("cup", "SuctionCup", add(':cup a rt:SuctionCup ; rt:gripperType "cup"')),
    ("sg", "SuctionGrasp", add(":sg a rt:SuctionGrasp")),
    ("sg", "SuctionGrasp", add(":sg a rt:SuctionGrasp ; rt:hasContact :gc")),
    (
        "fg",
        "ThreeFingerGrasp",
        add(":fg a rt:ThreeFingerGrasp ; rt:contactWidth 0.05e0 ; rt:hasContact :gc"),
    ),
    ("gc", "GraspContact", add(":gc a rt:GraspContact ; rt:contactIndex 0")),
    ("t", "GripperTranslation", add(":t a rt:GripperTranslation")),
    (
        "t",
        "GripperTranslation",
        add(
            ":t a rt:GripperTranslation ; rt:translationDirection :d ;"
            " rt:minDistance 0.2e0 ; rt:desiredDistance 0.1e0"
        ),
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("focus", "shape", "fault"), FAULTS, ids=[f"{n}-{f[1]}" for n, f in enumerate(FAULTS)]
)
def test_a_planted_fault_is_reported(
    focus: str, shape: str, fault: str, individuals: rdflib.Graph, shapes: rdflib.Graph
) -> None:
    data = rdflib.Graph()
    data += individuals
    data.update(PREFIXES + fault)
    assert (focus, shape) in _violations(data, shapes, [SHAPES[shape]])


def test_every_shape_has_a_planted_fault(shapes: rdflib.Graph) -> None:
    names = {
        str(s).removeprefix(str(SHAPES)) for s in shapes.subjects(rdflib.RDF.type, SH.NodeShape)
    }
    assert names == {shape for _, shape, _ in FAULTS}
