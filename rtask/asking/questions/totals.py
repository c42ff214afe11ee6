"""Questions for a total: "how many attempts were there?" asks for one number of the whole graph.

The ontology's questions count for each robot, object or kind. Adding up what they count gives
another number: what was attempted with a thing that never was held, say, is in none of their rows.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from rtask.asking.questions.filling import with_prefixes
from rtask.asking.questions.mentions import Select
from rtask.sparql.results import Solutions

__all__ = ["BY_KIND", "TOTAL", "Part", "Total", "counted_in", "counts_attempts", "total"]

TOTAL = "total"
BY_KIND = "cq26"
"""The ontology's question for the robots and objects of each kind, whose rows tell more."""
_COUNTED = {
    "attempts": ("rt:GraspAttempt", "attempt to grasp", "attempts to grasp"),
    "objects": ("rt:ManipulableObject", "object", "objects"),
    "robots": ("cora:Robot", "robot", "robots"),
    "grasps": ("rt:GraspConfiguration", "grasp", "grasps"),
    "tasks": ("rt:Task", "task", "tasks"),
    "places": ("rt:SupportSurface", "place", "places"),
    "refusals": ("rt:GraspRefusal", "refusal to grasp", "refusals to grasp"),
    "recognitions": ("rt:RecognitionResult", "recognition", "recognitions"),
    "hidden causes": ("rt:HiddenCause", "hidden cause", "hidden causes"),
}
_ALSO = {
    "grasp attempts": "attempts", "grasping attempts": "attempts", "attempts to grasp": "attempts",
    "attempts at grasping": "attempts", "tries": "attempts", "trials": "attempts",
    "manipulable objects": "objects", "known objects": "objects", "known robots": "robots",
    "known grasps": "grasps", "grasp configurations": "grasps",
}  # fmt: skip
# The whole text has to match: any word beyond ("... for the mug", "... failed") asks for a part.
_ASKS = re.compile(
    r"(?:(?:so|and|ok|okay|please|now|then)\b[,\s]*)*"
    r"(?:how many|(?:what(?: is|'s) )?(?:the )?(?:total )?number of(?: all)?|"
    r"count(?: all)?(?: the)?)"
    r" (?P<noun>[a-z]+(?: [a-z]+){0,2}?)"
    r"(?: (?:(?:are|were) (?:there|known|stored|recorded|made)|(?:have|had) there been|"
    r"(?:have|had) been (?:made|recorded|stored)|exist|"
    r"(?:do|does|has|have) (?:you|we|it|the graph|the store) (?:know|have|hold|store)(?: of)?))?"
    r"(?: (?:in (?:total|all|(?:this|the) (?:graph|store))|altogether|overall|so far))*\s*[?.!]*",
    re.I,
)
# "... for the mug", "... by nao", "... did nao make": the total of a part.
_PART = re.compile(
    r"(?:how many|(?:the )?number of) (?:grasp(?:ing)? )?(?:attempts|tries|trials)"
    r"(?: (?:were|was|are) (?:there|made|known))?"
    r"(?: (?:for|at|on|with|of|by|from) [^,;:?.!]{1,60}"
    r"| (?:did|has|have) [^,;:?.!]{1,60} (?:make|made)"
    r"(?: (?:for|at|on|with) [^,;:?.!]{1,60})?)"
    r"\s*[?.!]*",
    re.I,
)
_NEEDED = re.compile(
    r"\b(?:need|until|till|before|after|first|held?|holds?|fail\w*|lost|succe\w*)\b", re.I
)
_QUERY = "SELECT (COUNT(DISTINCT ?thing) AS ?count) WHERE {\n  ?thing a $class\n}"
_QUERIES = {
    "attempts": """SELECT (COUNT(DISTINCT ?attempt) AS ?count) (COUNT(DISTINCT ?good) AS ?held)
  (COUNT(DISTINCT ?bad) AS ?failed)
  (COUNT(DISTINCT ?attempt) - COUNT(DISTINCT ?judged) AS ?open)
WHERE {
  ?attempt a $class
  OPTIONAL { ?attempt rt:hasOutcome/rt:success ?success BIND(?attempt AS ?judged) }
  OPTIONAL { ?attempt rt:hasOutcome/rt:success true BIND(?attempt AS ?good) }
  OPTIONAL { ?attempt rt:hasOutcome/rt:success false BIND(?attempt AS ?bad) }
}""",
    # A single thing is an object, too; counted with its product, one carton would be two objects.
    "objects": """SELECT (COUNT(DISTINCT ?thing) - COUNT(DISTINCT ?one) AS ?count)
  (COUNT(DISTINCT ?one) AS ?single)
WHERE {
  ?thing a $class
  OPTIONAL { ?thing a rt:Exemplar BIND(?thing AS ?one) }
}""",
}


@dataclass(frozen=True)
class Total:
    """The number of all things of a sort that the graph knows.

    Parameters
    ----------
    understood
        The question in full.
    sparql, rows
        Its query, and the one row of its answer.
    count
        How many there are.
    sentence
        The answer in words.
    """

    understood: str
    sparql: str
    rows: Solutions
    count: int
    sentence: str


@dataclass(frozen=True)
class Part:
    """What attempts are counted of.

    Parameters
    ----------
    objects, robots
        IRIs as SPARQL writes them, none for any.
    kinds
        Classes of objects, where no single one is named.
    words
        Such as ``at the mug by nao``.
    """

    objects: tuple[str, ...]
    robots: tuple[str, ...]
    kinds: tuple[str, ...]
    words: str

    @property
    def pattern(self) -> str:
        """What restricts ``?attempt`` to it."""
        text = ""
        if self.objects:
            text += (
                f"  VALUES ?of {{ {' '.join(self.objects)} }}\n"
                "  FILTER EXISTS { { ?task rt:through ?attempt ; rt:handles ?of } UNION\n"
                "    { ?attempt rt:executesGrasp/rt:graspOf ?of } }\n"
            )
        elif self.kinds:
            text += (
                f"  VALUES ?kind {{ {' '.join(self.kinds)} }}\n"
                "  FILTER EXISTS { { ?task rt:through ?attempt ; rt:handles/a ?kind } UNION\n"
                "    { ?attempt rt:executesGrasp/rt:graspOf/a ?kind } }\n"
            )
        if self.robots:
            text += f"  VALUES ?by {{ {' '.join(self.robots)} }}\n  ?attempt rt:performedBy ?by .\n"
        return text


def counted_in(text: str) -> str | None:
    """Return the noun whose total a question asks for, or None if it asks for something else.

    >>> counted_in("How many grasp attempts were there in total?"), counted_in("number of robots")
    ('attempts', 'robots')
    >>> counted_in("How many attempts did nao make?") is None
    True
    """
    match = _ASKS.fullmatch(" ".join(text.split()))
    noun = match["noun"].lower() if match else ""
    noun = _ALSO.get(noun, noun)
    return noun if noun in _COUNTED else None


def counts_attempts(text: str) -> bool:
    """Return whether a question asks how many attempts there were at a thing, or by a robot.

    >>> counts_attempts("How many attempts for the mug?"), counts_attempts("how many attempts?")
    (True, False)
    >>> counts_attempts("How many attempts did nao need for the mug?")
    False
    """
    text = " ".join(text.split())
    return _PART.fullmatch(text) is not None and _NEEDED.search(text) is None


def total(select: Select, noun: str, part: Part | None = None) -> Total:
    """Return the number of all things that a noun of :func:`counted_in` stands for.

    Parameters
    ----------
    part
        Of what or of whom the attempts are counted; all by default.
    """
    cls, one, many = _COUNTED[noun]
    text = _QUERIES.get(noun, _QUERY).replace("$class", cls)
    if part is not None:
        text = text.replace(f"?attempt a {cls}\n", f"?attempt a {cls}\n{part.pattern}", 1)
        one, many = f"{one} {part.words}", f"{many} {part.words}"
    sparql = with_prefixes(text)
    rows = select(sparql)
    numbers = {name: int(str(rows[0].value(name))) for name in rows.variables}
    count = numbers["count"]
    words = f"{count} {one if count == 1 else many} {'is' if count == 1 else 'are'} known"
    if not count:
        words = f"No {one} is known, which does not mean that there is none"
    elif noun == "attempts":
        held, failed = numbers["held"], numbers["failed"]
        words += f": {held} held, {failed} failed"
        # An attempt without an outcome neither held nor failed as far as is known.
        words += f", of {numbers['open']} the outcome is not known" if numbers["open"] else ""
    elif numbers.get("single"):
        single = numbers["single"]
        words += f", and {single} exemplar{'s' * (single != 1)} of them (single things)"
    return Total(f"How many {many} are known?", sparql, rows, count, f"{words}.")
