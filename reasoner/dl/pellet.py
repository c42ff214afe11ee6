"""OWL 2 DL with Pellet: a second opinion on consistency, unsatisfiable classes, classification.

The jars come with owlready2. Pellet is run with its OWL API loader: the one that owlready2 takes
needs a Java newer than most systems have (Sirin et al. 2007, "Pellet").
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from reasoner.dl.hermit import (
    Axiom,
    DLError,
    DLReport,
    find_jar,
    find_java,
    ontology_file,
    reason_in,
    run_java,
)
from reasoner.terms.dictionary import Triple
from reasoner.terms.vocabulary import OWL

_INCONSISTENT = "Ontology is inconsistent"
_NOTHING, _THING = OWL + "Nothing", OWL + "Thing"


def check(
    triples: Iterable[Triple],
    classify: bool = False,
    timeout_s: float = 120,
    memory_mb: int = 2000,
) -> DLReport:
    """Check triples as :func:`reasoner.dl.hermit.check` does; the axioms are about classes only.

    Raises
    ------
    DLUnavailableError
        If Java or the jars are missing.
    DLError
        If there is no answer.
    """
    java, jar = find_java(), find_jar("pellet/pellet-2.3.1.jar")
    jars = ":".join(map(str, sorted(jar.parent.glob("*.jar"))))
    with ontology_file(triples, "ontology.ttl") as path:
        command = [java, f"-Xmx{memory_mb}M", "-cp", jars, "pellet.Pellet", "classify"]
        options = ["--loader", "OWLAPIv3", "--ignore-imports", path.as_uri()]
        code, output = run_java([*command, *options], timeout_s)
    if _INCONSISTENT in output:
        return DLReport(is_consistent=False)
    if code != 0 or _THING not in output:
        raise DLError(f"Pellet gave no answer: {reason_in(output)}")
    axioms = tuple(dict.fromkeys(read_tree(output)))
    unsatisfiable = tuple(
        name
        for axiom in axioms
        if axiom.kind == "EquivalentClasses" and _NOTHING in axiom.terms
        for name in axiom.terms
        if name != _NOTHING
    )
    return DLReport(True, unsatisfiable, axioms if classify else ())


def read_tree(output: str) -> Iterator[Axiom]:
    """Read a hierarchy from lines indented by depth, equivalent classes joined by ` = `.

    >>> [a.terms for a in read_tree(" urn:A = urn:B\\n    urn:C\\n")]
    [('urn:A', 'urn:B'), ('urn:C', 'urn:A')]
    """
    above: list[tuple[int, str]] = []
    for line in output.splitlines():
        names = line.strip().split(" = ")
        depth = len(line) - len(line.lstrip(" "))
        if not depth or any(":" not in name or " " in name for name in names):
            continue
        if len(names) > 1:
            yield Axiom("EquivalentClasses", tuple(names))
        while above and above[-1][0] >= depth:
            above.pop()
        if above and above[-1][1] != _THING:
            yield Axiom("SubClassOf", (names[0], above[-1][1]))
        above.append((depth, names[0]))
