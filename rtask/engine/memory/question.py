"""SPARQL query behind a decision (Gatto 2016, 3.2.4)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rtask.engine.grippers import StoredGripper
from rtask.engine.observation import Observation
from rtask.engine.policy import JUDGED, LOST, Policy
from rtask.rdf.namespaces import PREFIXES, RT, values
from rtask.rdf.terms import iri

if TYPE_CHECKING:
    from features.recognition.recogniser import Recognition

__all__ = ["Question", "query_text", "question_for"]

_NOBODY = "urn:rtask:nobody"


@dataclass(frozen=True)
class Question:
    """Subject of the query behind a decision.

    Parameters
    ----------
    objects
        IRIs from recognition or tracking.
    classes
        IRIs of classes whose members provide evidence.
    doubtful
        Those with low confidence, which also count as other members of their class.
    size
        (length, width, height), m, of the object in question.
    tracked
        The object that the robot is currently handling, if any.
    robot
        The asking robot, for its own attempts on ``tracked``.
    views
        Stored views whose viewpoints are needed.
    only
        Classes to one of which an object must belong; empty = any.
    in_space
        Whether to include grasps with a full pose.
    doubts
        Weights of reports, 0 to below 1, by IRI of the robot; attempts of weight 0 are not counted.
    """

    objects: tuple[str, ...] = ()
    classes: tuple[str, ...] = ()
    size: tuple[float, float, float] | None = None
    size_tolerance: float = 1.5
    tracked: str | None = None
    robot: str | None = None
    views: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    doubtful: tuple[str, ...] = ()
    in_space: bool = False
    doubts: Mapping[str, float] = field(default_factory=dict)

    @property
    def weighs_robots(self) -> bool:
        """Whether the attempts of some robot are counted by themselves, with a weight."""
        return any(weight > 0 for weight in self.doubts.values())


def query_text(question: Question) -> str:
    """Return the query of a decision.

    Each part leaves the variables of the others unbound; ``?part`` identifies the rows. The store
    reads only the necessary statements as long as every pattern is in one group that begins with
    its ``VALUES``. Therefore attempts are a separate part and not optional to grasps, verdicts are
    looked up by ``EXISTS``, and ``BIND`` comes last.
    """
    of = [(f"VALUES ?object {{ {values(question.objects)} }}", "false")]
    if question.classes and question.size is not None:
        of.append((_members(question), "true"))
    orientations = (_ABOUT_Z, _IN_SPACE) if question.in_space else (_ABOUT_Z,)
    parts = [
        _object_part(question),
        *(_grasp_part(which, of_class, orientation) for which, of_class in of
          for orientation in orientations),
        *(_contact_part(which, of_class) for which, of_class in of if question.in_space),
        *(_tally_part(which, of_class, fast, question.doubts)
          for which, of_class in of for fast in (False, True)),
        *(_trial_part(question.tracked, question.robot, orientation)
          for orientation in orientations if question.tracked),
        _view_part(question.views),
    ]  # fmt: skip
    union = "\n  UNION\n".join(f"  {{ {part} }}" for part in parts)
    return f"{PREFIXES}\nSELECT * WHERE {{\n{union}\n}}"


def _object_part(question: Question) -> str:
    """Return the pattern of statements about the objects themselves.

    Of a forgotten one its kind may still follow from the attempts that stay.
    """
    only = ""
    if question.only:
        allowed = f"VALUES ?wanted {{ {values(question.only)} }}"
        only = f"FILTER EXISTS {{ {allowed} ?object a ?wanted }}"
    return f"""VALUES ?object {{ {values(question.objects)} }}
    ?object a rt:ManipulableObject {only}
    FILTER NOT EXISTS {{ ?object prov:invalidatedAtTime ?forgotten }}
    OPTIONAL {{ ?object rt:name ?name }}
    OPTIONAL {{ ?object rt:extentX ?length ; rt:extentY ?width ; rt:extentZ ?height }}
    OPTIONAL {{ ?object rt:hasSymmetry/rt:symmetryOrder ?order }}
    OPTIONAL {{ ?object a ?class . ?class rdfs:subClassOf rt:ManipulableObject
      FILTER(?class != rt:ManipulableObject && isIRI(?class))
      OPTIONAL {{ ?class rdfs:label ?label }} OPTIONAL {{ ?class rt:shortId ?short }}
      OPTIONAL {{ ?class rdfs:subClassOf ?above . ?above rdfs:subClassOf rt:ManipulableObject
        FILTER(?above != ?class && isIRI(?above)) }} }}
    BIND("object" AS ?part)"""


def _members(question: Question) -> str:
    """Return the pattern of other objects of the classes with a similar size."""
    assert question.size is not None
    bounds = " && ".join(
        f"?{name} > {size / question.size_tolerance:.6f} && "
        f"?{name} < {size * question.size_tolerance:.6f}"
        for name, size in zip(("l", "w", "h"), question.size, strict=True)
    )
    sure = sorted(set(question.objects) - set(question.doubtful))
    sure_members = ", ".join(values([iri]) for iri in sure) or f"<{_NOBODY}>"
    return f"""VALUES ?kind {{ {values(question.classes)} }}
    ?object a ?kind ; rt:extentX ?l ; rt:extentY ?w ; rt:extentZ ?h
    FILTER({bounds} && ?object NOT IN ({sure_members}))"""


_ABOUT_Z = "rt:theta ?theta"
_IN_SPACE = "rt:qx ?qx ; rt:qy ?qy ; rt:qz ?qz ; rt:qw ?qw"


def _grasp_part(which: str, of_class: str, orientation: str) -> str:
    """Return the pattern of grasps whose pose states its orientation in one of two ways."""
    return f"""{which}
    ?object rt:hasGrasp ?grasp . ?grasp rt:gripperType ?gripper ; rt:graspPose ?pose .
    ?pose rt:inFrame ?frame ; rt:x ?x ; rt:y ?y ; rt:z ?z ; {orientation} .
    ?owner rt:bodyFrame ?frame
    OPTIONAL {{ ?object rt:extentX ?length ; rt:extentY ?width ; rt:extentZ ?height }}
    OPTIONAL {{ ?grasp rt:jawOpening ?opening }} OPTIONAL {{ ?grasp rt:graspQuality ?quality }}
    OPTIONAL {{ ?grasp rt:contactWidth ?contact }}
    BIND("grasp" AS ?part) BIND({of_class} AS ?of_class)"""


def _contact_part(which: str, of_class: str) -> str:
    """Return the pattern of places at which cups and fingers touch."""
    return f"""{which}
    ?object rt:hasGrasp ?grasp . ?grasp rt:hasContact ?touch ; a ?mode .
    ?touch rt:contactIndex ?number ; rt:x ?x ; rt:y ?y ; rt:z ?z ; rt:contactNormal ?normal .
    ?normal rt:dirX ?nx ; rt:dirY ?ny ; rt:dirZ ?nz
    OPTIONAL {{ ?touch rt:sealRadius ?seal }}
    FILTER(?mode IN (rt:SuctionGrasp, rt:ThreeFingerGrasp))
    BIND("contact" AS ?part) BIND({of_class} AS ?of_class)"""


def _tally_part(which: str, of_class: str, only_fast: bool, doubts: Mapping[str, float]) -> str:
    """Return the pattern that counts judged attempts: all, or those in the coarse physics.

    Those of each robot in doubt are counted apart, with the robot as ``?by``.
    """
    fast = '?outcome rt:hasFeedback ?feedback . ?feedback rt:preset "fast" .' if only_fast else ""
    name = "fast" if only_fast else "tally"
    robots = by = ""
    if doubts:
        silent, heard = (
            ", ".join(
                str(iri(robot)) for robot in sorted(doubts) if (doubts[robot] > 0) is is_heard
            )
            for is_heard in (False, True)
        )
        robots = "?attempt rt:performedBy ?robot"
        robots += f" FILTER(?robot NOT IN ({silent}))" if silent else ""
        if heard:
            robots, by = f'{robots} BIND(IF(?robot IN ({heard}), STR(?robot), "") AS ?by)', "?by"
    return f"""SELECT ("{name}" AS ?part) ({of_class} AS ?of_class) ?object ?grasp ?held ?lost {by}
      (COUNT(DISTINCT ?attempt) AS ?n) (MAX(?ended) AS ?latest)
    WHERE {{ {which} ?object rt:hasGrasp ?grasp . {fast} {JUDGED} {robots} {LOST} }}
    GROUP BY ?object ?grasp ?held ?lost {by}"""


def _trial_part(tracked: str, robot: str | None, orientation: str) -> str:
    """Return the pattern of one robot's attempts on one object."""
    return f"""VALUES ?object {{ {values([tracked])} }}
    ?object rt:hasGrasp ?grasp . ?grasp rt:graspPose ?pose .
    ?pose rt:x ?x ; rt:y ?y ; rt:z ?z ; {orientation} .
    ?attempt rt:performedBy {values([robot or _NOBODY])} ; rt:attemptNumber ?number .
    {JUDGED} {LOST} BIND(EXISTS {{ ?outcome rt:hasFeedback/rt:preset "fast" }} AS ?is_fast)
    BIND("trial" AS ?part)"""


def _view_part(views: Iterable[str]) -> str:
    """Return the pattern of the viewpoints and pictures of stored views."""
    return f"""VALUES ?view {{ {values(views)} }}
    OPTIONAL {{ ?view rt:viewpoint ?p . ?p rt:x ?x ; rt:y ?y ; rt:z ?z ;
      rt:qx ?qx ; rt:qy ?qy ; rt:qz ?qz ; rt:qw ?qw }}
    OPTIONAL {{ ?view rt:viewContent ?image . ?image a rt:ColorImage ; rt:hasBlob/rt:sha256 ?sha }}
    BIND("view" AS ?part)"""


def question_for(
    policy: Policy,
    seen: Observation,
    recognition: Recognition,
    tracked: str | None,
    gripper: StoredGripper | None,
    only: tuple[str, ...] = (),
) -> Question:
    """Return the question about an observation: its matches, its class, the robot's attempts."""
    objects = {match.object_iri for match in recognition.matches}
    kinds: set[str] = set()
    if recognition.accepted and not tracked:
        kinds.add(recognition.matches[0].class_iri)
    guess = seen.guess
    if guess is not None:
        kinds.add(guess[0].value)
    kinds -= {RT.ManipulableObject.value, ""}
    shape = seen.shape
    return Question(
        objects=tuple(sorted(objects | ({iri(tracked).value} if tracked else set()))),
        classes=tuple(sorted(kinds)) if gripper is not None else (),
        size=None if shape is None
        else (float(shape.length), float(shape.width), float(shape.height)),
        size_tolerance=policy.size_tolerance,
        tracked=tracked,
        robot=None if gripper is None else gripper.robot.value,
        views=tuple(sorted({m.view_iri for m in recognition.matches if m.view_iri})),
        only=only,
        doubtful=_doubtful(recognition, tracked, policy),
    )  # fmt: skip


def _doubtful(recognition: Recognition, tracked: str | None, policy: Policy) -> tuple[str, ...]:
    """Return the matches that weigh less as the object itself than as members of its class.

    Both together never weigh more than an outcome of the object itself.
    """
    most = 1 - policy.same_class
    others = recognition.matches[1:] if recognition.accepted else recognition.matches
    names = (m.object_iri for m in others if m.confidence < most)
    return tuple(sorted(name for name in names if name != tracked))
