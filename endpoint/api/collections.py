"""Tables that define `/api/robots`, `/api/tasks`, `/api/objects` and `/api/outcomes`.

Query, OpenAPI description and JSON-LD context are all derived from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["COLLECTIONS", "Block", "Collection", "Filter", "Member"]

Kind = Literal["iri", "iris", "text", "texts", "number", "integer", "boolean", "time"]


@dataclass(frozen=True)
class Member:
    """One member of an item.

    Parameters
    ----------
    name
        Name in JSON, including the unit if there is one.
    kind
        Kind of its value.
    summary
        Its meaning.
    value
        SPARQL aggregate over the rows of an item.
    term
        Prefixed name of the property that it represents; empty for counts.
    """

    name: str
    kind: Kind
    summary: str
    value: str
    term: str = ""


@dataclass(frozen=True)
class Block:
    """Members that one pattern about ``?iri`` yields, counted separately from other blocks."""

    pattern: str
    members: tuple[Member, ...]


@dataclass(frozen=True)
class Filter:
    """A parameter that selects some of the items.

    Parameters
    ----------
    pattern
        Pattern about ``?iri``; ``$value`` is the value requested.
    """

    name: str
    kind: Kind
    summary: str
    pattern: str


@dataclass(frozen=True)
class Collection:
    """All things of one kind.

    Parameters
    ----------
    name
        Last segment of the address.
    folder
        Folder of their IRIs, below the base of the knowledge base.
    pattern
        Binds ``?iri`` and, for lists by time with the newest first, ``?ended``.
    """

    name: str
    folder: str
    summary: str
    pattern: str
    blocks: tuple[Block, ...]
    filters: tuple[Filter, ...] = ()
    by_time: bool = False

    @property
    def members(self) -> tuple[Member, ...]:
        """All members in order."""
        time = (Member("time", "time", "when it ended", "?time", "prov:endedAtTime"),)
        rest = tuple(member for block in self.blocks for member in block.members)
        return (*(time if self.by_time else ()), *rest)


_ROBOTS = Collection(
    "robots", "robot", "Robots that made themselves known",
    "?iri a cora:Robot",
    (
        Block(
            """OPTIONAL { ?iri rt:name ?name_ }
            OPTIONAL { ?iri rt:hasRobotModel/rt:modelName ?model_ }
            OPTIONAL { ?iri rt:hasEndEffector/rt:gripperType ?gripper_ }""",
            (
                Member("name", "text", "what it is called", "SAMPLE(?name_)", "rt:name"),
                Member("model", "text", "what it is a copy of", "SAMPLE(?model_)", "rt:modelName"),
                Member("grippers", "texts", "kinds of its grippers",
                       'GROUP_CONCAT(DISTINCT ?gripper_; separator="\\n")', "rt:gripperType"),
            ),
        ),
        Block(
            """?any rt:performedBy ?iri ; a rt:GraspAttempt
            OPTIONAL { ?any prov:endedAtTime ?last_ }
            OPTIONAL { ?any rt:hasOutcome/rt:judgedSuccess true BIND(?any AS ?held) }""",
            (
                Member("attempts", "integer", "grasps that it tried", "COUNT(DISTINCT ?any)"),
                Member("successes", "integer", "of them held", "COUNT(DISTINCT ?held)"),
                Member("last_attempt", "time", "when the last one ended", "MAX(?last_)"),
            ),
        ),
    ),
    (
        Filter("name", "text", "what it is called",
               "?iri rt:name ?name_f FILTER(STR(?name_f) = $value)"),
        Filter("gripper_type", "text", "has a gripper of this kind",
               "?iri rt:hasEndEffector/rt:gripperType ?type_f FILTER(STR(?type_f) = $value)"),
    ),
)  # fmt: skip

_OBJECTS = Collection(
    "objects", "object", "Objects that robots met",
    "?iri a rt:ManipulableObject",
    (
        Block(
            """OPTIONAL { ?iri rt:name ?name_ } OPTIONAL { ?iri rt:objectId ?id_ }
            OPTIONAL { ?iri rt:graspWidth ?width_ } OPTIONAL { ?iri rt:mass ?mass_ }
            OPTIONAL { ?iri rt:extentX ?x_ ; rt:extentY ?y_ ; rt:extentZ ?z_ }""",
            (
                Member("name", "text", "what people call it", "SAMPLE(?name_)", "rt:name"),
                Member("id", "text", "number by which robots know it", "SAMPLE(?id_)",
                       "rt:objectId"),
                Member("length_m", "number", "extent along its longer side, m", "SAMPLE(?x_)",
                       "rt:extentX"),
                Member("width_m", "number", "extent across, m", "SAMPLE(?y_)", "rt:extentY"),
                Member("height_m", "number", "extent upwards, m", "SAMPLE(?z_)", "rt:extentZ"),
                Member("grasp_width_m", "number", "opening that takes hold of it, m",
                       "SAMPLE(?width_)", "rt:graspWidth"),
                Member("mass_kg", "number", "mass, kg", "SAMPLE(?mass_)", "rt:mass"),
            ),
        ),
        Block(
            """?iri a ?class_ . ?class_ rdfs:subClassOf rt:ManipulableObject
            FILTER(isIRI(?class_) && ?class_ != rt:ManipulableObject)""",
            (Member("classes", "iris", "kinds of object, derived ones included",
                    'GROUP_CONCAT(DISTINCT STR(?class_); separator="\\n")', "rdf:type"),),
        ),
        Block(
            "?iri rt:hasView ?view_",
            (Member("views", "integer", "how often it was looked at", "COUNT(DISTINCT ?view_)"),),
        ),
        Block(
            """?iri rt:hasGrasp ?grasp_ OPTIONAL { ?any rt:executesGrasp ?grasp_
            OPTIONAL { ?any rt:hasOutcome/rt:judgedSuccess true BIND(?any AS ?held) } }""",
            (
                Member("grasps", "integer", "known grasps", "COUNT(DISTINCT ?grasp_)"),
                Member("attempts", "integer", "grasps tried on it", "COUNT(DISTINCT ?any)"),
                Member("successes", "integer", "of them held", "COUNT(DISTINCT ?held)"),
            ),
        ),
    ),
    (
        Filter("class", "iri", "of this kind, or one below it", "?iri a $value"),
        Filter("text", "text", "these letters occur in its name",
               "?iri rt:name ?name_f FILTER(CONTAINS(LCASE(STR(?name_f)), LCASE($value)))"),
        Filter("robot", "iri", "this robot tried a grasp on it",
               "FILTER EXISTS { ?task_f rt:handles ?iri ; rt:through/rt:performedBy $value }"),
    ),
)  # fmt: skip

_TASKS = Collection(
    "tasks", "task", "Tasks that robots carried out, the newest first",
    "?iri rt:handles ?object_ ; rt:through ?attempt_ . ?attempt_ prov:endedAtTime ?ended",
    (
        Block(
            """?iri rt:handles ?object_ ; rt:through ?attempt_ . ?attempt_ rt:performedBy ?robot_
            OPTIONAL { ?attempt_ rt:requestId ?id_ }
            OPTIONAL { ?attempt_ rt:hasOutcome ?outcome_
              OPTIONAL { ?outcome_ rt:judgedSuccess ?held_ } }""",
            (
                Member("task_id", "text", "id of the request", "SAMPLE(?id_)", "rt:requestId"),
                Member("object", "iri", "what it handled", "SAMPLE(?object_)", "rt:handles"),
                Member("robot", "iri", "who carried it out", "SAMPLE(?robot_)", "rt:performedBy"),
                Member("attempts", "iris", "grasps tried for it",
                       'GROUP_CONCAT(DISTINCT STR(?attempt_); separator="\\n")', "rt:through"),
                Member("outcomes", "iris", "what came of them",
                       'GROUP_CONCAT(DISTINCT STR(?outcome_); separator="\\n")'),
                Member("success", "boolean", "whether the last word on it is that it held",
                       "MAX(?held_)"),
            ),
        ),
    ),
    (
        Filter("object", "iri", "handles this object", "?iri rt:handles $value"),
        Filter("robot", "iri", "carried out by this robot",
               "?iri rt:through/rt:performedBy $value"),
        Filter("since", "time", "ended at this time or later", "FILTER(?ended >= $value)"),
    ),
    by_time=True,
)  # fmt: skip

_OUTCOMES = Collection(
    "outcomes", "outcome", "What came of grasps, the newest first",
    "?attempt_ rt:hasOutcome ?iri ; prov:endedAtTime ?ended",
    (
        Block(
            """?attempt_ rt:hasOutcome ?iri ; rt:executesGrasp ?grasp_ ; rt:performedBy ?robot_
            OPTIONAL { ?attempt_ rt:requestId ?id_ } OPTIONAL { ?task_ rt:through ?attempt_
              OPTIONAL { ?task_ rt:handles ?object_ } }
            OPTIONAL { ?iri rt:success ?said_ } OPTIONAL { ?iri rt:judgedSuccess ?held_ }
            OPTIONAL { ?iri rt:disputed ?disputed_ }
            OPTIONAL { ?iri rt:hasReason/rt:code ?code_ }""",
            (
                Member("task_id", "text", "id of the request", "SAMPLE(?id_)", "rt:requestId"),
                Member("object", "iri", "what was grasped", "SAMPLE(?object_)", "rt:handles"),
                Member("grasp", "iri", "how", "SAMPLE(?grasp_)", "rt:executesGrasp"),
                Member("robot", "iri", "by whom", "SAMPLE(?robot_)", "rt:performedBy"),
                Member("attempt", "iri", "the attempt", "SAMPLE(?attempt_)"),
                Member("reported", "boolean", "whether the robot says that it held",
                       "SAMPLE(?said_)", "rt:success"),
                Member("success", "boolean", "what counts: people's verdicts outweigh the robot's",
                       "SAMPLE(?held_)", "rt:judgedSuccess"),
                Member("disputed", "boolean", "people disagree evenly", "SAMPLE(?disputed_)",
                       "rt:disputed"),
                Member("reason", "text", "code of why it ended so", "SAMPLE(?code_)",
                       "rt:hasReason"),
            ),
        ),
    ),
    (
        Filter("object", "iri", "of this object",
               "?task_f rt:through ?attempt_ ; rt:handles $value"),
        Filter("grasp", "iri", "of this grasp", "?attempt_ rt:executesGrasp $value"),
        Filter("robot", "iri", "by this robot", "?attempt_ rt:performedBy $value"),
        Filter("success", "boolean", "counts as held, or not", "?iri rt:judgedSuccess $value"),
        Filter("since", "time", "ended at this time or later", "FILTER(?ended >= $value)"),
    ),
    by_time=True,
)  # fmt: skip

COLLECTIONS = {collection.name: collection for collection in (_ROBOTS, _TASKS, _OBJECTS, _OUTCOMES)}
"""By name."""
