"""The vocabulary is consistent, and contradictions planted in the sample are found.

HermiT (Glimm et al. 2014) decides with all axioms; the OWL 2 RL closure finds what its rules can
see. HermiT comes with owlready2 and is called as a program.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
from collections.abc import Callable, Iterable
from pathlib import Path

import pyoxigraph as ox
import pytest

import ontology
import reasoner

Triples = list[tuple[ox.NamedNode | ox.BlankNode, ox.NamedNode, object]]

OWL = "http://www.w3.org/2002/07/owl#"
PREFIXES = "".join(f"@prefix {p}: <{iri}> .\n" for p, iri in ontology.PREFIXES.items())
PREFIXES += f"@prefix : <{ontology.BASE}sample/> .\n"


def _parse(paths: Iterable[Path]) -> Triples:
    return [
        (q.subject, q.predicate, q.object)
        for path in paths
        for q in ox.parse(path.read_bytes(), format=_format(path), rename_blank_nodes=True)
    ]


def _format(path: Path) -> ox.RdfFormat:
    return ox.RdfFormat.RDF_XML if path.suffix == ".owl" else ox.RdfFormat.TURTLE


def _turtle(text: str) -> Triples:
    quads = ox.parse(PREFIXES + text, format=ox.RdfFormat.TURTLE)
    return [(q.subject, q.predicate, q.object) for q in quads]


class Hermit:
    """HermiT's command line on one merged file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        spec = importlib.util.find_spec("owlready2")
        assert spec is not None
        assert spec.origin is not None
        home = Path(spec.origin).parent / "hermit"
        if shutil.which("java") is None:
            pytest.skip("HermiT needs Java")
        classes = f"{home}:{home / 'HermiT.jar'}"
        program = "org.semanticweb.HermiT.cli.CommandLine"
        # Of a run of two seconds, the optimising compiler and threads of the collector take half.
        quick = ("-XX:TieredStopAtLevel=1", "-XX:+UseSerialGC")
        self.command = ["java", "-Xmx2000M", *quick, "-cp", classes, program]

    def ask(self, option: str, triples: Triples) -> subprocess.CompletedProcess[str]:
        """Run it without headers (an unreachable import aborts) and without axiom annotations."""
        annotated = {s for s, _, o in triples if getattr(o, "value", "") == OWL + "Axiom"}
        headers = {s for s, _, o in triples if getattr(o, "value", "") == OWL + "Ontology"}
        kept = [t for t in triples if t[0] not in annotated | headers]
        file = self.folder / "merged.nt"
        file.write_text("".join(f"{s} {p} {o} .\n" for s, p, o in kept))
        command = [*self.command, option, file.as_uri()]
        return subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)

    def is_consistent(self, triples: Triples) -> bool:
        answer = self.ask("-k", triples)
        if answer.returncode == 0 and "Thing is satisfiable" in answer.stdout:
            return True
        assert "InconsistentOntologyException" in answer.stdout + answer.stderr, answer.stderr
        return False


@pytest.fixture
def hermit(tmp_path: Path) -> Hermit:
    return Hermit(tmp_path)


@pytest.fixture(scope="module")
def all_axioms(schema: Triples) -> Triples:
    return schema + _parse([ontology.path("rtask/dl.ttl")])


@pytest.fixture(scope="module")
def facts(sample: list[ox.Quad]) -> Triples:
    return [(q.subject, q.predicate, q.object) for q in sample]


@pytest.mark.slow
def test_no_class_is_impossible(hermit: Hermit, all_axioms: Triples) -> None:
    answer = hermit.ask("-U", all_axioms)
    assert answer.returncode == 0, answer.stderr
    listed = answer.stdout.split("Classes equivalent to 'owl:Nothing':")[1].split()
    assert listed == ["owl:Nothing"]


@pytest.mark.slow
def test_the_sample_is_consistent(hermit: Hermit, all_axioms: Triples, facts: Triples) -> None:
    assert hermit.is_consistent(all_axioms + facts)


@pytest.mark.slow
def test_rule_results_are_consistent(
    hermit: Hermit,
    all_axioms: Triples,
    facts: Triples,
    closed,  # type: ignore[no-untyped-def]
) -> None:
    names = ("effectiveMass", "canGrasp", "canPerform", "currentPose", "judgedSuccess")
    derived = {ox.NamedNode(ontology.NS + name) for name in names}
    results = [t for t in closed.triples() if t[1] in derived]
    assert len(results) > 10
    assert hermit.is_consistent(all_axioms + facts + results)


@pytest.mark.slow
@pytest.mark.parametrize("extra", [(), ("cora-fullaxiom.owl",)], ids=["plain", "full axioms"])
def test_together_with_the_published_cora(
    extra: tuple[str, ...],
    hermit: Hermit,
    all_axioms: Triples,
    facts: Triples,
    ontologies_dir: Path,
) -> None:
    names = ("cora-bare", "sumo-cora", "corax", "rparts", "pos", "cora")
    folder = ontologies_dir / "cora"
    published = _parse([*(folder / f"{n}.owl" for n in names), *(folder / n for n in extra)])
    agent_robot = ontology.PREFIXES["cora"] + "agentRobot"
    unions = {
        o
        for s, p, o in published
        if getattr(s, "value", "") == ontology.PREFIXES["sumo"] + "PhysicalQuantity"
        and p.value == OWL + "disjointUnionOf"
    }
    patched = [
        (s, p, o)
        for s, p, o in published
        if o not in unions
        and not (getattr(s, "value", "") == agent_robot and p.value.endswith("subPropertyOf"))
    ]
    assert len(published) - len(patched) == 2
    assert hermit.is_consistent(all_axioms + facts + patched)


CLASHES = {
    "a task is no action": ":t1 a rt:Action .",
    "a spatial grasp is not planar": ":g1 a rt:PlanarGrasp .",
    "one outcome, one result": ":o1 rt:success false .",
    "a robot is no person": ":pr2 a rt:Human .",
    "one outcome, one reason": ":o1 rt:hasReason rt:reason_missed .",
    "agentRobot below sumo:agent": (
        "cora:agentRobot rdfs:subPropertyOf sumo:agent . :pr2 cora:agentRobot :mo1 ."
    ),
}
BEYOND_RL = {
    "confidence above 1": ":r0 rt:recognitionConfidence 1.5e0 .",
    "a grasp is planar or spatial": (
        ":g9 a rt:GraspConfiguration, [ owl:complementOf rt:PlanarGrasp ],"
        " [ owl:complementOf rt:SpatialGrasp ] ."
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("clash", {**CLASHES, **BEYOND_RL}.values(), ids=[*CLASHES, *BEYOND_RL])
def test_hermit_finds_a_planted_clash(
    clash: str, hermit: Hermit, all_axioms: Triples, facts: Triples
) -> None:
    kept = facts
    if "recognitionConfidence" in clash:
        kept = [t for t in facts if not t[1].value.endswith("recognitionConfidence")]
    assert not hermit.is_consistent(all_axioms + kept + _turtle(clash))


@pytest.fixture(scope="module")
def plant(schema: Triples, facts: Triples) -> Callable[[str], list[object]]:
    rules = [path.read_text() for path in ontology.rules()]
    closure = reasoner.Closure.build(schema, facts, rules=rules)

    def contradictions(clash: str) -> list[object]:
        staged = closure.stage(add=_turtle(clash), remove=[])
        try:
            return list(staged.contradictions)
        finally:
            staged.discard()

    return contradictions


@pytest.mark.parametrize("clash", CLASHES.values(), ids=CLASHES)
def test_the_closure_finds_a_planted_clash(
    clash: str, plant: Callable[[str], list[object]]
) -> None:
    assert plant(clash)
    assert not plant(':rover rt:name "other name" .')
