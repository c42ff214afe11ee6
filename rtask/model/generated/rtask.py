"""Typed classes for the vocabulary of RTASK; generated, do not edit.

Written by ``rtask.model.generate.generate_rtask()`` from the modules and shapes in ``ontology/``.
"""

# fmt: off
# ruff: noqa: E501 - one field is one line, however long

from __future__ import annotations

import datetime
from typing import ClassVar

import ontology
from rtask.model.fields import Link, Links, Many, One
from rtask.model.instance import Identity, Model, Registry
from rtask.model.limits import Limits
from rtask.rdf.terms import NamedNode

REGISTRY = Registry()
_RT = ontology.PREFIXES["rt"]
_CORA = ontology.PREFIXES["cora"]
_CORAX = ontology.PREFIXES["corax"]
_RPARTS = ontology.PREFIXES["rparts"]
_POS = ontology.PREFIXES["pos"]
_SUMO = ontology.PREFIXES["sumo"]
_PROV = ontology.PREFIXES["prov"]
_SOSA = ontology.PREFIXES["sosa"]
_TIME = ontology.PREFIXES["time"]
_OWL = ontology.PREFIXES["owl"]
_RDF = ontology.PREFIXES["rdf"]
_RDFS = ontology.PREFIXES["rdfs"]
_XSD = ontology.PREFIXES["xsd"]


class Thing(Model):
    """The root of all classes.

    ``owl:Thing``

    Attributes
    ----------
    at_time
        The time at which it held or was made, with its time zone.
    beyond_reach_of
        The end effector does not get to the place, though another one of its robot may
        (rt:reaches): the left hand of a robot to what stands on its right.
    can_grasp
        The robot's opening, payload and capability suffice for the object: its mass is
        stated, or an end effector of no greater payload has lifted it (rule R2).
    can_perform
        The robot has every capability that the task asks for (rule R3).
    centre_of_mass_sigma
        The standard deviation of the centre of mass. [M]
    commit_number
        The number of a commit; on a graph: of the last commit that changed it. [NUM]
    confidence
        The confidence in a statement, on its RDF 1.2 reifier, in [0, 1]. [UNITLESS]
    crushed_by
        The end effector cannot close as gently as the object, or a thing of this product,
        needs: stated, or its least force is beyond what damages the object (rule R12). Where
        nobody has stated both, it is not known, and forbids nothing.
    current_placement
        The placement of the thing that has not ended, exactly one: of several, the last to
        begin (rule R9).
    current_pose
        The pose of the current placement; without placements, the latest pose by rt:atTime
        unless its estimate has ended (rule R5).
    disputed
        As many people say that it held as say that it did not: judged neither way, counted
        nowhere (rule R8).
    effective_grasp_width
        The object's own grasp width, else that of its reference object (rule R1). [M]
    effective_mass
        The object's own mass, else that of its reference object (rule R1). [KiloGM]
    ended_at_time
        When the activity ended (xsd:dateTime with time zone).
    friction_coefficient
        Coulomb friction between object and jaw; on objects and on evaluations. [UNITLESS]
    generated_at_time
        When the entity was made (xsd:dateTime with time zone).
    gripper_type
        The kind of gripper, on end effectors and on grasps: "nao_hand", "parallel_jaw_80".
        Grasps carry over between grippers of one type.
    has_beginning
        The instant at which the interval begins.
    has_end
        The instant at which the interval ends.
    has_feature_of_interest
        The thing that was observed.
    has_result
        What the observation gave.
    has_trait
        What to mind when the object is handled: a likely hidden cause says so, its mass does
        (rule R11), or somebody states it. Without domain and range, because a rule derives
        it.
    in_xsd_date_time_stamp
        The instant as xsd:dateTimeStamp.
    invalidated_at_time
        When the entity, here the reifier of a statement, ceased to hold.
    judged_success
        The verdict of most people, else rt:success; none while as many say the one as the
        other (rule R6).
    label
        A name for people, in a language.
    made_by_sensor
        The sensor that made the observation.
    mass_bound
        An upper bound on the mass of the object: the payload of an end effector that has
        lifted it, or its product (rule R7). Several end effectors give several bounds.
        [KiloGM]
    member
        Is a member of.
    merged_into
        The object that this one turned out to be; its old IRI leads there.
    name
        A handle for people and messages, such as "panda" or "coke can".
    note
        The reason for writing something, in the writer's own words.
    open_placement_of
        The thing, or the one that it turned out to be, of a placement without an end (rule
        R9).
    orientation_sigma
        The standard deviation of an orientation; on poses and evaluations. [RAD]
    overlaps_in_time
        The execution intervals of the two tasks overlap (rule R4).
    part
        Is a part of.
    phase
        The step to which something belongs: a reason to the step that failed, a picture to
        the step that it shows.
    phenomenon_time
        The time for which the result holds.
    policy_version
        The rules by which outcomes became the stored belief; numbers of other rules are
        recomputed, never mixed.
    position_sigma
        The standard deviation of a position, per axis; on poses and evaluations. [M]
    qualified_name
        "namespace/name" of a service or dataset.
    rdfs_comment
        An explanation for people, in a language.
    reaches
        The robot's hand gets to the surface, container or place: stated by a person or robot,
        or the robot has put something there (rule R10). Where nothing says so, it is not
        known.
    result_time
        When the result was complete (xsd:dateTime with time zone).
    simulated
        True if it happened, or if the robot lives, in a simulator.
    started_at_time
        When the activity began (xsd:dateTime with time zone).
    used
        An entity that the activity relied on.
    valid_until
        The time at which a statement expires, on its reifier.
    version
        The semantic version.
    vertex_sigma
        The standard deviation of a vertex of the outline (Kehoe 2014, 3.3). [M]
    was_associated_with
        An agent who answers for the activity.
    was_attributed_to
        An agent who answers for the entity.
    was_derived_from
        An entity from which this one was made.
    was_generated_by
        The activity that made the entity. A picture taken during a grasp attempt was
        generated by the attempt; its rt:phase says when.
    was_informed_by
        An activity whose results this activity used.
    """

    __iri__: ClassVar[str] = _OWL + "Thing"
    __registry__ = REGISTRY

    iri: Identity = Identity()
    at_time: One[datetime.datetime] = One(_RT + "atTime", _XSD + "dateTimeStamp", functional=True)
    beyond_reach_of: Links[EndEffector] = Links(_RT + "beyondReachOf", _RT + "EndEffector")
    can_grasp: Links[Thing] = Links(_RT + "canGrasp", _OWL + "Thing")
    can_perform: Links[Thing] = Links(_RT + "canPerform", _OWL + "Thing")
    centre_of_mass_sigma: One[float] = One(_RT + "centreOfMassSigma", _XSD + "double", unit="M")
    commit_number: One[int] = One(_RT + "commitNumber", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    confidence: Many[float] = Many(_RT + "confidence", _XSD + "double", unit="UNITLESS")
    crushed_by: Links[Thing] = Links(_RT + "crushedBy", _OWL + "Thing")
    current_placement: Links[Thing] = Links(_RT + "currentPlacement", _OWL + "Thing")
    current_pose: Links[Thing] = Links(_RT + "currentPose", _OWL + "Thing")
    disputed: Many[bool] = Many(_RT + "disputed", _XSD + "boolean")
    effective_grasp_width: One[float] = One(_RT + "effectiveGraspWidth", _XSD + "double", unit="M")
    effective_mass: One[float] = One(_RT + "effectiveMass", _XSD + "double", unit="KiloGM")
    ended_at_time: Many[object] = Many(_PROV + "endedAtTime", _RDFS + "Literal")
    friction_coefficient: One[float] = One(_RT + "frictionCoefficient", _XSD + "double", unit="UNITLESS")
    generated_at_time: Many[object] = Many(_PROV + "generatedAtTime", _RDFS + "Literal")
    gripper_type: Many[str] = Many(_RT + "gripperType", _XSD + "string")
    has_beginning: Links[Thing] = Links(_TIME + "hasBeginning", _OWL + "Thing")
    has_end: Links[Thing] = Links(_TIME + "hasEnd", _OWL + "Thing")
    has_feature_of_interest: Links[Thing] = Links(_SOSA + "hasFeatureOfInterest", _OWL + "Thing")
    has_result: Links[Thing] = Links(_SOSA + "hasResult", _OWL + "Thing")
    has_trait: Links[Thing] = Links(_RT + "hasTrait", _OWL + "Thing")
    in_xsd_date_time_stamp: Many[object] = Many(_TIME + "inXSDDateTimeStamp", _RDFS + "Literal")
    invalidated_at_time: Many[object] = Many(_PROV + "invalidatedAtTime", _RDFS + "Literal")
    judged_success: One[bool] = One(_RT + "judgedSuccess", _XSD + "boolean", functional=True)
    label: Many[str] = Many(_RDFS + "label", _RDF + "langString")
    made_by_sensor: Links[Thing] = Links(_SOSA + "madeBySensor", _OWL + "Thing")
    mass_bound: Many[float] = Many(_RT + "massBound", _XSD + "double", unit="KiloGM")
    member: Links[Thing] = Links(_SUMO + "member", _OWL + "Thing")
    merged_into: Links[ManipulableObject] = Links(_RT + "mergedInto", _RT + "ManipulableObject")
    name: Many[str] = Many(_RT + "name", _XSD + "string")
    note: Many[str] = Many(_RT + "note", _XSD + "string")
    open_placement_of: Links[Thing] = Links(_RT + "openPlacementOf", _OWL + "Thing")
    orientation_sigma: One[float] = One(_RT + "orientationSigma", _XSD + "double", unit="RAD")
    overlaps_in_time: Links[Thing] = Links(_RT + "overlapsInTime", _OWL + "Thing")
    part: Links[Thing] = Links(_SUMO + "part", _OWL + "Thing")
    phase: One[str] = One(_RT + "phase", _XSD + "string", functional=True)
    phenomenon_time: Links[Thing] = Links(_SOSA + "phenomenonTime", _OWL + "Thing")
    policy_version: One[str] = One(_RT + "policyVersion", _XSD + "string", functional=True)
    position_sigma: One[float] = One(_RT + "positionSigma", _XSD + "double", unit="M")
    qualified_name: One[str] = One(_RT + "qualifiedName", _XSD + "string", functional=True)
    rdfs_comment: Many[str] = Many(_RDFS + "comment", _RDF + "langString")
    reaches: Links[Thing] = Links(_RT + "reaches", _OWL + "Thing")
    result_time: Many[object] = Many(_SOSA + "resultTime", _RDFS + "Literal")
    simulated: One[bool] = One(_RT + "simulated", _XSD + "boolean", functional=True)
    started_at_time: Many[object] = Many(_PROV + "startedAtTime", _RDFS + "Literal")
    used: Links[Thing] = Links(_PROV + "used", _OWL + "Thing")
    valid_until: Many[datetime.datetime] = Many(_RT + "validUntil", _XSD + "dateTimeStamp")
    version: One[str] = One(_RT + "version", _XSD + "string", functional=True)
    vertex_sigma: One[float] = One(_RT + "vertexSigma", _XSD + "double", unit="M")
    was_associated_with: Links[Thing] = Links(_PROV + "wasAssociatedWith", _OWL + "Thing")
    was_attributed_to: Links[Thing] = Links(_PROV + "wasAttributedTo", _OWL + "Thing")
    was_derived_from: Links[Thing] = Links(_PROV + "wasDerivedFrom", _OWL + "Thing")
    was_generated_by: Links[Thing] = Links(_PROV + "wasGeneratedBy", _OWL + "Thing")
    was_informed_by: Links[Thing] = Links(_PROV + "wasInformedBy", _OWL + "Thing")


class Entity(Thing):
    """Anything.

    ``sumo:Entity``

    Attributes
    ----------
    depends_on
        Needs the other for its existence.
    property
        Deprecated: sumo:property is meant.
    sumo_property
        A quality of the thing.
    """

    __iri__: ClassVar[str] = _SUMO + "Entity"

    depends_on: Links[Entity] = Links(_CORAX + "dependsOn", _SUMO + "Entity")
    property: Links[Attribute] = Links(_CORAX + "property", _SUMO + "Attribute")
    sumo_property: Links[Attribute] = Links(_SUMO + "property", _SUMO + "Attribute")


class Instant(Thing):
    """A point of time.

    ``time:Instant``
    """

    __iri__: ClassVar[str] = _TIME + "Instant"


class ProperInterval(Thing):
    """A stretch of time whose begin is before its end.

    ``time:ProperInterval``
    """

    __iri__: ClassVar[str] = _TIME + "ProperInterval"


class Activity(Thing):
    """Something that happens over a time and works on entities.

    ``prov:Activity``

    Attributes
    ----------
    choice_time
        The time to choose among the candidates. [SEC]
    decoding_time
        The time to decode the compressed cloud or image. [SEC]
    execution_time
        The time to move; by the clock of the simulation if there is one. [SEC]
    extraction_time
        The time to compute descriptors. [SEC]
    generation_time
        The time to propose grasps. [SEC]
    matching_time
        The time to search the index. [SEC]
    planning_time
        The time to plan the motion. [SEC]
    pose_time
        The time to register the model. [SEC]
    query_time
        The time to ask the graph. [SEC]
    request_id
        The identifier that a client gave its request, so that a repeated request adds
        nothing.
    segmentation_time
        The time to segment the scene into objects. [SEC]
    total_time
        The time from request to result. [SEC]
    transfer_time
        The time to send the request and to receive the answer. [SEC]
    """

    __iri__: ClassVar[str] = _PROV + "Activity"

    choice_time: One[float] = One(_RT + "choiceTime", _XSD + "double", functional=True, unit="SEC")
    decoding_time: One[float] = One(_RT + "decodingTime", _XSD + "double", functional=True, unit="SEC")
    execution_time: One[float] = One(_RT + "executionTime", _XSD + "double", functional=True, unit="SEC")
    extraction_time: One[float] = One(_RT + "extractionTime", _XSD + "double", functional=True, unit="SEC")
    generation_time: One[float] = One(_RT + "generationTime", _XSD + "double", functional=True, unit="SEC")
    matching_time: One[float] = One(_RT + "matchingTime", _XSD + "double", functional=True, unit="SEC")
    planning_time: One[float] = One(_RT + "planningTime", _XSD + "double", functional=True, unit="SEC")
    pose_time: One[float] = One(_RT + "poseTime", _XSD + "double", functional=True, unit="SEC")
    query_time: One[float] = One(_RT + "queryTime", _XSD + "double", functional=True, unit="SEC")
    request_id: One[str] = One(_RT + "requestId", _XSD + "string", functional=True)
    segmentation_time: One[float] = One(_RT + "segmentationTime", _XSD + "double", functional=True, unit="SEC")
    total_time: One[float] = One(_RT + "totalTime", _XSD + "double", functional=True, unit="SEC")
    transfer_time: One[float] = One(_RT + "transferTime", _XSD + "double", functional=True, unit="SEC")


class ProvAgent(Thing):
    """Who answers for an activity or an entity.

    ``prov:Agent``
    """

    __iri__: ClassVar[str] = _PROV + "Agent"


class ProvEntity(Thing):
    """A thing of which somebody keeps the provenance.

    ``prov:Entity``
    """

    __iri__: ClassVar[str] = _PROV + "Entity"


class Person(Thing):
    """An agent who is a human being.

    ``prov:Person``
    """

    __iri__: ClassVar[str] = _PROV + "Person"


class Plan(Thing):
    """What an agent meant to do.

    ``prov:Plan``
    """

    __iri__: ClassVar[str] = _PROV + "Plan"


class SoftwareAgent(Thing):
    """An agent that is a running program.

    ``prov:SoftwareAgent``
    """

    __iri__: ClassVar[str] = _PROV + "SoftwareAgent"


class FeatureOfInterest(Thing):
    """The thing that an observation is about.

    ``sosa:FeatureOfInterest``
    """

    __iri__: ClassVar[str] = _SOSA + "FeatureOfInterest"


class SosaObservation(Thing):
    """The act of reading a sensor.

    ``sosa:Observation``
    """

    __iri__: ClassVar[str] = _SOSA + "Observation"


class Sensor(Thing):
    """What makes observations.

    ``sosa:Sensor``
    """

    __iri__: ClassVar[str] = _SOSA + "Sensor"


class Abstract(Entity):
    """What is in neither space nor time.

    ``sumo:Abstract``
    """

    __iri__: ClassVar[str] = _SUMO + "Abstract"


class Physical(Entity):
    """What is in space and time.

    ``sumo:Physical``

    Attributes
    ----------
    located
        Is where the other is.
    located_on
        Stands on or in the other thing.
    partly_located
        Is at least partly where the other is.
    time
        When it is or happens.
    """

    __iri__: ClassVar[str] = _SUMO + "Physical"

    located: Links[Object] = Links(_SUMO + "located", _SUMO + "Object")
    located_on: Links[Object] = Links(_RT + "locatedOn", _SUMO + "Object")
    partly_located: Links[Object] = Links(_SUMO + "partlyLocated", _SUMO + "Object")
    time: Links[TimePosition] = Links(_SUMO + "time", _SUMO + "TimePosition")


class AnswerChoice(ProvEntity):
    """One of the answers to a question; its label is for people, its code for the robot.

    ``rt:AnswerChoice``

    Attributes
    ----------
    answer_code
        What the robot does with this answer, in a code of its own such as go_on, done, leave,
        at or gone.
    answer_helps
        Whether the robot expects the task to succeed with this answer; other answers let it
        do what it would have done, or leave it.
    answer_number
        The place of the choice among those of its question, from 1. [NUM]
    answer_place
        The place or end effector that the answer names.
    """

    __iri__: ClassVar[str] = _RT + "AnswerChoice"

    answer_code: Many[str] = Many(_RT + "answerCode", _XSD + "string")
    answer_helps: Many[bool] = Many(_RT + "answerHelps", _XSD + "boolean")
    answer_number: One[int] = One(_RT + "answerNumber", _XSD + "positiveInteger", unit="NUM")
    answer_place: Links[Object] = Links(_RT + "answerPlace", _SUMO + "Object")


class GraspRefusal(Activity):
    """A decision against a grasp because a confidence was below its threshold (Kehoe 2014, 4.3).

    ``rt:GraspRefusal``

    Attributes
    ----------
    found_confidence
        The value of the confidence that was too low; 0 where nothing told it. [UNITLESS]
    lacking_confidence
        The confidence that was too low: identity, pose or grasp.
    refusal_advice
        Advice on how the object could be grasped after all.
    refusal_reason
        The refusal in words.
    refusal_response
        The robot's response to the refusal: second_look, new_object, measured_sides,
        other_grasp, postponed, pushed or left_alone.
    refused_object
        The object that was not grasped; where its identity was in doubt, the one most alike.
    refused_with
        The end effector that would have grasped.
    required_confidence
        The threshold that the confidence had to reach: c_I, c_T or c_G. [UNITLESS]
    """

    __iri__: ClassVar[str] = _RT + "GraspRefusal"
    __required__: ClassVar[tuple[str, ...]] = ("at_time", "found_confidence", "lacking_confidence", "required_confidence", "was_associated_with",)

    found_confidence: One[float] = One(_RT + "foundConfidence", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    lacking_confidence: One[str] = One(_RT + "lackingConfidence", _XSD + "string", functional=True)
    refusal_advice: One[str] = One(_RT + "refusalAdvice", _XSD + "string", functional=True)
    refusal_reason: One[str] = One(_RT + "refusalReason", _XSD + "string", functional=True)
    refusal_response: One[str] = One(_RT + "refusalResponse", _XSD + "string", functional=True)
    refused_object: Link[ManipulableObject] = Link(_RT + "refusedObject", _RT + "ManipulableObject", functional=True)
    refused_with: Link[EndEffector] = Link(_RT + "refusedWith", _RT + "EndEffector", functional=True)
    required_confidence: One[float] = One(_RT + "requiredConfidence", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))


class HumanAnswer(ProvEntity):
    """The answer of a person, to whom it is attributed, to the question of a robot.

    ``rt:HumanAnswer``

    Attributes
    ----------
    answer_remark
        What the person said besides.
    answers_question
        The question.
    chosen_answer
        The choice that the person made.
    """

    __iri__: ClassVar[str] = _RT + "HumanAnswer"
    __required__: ClassVar[tuple[str, ...]] = ("answers_question", "chosen_answer", "was_attributed_to",)

    answer_remark: Many[str] = Many(_RT + "answerRemark", _XSD + "string")
    answers_question: Link[Question] = Link(_RT + "answersQuestion", _RT + "Question")
    chosen_answer: Link[AnswerChoice] = Link(_RT + "chosenAnswer", _RT + "AnswerChoice")


class Interval(ProperInterval):
    """A stretch of time with a begin and an end.

    ``rt:Interval``
    """

    __iri__: ClassVar[str] = _RT + "Interval"
    __required__: ClassVar[tuple[str, ...]] = ("has_beginning", "has_end",)


class Question(ProvEntity):
    """What a robot, to whom it is attributed, asks people about a planned task. The task waits until
    somebody answers, or until rt:answerableUntil; its robot does other tasks meanwhile.

    ``rt:Question``

    Attributes
    ----------
    answerable_until
        When the robot goes on without an answer.
    asks_about
        The planned task that waits for the answer.
    choice_otherwise
        The choice that the robot makes itself where nobody answers in time: what it would
        have done without asking.
    has_answer_choice
        One of the answers to choose from.
    question_kind
        A code of the robot's own for what it asks, such as act (whether to do what is likely
        to fail) or where (a thing is not to be seen).
    question_picture
        What the robot saw when it asked.
    question_reason
        Why asking was worth its price, in words.
    question_text
        The question in words.
    """

    __iri__: ClassVar[str] = _RT + "Question"
    __required__: ClassVar[tuple[str, ...]] = ("answerable_until", "asks_about", "choice_otherwise", "has_answer_choice", "question_text", "was_attributed_to",)

    answerable_until: One[datetime.datetime] = One(_RT + "answerableUntil", _XSD + "dateTime")
    asks_about: Link[Task] = Link(_RT + "asksAbout", _RT + "Task")
    choice_otherwise: Link[AnswerChoice] = Link(_RT + "choiceOtherwise", _RT + "AnswerChoice")
    has_answer_choice: Links[AnswerChoice] = Links(_RT + "hasAnswerChoice", _RT + "AnswerChoice")
    question_kind: Many[str] = Many(_RT + "questionKind", _XSD + "string")
    question_picture: Links[InformationEntity] = Links(_RT + "questionPicture", _RT + "InformationEntity")
    question_reason: Many[str] = Many(_RT + "questionReason", _XSD + "string")
    question_text: One[str] = One(_RT + "questionText", _XSD + "string")


class TaskClaim(Activity):
    """A robot takes a planned task, and the thing that it handles, for itself: from
    prov:startedAtTime until prov:endedAtTime, or until the claim runs out.

    ``rt:TaskClaim``

    Attributes
    ----------
    claim_comment
        What happened, in words.
    claim_reason
        Why this robot got this task at that time, in words.
    claim_result
        How the claim ended: done, failed, declined (by a person) or released (untouched).
    claimed_until
        When the claim runs out unless its robot ends or renews it before.
    claims
        The planned task that a claim is about.
    claims_exemplar
        The thing that nobody else may handle meanwhile.
    """

    __iri__: ClassVar[str] = _RT + "TaskClaim"
    __required__: ClassVar[tuple[str, ...]] = ("claimed_until", "claims", "was_associated_with",)

    claim_comment: Many[str] = Many(_RT + "claimComment", _XSD + "string")
    claim_reason: Many[str] = Many(_RT + "claimReason", _XSD + "string")
    claim_result: One[str] = One(_RT + "claimResult", _XSD + "string")
    claimed_until: Many[datetime.datetime] = Many(_RT + "claimedUntil", _XSD + "dateTime")
    claims: Link[Task] = Link(_RT + "claims", _RT + "Task")
    claims_exemplar: Links[Exemplar] = Links(_RT + "claimsExemplar", _RT + "Exemplar")


class DesignObject(Abstract):
    """The abstract object that a design describes.

    ``corax:DesignObject``

    Attributes
    ----------
    design_attribute
        A quality that the design gives its object.
    design_measure
        A quantity that the design gives its object.
    """

    __iri__: ClassVar[str] = _CORAX + "DesignObject"

    design_attribute: Links[Attribute] = Links(_CORAX + "designAttribute", _SUMO + "Attribute")
    design_measure: Links[PhysicalQuantity] = Links(_CORAX + "designMeasure", _SUMO + "PhysicalQuantity")


class OrientationCoordinateSystem(Abstract):
    """A frame for rotations.

    ``pos:OrientationCoordinateSystem``

    Attributes
    ----------
    parent_ocs
        A frame for rotations above this one.
    ref_ocs
        The thing to which a frame for rotations is fixed.
    """

    __iri__: ClassVar[str] = _POS + "OrientationCoordinateSystem"

    parent_ocs: Links[OrientationCoordinateSystem] = Links(_POS + "parentOCS", _POS + "OrientationCoordinateSystem")
    ref_ocs: Link[Object] = Link(_POS + "refOCS", _SUMO + "Object", functional=True)


class PositionCoordinateSystem(Abstract):
    """A frame for points.

    ``pos:PositionCoordinateSystem``

    Attributes
    ----------
    parent_pcs
        A frame for points above this one.
    ref_pcs
        The thing to which a frame for points is fixed.
    """

    __iri__: ClassVar[str] = _POS + "PositionCoordinateSystem"

    parent_pcs: Links[PositionCoordinateSystem] = Links(_POS + "parentPCS", _POS + "PositionCoordinateSystem")
    ref_pcs: Link[Object] = Link(_POS + "refPCS", _SUMO + "Object", functional=True)


class Attribute(Abstract):
    """A quality.

    ``sumo:Attribute``
    """

    __iri__: ClassVar[str] = _SUMO + "Attribute"


class Object(Physical):
    """A physical thing that is wholly there at each moment.

    ``sumo:Object``

    Attributes
    ----------
    body_frame
        The frame that moves with the thing: a robot's base, a tool, an optical frame, an
        object.
    has_pose
        A pose of the thing, stated or estimated, at any time.
    interacts_with
        Both act on each other.
    measure
        A quantity of the object.
    oriented_at
        The turn of a thing.
    pose
        The pose of a thing.
    positioned_at
        The place of a thing.
    """

    __iri__: ClassVar[str] = _SUMO + "Object"

    body_frame: Link[Frame] = Link(_RT + "bodyFrame", _RT + "Frame", functional=True, inverse=_RT + "frameOf")
    has_pose: Links[Pose] = Links(_RT + "hasPose", _RT + "Pose")
    interacts_with: Links[Object] = Links(_CORAX + "interactsWith", _SUMO + "Object")
    measure: Links[PhysicalQuantity] = Links(_SUMO + "measure", _SUMO + "PhysicalQuantity")
    oriented_at: Links[OrientationMeasure] = Links(_POS + "orientedAt", _POS + "OrientationMeasure")
    pose: Links[PoseMeasure] = Links(_POS + "pose", _POS + "PoseMeasure")
    positioned_at: Links[PositionMeasure] = Links(_POS + "positionedAt", _POS + "PositionMeasure")


class Process(Physical):
    """What unfolds in time.

    ``sumo:Process``

    Attributes
    ----------
    agent
        The doer of a process.
    causes
        Brings the other process about.
    executed_in
        The interval in which the process took place.
    handles_exemplar
        The exemplar that an attempt was made on; the task names its product by rt:handles.
    patient
        What a process acts on.
    result
        What a process brings about.
    """

    __iri__: ClassVar[str] = _SUMO + "Process"

    agent: Links[Agent] = Links(_SUMO + "agent", _SUMO + "Agent")
    causes: Links[Process] = Links(_SUMO + "causes", _SUMO + "Process")
    executed_in: Link[Interval] = Link(_RT + "executedIn", _RT + "Interval", functional=True)
    handles_exemplar: Links[Exemplar] = Links(_RT + "handlesExemplar", _RT + "Exemplar")
    patient: Links[Entity] = Links(_SUMO + "patient", _SUMO + "Entity")
    result: Links[Entity] = Links(_SUMO + "result", _SUMO + "Entity")


class Proposition(Abstract):
    """A content that can be stated.

    ``sumo:Proposition``

    Attributes
    ----------
    about
        The subject of a content.
    """

    __iri__: ClassVar[str] = _SUMO + "Proposition"

    about: Links[Entity] = Links(_CORAX + "about", _SUMO + "Entity")


class Quantity(Abstract):
    """How much.

    ``sumo:Quantity``
    """

    __iri__: ClassVar[str] = _SUMO + "Quantity"


class Relation(Abstract):
    """A link between things.

    ``sumo:Relation``
    """

    __iri__: ClassVar[str] = _SUMO + "Relation"


class SetOrClass(Abstract):
    """A set, or a class with its members.

    ``sumo:SetOrClass``
    """

    __iri__: ClassVar[str] = _SUMO + "SetOrClass"


class InformationEntity(Abstract, ProvEntity):
    """Anything that is recorded rather than touched: images, poses, grasps, outcomes, services.

    ``rt:InformationEntity``

    Attributes
    ----------
    has_blob
        The bytes of the thing.
    """

    __iri__: ClassVar[str] = _RT + "InformationEntity"

    has_blob: Links[Blob] = Links(_RT + "hasBlob", _RT + "Blob")


class Design(Proposition):
    """What idealises an artefact.

    ``corax:Design``

    Attributes
    ----------
    idealizes
        The artefact that the design means.
    """

    __iri__: ClassVar[str] = _CORAX + "Design"

    idealizes: Links[Artifact] = Links(_CORAX + "idealizes", _SUMO + "Artifact")


class HumanRobotCommunication(Process):
    """A person and a robot exchanging information.

    ``corax:HumanRobotCommunication``
    """

    __iri__: ClassVar[str] = _CORAX + "HumanRobotCommunication"


class Interaction(Process):
    """Agents acting on each other.

    ``corax:Interaction``
    """

    __iri__: ClassVar[str] = _CORAX + "Interaction"


class PhysicalEnvironment(Object):
    """The place where things happen.

    ``corax:PhysicalEnvironment``
    """

    __iri__: ClassVar[str] = _CORAX + "PhysicalEnvironment"


class RobotRobotCommunication(Process):
    """Robots exchanging information with each other.

    ``corax:RobotRobotCommunication``
    """

    __iri__: ClassVar[str] = _CORAX + "RobotRobotCommunication"


class Agent(Object, ProvAgent):
    """An object that can act.

    ``sumo:Agent``

    Attributes
    ----------
    has_assignment
        A task of the agent.
    has_capability
        A capability of an agent, its own or that of one of its parts.
    performs
        An action of the agent.
    """

    __iri__: ClassVar[str] = _SUMO + "Agent"

    has_assignment: Links[Task] = Links(_RT + "hasAssignment", _RT + "Task", inverse=_RT + "assignedTo", stored=False)
    has_capability: Links[Capability] = Links(_RT + "hasCapability", _RT + "Capability")
    performs: Links[Action] = Links(_RT + "performs", _RT + "Action", inverse=_RT + "performedBy", stored=False)


class Collection(Object):
    """A set of things that is itself in space and time.

    ``sumo:Collection``
    """

    __iri__: ClassVar[str] = _SUMO + "Collection"


class IntentionalProcess(Process):
    """A process that somebody carries out on purpose.

    ``sumo:IntentionalProcess``
    """

    __iri__: ClassVar[str] = _SUMO + "IntentionalProcess"


class InternalChange(Process):
    """Change of the thing itself.

    ``sumo:InternalChange``
    """

    __iri__: ClassVar[str] = _SUMO + "InternalChange"


class List(Relation):
    """An ordered relation. Not used here.

    ``sumo:List``
    """

    __iri__: ClassVar[str] = _SUMO + "List"


class Motion(Process):
    """Change of place.

    ``sumo:Motion``
    """

    __iri__: ClassVar[str] = _SUMO + "Motion"


class PhysicalQuantity(Quantity):
    """A quantity that is measured.

    ``sumo:PhysicalQuantity``
    """

    __iri__: ClassVar[str] = _SUMO + "PhysicalQuantity"


class Predicate(Relation):
    """A relation that holds or does not. Not used here.

    ``sumo:Predicate``
    """

    __iri__: ClassVar[str] = _SUMO + "Predicate"


class QuaternaryRelation(Relation):
    """A relation of four arguments. Not used here.

    ``sumo:QuaternaryRelation``
    """

    __iri__: ClassVar[str] = _SUMO + "QuaternaryRelation"


class SelfConnectedObject(Object):
    """An object in one piece.

    ``sumo:SelfConnectedObject``
    """

    __iri__: ClassVar[str] = _SUMO + "SelfConnectedObject"


class SingleValuedRelation(Relation):
    """A relation whose last argument follows from the others. Not used here.

    ``sumo:SingleValuedRelation``
    """

    __iri__: ClassVar[str] = _SUMO + "SingleValuedRelation"


class TernaryRelation(Relation):
    """A relation of three arguments. Not used here.

    ``sumo:TernaryRelation``
    """

    __iri__: ClassVar[str] = _SUMO + "TernaryRelation"


class Action(Process, Activity):
    """A process by which an agent fulfils a task.

    ``rt:Action``

    Attributes
    ----------
    has_outcome
        The result of the action.
    performed_by
        The agent that performed the action.
    realises_motion
        The action carries this motion out.
    """

    __iri__: ClassVar[str] = _RT + "Action"

    has_outcome: Link[Outcome] = Link(_RT + "hasOutcome", _RT + "Outcome", functional=True, inverse=_RT + "outcomeOf")
    performed_by: Links[Agent] = Links(_RT + "performedBy", _SUMO + "Agent", inverse=_RT + "performs")
    realises_motion: Links[Motion] = Links(_RT + "realisesMotion", _SUMO + "Motion")


class Blob(InformationEntity):
    """A string of bytes kept outside the graph and named by its SHA-256 digest.

    ``rt:Blob``

    Attributes
    ----------
    byte_length
        The number of bytes. [BYTE]
    media_type
        The IANA media type of the bytes.
    sha256
        The digest of the bytes: 64 lower-case hexadecimal digits.
    """

    __iri__: ClassVar[str] = _RT + "Blob"
    __required__: ClassVar[tuple[str, ...]] = ("byte_length", "sha256",)

    byte_length: One[int] = One(_RT + "byteLength", _XSD + "nonNegativeInteger", functional=True, unit="BYTE", limits=Limits(least=0.0))
    media_type: One[str] = One(_RT + "mediaType", _XSD + "string", functional=True)
    sha256: One[str] = One(_RT + "sha256", _XSD + "string", functional=True, limits=Limits(pattern='^[0-9a-f]{64}$'))


class Capability(Attribute):
    """Something that a device lets its robot do.

    ``rt:Capability``
    """

    __iri__: ClassVar[str] = _RT + "Capability"


class CodedValue(Attribute):
    """A member of a closed list that the ontology itself keeps.

    ``rt:CodedValue``
    """

    __iri__: ClassVar[str] = _RT + "CodedValue"


class DataResource(InformationEntity):
    """A named slot that a service needs filled with data.

    ``rt:DataResource``

    Attributes
    ----------
    resource_kind
        "binary", "records" or "graph".
    resource_name
        The name of the slot.
    writable
        Whether the service may write it; read-only if false.
    """

    __iri__: ClassVar[str] = _RT + "DataResource"
    __required__: ClassVar[tuple[str, ...]] = ("resource_kind", "resource_name",)

    resource_kind: One[str] = One(_RT + "resourceKind", _XSD + "string", functional=True)
    resource_name: One[str] = One(_RT + "resourceName", _XSD + "string", functional=True)
    writable: One[bool] = One(_RT + "writable", _XSD + "boolean", functional=True)


class Dataset(InformationEntity):
    """A named, versioned store of entries.

    ``rt:Dataset``
    """

    __iri__: ClassVar[str] = _RT + "Dataset"
    __required__: ClassVar[tuple[str, ...]] = ("qualified_name",)


class DatasetVersion(InformationEntity):
    """A frozen state of a dataset.

    ``rt:DatasetVersion``

    Attributes
    ----------
    content_digest
        The digest of the manifest: "sha256:<hex>".
    has_entry
        An entry of the version.
    version_number
        The number n of "name@n". [NUM]
    version_of
        The dataset of the version.
    """

    __iri__: ClassVar[str] = _RT + "DatasetVersion"
    __required__: ClassVar[tuple[str, ...]] = ("content_digest", "version_number",)

    content_digest: One[str] = One(_RT + "contentDigest", _XSD + "string", functional=True)
    has_entry: Links[InformationEntity] = Links(_RT + "hasEntry", _RT + "InformationEntity")
    version_number: One[int] = One(_RT + "versionNumber", _XSD + "positiveInteger", functional=True, unit="NUM", limits=Limits(least=1.0))
    version_of: Link[Dataset] = Link(_RT + "versionOf", _RT + "Dataset", functional=True)


class DecisionPolicy(InformationEntity, Plan):
    """The thresholds and the exploration in force.

    ``rt:DecisionPolicy``

    Attributes
    ----------
    exploration_rate
        The share of random choices. [UNITLESS]
    grasp_threshold
        The least confidence c_G at which a grasp is tried. [UNITLESS]
    pose_threshold
        The least confidence c_T at which a pose is accepted. [UNITLESS]
    recognition_threshold
        The least confidence c_I at which a recognition is accepted. [UNITLESS]
    """

    __iri__: ClassVar[str] = _RT + "DecisionPolicy"

    exploration_rate: One[float] = One(_RT + "explorationRate", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    grasp_threshold: One[float] = One(_RT + "graspThreshold", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    pose_threshold: One[float] = One(_RT + "poseThreshold", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    recognition_threshold: One[float] = One(_RT + "recognitionThreshold", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))


class Experience(InformationEntity):
    """State, action, reward and next state of one attempt.

    ``rt:Experience``

    Attributes
    ----------
    chose_action
        The action that was chosen.
    in_state
        The state before the choice.
    next_state
        The state after the attempt.
    of_attempt
        The attempt that the experience records.
    reward
        The reward of the step. [UNITLESS]
    step_index
        The place of the step in the episode, from 0. [NUM]
    terminal
        Whether the episode ended.
    """

    __iri__: ClassVar[str] = _RT + "Experience"
    __required__: ClassVar[tuple[str, ...]] = ("chose_action", "in_state", "of_attempt", "reward",)

    chose_action: Link[LearningAction] = Link(_RT + "choseAction", _RT + "LearningAction", functional=True, limits=Limits(one_of=(_RT + "sector0", _RT + "sector1", _RT + "sector2", _RT + "sector3",)))
    in_state: Link[LearningState] = Link(_RT + "inState", _RT + "LearningState", functional=True)
    next_state: Link[LearningState] = Link(_RT + "nextState", _RT + "LearningState", functional=True)
    of_attempt: Link[GraspAttempt] = Link(_RT + "ofAttempt", _RT + "GraspAttempt", functional=True)
    reward: One[float] = One(_RT + "reward", _XSD + "double", functional=True, unit="UNITLESS")
    step_index: One[int] = One(_RT + "stepIndex", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    terminal: One[bool] = One(_RT + "terminal", _XSD + "boolean", functional=True)


class FeatureExtraction(Process, Activity):
    """A run that made features from an observation.

    ``rt:FeatureExtraction``
    """

    __iri__: ClassVar[str] = _RT + "FeatureExtraction"


class Feedback(InformationEntity):
    """Evidence on which an outcome was decided.

    ``rt:Feedback``

    Attributes
    ----------
    comment
        The person's words, or the executor's own text.
    verdict
        The verdict of this piece of evidence: success or not.
    """

    __iri__: ClassVar[str] = _RT + "Feedback"

    comment: Many[str] = Many(_RT + "comment", _XSD + "string")
    verdict: One[bool] = One(_RT + "verdict", _XSD + "boolean", functional=True)


class Frame(PositionCoordinateSystem, OrientationCoordinateSystem):
    """A right-handed coordinate frame, named after REP 105.

    ``rt:Frame``

    Attributes
    ----------
    ancestor_frame
        Any frame above.
    frame_id
        The name of the frame as in tf, such as "base_link".
    frame_of
        The thing to which the frame is fixed.
    parent_frame
        The next frame up the tree.
    pose_in_parent
        The pose parent_from_frame.
    """

    __iri__: ClassVar[str] = _RT + "Frame"
    __required__: ClassVar[tuple[str, ...]] = ("frame_id",)

    ancestor_frame: Links[Frame] = Links(_RT + "ancestorFrame", _RT + "Frame")
    frame_id: One[str] = One(_RT + "frameId", _XSD + "string", functional=True)
    frame_of: Links[Object] = Links(_RT + "frameOf", _SUMO + "Object", inverse=_RT + "bodyFrame", stored=False)
    parent_frame: Link[Frame] = Link(_RT + "parentFrame", _RT + "Frame", functional=True)
    pose_in_parent: Link[Pose] = Link(_RT + "poseInParent", _RT + "Pose", functional=True)


class Full(Object):
    """A place that nothing more can be put into or onto now; what is there can be taken. Whoever
    makes room withdraws the statement.

    ``rt:Full``
    """

    __iri__: ClassVar[str] = _RT + "Full"


class GraspConfiguration(InformationEntity):
    """A way in which a gripper takes an object; the content of one moveit_msgs/Grasp message.

    ``rt:GraspConfiguration``

    Attributes
    ----------
    allowed_touch
        An object that the hand may touch during the grasp.
    approach_angle
        The angle phi of a push grasp (Kehoe 2014, 3.3). [RAD]
    contact_arc_length
        The place of the first contact, along the outline. [M]
    contact_width
        The distance between the two contacts of the grasp. [M]
    generator
        The name and version of what proposed the grasp.
    grasp_of
        The object that the grasp takes.
    grasp_pose
        The pose of the end effector's parent link, in the body frame of the object or in a
        work surface's frame; a planar pose for planar grasps.
    grasp_posture
        The fingers closed; positions and efforts count.
    grasp_quality
        The generator's own score. [UNITLESS]
    has_contact
        A place at which the hand touches the object. Those of two jaws follow from pose and
        contact width.
    has_evaluation
        A computed quality of the grasp.
    jaw_opening
        The opening of the jaws on approach; of three fingers the diameter between them. [M]
    max_contact_force
        The limit of the contact force for the controller. [N]
    post_grasp_retreat
        The motion away from the support, with the object.
    post_place_retreat
        The motion away from the object after placing it.
    pre_grasp_approach
        The motion towards the object.
    pre_grasp_posture
        The fingers before the grasp; positions count.
    tried_in
        An attempt of this grasp.
    """

    __iri__: ClassVar[str] = _RT + "GraspConfiguration"
    __required__: ClassVar[tuple[str, ...]] = ("grasp_of", "grasp_pose", "gripper_type",)

    allowed_touch: Links[Object] = Links(_RT + "allowedTouch", _SUMO + "Object")
    approach_angle: One[float] = One(_RT + "approachAngle", _XSD + "double", functional=True, unit="RAD")
    contact_arc_length: One[float] = One(_RT + "contactArcLength", _XSD + "double", functional=True, unit="M")
    contact_width: One[float] = One(_RT + "contactWidth", _XSD + "double", functional=True, unit="M")
    generator: One[str] = One(_RT + "generator", _XSD + "string", functional=True)
    grasp_of: Links[ManipulableObject] = Links(_RT + "graspOf", _RT + "ManipulableObject", inverse=_RT + "hasGrasp", stored=False)
    grasp_pose: Link[FramedMeasure] = Link(_RT + "graspPose", _RT + "FramedMeasure", functional=True)
    grasp_posture: Link[JointTrajectory] = Link(_RT + "graspPosture", _RT + "JointTrajectory", functional=True)
    grasp_quality: One[float] = One(_RT + "graspQuality", _XSD + "double", functional=True, unit="UNITLESS")
    has_contact: Links[GraspContact] = Links(_RT + "hasContact", _RT + "GraspContact")
    has_evaluation: Links[GraspEvaluation] = Links(_RT + "hasEvaluation", _RT + "GraspEvaluation", inverse=_RT + "evaluates")
    jaw_opening: One[float] = One(_RT + "jawOpening", _XSD + "double", functional=True, unit="M")
    max_contact_force: One[float] = One(_RT + "maxContactForce", _XSD + "double", functional=True, unit="N")
    post_grasp_retreat: Link[GripperTranslation] = Link(_RT + "postGraspRetreat", _RT + "GripperTranslation", functional=True)
    post_place_retreat: Link[GripperTranslation] = Link(_RT + "postPlaceRetreat", _RT + "GripperTranslation", functional=True)
    pre_grasp_approach: Link[GripperTranslation] = Link(_RT + "preGraspApproach", _RT + "GripperTranslation", functional=True)
    pre_grasp_posture: Link[JointTrajectory] = Link(_RT + "preGraspPosture", _RT + "JointTrajectory", functional=True)
    tried_in: Links[GraspAttempt] = Links(_RT + "triedIn", _RT + "GraspAttempt", inverse=_RT + "executesGrasp", stored=False)


class GraspEvaluation(InformationEntity):
    """The quality of a grasp under stated uncertainty.

    ``rt:GraspEvaluation``

    Attributes
    ----------
    belief_alpha
        Alpha of the Beta distribution whose mean is the confidence: prior and counted
        successes. [UNITLESS]
    belief_beta
        Beta of the Beta distribution whose mean is the confidence: prior and counted
        failures. [UNITLESS]
    carry_score
        The score in [0, 1] by which a grasp is ranked for carrying at 2.5 g; a hand's
        outcomes map it to a chance. [UNITLESS]
    closure_mode
        The kind of closure of the grasp.
    confidence_lower95
        The one-sided lower 95 % bound of the confidence s_G, from the number of
        perturbations. [UNITLESS]
    epsilon_quality
        The radius of the largest ball of wrenches that the contacts resist (Ferrari and Canny
        1992), torques over the object's radius. [UNITLESS]
    evaluates
        The grasp that was evaluated.
    force_closure_lower_bound
        The lower bound Q on the probability of force closure (Kehoe 2014, 3.1). [UNITLESS]
    grasp_confidence
        The confidence s_G in [0, 1]: mean quality over weighted perturbations. [UNITLESS]
    lift_score
        The score in [0, 1] by which a grasp is ranked for lifting at 1 g; a hand's outcomes
        map it to a chance. [UNITLESS]
    load_share
        The weight of the object over what the friction of the hand bears, as assumed when the
        grasp was planned. [UNITLESS]
    sample_count
        The number of perturbations tried. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "GraspEvaluation"
    __required__: ClassVar[tuple[str, ...]] = ("evaluates",)

    belief_alpha: One[float] = One(_RT + "beliefAlpha", _XSD + "double", functional=True, unit="UNITLESS")
    belief_beta: One[float] = One(_RT + "beliefBeta", _XSD + "double", functional=True, unit="UNITLESS")
    carry_score: One[float] = One(_RT + "carryScore", _XSD + "double", functional=True, unit="UNITLESS")
    closure_mode: Links[ClosureMode] = Links(_RT + "closureMode", _RT + "ClosureMode", limits=Limits(one_of=(_RT + "convexVertexClosure", _RT + "frictionClosure", _RT + "slipClosure",)))
    confidence_lower95: One[float] = One(_RT + "confidenceLower95", _XSD + "double", functional=True, unit="UNITLESS")
    epsilon_quality: One[float] = One(_RT + "epsilonQuality", _XSD + "double", functional=True, unit="UNITLESS")
    evaluates: Link[GraspConfiguration] = Link(_RT + "evaluates", _RT + "GraspConfiguration", functional=True, inverse=_RT + "hasEvaluation", stored=False)
    force_closure_lower_bound: One[float] = One(_RT + "forceClosureLowerBound", _XSD + "double", functional=True, unit="UNITLESS")
    grasp_confidence: One[float] = One(_RT + "graspConfidence", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    lift_score: One[float] = One(_RT + "liftScore", _XSD + "double", functional=True, unit="UNITLESS")
    load_share: One[float] = One(_RT + "loadShare", _XSD + "double", functional=True, unit="UNITLESS")
    sample_count: One[int] = One(_RT + "sampleCount", _XSD + "positiveInteger", functional=True, unit="NUM")


class GraspStatistics(InformationEntity):
    """Attempts and successes of one grasp with one kind of gripper, over all robots.

    ``rt:GraspStatistics``

    Attributes
    ----------
    attempts
        The number of judged attempts. [NUM]
    lower95
        The lower end of the 95 % interval of Clopper and Pearson. [UNITLESS]
    mean_success
        Successes over attempts. [UNITLESS]
    statistics_of
        The grasp that is counted.
    successes
        The number of attempts judged a success. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "GraspStatistics"
    __required__: ClassVar[tuple[str, ...]] = ("attempts", "gripper_type", "statistics_of", "successes",)

    attempts: One[int] = One(_RT + "attempts", _XSD + "nonNegativeInteger", functional=True, unit="NUM", limits=Limits(least=0.0))
    lower95: One[float] = One(_RT + "lower95", _XSD + "double", functional=True, unit="UNITLESS")
    mean_success: One[float] = One(_RT + "meanSuccess", _XSD + "double", functional=True, unit="UNITLESS")
    statistics_of: Link[GraspConfiguration] = Link(_RT + "statisticsOf", _RT + "GraspConfiguration", functional=True)
    successes: One[int] = One(_RT + "successes", _XSD + "nonNegativeInteger", functional=True, unit="NUM", limits=Limits(least=0.0))


class GripperTranslation(InformationEntity):
    """An approach or retreat along a direction; moveit_msgs/GripperTranslation.

    ``rt:GripperTranslation``

    Attributes
    ----------
    desired_distance
        The intended distance. [M]
    min_distance
        The minimum distance. [M]
    translation_direction
        The direction of travel.
    """

    __iri__: ClassVar[str] = _RT + "GripperTranslation"
    __required__: ClassVar[tuple[str, ...]] = ("translation_direction",)

    desired_distance: One[float] = One(_RT + "desiredDistance", _XSD + "double", functional=True, unit="M")
    min_distance: One[float] = One(_RT + "minDistance", _XSD + "double", functional=True, unit="M", limits=Limits(least=0.0))
    translation_direction: Link[Direction] = Link(_RT + "translationDirection", _RT + "Direction", functional=True)


class HiddenCause(InformationEntity):
    """A property of an object that no camera sees and that explains how attempts at it ended;
    inferred from the judged attempts of all robots and restated with each.

    ``rt:HiddenCause``

    Attributes
    ----------
    cause_probability
        The probability of the cause, given the attempts that it is derived from. [UNITLESS]
    explains_failure
        An attempt that failed as the cause would have it.
    explains_reason
        A reason given for attempts that failed as the cause would have it.
    hidden_cause_of
        The object to which the cause belongs.
    """

    __iri__: ClassVar[str] = _RT + "HiddenCause"
    __required__: ClassVar[tuple[str, ...]] = ("cause_probability", "was_derived_from",)

    cause_probability: One[float] = One(_RT + "causeProbability", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    explains_failure: Links[GraspAttempt] = Links(_RT + "explainsFailure", _RT + "GraspAttempt")
    explains_reason: Links[OutcomeReason] = Links(_RT + "explainsReason", _RT + "OutcomeReason", limits=Limits(one_of=(_RT + "reason_approach_collision", _RT + "reason_approach_ik", _RT + "reason_came_apart", _RT + "reason_crushed", _RT + "reason_drop_outside", _RT + "reason_grasp_collision", _RT + "reason_hardware", _RT + "reason_ik", _RT + "reason_lift_ik", _RT + "reason_low_grasp", _RT + "reason_low_pose", _RT + "reason_low_recognition", _RT + "reason_missed", _RT + "reason_no_grasp", _RT + "reason_no_match", _RT + "reason_not_judged", _RT + "reason_ok", _RT + "reason_place_plan", _RT + "reason_pose_unknown", _RT + "reason_pregrasp_collision", _RT + "reason_pushed_away", _RT + "reason_rrt_goal", _RT + "reason_rrt_start", _RT + "reason_rrt_time", _RT + "reason_slip_hold", _RT + "reason_slip_lift", _RT + "reason_slip_transport", _RT + "reason_stopped_by_human", _RT + "reason_tilt", _RT + "reason_timed_out", _RT + "reason_too_heavy", _RT + "reason_too_wide", _RT + "reason_touched", _RT + "reason_tracking", _RT + "reason_wrong_object",)))
    hidden_cause_of: Links[ManipulableObject] = Links(_RT + "hiddenCauseOf", _RT + "ManipulableObject", inverse=_RT + "hasHiddenCause", stored=False)


class JointTrajectory(InformationEntity):
    """A posture over time; the content of trajectory_msgs/JointTrajectory.

    ``rt:JointTrajectory``

    Attributes
    ----------
    has_waypoint
        A point of the trajectory; the times order them.
    of_robot_model
        Make and version of the robot whose joints a recorded movement has; it stays when the
        robot gets another body.
    """

    __iri__: ClassVar[str] = _RT + "JointTrajectory"

    has_waypoint: Links[JointWaypoint] = Links(_RT + "hasWaypoint", _RT + "JointWaypoint")
    of_robot_model: Links[RobotModel] = Links(_RT + "ofRobotModel", _RT + "RobotModel")


class JointValue(InformationEntity):
    """The values of one joint at a way point.

    ``rt:JointValue``

    Attributes
    ----------
    angle
        The position of a revolute joint. [RAD]
    angular_acceleration
        The acceleration of a revolute joint. [RAD-PER-SEC2]
    angular_velocity
        The velocity of a revolute joint. [RAD-PER-SEC]
    displacement
        The position of a prismatic joint. [M]
    force
        The effort of a prismatic joint. [N]
    linear_acceleration
        The acceleration of a prismatic joint. [M-PER-SEC2]
    linear_velocity
        The velocity of a prismatic joint. [M-PER-SEC]
    of_joint
        The joint to which the values belong.
    torque
        The effort of a revolute joint. [N-M]
    """

    __iri__: ClassVar[str] = _RT + "JointValue"
    __required__: ClassVar[tuple[str, ...]] = ("of_joint",)

    angle: One[float] = One(_RT + "angle", _XSD + "double", functional=True, unit="RAD")
    angular_acceleration: One[float] = One(_RT + "angularAcceleration", _XSD + "double", functional=True, unit="RAD-PER-SEC2")
    angular_velocity: One[float] = One(_RT + "angularVelocity", _XSD + "double", functional=True, unit="RAD-PER-SEC")
    displacement: One[float] = One(_RT + "displacement", _XSD + "double", functional=True, unit="M")
    force: One[float] = One(_RT + "force", _XSD + "double", functional=True, unit="N")
    linear_acceleration: One[float] = One(_RT + "linearAcceleration", _XSD + "double", functional=True, unit="M-PER-SEC2")
    linear_velocity: One[float] = One(_RT + "linearVelocity", _XSD + "double", functional=True, unit="M-PER-SEC")
    of_joint: Link[Joint] = Link(_RT + "ofJoint", _RT + "Joint", functional=True)
    torque: One[float] = One(_RT + "torque", _XSD + "double", functional=True, unit="N-M")


class JointWaypoint(InformationEntity):
    """One point of a trajectory: position, velocity, acceleration, time (Gatto 2016, 4.2).

    ``rt:JointWaypoint``

    Attributes
    ----------
    has_joint_value
        The values of one joint at this point.
    time_from_start
        The time since the start of the trajectory. [SEC]
    waypoint_index
        The place in the trajectory, from 0. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "JointWaypoint"

    has_joint_value: Links[JointValue] = Links(_RT + "hasJointValue", _RT + "JointValue")
    time_from_start: One[float] = One(_RT + "timeFromStart", _XSD + "double", functional=True, unit="SEC")
    waypoint_index: One[int] = One(_RT + "waypointIndex", _XSD + "nonNegativeInteger", functional=True, unit="NUM")


class LearnerSnapshot(InformationEntity):
    """The saved state of a learner.

    ``rt:LearnerSnapshot``

    Attributes
    ----------
    algorithm
        The name and version of the learner.
    episode_count
        The number of episodes learnt so far. [NUM]
    learnt_from
        An experience that the learner has taken in.
    learnt_in
        The name and version of the environment in which the learner acted; another robot can
        use the policy in the same one.
    mean_return
        The mean undiscounted sum of the rewards of an episode, over the latest episodes of
        the training. [UNITLESS]
    step_count
        The number of steps learnt so far. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "LearnerSnapshot"
    __required__: ClassVar[tuple[str, ...]] = ("algorithm", "has_blob",)

    algorithm: One[str] = One(_RT + "algorithm", _XSD + "string", functional=True)
    episode_count: One[int] = One(_RT + "episodeCount", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    learnt_from: Links[Experience] = Links(_RT + "learntFrom", _RT + "Experience")
    learnt_in: One[str] = One(_RT + "learntIn", _XSD + "string", functional=True)
    mean_return: One[float] = One(_RT + "meanReturn", _XSD + "double", functional=True, unit="UNITLESS")
    step_count: One[int] = One(_RT + "stepCount", _XSD + "nonNegativeInteger", functional=True, unit="NUM")


class LearningState(InformationEntity):
    """The learner's view of the object before its choice, as five numbers (Gatto 2016, 3.3.4).

    ``rt:LearningState``

    Attributes
    ----------
    projected_by
        The components used to make the state.
    state_of
        The object that was seen.
    state_vector
        The numbers of the state as decimals, separated by one space.
    """

    __iri__: ClassVar[str] = _RT + "LearningState"

    projected_by: Link[StateProjection] = Link(_RT + "projectedBy", _RT + "StateProjection", functional=True)
    state_of: Links[ManipulableObject] = Links(_RT + "stateOf", _RT + "ManipulableObject")
    state_vector: One[str] = One(_RT + "stateVector", _XSD + "string", functional=True)


class Match(InformationEntity):
    """One candidate object in the answer of a recognition.

    ``rt:Match``

    Attributes
    ----------
    inlier_count
        The number of matches that one geometric transform explains. [NUM]
    match_score
        The raw score of the candidate. [UNITLESS]
    matched_class
        The class of the candidate: a class used as a value (OWL 2 punning).
    matched_object
        The object of the candidate.
    matched_view
        A stored view that matched.
    rank
        The place in the list; 1 is best. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "Match"
    __required__: ClassVar[tuple[str, ...]] = ("rank",)

    inlier_count: One[int] = One(_RT + "inlierCount", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    match_score: One[float] = One(_RT + "matchScore", _XSD + "double", functional=True, unit="UNITLESS")
    matched_class: Links[Thing] = Links(_RT + "matchedClass", _OWL + "Thing")
    matched_object: Link[ManipulableObject] = Link(_RT + "matchedObject", _RT + "ManipulableObject", functional=True)
    matched_view: Links[View] = Links(_RT + "matchedView", _RT + "View")
    rank: One[int] = One(_RT + "rank", _XSD + "positiveInteger", functional=True, unit="NUM", limits=Limits(least=1.0))


class MethodParameter(InformationEntity):
    """One input or output of a method.

    ``rt:MethodParameter``

    Attributes
    ----------
    parameter_index
        The place among the parameters, from 0. [NUM]
    parameter_name
        The name of the parameter.
    value_type
        The name of the type in the service registry.
    """

    __iri__: ClassVar[str] = _RT + "MethodParameter"
    __required__: ClassVar[tuple[str, ...]] = ("parameter_name", "value_type",)

    parameter_index: One[int] = One(_RT + "parameterIndex", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    parameter_name: One[str] = One(_RT + "parameterName", _XSD + "string", functional=True)
    value_type: One[str] = One(_RT + "valueType", _XSD + "string", functional=True)


class NamedGraph(InformationEntity):
    """A named graph of the store, described as a thing.

    ``rt:NamedGraph``

    Attributes
    ----------
    graph_digest
        The digest of the graph's triples, independent of their order.
    graph_owner
        The agent that may write the graph.
    triple_count
        The number of triples after the commit in rt:commitNumber. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "NamedGraph"

    graph_digest: One[str] = One(_RT + "graphDigest", _XSD + "string", functional=True)
    graph_owner: Link[ProvAgent] = Link(_RT + "graphOwner", _PROV + "Agent", functional=True)
    triple_count: One[int] = One(_RT + "tripleCount", _XSD + "nonNegativeInteger", functional=True, unit="NUM")


class Observation(Process, SosaObservation, Activity):
    """One reading of a sensor, of a whole scene or of the segment that shows one object.

    ``rt:Observation``

    Attributes
    ----------
    entropy_change
        The change of image entropy against the frame before, on which frames are culled
        (Gatto 2016, 3.2.1). [UNITLESS]
    """

    __iri__: ClassVar[str] = _RT + "Observation"
    __required__: ClassVar[tuple[str, ...]] = ("made_by_sensor", "result_time",)

    entropy_change: One[float] = One(_RT + "entropyChange", _XSD + "double", functional=True, unit="UNITLESS")


class OutOfOrder(Object):
    """A robot or an end effector that cannot be used now: its arm does not move, its fingers do not
    close. With a robot all its end effectors are. Whoever mends it withdraws the statement.

    ``rt:OutOfOrder``
    """

    __iri__: ClassVar[str] = _RT + "OutOfOrder"


class Outcome(InformationEntity):
    """The result of an action.

    ``rt:Outcome``

    Attributes
    ----------
    has_feedback
        The evidence for the outcome.
    has_reason
        The reason for this outcome.
    outcome_of
        The action of which this is the outcome.
    success
        The result as the executor decided it, written once; for a grasp: held.
    """

    __iri__: ClassVar[str] = _RT + "Outcome"
    __required__: ClassVar[tuple[str, ...]] = ("has_feedback", "has_reason", "success",)

    has_feedback: Links[Feedback] = Links(_RT + "hasFeedback", _RT + "Feedback")
    has_reason: Link[OutcomeReason] = Link(_RT + "hasReason", _RT + "OutcomeReason", functional=True, limits=Limits(one_of=(_RT + "reason_approach_collision", _RT + "reason_approach_ik", _RT + "reason_came_apart", _RT + "reason_crushed", _RT + "reason_drop_outside", _RT + "reason_grasp_collision", _RT + "reason_hardware", _RT + "reason_ik", _RT + "reason_lift_ik", _RT + "reason_low_grasp", _RT + "reason_low_pose", _RT + "reason_low_recognition", _RT + "reason_missed", _RT + "reason_no_grasp", _RT + "reason_no_match", _RT + "reason_not_judged", _RT + "reason_ok", _RT + "reason_place_plan", _RT + "reason_pose_unknown", _RT + "reason_pregrasp_collision", _RT + "reason_pushed_away", _RT + "reason_rrt_goal", _RT + "reason_rrt_start", _RT + "reason_rrt_time", _RT + "reason_slip_hold", _RT + "reason_slip_lift", _RT + "reason_slip_transport", _RT + "reason_stopped_by_human", _RT + "reason_tilt", _RT + "reason_timed_out", _RT + "reason_too_heavy", _RT + "reason_too_wide", _RT + "reason_touched", _RT + "reason_tracking", _RT + "reason_wrong_object",)))
    outcome_of: Links[Action] = Links(_RT + "outcomeOf", _RT + "Action", inverse=_RT + "hasOutcome", stored=False)
    success: One[bool] = One(_RT + "success", _XSD + "boolean", functional=True)


class Pipeline(InformationEntity):
    """Methods joined so that data flow from one to the next.

    ``rt:Pipeline``

    Attributes
    ----------
    has_step
        A step of the pipeline.
    """

    __iri__: ClassVar[str] = _RT + "Pipeline"

    has_step: Links[PipelineStep] = Links(_RT + "hasStep", _RT + "PipelineStep")


class PipelineStep(InformationEntity):
    """One method in a pipeline.

    ``rt:PipelineStep``

    Attributes
    ----------
    feeds
        The step to which the output goes straight.
    step_method
        The method that the step calls.
    """

    __iri__: ClassVar[str] = _RT + "PipelineStep"
    __required__: ClassVar[tuple[str, ...]] = ("step_method",)

    feeds: Links[PipelineStep] = Links(_RT + "feeds", _RT + "PipelineStep")
    step_method: Link[ServiceMethod] = Link(_RT + "stepMethod", _RT + "ServiceMethod", functional=True)


class Placement(InformationEntity, ProperInterval):
    """The interval in which a thing, or a frame, was at one place; it lasts until it has an end.

    ``rt:Placement``

    Attributes
    ----------
    confirmed_at
        A later time at which the thing was seen at the same place; the last one counts.
    held_by
        The end effector that held the thing during the interval.
    placed_in
        The container that held the thing during the interval.
    placed_on
        The support on which the thing stood during the interval.
    placement_confidence
        The confidence, when the interval began, that the thing was there, in [0, 1].
        [UNITLESS]
    placement_of
        The exemplar that was there, or the frame that had this pose in another.
    placement_pose
        The pose during the interval, in the frame in which it was measured.
    """

    __iri__: ClassVar[str] = _RT + "Placement"
    __required__: ClassVar[tuple[str, ...]] = ("has_beginning", "placement_of",)

    confirmed_at: Many[datetime.datetime] = Many(_RT + "confirmedAt", _XSD + "dateTimeStamp")
    held_by: Links[Object] = Links(_RT + "heldBy", _SUMO + "Object")
    placed_in: Links[Object] = Links(_RT + "placedIn", _SUMO + "Object")
    placed_on: Links[Object] = Links(_RT + "placedOn", _SUMO + "Object")
    placement_confidence: One[float] = One(_RT + "placementConfidence", _XSD + "double", unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    placement_of: Link[Thing] = Link(_RT + "placementOf", _OWL + "Thing")
    placement_pose: Link[Pose] = Link(_RT + "placementPose", _RT + "Pose")


class PoseEstimate(InformationEntity):
    """The pose of an object as estimated from an observation.

    ``rt:PoseEstimate``

    Attributes
    ----------
    accepted
        Whether the estimate passed its threshold (s_T >= c_T).
    coverage
        The share of visible model samples that the cloud explains. [UNITLESS]
    estimated_pose
        The pose that was estimated.
    fit_score
        The score of the registration. [UNITLESS]
    pose_confidence
        The confidence s_T of the pose, in [0, 1]. [UNITLESS]
    pose_of
        The object whose pose was estimated.
    pose_of_exemplar
        The exemplar that was seen there; rt:poseOf names its product.
    principal_axis_angle
        The angle between the principal axes of model and view; above pi/10 the pose is
        rejected (Kehoe 2014, 4.6). [RAD]
    sum_squared_residual
        The sum of squared distances after registration (Kehoe 2014, 4.4). [M2]
    violation
        The share of model samples that the camera saw through. [UNITLESS]
    """

    __iri__: ClassVar[str] = _RT + "PoseEstimate"
    __required__: ClassVar[tuple[str, ...]] = ("estimated_pose", "pose_confidence", "pose_of",)

    accepted: One[bool] = One(_RT + "accepted", _XSD + "boolean", functional=True)
    coverage: One[float] = One(_RT + "coverage", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    estimated_pose: Link[Pose] = Link(_RT + "estimatedPose", _RT + "Pose", functional=True)
    fit_score: One[float] = One(_RT + "fitScore", _XSD + "double", functional=True, unit="UNITLESS")
    pose_confidence: One[float] = One(_RT + "poseConfidence", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    pose_of: Link[ManipulableObject] = Link(_RT + "poseOf", _RT + "ManipulableObject", inverse=_RT + "poseEstimatedIn")
    pose_of_exemplar: Links[Exemplar] = Links(_RT + "poseOfExemplar", _RT + "Exemplar")
    principal_axis_angle: One[float] = One(_RT + "principalAxisAngle", _XSD + "double", functional=True, unit="RAD")
    sum_squared_residual: One[float] = One(_RT + "sumSquaredResidual", _XSD + "double", functional=True, unit="M2")
    violation: One[float] = One(_RT + "violation", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))


class PrintedWord(InformationEntity):
    """A line of print as a program read it, perhaps wrongly, with its place in the view's image.

    ``rt:PrintedWord``

    Attributes
    ----------
    reading_score
        The confidence of the program that read, 0 to 1; not calibrated. [UNITLESS]
    word_angle
        The angle from the direction of the columns to that of reading, clockwise in the
        image. [RAD]
    word_height
        The height of the line across its direction of reading, in pixels. [NUM]
    word_length
        The length of the line along its direction of reading, in pixels. [NUM]
    word_text
        The letters as read, without control characters.
    word_token
        A single word of the line, in small letters without accents, to find objects by.
    word_u
        The column of the middle of the line in the image of the view, in pixels. [NUM]
    word_v
        The row of the middle of the line in the image of the view, in pixels. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "PrintedWord"
    __required__: ClassVar[tuple[str, ...]] = ("reading_score", "word_angle", "word_height", "word_length", "word_text", "word_u", "word_v",)

    reading_score: One[float] = One(_RT + "readingScore", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    word_angle: One[float] = One(_RT + "wordAngle", _XSD + "double", functional=True, unit="RAD")
    word_height: One[float] = One(_RT + "wordHeight", _XSD + "double", functional=True, unit="NUM", limits=Limits(above=0.0))
    word_length: One[float] = One(_RT + "wordLength", _XSD + "double", functional=True, unit="NUM", limits=Limits(above=0.0))
    word_text: One[str] = One(_RT + "wordText", _XSD + "string", functional=True, limits=Limits(pattern='^[^\x01-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]+$'))
    word_token: Many[str] = Many(_RT + "wordToken", _XSD + "string")
    word_u: One[float] = One(_RT + "wordU", _XSD + "double", functional=True, unit="NUM")
    word_v: One[float] = One(_RT + "wordV", _XSD + "double", functional=True, unit="NUM")


class Recognition(Process, Activity):
    """One run of the recognition pipeline.

    ``rt:Recognition``
    """

    __iri__: ClassVar[str] = _RT + "Recognition"


class RecognitionResult(InformationEntity):
    """The answer of one recognition: null, single or multiple.

    ``rt:RecognitionResult``

    Attributes
    ----------
    best_match
        The candidate decided for; absent if none passed.
    has_match
        A candidate of the answer; rt:rank orders them.
    match_count
        The number of objects matched: 0 is null recognition, 1 single, more multiple. [NUM]
    recognised_from
        The observation that was looked at.
    recognised_object
        The object decided for.
    recognition_confidence
        The confidence s_I of the recognition, in [0, 1] (Kehoe 2014, 4.3). [UNITLESS]
    """

    __iri__: ClassVar[str] = _RT + "RecognitionResult"
    __required__: ClassVar[tuple[str, ...]] = ("match_count", "recognition_confidence",)

    best_match: Link[Match] = Link(_RT + "bestMatch", _RT + "Match", functional=True)
    has_match: Links[Match] = Links(_RT + "hasMatch", _RT + "Match")
    match_count: One[int] = One(_RT + "matchCount", _XSD + "nonNegativeInteger", functional=True, unit="NUM", limits=Limits(least=0.0))
    recognised_from: Links[Observation] = Links(_RT + "recognisedFrom", _RT + "Observation")
    recognised_object: Links[ManipulableObject] = Links(_RT + "recognisedObject", _RT + "ManipulableObject")
    recognition_confidence: One[float] = One(_RT + "recognitionConfidence", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))


class ResourceBinding(InformationEntity):
    """The version of a dataset that fills a slot.

    ``rt:ResourceBinding``

    Attributes
    ----------
    binds_dataset
        The dataset version in the slot.
    binds_resource
        The slot.
    """

    __iri__: ClassVar[str] = _RT + "ResourceBinding"
    __required__: ClassVar[tuple[str, ...]] = ("binds_dataset", "binds_resource",)

    binds_dataset: Link[DatasetVersion] = Link(_RT + "bindsDataset", _RT + "DatasetVersion", functional=True)
    binds_resource: Link[DataResource] = Link(_RT + "bindsResource", _RT + "DataResource", functional=True)


class RobotModel(InformationEntity):
    """A make and version of robot, with its kinematic and semantic descriptions.

    ``rt:RobotModel``

    Attributes
    ----------
    model_name
        The name of make and version, such as "nao-h25-v5".
    srdf
        The semantic description (SRDF).
    urdf
        The kinematic description (URDF).
    """

    __iri__: ClassVar[str] = _RT + "RobotModel"
    __required__: ClassVar[tuple[str, ...]] = ("model_name",)

    model_name: One[str] = One(_RT + "modelName", _XSD + "string", functional=True)
    srdf: Links[Blob] = Links(_RT + "srdf", _RT + "Blob")
    urdf: Links[Blob] = Links(_RT + "urdf", _RT + "Blob")


class Rule(InformationEntity):
    """A rule of the user, which the reasoner applies from the commit on that adds it.

    ``rt:Rule``

    Attributes
    ----------
    rule_text
        The rule, as a SPARQL CONSTRUCT query.
    """

    __iri__: ClassVar[str] = _RT + "Rule"

    rule_text: Many[str] = Many(_RT + "ruleText", _XSD + "string")


class ScoreCalibration(InformationEntity):
    """The map from a planner's score to the chance that a grasp of one robot's hand holds:
    logistic(offset + slope logit(score)), grown from that robot's outcomes.

    ``rt:ScoreCalibration``

    Attributes
    ----------
    calibrated_score
        The kind of score that is mapped, as rt:qualityKind names it.
    calibrates_hand
        The end effector whose outcomes made the map.
    calibration_offset
        The offset of the map, in logits. [UNITLESS]
    calibration_slope
        The slope of the map; never negative. [UNITLESS]
    offset_slope_covariance
        The covariance of offset and slope. [UNITLESS]
    offset_variance
        The variance of the offset. [UNITLESS]
    outcome_count
        The number of outcomes from which the map grew. [NUM]
    slope_variance
        The variance of the slope. [UNITLESS]
    """

    __iri__: ClassVar[str] = _RT + "ScoreCalibration"
    __required__: ClassVar[tuple[str, ...]] = ("calibrated_score", "calibrates_hand", "calibration_offset", "calibration_slope", "offset_slope_covariance", "offset_variance", "outcome_count", "slope_variance",)

    calibrated_score: One[str] = One(_RT + "calibratedScore", _XSD + "string", functional=True)
    calibrates_hand: Link[EndEffector] = Link(_RT + "calibratesHand", _RT + "EndEffector", functional=True)
    calibration_offset: One[float] = One(_RT + "calibrationOffset", _XSD + "double", functional=True, unit="UNITLESS")
    calibration_slope: One[float] = One(_RT + "calibrationSlope", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0))
    offset_slope_covariance: One[float] = One(_RT + "offsetSlopeCovariance", _XSD + "double", functional=True, unit="UNITLESS")
    offset_variance: One[float] = One(_RT + "offsetVariance", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(above=0.0))
    outcome_count: One[int] = One(_RT + "outcomeCount", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    slope_variance: One[float] = One(_RT + "slopeVariance", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(above=0.0))


class Service(InformationEntity):
    """A collection of methods at one address (Kehoe 2014, 5.5).

    ``rt:Service``

    Attributes
    ----------
    has_method
        A method of the service.
    requires_resource
        A slot that must be filled.
    """

    __iri__: ClassVar[str] = _RT + "Service"
    __required__: ClassVar[tuple[str, ...]] = ("qualified_name", "version",)

    has_method: Links[ServiceMethod] = Links(_RT + "hasMethod", _RT + "ServiceMethod", inverse=_RT + "methodOf")
    requires_resource: Links[DataResource] = Links(_RT + "requiresResource", _RT + "DataResource")


class ServiceCall(Process, Activity):
    """One call of a method.

    ``rt:ServiceCall``

    Attributes
    ----------
    call_succeeded
        Whether the call returned without an error.
    called_method
        The method that was called.
    executor_kind
        "inline", "threads", "processes" or "ray".
    has_binding
        A slot as filled for this call.
    worker_id
        The agent that ran the call.
    """

    __iri__: ClassVar[str] = _RT + "ServiceCall"
    __required__: ClassVar[tuple[str, ...]] = ("called_method",)

    call_succeeded: One[bool] = One(_RT + "callSucceeded", _XSD + "boolean", functional=True)
    called_method: Link[ServiceMethod] = Link(_RT + "calledMethod", _RT + "ServiceMethod", functional=True)
    executor_kind: One[str] = One(_RT + "executorKind", _XSD + "string", functional=True)
    has_binding: Links[ResourceBinding] = Links(_RT + "hasBinding", _RT + "ResourceBinding")
    worker_id: One[str] = One(_RT + "workerId", _XSD + "string", functional=True)


class ServiceMethod(InformationEntity):
    """A function of a service with typed inputs and outputs.

    ``rt:ServiceMethod``

    Attributes
    ----------
    has_input
        An input of the method.
    has_output
        An output of the method.
    is_idempotent
        Whether a call may be repeated without harm.
    method_name
        The name of the method.
    method_of
        The service to which the method belongs.
    """

    __iri__: ClassVar[str] = _RT + "ServiceMethod"
    __required__: ClassVar[tuple[str, ...]] = ("method_name", "method_of",)

    has_input: Links[MethodParameter] = Links(_RT + "hasInput", _RT + "MethodParameter")
    has_output: Links[MethodParameter] = Links(_RT + "hasOutput", _RT + "MethodParameter")
    is_idempotent: One[bool] = One(_RT + "isIdempotent", _XSD + "boolean", functional=True)
    method_name: One[str] = One(_RT + "methodName", _XSD + "string", functional=True)
    method_of: Link[Service] = Link(_RT + "methodOf", _RT + "Service", functional=True, inverse=_RT + "hasMethod", stored=False)


class Shut(Object):
    """A place that nothing can be taken from or put into now, as its door or lid is closed. Whoever
    opens it withdraws the statement.

    ``rt:Shut``
    """

    __iri__: ClassVar[str] = _RT + "Shut"


class StateProjection(InformationEntity):
    """The principal components that turn descriptors into states.

    ``rt:StateProjection``

    Attributes
    ----------
    explained_variance
        The share of the variance that is kept. [UNITLESS]
    input_dimension
        The number of dimensions before the projection. [NUM]
    output_dimension
        The number of dimensions after the projection; 5 in Gatto 2016, 3.3.4. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "StateProjection"
    __required__: ClassVar[tuple[str, ...]] = ("output_dimension",)

    explained_variance: One[float] = One(_RT + "explainedVariance", _XSD + "double", functional=True, unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    input_dimension: One[int] = One(_RT + "inputDimension", _XSD + "positiveInteger", functional=True, unit="NUM", limits=Limits(least=1.0))
    output_dimension: One[int] = One(_RT + "outputDimension", _XSD + "positiveInteger", functional=True, unit="NUM", limits=Limits(least=1.0))


class Symmetry(InformationEntity):
    """A rotation that leaves the object as it was.

    ``rt:Symmetry``

    Attributes
    ----------
    symmetry_axis
        The axis of the rotation, through the origin of the body frame.
    symmetry_order
        The number of equal positions in one turn; 0 for continuous. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "Symmetry"
    __required__: ClassVar[tuple[str, ...]] = ("symmetry_axis", "symmetry_order",)

    symmetry_axis: Link[Direction] = Link(_RT + "symmetryAxis", _RT + "Direction", functional=True)
    symmetry_order: One[int] = One(_RT + "symmetryOrder", _XSD + "nonNegativeInteger", functional=True, unit="NUM", limits=Limits(least=0.0))


class View(InformationEntity):
    """One registration of an object from one side; one is enough to store the object (Gatto 2016,
    3.2.2).

    ``rt:View``

    Attributes
    ----------
    view_content
        A part of the view: image crop, cloud, descriptors.
    view_of
        The object that the view shows.
    viewpoint
        The pose object_from_camera at capture.
    """

    __iri__: ClassVar[str] = _RT + "View"
    __required__: ClassVar[tuple[str, ...]] = ("view_content", "view_of",)

    view_content: Links[VisualFeature] = Links(_RT + "viewContent", _RT + "VisualFeature")
    view_of: Link[ManipulableObject] = Link(_RT + "viewOf", _RT + "ManipulableObject", inverse=_RT + "hasView", stored=False)
    viewpoint: Links[Pose] = Links(_RT + "viewpoint", _RT + "Pose")


class VisualFeature(InformationEntity):
    """Something recorded or computed from an object's appearance or shape.

    ``rt:VisualFeature``

    Attributes
    ----------
    acquired_by
        The sensor from which the feature came.
    feature_of
        The object to which the feature belongs.
    """

    __iri__: ClassVar[str] = _RT + "VisualFeature"

    acquired_by: Link[RobotSensor] = Link(_RT + "acquiredBy", _RT + "RobotSensor", functional=True)
    feature_of: Links[ManipulableObject] = Links(_RT + "featureOf", _RT + "ManipulableObject", inverse=_RT + "hasFeature", stored=False)


class WriteActivity(Process, Activity):
    """One committed transaction.

    ``rt:WriteActivity``

    Attributes
    ----------
    changed_graph
        A graph that the commit changed.
    """

    __iri__: ClassVar[str] = _RT + "WriteActivity"
    __required__: ClassVar[tuple[str, ...]] = ("commit_number", "ended_at_time",)

    changed_graph: Links[NamedGraph] = Links(_RT + "changedGraph", _RT + "NamedGraph")


class RoboticEnvironment(PhysicalEnvironment):
    """A place that is equipped with a robotic system.

    ``cora:RoboticEnvironment``

    Attributes
    ----------
    equipped_with
        The place has the system.
    """

    __iri__: ClassVar[str] = _CORA + "RoboticEnvironment"

    equipped_with: Links[RoboticSystem] = Links(_CORA + "equippedWith", _CORA + "RoboticSystem")


class RobotMotion(Motion):
    """Motion of a robot or of its parts.

    ``corax:RobotMotion``
    """

    __iri__: ClassVar[str] = _CORAX + "RobotMotion"


class OrientationMeasure(PhysicalQuantity):
    """How something is turned.

    ``pos:OrientationMeasure``

    Attributes
    ----------
    in_opr
        The range within which an orientation lies.
    """

    __iri__: ClassVar[str] = _POS + "OrientationMeasure"

    in_opr: Links[OrientationRegion] = Links(_POS + "inOPR", _POS + "OrientationRegion")


class PoseMeasure(PhysicalQuantity):
    """Position and orientation together.

    ``pos:PoseMeasure``

    Attributes
    ----------
    pose_orientation
        The orientation of a pose.
    pose_position
        The position of a pose.
    """

    __iri__: ClassVar[str] = _POS + "PoseMeasure"

    pose_orientation: Links[OrientationMeasure] = Links(_POS + "poseOrientation", _POS + "OrientationMeasure")
    pose_position: Link[PositionMeasure] = Link(_POS + "posePosition", _POS + "PositionMeasure", functional=True)


class PositionMeasure(PhysicalQuantity):
    """Where something is.

    ``pos:PositionMeasure``

    Attributes
    ----------
    in_pcs
        The frame in which a position holds.
    in_pr
        The region within which a position lies.
    """

    __iri__: ClassVar[str] = _POS + "PositionMeasure"

    in_pcs: Link[PositionCoordinateSystem] = Link(_POS + "inPCS", _POS + "PositionCoordinateSystem", functional=True)
    in_pr: Links[PositionRegion] = Links(_POS + "inPR", _POS + "PositionRegion")


class ConstantQuantity(PhysicalQuantity):
    """A quantity that stays as it is.

    ``sumo:ConstantQuantity``
    """

    __iri__: ClassVar[str] = _SUMO + "ConstantQuantity"


class CorpuscularObject(SelfConnectedObject):
    """An object in one piece with parts of its own.

    ``sumo:CorpuscularObject``
    """

    __iri__: ClassVar[str] = _SUMO + "CorpuscularObject"


class Creation(InternalChange):
    """Bringing something into being.

    ``sumo:Creation``
    """

    __iri__: ClassVar[str] = _SUMO + "Creation"


class Function(SingleValuedRelation):
    """A relation that gives one value. Not used here.

    ``sumo:Function``
    """

    __iri__: ClassVar[str] = _SUMO + "Function"


class Group(Collection, Agent):
    """A collection of agents.

    ``sumo:Group``
    """

    __iri__: ClassVar[str] = _SUMO + "Group"


class QuaternaryPredicate(QuaternaryRelation, Predicate):
    """A predicate of four arguments. Not used here.

    ``sumo:QuaternaryPredicate``
    """

    __iri__: ClassVar[str] = _SUMO + "QuaternaryPredicate"


class SentientAgent(Agent):
    """An agent that perceives.

    ``sumo:SentientAgent``
    """

    __iri__: ClassVar[str] = _SUMO + "SentientAgent"


class TernaryPredicate(TernaryRelation, Predicate):
    """A predicate of three arguments. Not used here.

    ``sumo:TernaryPredicate``
    """

    __iri__: ClassVar[str] = _SUMO + "TernaryPredicate"


class AgentGraph(NamedGraph):
    """The graph of what one robot or one person asserts.

    ``rt:AgentGraph``
    """

    __iri__: ClassVar[str] = _RT + "AgentGraph"
    __required__: ClassVar[tuple[str, ...]] = ("graph_owner",)


class ClosureMode(CodedValue):
    """A way in which force closure comes about (Kehoe 2014, 3.4).

    ``rt:ClosureMode``
    """

    __iri__: ClassVar[str] = _RT + "ClosureMode"


class Colour(CodedValue):
    """A colour as people name it.

    ``rt:Colour``
    """

    __iri__: ClassVar[str] = _RT + "Colour"


class Demonstration(Action):
    """A person shows an object or a grasp.

    ``rt:Demonstration``
    """

    __iri__: ClassVar[str] = _RT + "Demonstration"


class DescriptorSet(VisualFeature):
    """A matrix of descriptors, one row each.

    ``rt:DescriptorSet``

    Attributes
    ----------
    descriptor_count
        The number of rows. [NUM]
    descriptor_length
        The number of columns. [NUM]
    element_type
        The type of an element: "uint8", "float32".
    """

    __iri__: ClassVar[str] = _RT + "DescriptorSet"
    __required__: ClassVar[tuple[str, ...]] = ("has_blob",)

    descriptor_count: One[int] = One(_RT + "descriptorCount", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    descriptor_length: One[int] = One(_RT + "descriptorLength", _XSD + "positiveInteger", functional=True, unit="NUM")
    element_type: One[str] = One(_RT + "elementType", _XSD + "string", functional=True)


class FailedOutcome(Outcome):
    """An outcome judged a failure.

    ``rt:FailedOutcome``
    """

    __iri__: ClassVar[str] = _RT + "FailedOutcome"


class FramedMeasure(PhysicalQuantity):
    """A measure whose numbers only mean something in a frame.

    ``rt:FramedMeasure``

    Attributes
    ----------
    in_frame
        The frame in which the numbers hold.
    """

    __iri__: ClassVar[str] = _RT + "FramedMeasure"

    in_frame: Link[Frame] = Link(_RT + "inFrame", _RT + "Frame", functional=True)


class GraspCandidate(GraspConfiguration):
    """A grasp that a generator proposed.

    ``rt:GraspCandidate``
    """

    __iri__: ClassVar[str] = _RT + "GraspCandidate"


class GraspOutcome(Outcome):
    """The result of a grasp attempt.

    ``rt:GraspOutcome``

    Attributes
    ----------
    place_reason
        The reason why an object that was held did not reach its destination.
    placed
        Whether the object reached its destination.
    """

    __iri__: ClassVar[str] = _RT + "GraspOutcome"

    place_reason: Link[OutcomeReason] = Link(_RT + "placeReason", _RT + "OutcomeReason", functional=True, limits=Limits(one_of=(_RT + "reason_approach_collision", _RT + "reason_approach_ik", _RT + "reason_came_apart", _RT + "reason_crushed", _RT + "reason_drop_outside", _RT + "reason_grasp_collision", _RT + "reason_hardware", _RT + "reason_ik", _RT + "reason_lift_ik", _RT + "reason_low_grasp", _RT + "reason_low_pose", _RT + "reason_low_recognition", _RT + "reason_missed", _RT + "reason_no_grasp", _RT + "reason_no_match", _RT + "reason_not_judged", _RT + "reason_ok", _RT + "reason_place_plan", _RT + "reason_pose_unknown", _RT + "reason_pregrasp_collision", _RT + "reason_pushed_away", _RT + "reason_rrt_goal", _RT + "reason_rrt_start", _RT + "reason_rrt_time", _RT + "reason_slip_hold", _RT + "reason_slip_lift", _RT + "reason_slip_transport", _RT + "reason_stopped_by_human", _RT + "reason_tilt", _RT + "reason_timed_out", _RT + "reason_too_heavy", _RT + "reason_too_wide", _RT + "reason_touched", _RT + "reason_tracking", _RT + "reason_wrong_object",)))
    placed: One[bool] = One(_RT + "placed", _XSD + "boolean", functional=True)


class GraspZone(HiddenCause):
    """A part at one end of an object that gives way where a finger touches it.

    ``rt:GraspZone``

    Attributes
    ----------
    zone_end
        The end of the zone along x of the body frame. [M]
    zone_kind
        In which way the zone gives way; not stated if the reasons do not tell.
    zone_start
        The beginning of the zone along x of the body frame. [M]
    """

    __iri__: ClassVar[str] = _RT + "GraspZone"
    __required__: ClassVar[tuple[str, ...]] = ("zone_end", "zone_start",)

    zone_end: One[float] = One(_RT + "zoneEnd", _XSD + "double", functional=True, unit="M")
    zone_kind: Link[ZoneKind] = Link(_RT + "zoneKind", _RT + "ZoneKind", functional=True, limits=Limits(one_of=(_RT + "zone_comes_off", _RT + "zone_fragile", _RT + "zone_slippery",)))
    zone_start: One[float] = One(_RT + "zoneStart", _XSD + "double", functional=True, unit="M")


class HumanFeedback(Feedback):
    """Evidence from a person; it wins over physics.

    ``rt:HumanFeedback``

    Attributes
    ----------
    held_votes
        The number of people who say that it held, each by their latest verdict, when this
        feedback was given. [NUM]
    lost_votes
        The number of people who say that it did not hold, each by their latest verdict, when
        this feedback was given. [NUM]
    said_reason
        The reason for the outcome in the person's opinion; the executor's own reason stays on
        the outcome.
    """

    __iri__: ClassVar[str] = _RT + "HumanFeedback"
    __required__: ClassVar[tuple[str, ...]] = ("at_time", "verdict", "was_attributed_to",)

    held_votes: One[int] = One(_RT + "heldVotes", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    lost_votes: One[int] = One(_RT + "lostVotes", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    said_reason: Link[OutcomeReason] = Link(_RT + "saidReason", _RT + "OutcomeReason", functional=True, limits=Limits(one_of=(_RT + "reason_approach_collision", _RT + "reason_approach_ik", _RT + "reason_came_apart", _RT + "reason_crushed", _RT + "reason_drop_outside", _RT + "reason_grasp_collision", _RT + "reason_hardware", _RT + "reason_ik", _RT + "reason_lift_ik", _RT + "reason_low_grasp", _RT + "reason_low_pose", _RT + "reason_low_recognition", _RT + "reason_missed", _RT + "reason_no_grasp", _RT + "reason_no_match", _RT + "reason_not_judged", _RT + "reason_ok", _RT + "reason_place_plan", _RT + "reason_pose_unknown", _RT + "reason_pregrasp_collision", _RT + "reason_pushed_away", _RT + "reason_rrt_goal", _RT + "reason_rrt_start", _RT + "reason_rrt_time", _RT + "reason_slip_hold", _RT + "reason_slip_lift", _RT + "reason_slip_transport", _RT + "reason_stopped_by_human", _RT + "reason_tilt", _RT + "reason_timed_out", _RT + "reason_too_heavy", _RT + "reason_too_wide", _RT + "reason_touched", _RT + "reason_tracking", _RT + "reason_wrong_object",)))


class Image2D(VisualFeature):
    """A picture.

    ``rt:Image2D``

    Attributes
    ----------
    encoding
        The encoding of the pixels: "rgb8", "16UC1".
    height_px
        The number of rows. [NUM]
    width_px
        The number of columns. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "Image2D"
    __required__: ClassVar[tuple[str, ...]] = ("has_blob",)

    encoding: One[str] = One(_RT + "encoding", _XSD + "string", functional=True)
    height_px: One[int] = One(_RT + "heightPx", _XSD + "positiveInteger", functional=True, unit="NUM")
    width_px: One[int] = One(_RT + "widthPx", _XSD + "positiveInteger", functional=True, unit="NUM")


class ImportGraph(NamedGraph):
    """A graph of data taken over from elsewhere.

    ``rt:ImportGraph``
    """

    __iri__: ClassVar[str] = _RT + "ImportGraph"


class InferredGraph(NamedGraph):
    """The graph of what the closure derives.

    ``rt:InferredGraph``
    """

    __iri__: ClassVar[str] = _RT + "InferredGraph"


class LearningAction(CodedValue):
    """A choice open to a learner.

    ``rt:LearningAction``
    """

    __iri__: ClassVar[str] = _RT + "LearningAction"


class ManipulatingAction(Action):
    """An action on an object.

    ``rt:ManipulatingAction``
    """

    __iri__: ClassVar[str] = _RT + "ManipulatingAction"


class MassOffCentre(HiddenCause):
    """The centre of mass is away from the middle, so that what is held far from it turns or slips.

    ``rt:MassOffCentre``

    Attributes
    ----------
    centre_along_x
        The expected place of the centre of mass along x of the body frame;
        rt:centreOfMassSigma is its standard deviation. [M]
    """

    __iri__: ClassVar[str] = _RT + "MassOffCentre"
    __required__: ClassVar[tuple[str, ...]] = ("centre_along_x", "centre_of_mass_sigma",)

    centre_along_x: One[float] = One(_RT + "centreAlongX", _XSD + "double", functional=True, unit="M")


class MetaGraph(NamedGraph):
    """The catalogue of all graphs.

    ``rt:MetaGraph``
    """

    __iri__: ClassVar[str] = _RT + "MetaGraph"


class ObjectFunction(CodedValue):
    """A purpose that an object serves.

    ``rt:ObjectFunction``
    """

    __iri__: ClassVar[str] = _RT + "ObjectFunction"


class ObjectTrait(CodedValue):
    """What to mind when an object is handled, such as that it is fragile.

    ``rt:ObjectTrait``
    """

    __iri__: ClassVar[str] = _RT + "ObjectTrait"


class OntologyGraph(NamedGraph):
    """The graph of one loaded ontology.

    ``rt:OntologyGraph``
    """

    __iri__: ClassVar[str] = _RT + "OntologyGraph"


class OutcomeReason(CodedValue):
    """A reason why an action ended as it did; the executor's code maps to the IRI reason_<code>.

    ``rt:OutcomeReason``

    Attributes
    ----------
    code
        The code as the executor reports it.
    """

    __iri__: ClassVar[str] = _RT + "OutcomeReason"

    code: One[str] = One(_RT + "code", _XSD + "string", functional=True)


class PhysicsFeedback(Feedback):
    """Evidence from jaws, contact forces and the height of the lift.

    ``rt:PhysicsFeedback``

    Attributes
    ----------
    contact_force
        The normal force at the jaws. [N]
    hold_time
        The time for which the object was held. [SEC]
    jaw_gap
        The gap between the jaws after closing. [M]
    lift_height
        The height that the object reached. [M]
    links_touching
        The number of links of the hand in contact. [NUM]
    place_offset
        The horizontal distance between the target and where the object was put down. [M]
    preset
        The physics behind the evidence: "faithful", "fast", "real".
    slip_distance
        The distance by which the object slipped in the hand. [M]
    """

    __iri__: ClassVar[str] = _RT + "PhysicsFeedback"
    __required__: ClassVar[tuple[str, ...]] = ("verdict",)

    contact_force: One[float] = One(_RT + "contactForce", _XSD + "double", functional=True, unit="N")
    hold_time: One[float] = One(_RT + "holdTime", _XSD + "double", functional=True, unit="SEC", limits=Limits(least=0.0))
    jaw_gap: One[float] = One(_RT + "jawGap", _XSD + "double", functional=True, unit="M")
    lift_height: One[float] = One(_RT + "liftHeight", _XSD + "double", functional=True, unit="M")
    links_touching: One[int] = One(_RT + "linksTouching", _XSD + "nonNegativeInteger", functional=True, unit="NUM", limits=Limits(least=0.0))
    place_offset: One[float] = One(_RT + "placeOffset", _XSD + "double", functional=True, unit="M")
    preset: One[str] = One(_RT + "preset", _XSD + "string", functional=True)
    slip_distance: One[float] = One(_RT + "slipDistance", _XSD + "double", functional=True, unit="M")


class PlanarGrasp(GraspConfiguration):
    """A grasp from above, given by X, Y and theta.

    ``rt:PlanarGrasp``
    """

    __iri__: ClassVar[str] = _RT + "PlanarGrasp"


class PointCloud(VisualFeature):
    """A set of points in space, with or without colour.

    ``rt:PointCloud``

    Attributes
    ----------
    codec
        The name and version of the coder.
    point_count
        The number of points. [NUM]
    voxel_size
        The edge of a voxel after coding. [M]
    """

    __iri__: ClassVar[str] = _RT + "PointCloud"
    __required__: ClassVar[tuple[str, ...]] = ("has_blob",)

    codec: One[str] = One(_RT + "codec", _XSD + "string", functional=True)
    point_count: One[int] = One(_RT + "pointCount", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    voxel_size: One[float] = One(_RT + "voxelSize", _XSD + "double", functional=True, unit="M")


class ProvenGrasp(GraspConfiguration):
    """A grasp that has succeeded at least once.

    ``rt:ProvenGrasp``
    """

    __iri__: ClassVar[str] = _RT + "ProvenGrasp"


class ProvenanceGraph(NamedGraph):
    """The graph of commit activities.

    ``rt:ProvenanceGraph``
    """

    __iri__: ClassVar[str] = _RT + "ProvenanceGraph"


class QuarantineGraph(NamedGraph):
    """A graph of statements that were set aside because they contradict what is known or violate a
    shape; no input of the closure.

    ``rt:QuarantineGraph``

    Attributes
    ----------
    quarantine_reason
        The finding: the contradiction or the violated shape.
    quarantined_from
        The graph for which the statements were meant.
    """

    __iri__: ClassVar[str] = _RT + "QuarantineGraph"
    __required__: ClassVar[tuple[str, ...]] = ("quarantine_reason", "quarantined_from",)

    quarantine_reason: Many[str] = Many(_RT + "quarantineReason", _XSD + "string")
    quarantined_from: Links[NamedGraph] = Links(_RT + "quarantinedFrom", _RT + "NamedGraph")


class Retraction(WriteActivity):
    """A commit that withdraws statements because they were wrong, not because the world changed.

    ``rt:Retraction``

    Attributes
    ----------
    retraction_reason
        The reason why the statements were wrong, in words.
    """

    __iri__: ClassVar[str] = _RT + "Retraction"
    __required__: ClassVar[tuple[str, ...]] = ("retraction_reason",)

    retraction_reason: Many[str] = Many(_RT + "retractionReason", _XSD + "string")


class RobotAction(Action):
    """An action of a robot; it realises the motion that a task asks for (Gatto 2016, 3.2.3).

    ``rt:RobotAction``
    """

    __iri__: ClassVar[str] = _RT + "RobotAction"


class RuleBaseGraph(NamedGraph):
    """The graph of the users' rules: who may write it adds rules to the reasoner.

    ``rt:RuleBaseGraph``
    """

    __iri__: ClassVar[str] = _RT + "RuleBaseGraph"


class RuleGraph(NamedGraph):
    """A graph of what scheduled SPARQL rules derive.

    ``rt:RuleGraph``
    """

    __iri__: ClassVar[str] = _RT + "RuleGraph"


class ShapeModel(VisualFeature):
    """A geometric model of an object or of a part of it.

    ``rt:ShapeModel``

    Attributes
    ----------
    control_point_count
        The number of control points of the B-spline. [NUM]
    degree
        The degree of the B-spline. [NUM]
    face_count
        The number of faces of a mesh. [NUM]
    knot_count
        The number of knots of the B-spline. [NUM]
    median_residual
        The median distance of the measured points from the surface that was fitted to them.
        [M]
    residual90
        The distance from the fitted surface within which 90 % of the measured points lie. [M]
    rms_residual
        The root mean square distance between the model and the points it was fitted to. [M]
    vertex_count
        The number of vertices of a mesh or polygon. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "ShapeModel"

    control_point_count: One[int] = One(_RT + "controlPointCount", _XSD + "positiveInteger", functional=True, unit="NUM")
    degree: One[int] = One(_RT + "degree", _XSD + "positiveInteger", functional=True, unit="NUM")
    face_count: One[int] = One(_RT + "faceCount", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    knot_count: One[int] = One(_RT + "knotCount", _XSD + "positiveInteger", functional=True, unit="NUM")
    median_residual: One[float] = One(_RT + "medianResidual", _XSD + "double", functional=True, unit="M")
    residual90: One[float] = One(_RT + "residual90", _XSD + "double", functional=True, unit="M")
    rms_residual: One[float] = One(_RT + "rmsResidual", _XSD + "double", functional=True, unit="M")
    vertex_count: One[int] = One(_RT + "vertexCount", _XSD + "nonNegativeInteger", functional=True, unit="NUM")


class SharedGraph(NamedGraph):
    """The graph of objects taught for everybody.

    ``rt:SharedGraph``
    """

    __iri__: ClassVar[str] = _RT + "SharedGraph"


class SpatialGrasp(GraspConfiguration):
    """A grasp with a full pose of six degrees of freedom.

    ``rt:SpatialGrasp``
    """

    __iri__: ClassVar[str] = _RT + "SpatialGrasp"


class SuccessfulOutcome(Outcome):
    """An outcome judged a success.

    ``rt:SuccessfulOutcome``
    """

    __iri__: ClassVar[str] = _RT + "SuccessfulOutcome"


class Task(IntentionalProcess):
    """Something to be achieved, assigned to an agent (Gatto 2016, 3.2.3).

    ``rt:Task``

    Attributes
    ----------
    assigned_to
        The agent who shall do the task; several agents may share one.
    assignment_reason
        Why the task is assigned to whom it is now, where that is no longer as planned, in
        words.
    carried_out_by
        An action that was done for the task.
    engages
        The end effector that a task uses, through its action.
    has_sub_task
        A part of the task, at any depth.
    has_time_window
        The time at which the task should be done.
    parameter_values
        A JSON object with the IRI of each parameter of the class of a planned task, by its
        name.
    planned_chance
        The chance of success that the plan expects of the task, in [0, 1]. [UNITLESS]
    planned_duration
        How long the plan expects the task to take. [SEC]
    precedes
        This task must end before the other begins.
    requires_capability
        A capability that the doer must have.
    requires_motion
        A motion that fulfils the task (Gatto 2016, 3.2.3).
    step_number
        The place of the task in its plan, from 1. [NUM]
    sub_task_of
        The task of which this one is a part, at any depth.
    taken_from
        The task was assigned to this agent before another one, which had nothing to do, took
        it over.
    task_name
        The name of the task in messages: "pick", "place".
    waits_for
        The task cannot begin before the other has ended, because that makes true what it
        needs, or needs what it changes.
    waits_for_hand
        The task waits for the other only because the same end effector does both; done by
        another one, it need not wait. What a task waits for without this statement, it waits
        for whoever does it, such as for the order that a goal asks for, or for the thing to
        be there.
    """

    __iri__: ClassVar[str] = _RT + "Task"
    __required__: ClassVar[tuple[str, ...]] = ("assigned_to",)

    assigned_to: Links[Agent] = Links(_RT + "assignedTo", _SUMO + "Agent", inverse=_RT + "hasAssignment")
    assignment_reason: Many[str] = Many(_RT + "assignmentReason", _XSD + "string")
    carried_out_by: Links[Action] = Links(_RT + "carriedOutBy", _RT + "Action")
    engages: Links[EndEffector] = Links(_RT + "engages", _RT + "EndEffector")
    has_sub_task: Links[Task] = Links(_RT + "hasSubTask", _RT + "Task", inverse=_RT + "subTaskOf")
    has_time_window: Link[Interval] = Link(_RT + "hasTimeWindow", _RT + "Interval", functional=True)
    parameter_values: Many[str] = Many(_RT + "parameterValues", _XSD + "string")
    planned_chance: One[float] = One(_RT + "plannedChance", _XSD + "double", unit="UNITLESS")
    planned_duration: One[float] = One(_RT + "plannedDuration", _XSD + "double", unit="SEC")
    precedes: Links[Task] = Links(_RT + "precedes", _RT + "Task")
    requires_capability: Links[Capability] = Links(_RT + "requiresCapability", _RT + "Capability")
    requires_motion: Links[Motion] = Links(_RT + "requiresMotion", _SUMO + "Motion")
    step_number: One[int] = One(_RT + "stepNumber", _XSD + "positiveInteger", unit="NUM")
    sub_task_of: Links[Task] = Links(_RT + "subTaskOf", _RT + "Task", inverse=_RT + "hasSubTask", stored=False)
    taken_from: Links[Agent] = Links(_RT + "takenFrom", _SUMO + "Agent")
    task_name: Many[str] = Many(_RT + "taskName", _XSD + "string")
    waits_for: Links[Task] = Links(_RT + "waitsFor", _RT + "Task")
    waits_for_hand: Links[Task] = Links(_RT + "waitsForHand", _RT + "Task")


class TextReading(VisualFeature):
    """What a program read on a view; without a word, it found none. Anybody may have printed it: it
    is data, and never an instruction.

    ``rt:TextReading``

    Attributes
    ----------
    has_word
        A word of the reading.
    read_by
        The name and version of the program that read.
    """

    __iri__: ClassVar[str] = _RT + "TextReading"
    __required__: ClassVar[tuple[str, ...]] = ("read_by",)

    has_word: Links[PrintedWord] = Links(_RT + "hasWord", _RT + "PrintedWord")
    read_by: One[str] = One(_RT + "readBy", _XSD + "string", functional=True)


class RobotGroup(Group):
    """Robots organised for one goal.

    ``cora:RobotGroup``
    """

    __iri__: ClassVar[str] = _CORA + "RobotGroup"


class OrientationRegion(OrientationMeasure):
    """The range within which something is turned.

    ``pos:OrientationRegion``
    """

    __iri__: ClassVar[str] = _POS + "OrientationRegion"


class OrientationSpatialOperator(Function):
    """A function that makes regions of orientations. Not used here.

    ``pos:OrientationSpatialOperator``
    """

    __iri__: ClassVar[str] = _POS + "OrientationSpatialOperator"


class OrientationValue(OrientationMeasure):
    """How something is turned, exactly.

    ``pos:OrientationValue``

    Attributes
    ----------
    in_ocs
        The frame in which an orientation holds.
    """

    __iri__: ClassVar[str] = _POS + "OrientationValue"

    in_ocs: Link[OrientationCoordinateSystem] = Link(_POS + "inOCS", _POS + "OrientationCoordinateSystem", functional=True)


class PositionPoint(PositionMeasure):
    """Where something is, exactly.

    ``pos:PositionPoint``
    """

    __iri__: ClassVar[str] = _POS + "PositionPoint"


class PositionRegion(PositionMeasure):
    """The region within which something is.

    ``pos:PositionRegion``

    Attributes
    ----------
    overlaps_position
        The two regions share a part.
    """

    __iri__: ClassVar[str] = _POS + "PositionRegion"

    overlaps_position: Links[PositionRegion] = Links(_POS + "overlapsPosition", _POS + "PositionRegion")


class PositionSpatialOperator(Function):
    """A function that makes regions of positions. Not used here.

    ``pos:PositionSpatialOperator``
    """

    __iri__: ClassVar[str] = _POS + "PositionSpatialOperator"


class QuantitativePose(PoseMeasure):
    """A pose given by numbers.

    ``pos:QuantitativePose``
    """

    __iri__: ClassVar[str] = _POS + "QuantitativePose"


class Artifact(CorpuscularObject):
    """Something that was made.

    ``sumo:Artifact``
    """

    __iri__: ClassVar[str] = _SUMO + "Artifact"


class CognitiveAgent(SentientAgent):
    """An agent that reasons.

    ``sumo:CognitiveAgent``
    """

    __iri__: ClassVar[str] = _SUMO + "CognitiveAgent"


class Making(Creation, IntentionalProcess):
    """Bringing something into being on purpose.

    ``sumo:Making``
    """

    __iri__: ClassVar[str] = _SUMO + "Making"


class TimeMeasure(ConstantQuantity):
    """A quantity of time.

    ``sumo:TimeMeasure``
    """

    __iri__: ClassVar[str] = _SUMO + "TimeMeasure"


class UnaryFunction(Function):
    """A function of one argument. Not used here.

    ``sumo:UnaryFunction``
    """

    __iri__: ClassVar[str] = _SUMO + "UnaryFunction"


class AngleSector(LearningAction):
    """All candidates whose angle theta lies in a range (Gatto 2016, 3.3.4).

    ``rt:AngleSector``

    Attributes
    ----------
    lower_angle
        The lower end of the range, inclusive. [RAD]
    upper_angle
        The upper end of the range, exclusive. [RAD]
    """

    __iri__: ClassVar[str] = _RT + "AngleSector"
    __required__: ClassVar[tuple[str, ...]] = ("lower_angle", "upper_angle",)

    lower_angle: One[float] = One(_RT + "lowerAngle", _XSD + "double", functional=True, unit="RAD", limits=Limits(least=0.0))
    upper_angle: One[float] = One(_RT + "upperAngle", _XSD + "double", functional=True, unit="RAD")


class BSplineModel(ShapeModel):
    """A shape made of B-splines.

    ``rt:BSplineModel``
    """

    __iri__: ClassVar[str] = _RT + "BSplineModel"
    __required__: ClassVar[tuple[str, ...]] = ("control_point_count", "degree", "has_blob",)


class CloudImage(Image2D):
    """A point cloud rendered as a colour picture (Gatto 2016, 3.2.4).

    ``rt:CloudImage``
    """

    __iri__: ClassVar[str] = _RT + "CloudImage"


class ColorImage(Image2D):
    """A picture in colour.

    ``rt:ColorImage``
    """

    __iri__: ClassVar[str] = _RT + "ColorImage"


class CompressedPointCloud(PointCloud):
    """A point cloud coded for the wire.

    ``rt:CompressedPointCloud``
    """

    __iri__: ClassVar[str] = _RT + "CompressedPointCloud"


class DepthImage(Image2D):
    """A picture whose pixels are ranges.

    ``rt:DepthImage``
    """

    __iri__: ClassVar[str] = _RT + "DepthImage"


class Direction(FramedMeasure):
    """A unit vector in a frame.

    ``rt:Direction``

    Attributes
    ----------
    dir_x
        The first component of the unit vector. [UNITLESS]
    dir_y
        The second component of the unit vector. [UNITLESS]
    dir_z
        The third component of the unit vector. [UNITLESS]
    """

    __iri__: ClassVar[str] = _RT + "Direction"
    __required__: ClassVar[tuple[str, ...]] = ("dir_x", "dir_y", "dir_z",)

    dir_x: One[float] = One(_RT + "dirX", _XSD + "double", functional=True, unit="UNITLESS")
    dir_y: One[float] = One(_RT + "dirY", _XSD + "double", functional=True, unit="UNITLESS")
    dir_z: One[float] = One(_RT + "dirZ", _XSD + "double", functional=True, unit="UNITLESS")


class FPFHFeatureSet(DescriptorSet):
    """Fast point feature histograms, 33 numbers a point (Rusu et al. 2009).

    ``rt:FPFHFeatureSet``
    """

    __iri__: ClassVar[str] = _RT + "FPFHFeatureSet"


class HOGDescriptor(DescriptorSet):
    """A histogram of oriented gradients (Dalal and Triggs 2005).

    ``rt:HOGDescriptor``
    """

    __iri__: ClassVar[str] = _RT + "HOGDescriptor"


class HandleShape(ShapeModel):
    """The shape of a handle found on an object.

    ``rt:HandleShape``
    """

    __iri__: ClassVar[str] = _RT + "HandleShape"


class ManipulableObject(CorpuscularObject, FeatureOfInterest):
    """A known physical thing with an identifier, a name, a function, features and grasps: the Object
    of Gatto 2016, 3.2.2.

    ``rt:ManipulableObject``

    Attributes
    ----------
    centre_of_mass
        The centre of mass in the body frame.
    crushing_force
        The closing force of a hand beyond which the object is damaged. [N]
    exemplar_of
        Same make as a reference object, whose functions, features and grasps carry over.
    extent_x
        The size of the bounding box along x of the body frame. [M]
    extent_y
        The size of the bounding box along y of the body frame. [M]
    extent_z
        The size of the bounding box along z of the body frame. [M]
    grasp_width
        The width between the jaws while the object is held. [M]
    has_colour
        A colour of a large part of what the first view shows of the object, under the light
        of that view.
    has_feature
        A feature of the object.
    has_function
        A function of the object.
    has_grasp
        A way to take the object.
    has_hidden_cause
        A cause that the attempts at the object make likely.
    has_model
        A model of the object; of several, that with the most views counts.
    has_symmetry
        A rotation to divide out of pose errors and grasps.
    has_view
        A view of the object.
    known_by
        A robot whose own sensors saw the object.
    mass
        The mass of the object. [KiloGM]
    object_id
        "namespace/name", unique for ever; objects with the same one are the same.
    pose_estimated_in
        An estimate of the object's pose.
    roundness
        The closeness of the outline seen from above to a circle, in [0, 1]; 1 is a circle.
        [UNITLESS]
    similar_to
        Looks alike: a hint, never an identity.
    surface_material
        The material of the surface.
    """

    __iri__: ClassVar[str] = _RT + "ManipulableObject"
    __required__: ClassVar[tuple[str, ...]] = ("object_id",)

    centre_of_mass: Links[Position] = Links(_RT + "centreOfMass", _RT + "Position")
    crushing_force: One[float] = One(_RT + "crushingForce", _XSD + "double", unit="N")
    exemplar_of: Links[ManipulableObject] = Links(_RT + "exemplarOf", _RT + "ManipulableObject")
    extent_x: One[float] = One(_RT + "extentX", _XSD + "double", unit="M", limits=Limits(above=0.0))
    extent_y: One[float] = One(_RT + "extentY", _XSD + "double", unit="M", limits=Limits(above=0.0))
    extent_z: One[float] = One(_RT + "extentZ", _XSD + "double", unit="M", limits=Limits(above=0.0))
    grasp_width: One[float] = One(_RT + "graspWidth", _XSD + "double", unit="M", limits=Limits(above=0.0))
    has_colour: Links[Colour] = Links(_RT + "hasColour", _RT + "Colour", limits=Limits(one_of=(_RT + "colour_black", _RT + "colour_blue", _RT + "colour_brown", _RT + "colour_green", _RT + "colour_grey", _RT + "colour_orange", _RT + "colour_pink", _RT + "colour_purple", _RT + "colour_red", _RT + "colour_white", _RT + "colour_yellow",)))
    has_feature: Links[VisualFeature] = Links(_RT + "hasFeature", _RT + "VisualFeature", inverse=_RT + "featureOf")
    has_function: Links[ObjectFunction] = Links(_RT + "hasFunction", _RT + "ObjectFunction", limits=Limits(one_of=(_RT + "clean", _RT + "containLiquid", _RT + "containSolid", _RT + "cut", _RT + "drinkFrom", _RT + "eatWith", _RT + "fasten", _RT + "illuminate", _RT + "playWith", _RT + "write",)))
    has_grasp: Links[GraspConfiguration] = Links(_RT + "hasGrasp", _RT + "GraspConfiguration", inverse=_RT + "graspOf")
    has_hidden_cause: Links[HiddenCause] = Links(_RT + "hasHiddenCause", _RT + "HiddenCause", inverse=_RT + "hiddenCauseOf")
    has_model: Links[ObjectModel] = Links(_RT + "hasModel", _RT + "ObjectModel")
    has_symmetry: Links[Symmetry] = Links(_RT + "hasSymmetry", _RT + "Symmetry")
    has_view: Links[View] = Links(_RT + "hasView", _RT + "View", inverse=_RT + "viewOf")
    known_by: Links[Robot] = Links(_RT + "knownBy", _CORA + "Robot")
    mass: One[float] = One(_RT + "mass", _XSD + "double", unit="KiloGM", limits=Limits(above=0.0))
    object_id: One[str] = One(_RT + "objectId", _XSD + "string", functional=True, limits=Limits(pattern='^[A-Za-z0-9][A-Za-z0-9._-]{0,63}/[A-Za-z0-9][A-Za-z0-9._-]{0,63}$'))
    pose_estimated_in: Links[PoseEstimate] = Links(_RT + "poseEstimatedIn", _RT + "PoseEstimate", inverse=_RT + "poseOf", stored=False)
    roundness: One[float] = One(_RT + "roundness", _XSD + "double", unit="UNITLESS", limits=Limits(least=0.0, most=1.0))
    similar_to: Links[ManipulableObject] = Links(_RT + "similarTo", _RT + "ManipulableObject")
    surface_material: Many[str] = Many(_RT + "surfaceMaterial", _XSD + "string")


class Manipulation(Task):
    """A task that handles an object.

    ``rt:Manipulation``

    Attributes
    ----------
    handles
        The object that the task handles.
    target_pose
        The pose that is to be reached.
    target_surface
        The place where the object is to be put.
    through
        The manipulating action of a manipulation task (Gatto 2016, figure 16).
    """

    __iri__: ClassVar[str] = _RT + "Manipulation"

    handles: Links[ManipulableObject] = Links(_RT + "handles", _RT + "ManipulableObject")
    target_pose: Links[FramedMeasure] = Links(_RT + "targetPose", _RT + "FramedMeasure")
    target_surface: Links[Object] = Links(_RT + "targetSurface", _SUMO + "Object")
    through: Links[ManipulatingAction] = Links(_RT + "through", _RT + "ManipulatingAction")


class Navigation(Task):
    """The task of moving the whole robot.

    ``rt:Navigation``
    """

    __iri__: ClassVar[str] = _RT + "Navigation"


class ObjectModel(PointCloud):
    """The surface of an object in its body frame, grown from registered views: places, outward
    normals, colours (Kehoe 2014, 4.3).

    ``rt:ObjectModel``

    Attributes
    ----------
    built_from
        A view whose points are in the model.
    """

    __iri__: ClassVar[str] = _RT + "ObjectModel"

    built_from: Links[View] = Links(_RT + "builtFrom", _RT + "View")


class Perception(Task):
    """The task of finding out what is there.

    ``rt:Perception``
    """

    __iri__: ClassVar[str] = _RT + "Perception"


class PolygonModel(ShapeModel):
    """A planar outline with a tolerance for its vertices (Kehoe 2014, 3.3).

    ``rt:PolygonModel``
    """

    __iri__: ClassVar[str] = _RT + "PolygonModel"


class PushGrasp(PlanarGrasp):
    """A planar grasp that pushes until the object is aligned, then closes (Kehoe 2014, 3.3).

    ``rt:PushGrasp``
    """

    __iri__: ClassVar[str] = _RT + "PushGrasp"


class ReferencePointSet(PointCloud):
    """A scan of the whole object in a stable pose (Kehoe 2014, 4.3, Theta).

    ``rt:ReferencePointSet``
    """

    __iri__: ClassVar[str] = _RT + "ReferencePointSet"


class RobotManipulationAction(RobotAction, ManipulatingAction):
    """A robot's action on an object, with one of its end effectors.

    ``rt:RobotManipulationAction``

    Attributes
    ----------
    activates
        The end effector used by the action.
    """

    __iri__: ClassVar[str] = _RT + "RobotManipulationAction"

    activates: Links[EndEffector] = Links(_RT + "activates", _RT + "EndEffector")


class Rotated(FramedMeasure):
    """A framed measure that carries a unit quaternion in the order x, y, z, w.

    ``rt:Rotated``

    Attributes
    ----------
    qw
        The scalar component of the unit quaternion, last in the order. [UNITLESS]
    qx
        The first component of the unit quaternion. [UNITLESS]
    qy
        The second component of the unit quaternion. [UNITLESS]
    qz
        The third component of the unit quaternion. [UNITLESS]
    """

    __iri__: ClassVar[str] = _RT + "Rotated"

    qw: One[float] = One(_RT + "qw", _XSD + "double", functional=True, unit="UNITLESS")
    qx: One[float] = One(_RT + "qx", _XSD + "double", functional=True, unit="UNITLESS")
    qy: One[float] = One(_RT + "qy", _XSD + "double", functional=True, unit="UNITLESS")
    qz: One[float] = One(_RT + "qz", _XSD + "double", functional=True, unit="UNITLESS")


class SIFTFeatureSet(DescriptorSet):
    """SIFT keypoints and descriptors (Lowe 2004).

    ``rt:SIFTFeatureSet``
    """

    __iri__: ClassVar[str] = _RT + "SIFTFeatureSet"


class SuctionGrasp(SpatialGrasp):
    """A grasp by the lip of a suction cup: one contact, at which it seals. The pose has its origin
    in the middle of the lip and approaches against the normal.

    ``rt:SuctionGrasp``
    """

    __iri__: ClassVar[str] = _RT + "SuctionGrasp"
    __required__: ClassVar[tuple[str, ...]] = ("has_contact",)


class SupportSurface(CorpuscularObject):
    """Something on which objects stand, such as a table.

    ``rt:SupportSurface``

    Attributes
    ----------
    rim_height
        The height of the walls around the surface; none or 0 for a table. [M]
    surface_length
        The size along x of the body frame, whose origin is the middle of the surface on which
        things stand and whose z axis points up; for a box, that of its floor. [M]
    surface_width
        The size along y of the body frame. [M]
    """

    __iri__: ClassVar[str] = _RT + "SupportSurface"

    rim_height: One[float] = One(_RT + "rimHeight", _XSD + "double", unit="M")
    surface_length: One[float] = One(_RT + "surfaceLength", _XSD + "double", unit="M")
    surface_width: One[float] = One(_RT + "surfaceWidth", _XSD + "double", unit="M")


class TaskPlan(Task):
    """A goal to be achieved by its sub-tasks, in the order of rt:precedes. What robots did for a
    sub-task is rt:carriedOutBy it.

    ``rt:TaskPlan``

    Attributes
    ----------
    allows_part
        Whether what is possible of the goal is to be done where the rest is out of reach;
        without it, all or nothing.
    allows_takeover
        Whether a robot with nothing to do may take over what another one has not begun: not
        where the goal names who is to do it, or who is not. Nothing may be taken over from a
        plan without this statement.
    asking_price
        What a question to a person about a step of the plan costs, in any unit that
        rt:failingPrice has, too. [UNITLESS]
    cancel_reason
        Why somebody cancelled the plan, at prov:invalidatedAtTime.
    failing_price
        What a step of the plan that fails costs, in any unit that rt:askingPrice has, too.
        [UNITLESS]
    goal_text
        The goal in the words of whoever stated it.
    open_goal
        A part of the goal that was out of reach when the plan was made, and what hindered it,
        in words. It is planned again once the rest is done.
    plan_assumption
        A statement that the plan needs and that nobody has made, in words.
    replaces_plan
        The plan was made for the same goal after the other could not be carried out; nothing
        more is begun of that.
    settled_goal
        The goal as JSON, with the things that its words meant when it was stated; it is
        planned again from this, as the words would mean other things once a part of it is
        done.
    task_deadline
        When the plan is to be done; no step of it is begun later.
    task_priority
        Plans with a greater number are begun first; one without has 0.
    """

    __iri__: ClassVar[str] = _RT + "TaskPlan"

    allows_part: Many[bool] = Many(_RT + "allowsPart", _XSD + "boolean")
    allows_takeover: Many[bool] = Many(_RT + "allowsTakeover", _XSD + "boolean")
    asking_price: One[float] = One(_RT + "askingPrice", _XSD + "double", unit="UNITLESS")
    cancel_reason: Many[str] = Many(_RT + "cancelReason", _XSD + "string")
    failing_price: One[float] = One(_RT + "failingPrice", _XSD + "double", unit="UNITLESS")
    goal_text: Many[str] = Many(_RT + "goalText", _XSD + "string")
    open_goal: Many[str] = Many(_RT + "openGoal", _XSD + "string")
    plan_assumption: Many[str] = Many(_RT + "planAssumption", _XSD + "string")
    replaces_plan: Links[TaskPlan] = Links(_RT + "replacesPlan", _RT + "TaskPlan")
    settled_goal: Many[str] = Many(_RT + "settledGoal", _XSD + "string")
    task_deadline: Many[datetime.datetime] = Many(_RT + "taskDeadline", _XSD + "dateTime")
    task_priority: Many[int] = Many(_RT + "taskPriority", _XSD + "integer")


class ThreeFingerGrasp(SpatialGrasp):
    """A grasp by three fingers that close on a common axis: three contacts, or two that jam the
    object. The pose has its origin and approach on that axis; opening and contact width are
    diameters about it.

    ``rt:ThreeFingerGrasp``
    """

    __iri__: ClassVar[str] = _RT + "ThreeFingerGrasp"
    __required__: ClassVar[tuple[str, ...]] = ("contact_width", "has_contact",)


class Translated(FramedMeasure):
    """A framed measure that carries x, y and z.

    ``rt:Translated``

    Attributes
    ----------
    x
        The first coordinate. [M]
    y
        The second coordinate. [M]
    z
        The third coordinate. [M]
    """

    __iri__: ClassVar[str] = _RT + "Translated"

    x: One[float] = One(_RT + "x", _XSD + "double", functional=True, unit="M")
    y: One[float] = One(_RT + "y", _XSD + "double", functional=True, unit="M")
    z: One[float] = One(_RT + "z", _XSD + "double", functional=True, unit="M")


class TriangleMesh(ShapeModel):
    """A mesh of triangles (Kehoe 2014, 4.3, v).

    ``rt:TriangleMesh``

    Attributes
    ----------
    is_watertight
        Whether every edge of the mesh belongs to exactly two faces.
    reconstruction_method
        The name of the method by which a surface was made from measured points.
    seen_share
        The share of a reconstructed surface's area that was measured, 0 to 1. The rest was
        filled in to close the surface; nobody has seen it. [UNITLESS]
    """

    __iri__: ClassVar[str] = _RT + "TriangleMesh"
    __required__: ClassVar[tuple[str, ...]] = ("has_blob",)

    is_watertight: One[bool] = One(_RT + "isWatertight", _XSD + "boolean", functional=True)
    reconstruction_method: One[str] = One(_RT + "reconstructionMethod", _XSD + "string", functional=True)
    seen_share: One[float] = One(_RT + "seenShare", _XSD + "double", functional=True, unit="UNITLESS")


class ZoneKind(ObjectTrait):
    """In which way a zone gives way.

    ``rt:ZoneKind``
    """

    __iri__: ClassVar[str] = _RT + "ZoneKind"


class ArtificialSystem(Artifact):
    """An artefact made of devices that interact.

    ``corax:ArtificialSystem``
    """

    __iri__: ClassVar[str] = _CORAX + "ArtificialSystem"


class OrientationTransformationFunction(UnaryFunction):
    """A map from one frame for rotations to another. Not used here.

    ``pos:OrientationTransformationFunction``
    """

    __iri__: ClassVar[str] = _POS + "OrientationTransformationFunction"


class PositionTransformationFunction(UnaryFunction):
    """A map from one frame for points to another. Not used here.

    ``pos:PositionTransformationFunction``
    """

    __iri__: ClassVar[str] = _POS + "PositionTransformationFunction"


class QuantPoseTransformationFunction(UnaryFunction):
    """A map from one frame for poses to another. Not used here.

    ``pos:QuantPoseTransformationFunction``
    """

    __iri__: ClassVar[str] = _POS + "QuantPoseTransformationFunction"


class Device(Artifact):
    """An artefact made to serve a purpose.

    ``sumo:Device``

    Attributes
    ----------
    has_joint
        From a device to its joint.
    provides_capability
        A capability that a part gives to its robot.
    robot_actuating_part
        From a part to the robot that moves by it.
    robot_communicating_part
        From a part to the robot that communicates by it.
    robot_part
        From a part to its robot; mind the direction.
    robot_sensing_part
        From a part to the robot that senses by it.
    support
        The device helps the system.
    """

    __iri__: ClassVar[str] = _SUMO + "Device"

    has_joint: Links[Joint] = Links(_RT + "hasJoint", _RT + "Joint", inverse=_RT + "jointOf")
    provides_capability: Links[Capability] = Links(_RT + "providesCapability", _RT + "Capability")
    robot_actuating_part: Links[Robot] = Links(_RPARTS + "robotActuatingPart", _CORA + "Robot")
    robot_communicating_part: Links[Robot] = Links(_RPARTS + "robotCommunicatingPart", _CORA + "Robot")
    robot_part: Links[Robot] = Links(_CORA + "robotPart", _CORA + "Robot")
    robot_sensing_part: Links[Robot] = Links(_RPARTS + "robotSensingPart", _CORA + "Robot")
    support: Links[RoboticSystem] = Links(_CORA + "support", _CORA + "RoboticSystem")


class TimePosition(TimeMeasure):
    """A point or stretch on the axis of time.

    ``sumo:TimePosition``
    """

    __iri__: ClassVar[str] = _SUMO + "TimePosition"


class BSplineContour(BSplineModel):
    """A closed B-spline curve that follows an outline.

    ``rt:BSplineContour``
    """

    __iri__: ClassVar[str] = _RT + "BSplineContour"


class BSplineSurface(BSplineModel):
    """A B-spline surface patch.

    ``rt:BSplineSurface``
    """

    __iri__: ClassVar[str] = _RT + "BSplineSurface"


class Ball(ManipulableObject):
    """An object shaped as a sphere.

    ``rt:Ball``
    """

    __iri__: ClassVar[str] = _RT + "Ball"


class Bar(ManipulableObject):
    """A long straight object, thicker than a pen.

    ``rt:Bar``
    """

    __iri__: ClassVar[str] = _RT + "Bar"


class Box(ManipulableObject):
    """An object shaped as a cuboid.

    ``rt:Box``
    """

    __iri__: ClassVar[str] = _RT + "Box"


class Container(ManipulableObject):
    """An object that holds other things.

    ``rt:Container``
    """

    __iri__: ClassVar[str] = _RT + "Container"


class Cylinder(ManipulableObject):
    """An object shaped as a cylinder.

    ``rt:Cylinder``
    """

    __iri__: ClassVar[str] = _RT + "Cylinder"


class DrinkingVessel(ManipulableObject):
    """An object to drink from; whatever holds liquid and has a handle is recognised as one.

    ``rt:DrinkingVessel``
    """

    __iri__: ClassVar[str] = _RT + "DrinkingVessel"


class Exemplar(ManipulableObject):
    """One physical thing, such as the carton on this table, of which the product is rt:exemplarOf;
    it has no objectId of its own.

    ``rt:Exemplar``

    Attributes
    ----------
    distinct_from
        Turned out to be another thing than this one, which it might have been.
    possibly_identical_to
        May be this earlier thing, seen again: rt:confidence on the reifier is the chance.
        rt:mergedInto or rt:distinctFrom settle it.
    """

    __iri__: ClassVar[str] = _RT + "Exemplar"

    distinct_from: Links[Exemplar] = Links(_RT + "distinctFrom", _RT + "Exemplar")
    possibly_identical_to: Links[Exemplar] = Links(_RT + "possiblyIdenticalTo", _RT + "Exemplar")


class Grasp(Manipulation):
    """The task of taking hold of an object. How a gripper takes it is a grasp configuration.

    ``rt:Grasp``
    """

    __iri__: ClassVar[str] = _RT + "Grasp"


class GraspAttempt(RobotManipulationAction):
    """One execution of a grasp by a robot; without an outcome as long as nobody judged it.

    ``rt:GraspAttempt``

    Attributes
    ----------
    analytic_quality
        The computed quality before the attempt. [UNITLESS]
    approach_tilt
        The angle between the executed approach and the vertical. [RAD]
    attempt_number
        The number of this attempt among those on the object for this task, from 1. [NUM]
    candidate_count
        The number of grasps to choose from. [NUM]
    candidate_rank
        The rank of the chosen grasp among the candidates. [NUM]
    executes_grasp
        The grasp that was tried.
    followed_policy
        The thresholds in force at the attempt.
    prior_alpha
        The belief in success before the attempt (alpha of a Beta distribution). [UNITLESS]
    prior_beta
        The belief in failure before the attempt (beta of a Beta distribution). [UNITLESS]
    quality_kind
        The measure used for the analytic quality.
    seed
        The seed of the choice and of the simulation. [NUM]
    used_pose_estimate
        The pose estimate that the attempt relied on.
    used_recognition
        The recognition that the attempt relied on.
    """

    __iri__: ClassVar[str] = _RT + "GraspAttempt"
    __required__: ClassVar[tuple[str, ...]] = ("activates", "executes_grasp", "performed_by",)

    analytic_quality: One[float] = One(_RT + "analyticQuality", _XSD + "double", functional=True, unit="UNITLESS")
    approach_tilt: One[float] = One(_RT + "approachTilt", _XSD + "double", functional=True, unit="RAD")
    attempt_number: One[int] = One(_RT + "attemptNumber", _XSD + "positiveInteger", functional=True, unit="NUM")
    candidate_count: One[int] = One(_RT + "candidateCount", _XSD + "positiveInteger", functional=True, unit="NUM")
    candidate_rank: One[int] = One(_RT + "candidateRank", _XSD + "positiveInteger", functional=True, unit="NUM")
    executes_grasp: Link[GraspConfiguration] = Link(_RT + "executesGrasp", _RT + "GraspConfiguration", functional=True, inverse=_RT + "triedIn")
    followed_policy: Links[DecisionPolicy] = Links(_RT + "followedPolicy", _RT + "DecisionPolicy")
    prior_alpha: One[float] = One(_RT + "priorAlpha", _XSD + "double", functional=True, unit="UNITLESS")
    prior_beta: One[float] = One(_RT + "priorBeta", _XSD + "double", functional=True, unit="UNITLESS")
    quality_kind: One[str] = One(_RT + "qualityKind", _XSD + "string", functional=True)
    seed: One[int] = One(_RT + "seed", _XSD + "nonNegativeInteger", functional=True, unit="NUM")
    used_pose_estimate: Links[PoseEstimate] = Links(_RT + "usedPoseEstimate", _RT + "PoseEstimate")
    used_recognition: Links[RecognitionResult] = Links(_RT + "usedRecognition", _RT + "RecognitionResult")


class HandOver(Manipulation):
    """The task of giving a held object into the hand of another robot.

    ``rt:HandOver``
    """

    __iri__: ClassVar[str] = _RT + "HandOver"


class Human(CognitiveAgent, Person):
    """A person who operates, teaches or writes.

    ``rt:Human``
    """

    __iri__: ClassVar[str] = _RT + "Human"


class Orientation(Rotated, OrientationValue):
    """A rotation in a frame, without a place.

    ``rt:Orientation``
    """

    __iri__: ClassVar[str] = _RT + "Orientation"


class Pen(ManipulableObject):
    """A long thin tool for writing.

    ``rt:Pen``
    """

    __iri__: ClassVar[str] = _RT + "Pen"


class PickAndPlace(Manipulation):
    """A grasp followed by a place, both as sub-tasks.

    ``rt:PickAndPlace``
    """

    __iri__: ClassVar[str] = _RT + "PickAndPlace"


class Place(Manipulation):
    """The task of putting a held object down at a target.

    ``rt:Place``
    """

    __iri__: ClassVar[str] = _RT + "Place"


class PlanarPose(Translated, PoseMeasure):
    """X, Y and an angle theta on a work surface (Gatto 2016, 4.3); z, where given, is the height
    over the frame's origin.

    ``rt:PlanarPose``

    Attributes
    ----------
    theta
        The angle about the normal of the surface, in [0, 2 pi). [RAD]
    """

    __iri__: ClassVar[str] = _RT + "PlanarPose"
    __required__: ClassVar[tuple[str, ...]] = ("in_frame", "theta", "x", "y",)

    theta: One[float] = One(_RT + "theta", _XSD + "double", functional=True, unit="RAD", limits=Limits(least=0.0, below=6.283185307179586))


class Pose(Translated, Rotated, QuantitativePose):
    """Position and orientation of a body in a frame, read as frame_from_body; all seven numbers
    stand on this one node.

    ``rt:Pose``
    """

    __iri__: ClassVar[str] = _RT + "Pose"
    __required__: ClassVar[tuple[str, ...]] = ("in_frame", "qw", "qx", "qy", "qz", "x", "y", "z",)


class Position(Translated, PositionPoint):
    """A point in a frame.

    ``rt:Position``
    """

    __iri__: ClassVar[str] = _RT + "Position"


class Push(Manipulation):
    """The task of moving an object by contact, without holding it.

    ``rt:Push``
    """

    __iri__: ClassVar[str] = _RT + "Push"


class Tool(ManipulableObject):
    """A hand tool.

    ``rt:Tool``
    """

    __iri__: ClassVar[str] = _RT + "Tool"


class Robot(Device, Agent):
    """A device that acts in the world with some autonomy.

    ``cora:Robot``

    Attributes
    ----------
    agent_robot
        A robot and a process in which it takes part. Runs against the direction of
        sumo:agent, hence never asserted here.
    automated_robot
        The robot takes part as an automat. Never asserted here.
    fullyautonomous_robot
        The robot takes part with full autonomy. Never asserted here.
    has_end_effector
        From a robot to its end effector.
    has_robot_model
        Make and version of the robot.
    has_sensor
        From a robot to its sensor.
    meets
        The hands of the two robots can meet, so that one can give to the other. A place that
        both reach is no proof of it.
    remotecontrolled_robot
        The robot takes part while a person controls it from afar. Never asserted here.
    semiautonomous_robot
        The robot takes part with some autonomy. Never asserted here.
    serial_number
        The maker's number of the individual robot.
    teleoperated_robot
        The robot takes part while a person guides each step. Never asserted here.
    """

    __iri__: ClassVar[str] = _CORA + "Robot"

    agent_robot: Links[Process] = Links(_CORA + "agentRobot", _SUMO + "Process")
    automated_robot: Links[Process] = Links(_CORA + "automatedRobot", _SUMO + "Process")
    fullyautonomous_robot: Links[Process] = Links(_CORA + "fullyautonomousRobot", _SUMO + "Process")
    has_end_effector: Links[EndEffector] = Links(_RT + "hasEndEffector", _RT + "EndEffector", inverse=_RT + "endEffectorOf")
    has_robot_model: Link[RobotModel] = Link(_RT + "hasRobotModel", _RT + "RobotModel", functional=True)
    has_sensor: Links[RobotSensor] = Links(_RT + "hasSensor", _RT + "RobotSensor", inverse=_RT + "sensorOf")
    meets: Links[Robot] = Links(_RT + "meets", _CORA + "Robot")
    remotecontrolled_robot: Links[Process] = Links(_CORA + "remotecontrolledRobot", _SUMO + "Process")
    semiautonomous_robot: Links[Process] = Links(_CORA + "semiautonomousRobot", _SUMO + "Process")
    serial_number: One[str] = One(_RT + "serialNumber", _XSD + "string", functional=True)
    teleoperated_robot: Links[Process] = Links(_CORA + "teleoperatedRobot", _SUMO + "Process")


class RobotInterface(Device):
    """The parts through which a robot senses, acts and communicates.

    ``cora:RobotInterface``
    """

    __iri__: ClassVar[str] = _CORA + "RobotInterface"


class RoboticSystem(ArtificialSystem):
    """One or several robots together with the devices that support them.

    ``cora:RoboticSystem``
    """

    __iri__: ClassVar[str] = _CORA + "RoboticSystem"


class ElectricDevice(Device):
    """A device that runs on electricity.

    ``sumo:ElectricDevice``
    """

    __iri__: ClassVar[str] = _SUMO + "ElectricDevice"


class Bottle(Container):
    """A container with a narrow neck.

    ``rt:Bottle``
    """

    __iri__: ClassVar[str] = _RT + "Bottle"


class Can(Container):
    """A cylindrical container of sheet metal.

    ``rt:Can``
    """

    __iri__: ClassVar[str] = _RT + "Can"


class Cup(DrinkingVessel, Container):
    """A small open vessel, with or without a handle.

    ``rt:Cup``
    """

    __iri__: ClassVar[str] = _RT + "Cup"


class EndEffector(Device):
    """A part of a robot that touches objects on purpose.

    ``rt:EndEffector``

    Attributes
    ----------
    end_effector_of
        From an end effector to its robot, in CORA's direction.
    finger_length
        The reach of the fingers. [M]
    flange_radius
        The radius of the arm's flange behind the stem of a suction cup. [M]
    jaw_width
        The width of a jaw's face (Kehoe 2014, 3.4, w). [M]
    lip_compliance
        The difference in depth between points of the lip at which it still seals. [M]
    lip_radius
        The radius of the lip of a suction cup. [M]
    max_force
        The largest closing force; of a suction cup, the pull of its vacuum. [N]
    max_opening
        The largest width that it can hold. [M]
    max_payload
        The largest mass that it can lift. [KiloGM]
    min_force
        The smallest closing force that it can be set to. [N]
    min_opening
        The smallest width that it can hold. [M]
    parent_link
        The link to which grasp poses refer.
    planning_group
        The group of joints that moves it, as motion planners such as MoveIt name it.
    vacuum_pressure
        The pressure within the lip below that of the air. [PA]
    """

    __iri__: ClassVar[str] = _RT + "EndEffector"

    end_effector_of: Link[Robot] = Link(_RT + "endEffectorOf", _CORA + "Robot", inverse=_RT + "hasEndEffector", stored=False)
    finger_length: One[float] = One(_RT + "fingerLength", _XSD + "double", unit="M")
    flange_radius: One[float] = One(_RT + "flangeRadius", _XSD + "double", unit="M")
    jaw_width: One[float] = One(_RT + "jawWidth", _XSD + "double", unit="M")
    lip_compliance: One[float] = One(_RT + "lipCompliance", _XSD + "double", unit="M")
    lip_radius: One[float] = One(_RT + "lipRadius", _XSD + "double", unit="M")
    max_force: One[float] = One(_RT + "maxForce", _XSD + "double", unit="N")
    max_opening: One[float] = One(_RT + "maxOpening", _XSD + "double", unit="M")
    max_payload: One[float] = One(_RT + "maxPayload", _XSD + "double", unit="KiloGM")
    min_force: One[float] = One(_RT + "minForce", _XSD + "double", unit="N")
    min_opening: One[float] = One(_RT + "minOpening", _XSD + "double", unit="M")
    parent_link: Many[str] = Many(_RT + "parentLink", _XSD + "string")
    planning_group: Many[str] = Many(_RT + "planningGroup", _XSD + "string")
    vacuum_pressure: One[float] = One(_RT + "vacuumPressure", _XSD + "double", unit="PA")


class GraspContact(Position):
    """A place at which a lip seals or a finger pushes, in the body frame of the object.

    ``rt:GraspContact``

    Attributes
    ----------
    contact_index
        The place among the contacts of the grasp, from 0; 0 is the finger along the pose's x.
        [NUM]
    contact_normal
        The normal of the surface at the contact, out of the object.
    seal_radius
        The radius of the lip that seals at the contact; a smaller lip does so, too. [M]
    """

    __iri__: ClassVar[str] = _RT + "GraspContact"
    __required__: ClassVar[tuple[str, ...]] = ("contact_index", "contact_normal", "in_frame", "x", "y", "z",)

    contact_index: One[int] = One(_RT + "contactIndex", _XSD + "nonNegativeInteger", functional=True, unit="NUM", limits=Limits(most=2.0))
    contact_normal: Link[Direction] = Link(_RT + "contactNormal", _RT + "Direction", functional=True)
    seal_radius: One[float] = One(_RT + "sealRadius", _XSD + "double", functional=True, unit="M", limits=Limits(above=0.0))


class Joint(Device):
    """One degree of freedom of a robot or of an end effector.

    ``rt:Joint``

    Attributes
    ----------
    joint_kind
        "revolute" or "prismatic".
    joint_name
        The name of the joint in the URDF.
    joint_of
        From a joint to the device it belongs to.
    """

    __iri__: ClassVar[str] = _RT + "Joint"
    __required__: ClassVar[tuple[str, ...]] = ("joint_name",)

    joint_kind: One[str] = One(_RT + "jointKind", _XSD + "string", functional=True)
    joint_name: One[str] = One(_RT + "jointName", _XSD + "string", functional=True)
    joint_of: Links[Device] = Links(_RT + "jointOf", _SUMO + "Device", inverse=_RT + "hasJoint", stored=False)


class RobotSensor(Device, Sensor):
    """A sensor mounted on a robot or in its work cell.

    ``rt:RobotSensor``

    Attributes
    ----------
    sensor_of
        From a sensor to its robot, in CORA's direction.
    """

    __iri__: ClassVar[str] = _RT + "RobotSensor"

    sensor_of: Links[Robot] = Links(_RT + "sensorOf", _CORA + "Robot", inverse=_RT + "hasSensor", stored=False)


class Tray(Container, SupportSurface):
    """A flat carrier on which other objects stand.

    ``rt:Tray``
    """

    __iri__: ClassVar[str] = _RT + "Tray"


class CollectiveRoboticSystem(RoboticSystem):
    """A robotic system with several robots.

    ``cora:CollectiveRoboticSystem``
    """

    __iri__: ClassVar[str] = _CORA + "CollectiveRoboticSystem"


class SingleRoboticSystem(RoboticSystem):
    """A robotic system with exactly one robot.

    ``cora:SingleRoboticSystem``
    """

    __iri__: ClassVar[str] = _CORA + "SingleRoboticSystem"


class ProcessingDevice(ElectricDevice):
    """A device that computes.

    ``corax:ProcessingDevice``

    Attributes
    ----------
    robot_processing_part
        From a part to the robot that computes by it.
    """

    __iri__: ClassVar[str] = _CORAX + "ProcessingDevice"

    robot_processing_part: Links[Robot] = Links(_RPARTS + "robotProcessingPart", _CORA + "Robot")


class Camera(RobotSensor):
    """An imaging sensor with known intrinsics (pinhole model).

    ``rt:Camera``

    Attributes
    ----------
    depth_error_ratio
        The error of a depth over the distance. [UNITLESS]
    focal_x
        The focal length along x, in pixels. [NUM]
    focal_y
        The focal length along y, in pixels. [NUM]
    frame_rate
        Frames per second. [HZ]
    image_height
        The height of the image in pixels. [NUM]
    image_width
        The width of the image in pixels. [NUM]
    max_range
        The farthest depth that it measures. [M]
    min_range
        The nearest depth that it measures. [M]
    principal_x
        The column of the principal point, in pixels. [NUM]
    principal_y
        The row of the principal point, in pixels. [NUM]
    """

    __iri__: ClassVar[str] = _RT + "Camera"

    depth_error_ratio: One[float] = One(_RT + "depthErrorRatio", _XSD + "double", unit="UNITLESS")
    focal_x: One[float] = One(_RT + "focalX", _XSD + "double", unit="NUM", limits=Limits(above=0.0))
    focal_y: One[float] = One(_RT + "focalY", _XSD + "double", unit="NUM", limits=Limits(above=0.0))
    frame_rate: One[float] = One(_RT + "frameRate", _XSD + "double", unit="HZ")
    image_height: One[int] = One(_RT + "imageHeight", _XSD + "positiveInteger", unit="NUM", limits=Limits(least=1.0))
    image_width: One[int] = One(_RT + "imageWidth", _XSD + "positiveInteger", unit="NUM", limits=Limits(least=1.0))
    max_range: One[float] = One(_RT + "maxRange", _XSD + "double", unit="M")
    min_range: One[float] = One(_RT + "minRange", _XSD + "double", unit="M", limits=Limits(least=0.0))
    principal_x: One[float] = One(_RT + "principalX", _XSD + "double", unit="NUM")
    principal_y: One[float] = One(_RT + "principalY", _XSD + "double", unit="NUM")


class ForceSensor(RobotSensor):
    """A sensor that measures force or torque.

    ``rt:ForceSensor``
    """

    __iri__: ClassVar[str] = _RT + "ForceSensor"


class Gripper(EndEffector):
    """An end effector that holds by enclosing.

    ``rt:Gripper``
    """

    __iri__: ClassVar[str] = _RT + "Gripper"
    __required__: ClassVar[tuple[str, ...]] = ("gripper_type", "max_payload", "min_opening",)


class ManipulatorRobot(Robot):
    """A robot with at least one end effector; robots are recognised as such from their parts.

    ``rt:ManipulatorRobot``
    """

    __iri__: ClassVar[str] = _RT + "ManipulatorRobot"


class Mug(Cup):
    """A cup with a handle.

    ``rt:Mug``
    """

    __iri__: ClassVar[str] = _RT + "Mug"


class SuctionCup(EndEffector):
    """An end effector that holds by vacuum.

    ``rt:SuctionCup``
    """

    __iri__: ClassVar[str] = _RT + "SuctionCup"
    __required__: ClassVar[tuple[str, ...]] = ("gripper_type", "lip_radius", "max_payload",)


class TactileSensor(RobotSensor):
    """A sensor that reports contact.

    ``rt:TactileSensor``
    """

    __iri__: ClassVar[str] = _RT + "TactileSensor"


class ColorCamera(Camera):
    """A camera that gives colour images.

    ``rt:ColorCamera``
    """

    __iri__: ClassVar[str] = _RT + "ColorCamera"


class DepthCamera(Camera):
    """A camera that gives a range for each pixel.

    ``rt:DepthCamera``
    """

    __iri__: ClassVar[str] = _RT + "DepthCamera"


class Hand(Gripper):
    """A gripper whose fingers have joints, such as the hand of a Nao.

    ``rt:Hand``
    """

    __iri__: ClassVar[str] = _RT + "Hand"


class ParallelJawGripper(Gripper):
    """A gripper with two jaws on one closing axis.

    ``rt:ParallelJawGripper``
    """

    __iri__: ClassVar[str] = _RT + "ParallelJawGripper"


class ThreeFingerHand(Gripper):
    """A gripper with three fingers, 120 degrees apart, that close together on a common axis.

    ``rt:ThreeFingerHand``
    """

    __iri__: ClassVar[str] = _RT + "ThreeFingerHand"


class RGBDCamera(DepthCamera, ColorCamera):
    """A camera that gives colour and depth, registered to each other.

    ``rt:RGBDCamera``
    """

    __iri__: ClassVar[str] = _RT + "RGBDCamera"


clean = NamedNode(_RT + "clean")
colour_black = NamedNode(_RT + "colour_black")
colour_blue = NamedNode(_RT + "colour_blue")
colour_brown = NamedNode(_RT + "colour_brown")
colour_green = NamedNode(_RT + "colour_green")
colour_grey = NamedNode(_RT + "colour_grey")
colour_orange = NamedNode(_RT + "colour_orange")
colour_pink = NamedNode(_RT + "colour_pink")
colour_purple = NamedNode(_RT + "colour_purple")
colour_red = NamedNode(_RT + "colour_red")
colour_sensing = NamedNode(_RT + "colourSensing")
colour_white = NamedNode(_RT + "colour_white")
colour_yellow = NamedNode(_RT + "colour_yellow")
contain_liquid = NamedNode(_RT + "containLiquid")
contain_solid = NamedNode(_RT + "containSolid")
convex_vertex_closure = NamedNode(_RT + "convexVertexClosure")
cut = NamedNode(_RT + "cut")
depth_sensing = NamedNode(_RT + "depthSensing")
drink_from = NamedNode(_RT + "drinkFrom")
eat_with = NamedNode(_RT + "eatWith")
fasten = NamedNode(_RT + "fasten")
force_sensing = NamedNode(_RT + "forceSensing")
friction_closure = NamedNode(_RT + "frictionClosure")
grasping = NamedNode(_RT + "grasping")
illuminate = NamedNode(_RT + "illuminate")
placing = NamedNode(_RT + "placing")
play_with = NamedNode(_RT + "playWith")
power_grasping = NamedNode(_RT + "powerGrasping")
pushing = NamedNode(_RT + "pushing")
reason_approach_collision = NamedNode(_RT + "reason_approach_collision")
reason_approach_ik = NamedNode(_RT + "reason_approach_ik")
reason_came_apart = NamedNode(_RT + "reason_came_apart")
reason_crushed = NamedNode(_RT + "reason_crushed")
reason_drop_outside = NamedNode(_RT + "reason_drop_outside")
reason_grasp_collision = NamedNode(_RT + "reason_grasp_collision")
reason_hardware = NamedNode(_RT + "reason_hardware")
reason_ik = NamedNode(_RT + "reason_ik")
reason_lift_ik = NamedNode(_RT + "reason_lift_ik")
reason_low_grasp = NamedNode(_RT + "reason_low_grasp")
reason_low_pose = NamedNode(_RT + "reason_low_pose")
reason_low_recognition = NamedNode(_RT + "reason_low_recognition")
reason_missed = NamedNode(_RT + "reason_missed")
reason_no_grasp = NamedNode(_RT + "reason_no_grasp")
reason_no_match = NamedNode(_RT + "reason_no_match")
reason_not_judged = NamedNode(_RT + "reason_not_judged")
reason_ok = NamedNode(_RT + "reason_ok")
reason_place_plan = NamedNode(_RT + "reason_place_plan")
reason_pose_unknown = NamedNode(_RT + "reason_pose_unknown")
reason_pregrasp_collision = NamedNode(_RT + "reason_pregrasp_collision")
reason_pushed_away = NamedNode(_RT + "reason_pushed_away")
reason_rrt_goal = NamedNode(_RT + "reason_rrt_goal")
reason_rrt_start = NamedNode(_RT + "reason_rrt_start")
reason_rrt_time = NamedNode(_RT + "reason_rrt_time")
reason_slip_hold = NamedNode(_RT + "reason_slip_hold")
reason_slip_lift = NamedNode(_RT + "reason_slip_lift")
reason_slip_transport = NamedNode(_RT + "reason_slip_transport")
reason_stopped_by_human = NamedNode(_RT + "reason_stopped_by_human")
reason_tilt = NamedNode(_RT + "reason_tilt")
reason_timed_out = NamedNode(_RT + "reason_timed_out")
reason_too_heavy = NamedNode(_RT + "reason_too_heavy")
reason_too_wide = NamedNode(_RT + "reason_too_wide")
reason_touched = NamedNode(_RT + "reason_touched")
reason_tracking = NamedNode(_RT + "reason_tracking")
reason_wrong_object = NamedNode(_RT + "reason_wrong_object")
sector0 = NamedNode(_RT + "sector0")
sector1 = NamedNode(_RT + "sector1")
sector2 = NamedNode(_RT + "sector2")
sector3 = NamedNode(_RT + "sector3")
slip_closure = NamedNode(_RT + "slipClosure")
suction_holding = NamedNode(_RT + "suctionHolding")
trait_heavy = NamedNode(_RT + "trait_heavy")
write = NamedNode(_RT + "write")
zone_comes_off = NamedNode(_RT + "zone_comes_off")
zone_fragile = NamedNode(_RT + "zone_fragile")
zone_slippery = NamedNode(_RT + "zone_slippery")
