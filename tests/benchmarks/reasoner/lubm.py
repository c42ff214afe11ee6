"""The Lehigh University Benchmark: its schema, data in its published proportions, its 14 queries.

Guo, Pan and Heflin 2005, "LUBM: a benchmark for OWL knowledge base systems". The numbers of things
are drawn from the published ranges, by a random stream of our own, so the counts of answers differ
from those published for the original generator; several follow from the numbers drawn.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass, field

from pyoxigraph import Literal, NamedNode, RdfFormat, parse

UB = "http://swat.cse.lehigh.edu/onto/univ-bench.owl#"
TYPE = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
Triple = tuple[NamedNode, NamedNode, NamedNode | Literal]

_PREFIXES = f"""
PREFIX ub: <{UB}> PREFIX owl: <http://www.w3.org/2002/07/owl#>
PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
"""
_BELOW = {
    "Person": "Employee Student TeachingAssistant ResearchAssistant GraduateStudent Director",
    "Employee": "Faculty AdministrativeStaff",
    "Faculty": "Professor Lecturer PostDoc",
    "Professor": "FullProfessor AssociateProfessor AssistantProfessor VisitingProfessor Dean Chair",
    "AdministrativeStaff": "ClericalStaff SystemsStaff",
    "Student": "UndergraduateStudent",
    "Organization": "University Department College Institute Program ResearchGroup",
    "Work": "Course Research",
    "Course": "GraduateCourse",
    "Publication": "Article Book Manual Software Specification UnofficialPublication",
    "Article": "ConferencePaper JournalArticle TechnicalReport",
}
_DEFINED = {
    "Employee": ("worksFor", "Organization"),
    "Student": ("takesCourse", "Course"),
    "TeachingAssistant": ("teachingAssistantOf", "Course"),
    "Chair": ("headOf", "Department"),
    "Director": ("headOf", "Program"),
}
_SIDES = {
    "advisor": ("Person", "Professor"),
    "degreeFrom": ("Person", "University"),
    "hasAlumnus": ("University", "Person"),
    "member": ("Organization", "Person"),
    "publicationAuthor": ("Publication", "Person"),
    "subOrganizationOf": ("Organization", "Organization"),
    "teacherOf": ("Faculty", "Course"),
    "teachingAssistantOf": ("TeachingAssistant", "Course"),
}

QUERIES = {
    1: "?x a ub:GraduateStudent ; ub:takesCourse <{d}GraduateCourse0>",
    2: "?x a ub:GraduateStudent . ?y a ub:University . ?z a ub:Department . ?x ub:memberOf ?z . "
    "?z ub:subOrganizationOf ?y . ?x ub:undergraduateDegreeFrom ?y",
    3: "?x a ub:Publication ; ub:publicationAuthor <{d}AssistantProfessor0>",
    4: "?x a ub:Professor ; ub:worksFor <{D}> ; ub:name ?a ; ub:emailAddress ?b ; ub:telephone ?c",
    5: "?x a ub:Person ; ub:memberOf <{D}>",
    6: "?x a ub:Student",
    7: "?x a ub:Student . ?y a ub:Course . <{d}AssociateProfessor0> ub:teacherOf ?y . "
    "?x ub:takesCourse ?y",
    8: "?x a ub:Student . ?y a ub:Department . ?x ub:memberOf ?y . "
    "?y ub:subOrganizationOf <{u}> . ?x ub:emailAddress ?z",
    9: "?x a ub:Student . ?y a ub:Faculty . ?z a ub:Course . ?x ub:advisor ?y . "
    "?x ub:takesCourse ?z . ?y ub:teacherOf ?z",
    10: "?x a ub:Student ; ub:takesCourse <{d}GraduateCourse0>",
    11: "?x a ub:ResearchGroup ; ub:subOrganizationOf <{u}>",
    12: "?x a ub:Chair . ?y a ub:Department . ?x ub:worksFor ?y . ?y ub:subOrganizationOf <{u}>",
    13: "?x a ub:Person . <{u}> ub:hasAlumnus ?x",
    14: "?x a ub:UndergraduateStudent",
}


def query(number: int) -> str:
    """Return the text of a query, about the first department of the first university."""
    where = QUERIES[number]
    for mark, value in (
        ("{D}", department(0, 0)),
        ("{d}", department(0, 0) + "/"),
        ("{u}", university(0)),
    ):
        where = where.replace(mark, value)
    return f"PREFIX ub: <{UB}> SELECT DISTINCT * {{ {where} }}"


def schema() -> list[Triple]:
    """Return the axioms of the ontology that bear on the queries."""
    lines = [_PREFIXES.replace("PREFIX ", "@prefix ").replace("> ", "> . ").replace(">\n", "> .\n")]
    for above, below in _BELOW.items():
        lines += [f"ub:{name} rdfs:subClassOf ub:{above} ." for name in below.split()]
    for name, (p, c) in _DEFINED.items():
        lines.append(
            f"ub:{name} owl:equivalentClass [ owl:intersectionOf ( ub:Person [ "
            f"owl:onProperty ub:{p} ; owl:someValuesFrom ub:{c} ] ) ] ."
        )
    lines.append(
        "ub:GraduateStudent rdfs:subClassOf [ owl:onProperty ub:takesCourse ; "
        "owl:someValuesFrom ub:GraduateCourse ] ."
    )
    for p, (domain, value) in _SIDES.items():
        lines.append(f"ub:{p} a owl:ObjectProperty ; rdfs:domain ub:{domain} .")
        lines.append(f"ub:{p} rdfs:range ub:{value} .")
    lines += [
        f"ub:{name}DegreeFrom rdfs:subPropertyOf ub:degreeFrom ."
        for name in ("undergraduate", "masters", "doctoral")
    ]
    lines += [
        "ub:worksFor rdfs:subPropertyOf ub:memberOf . ub:headOf rdfs:subPropertyOf ub:worksFor .",
        "ub:memberOf owl:inverseOf ub:member . ub:degreeFrom owl:inverseOf ub:hasAlumnus .",
        "ub:subOrganizationOf a owl:TransitiveProperty .",
    ]
    quads = parse("\n".join(lines), format=RdfFormat.TURTLE)
    return [(q.subject, q.predicate, q.object) for q in quads]  # type: ignore[misc]


def university(number: int) -> str:
    """Return the IRI of a university."""
    return f"http://www.University{number}.edu"


def department(of: int, number: int) -> str:
    """Return the IRI of a department of a university."""
    return f"http://www.Department{number}.University{of}.edu"


@dataclass
class Counts:
    """Answers that follow from the numbers drawn, by query."""

    answers: dict[int, int] = field(default_factory=lambda: dict.fromkeys((5, 6, 11, 12, 14), 0))


class Generator:
    """Draws universities from the published ranges.

    Parameters
    ----------
    seed
        Of the random stream.
    """

    def __init__(self, seed: int = 0) -> None:
        self._random = random.Random(seed)
        self.counts = Counts()

    def university(self, number: int, departments: int | None = None) -> Iterator[Triple]:
        """Yield the statements of one university, of its first departments only if so wanted."""
        drawn = self._random.randint(15, 25)
        yield _a(university(number), "University")
        for one in range(drawn if departments is None else departments):
            yield from self._department(number, one)

    def _department(self, number: int, at: int) -> Iterator[Triple]:
        here, draw, answers = department(number, at), self._random, self.counts.answers
        first, in_first = number == 0 and at == 0, number == 0
        yield _a(here, "Department")
        yield _p(here, "subOrganizationOf", university(number))
        groups = draw.randint(10, 20)
        for n in range(groups):
            yield _a(f"{here}/ResearchGroup{n}", "ResearchGroup")
            yield _p(f"{here}/ResearchGroup{n}", "subOrganizationOf", here)
        answers[11] += groups * in_first
        answers[12] += in_first
        faculty: list[tuple[str, str]] = []
        for kind, low, high in (
            ("FullProfessor", 7, 10), ("AssociateProfessor", 10, 14),
            ("AssistantProfessor", 8, 11), ("Lecturer", 5, 7),
        ):  # fmt: skip
            faculty += [(f"{here}/{kind}{n}", kind) for n in range(draw.randint(low, high))]
        courses: dict[str, list[str]] = {"Course": [], "GraduateCourse": []}
        for name, kind in faculty:
            yield from self._member(name, kind, here, "worksFor")
            for degree in ("undergraduate", "masters", "doctoral"):
                yield _p(name, f"{degree}DegreeFrom", university(draw.randrange(1000)))
            for course_kind, given in courses.items():
                for _ in range(draw.randint(1, 2)):
                    course = f"{here}/{course_kind}{len(given)}"
                    given.append(course)
                    yield _a(course, course_kind)
                    yield _p(name, "teacherOf", course)
        yield _p(faculty[0][0], "headOf", here)
        undergraduates = len(faculty) * draw.randint(8, 14)
        graduates = len(faculty) * draw.randint(3, 4)
        professors = [name for name, kind in faculty if kind != "Lecturer"]
        for n in range(undergraduates):
            name = f"{here}/UndergraduateStudent{n}"
            yield from self._member(name, "UndergraduateStudent", here, "memberOf")
            for course in draw.sample(courses["Course"], draw.randint(2, 4)):
                yield _p(name, "takesCourse", course)
            if n % 5 == 0:
                yield _p(name, "advisor", draw.choice(professors))
        for n in range(graduates):
            name = f"{here}/GraduateStudent{n}"
            yield from self._member(name, "GraduateStudent", here, "memberOf")
            yield _p(name, "undergraduateDegreeFrom", university(draw.randrange(1000)))
            yield _p(name, "advisor", draw.choice(professors))
            for course in draw.sample(courses["GraduateCourse"], draw.randint(1, 3)):
                yield _p(name, "takesCourse", course)
            if n % 5 == 0:
                yield _p(name, "teachingAssistantOf", draw.choice(courses["Course"]))
            elif n % 4 == 0:
                yield _a(name, "ResearchAssistant")
        answers[5] += (len(faculty) + undergraduates + graduates) * first
        answers[6] += undergraduates + graduates
        answers[14] += undergraduates
        for name, kind in faculty:
            low, high = {"FullProfessor": (15, 20), "AssociateProfessor": (10, 18),
                         "AssistantProfessor": (5, 10), "Lecturer": (0, 5)}[kind]  # fmt: skip
            for n in range(draw.randint(low, high)):
                paper = f"{name}/Publication{n}"
                yield _a(paper, "Publication")
                yield _p(paper, "publicationAuthor", name)

    def _member(self, name: str, kind: str, here: str, link: str) -> Iterator[Triple]:
        short = name.rpartition("/")[2]
        yield _a(name, kind)
        yield _p(name, link, here)
        yield NamedNode(name), NamedNode(UB + "name"), Literal(short)
        yield NamedNode(name), NamedNode(UB + "emailAddress"), Literal(f"{short}@{here[7:]}")
        yield NamedNode(name), NamedNode(UB + "telephone"), Literal("xxx-xxx-xxxx")


def _a(name: str, kind: str) -> Triple:
    return NamedNode(name), TYPE, NamedNode(UB + kind)


def _p(name: str, predicate: str, value: str) -> Triple:
    return NamedNode(name), NamedNode(UB + predicate), NamedNode(value)
