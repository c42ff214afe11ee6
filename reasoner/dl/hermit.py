"""OWL 2 DL with HermiT: consistency, unsatisfiable classes, classification.

For ontologies and small extracts, never for a commit: a tableau has no bound on its time. The jar
comes with owlready2; it is run directly, because owlready2's own reading of the answer fails on
undeclared properties (Glimm et al. 2014, "HermiT: An OWL 2 Reasoner").
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import BlankNode, NamedNode, RdfFormat, serialize
from pyoxigraph import Triple as RdfTriple

from reasoner.terms.dictionary import Term, Triple
from reasoner.terms.vocabulary import OWL, RDF

_TYPE = NamedNode(RDF + "type")
_REIFIES = NamedNode(RDF + "reifies")
_ONTOLOGY, _IMPORTS, _AXIOM = (NamedNode(OWL + n) for n in ("Ontology", "imports", "Axiom"))
_NOTHING = OWL + "Nothing"
_MAIN = "org.semanticweb.HermiT.cli.CommandLine"
_LINE = re.compile(r"^(\w+)\( (.+) \)$", re.MULTILINE)
_TERM = re.compile(r"<([^>]*)>")


class DLUnavailableError(RuntimeError):
    """HermiT cannot run here; the message says what to install."""


class DLError(RuntimeError):
    """HermiT ran and gave no answer: unreadable ontology, time or memory used up."""


@dataclass(frozen=True)
class Axiom:
    """One line of a classification, such as SubClassOf of two IRIs."""

    kind: str
    terms: tuple[str, ...]


@dataclass(frozen=True)
class DLReport:
    """Report of HermiT.

    Attributes
    ----------
    is_consistent : bool
    unsatisfiable : tuple of str
        Classes that cannot have members, except owl:Nothing.
    axioms : tuple of Axiom
        Hierarchies and types, if a classification was requested.
    """

    is_consistent: bool
    unsatisfiable: tuple[str, ...] = ()
    axioms: tuple[Axiom, ...] = ()


def check(
    triples: Iterable[Triple],
    classify: bool = False,
    timeout_s: float = 120,
    memory_mb: int = 2000,
) -> DLReport:
    """Check triples for consistency and unsatisfiable classes under OWL 2 DL.

    Parameters
    ----------
    triples : iterable of Triple
        Ontology and data together; imports are not followed.
    classify : bool
        Also return the hierarchies of classes and properties and the types of individuals.
    timeout_s : float
        For each of the two runs.
    memory_mb : int
        Heap of the Java machine.

    Raises
    ------
    DLUnavailableError
        If Java or the jar is missing.
    DLError
        If there is no answer.
    """
    # Two runs: of an inconsistent ontology HermiT has no classification, and tells both apart by
    # its output only.
    java, jar = find_java(), find_jar()
    with ontology_file(triples, "ontology.nt") as path:
        command = [java, f"-Xmx{memory_mb}M", "-cp", f"{jar.parent}:{jar}", _MAIN]
        code, output = run_java([*command, "-k", path.as_uri()], timeout_s)
        if "InconsistentOntologyException" in output:
            return DLReport(is_consistent=False)
        if code != 0 or "is satisfiable" not in output:
            raise DLError(f"HermiT gave no answer: {reason_in(output)}")
        answer = path.with_name("answer")
        options = ["-c", "-O", "-D", "-I"] if classify else ["-c"]
        code, output = run_java([*command, *options, "-o", str(answer), path.as_uri()], timeout_s)
        if code != 0 or not answer.exists():
            raise DLError(f"HermiT did not classify: {reason_in(output)}")
        axioms = tuple(_read(answer.read_text(encoding="utf-8")))
    return DLReport(True, _unsatisfiable(axioms), axioms if classify else ())


def find_java() -> str:
    """Return the Java command.

    Raises
    ------
    DLUnavailableError
        If there is none.
    """
    java = shutil.which("java")
    if java is None:
        raise DLUnavailableError(
            "OWL 2 DL needs Java, which is not installed; apt-get install default-jre-headless"
        )
    return java


def find_jar(name: str = "hermit/HermiT.jar") -> Path:
    """Return a jar in the installed owlready2.

    Raises
    ------
    DLUnavailableError
        If owlready2 or the jar is missing.
    """
    spec = importlib.util.find_spec("owlready2")
    jar = Path(spec.origin).parent / name if spec and spec.origin else None
    if jar is None or not jar.exists():
        raise DLUnavailableError("OWL 2 DL needs the package owlready2; pip install owlready2")
    return jar


@contextlib.contextmanager
def ontology_file(triples: Iterable[Triple], name: str) -> Iterator[Path]:
    """Write triples to a temporary file for Java reasoners, removed at the end of the block.

    Raises
    ------
    DLError
        If the folder for temporary files has a space in its name.
    """
    with tempfile.TemporaryDirectory(prefix="rtask-dl-") as folder:
        path = Path(folder).resolve() / name
        if " " in str(path):
            raise DLError(f"HermiT and Pellet take no path with a space: {path}; set TMPDIR")
        path.write_bytes(_prepare(triples))
        yield path


def _prepare(triples: Iterable[Triple]) -> bytes:
    """Return one N-Triples document that HermiT reads: no imports, one header, no annotations.

    Statements about statements are left out, both OWL's (``owl:Axiom``) and those of RDF 1.2
    (``rdf:reifies``), because HermiT's parser does not know triple terms.
    """
    unreified = set(triples)
    reified = {s for s, p, o in unreified if p == _REIFIES or (p == _TYPE and o == _AXIOM)}
    headers = {s for s, p, o in unreified if p == _TYPE and o == _ONTOLOGY}
    lines = [
        RdfTriple(s, p, o)
        for s, p, o in unreified
        if p != _IMPORTS
        and s not in reified
        and s not in headers
        and not _is_triple_term(o)
        and isinstance(s, NamedNode | BlankNode)
        and isinstance(p, NamedNode)
    ]
    lines.append(RdfTriple(NamedNode("urn:rtask:merged"), _TYPE, _ONTOLOGY))
    return serialize(lines, format=RdfFormat.N_TRIPLES) or b""


def _is_triple_term(value: object) -> bool:
    """Whether this is a triple term of RDF 1.2, which callers may pass although OWL 2 has none."""
    return isinstance(value, RdfTriple)


def run_java(command: list[str], timeout_s: float) -> tuple[int, str]:
    """Run Java; return its exit code and its output.

    Raises
    ------
    DLError
        If it did not finish in time; the process has then been killed.
    """
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        # Its own group, so that killing it takes along what Java started.
        start_new_session=True,
    ) as java:
        try:
            output, _ = java.communicate(timeout=timeout_s)
        # Also on Ctrl-C: Java would go on computing for hours.
        except BaseException as error:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(java.pid, signal.SIGKILL)
            java.wait()
            if isinstance(error, subprocess.TimeoutExpired):
                raise DLError(
                    f"no answer within {timeout_s:g} s, stopped; "
                    "give it more time, or a smaller part of the ontology"
                ) from error
            raise
    return java.returncode, output


def reason_in(output: str) -> str:
    """Return the first line of the output that is not part of a stack trace."""
    lines = [line for line in output.splitlines() if line.strip() and "\tat " not in line]
    return lines[0].strip() if lines else "no output"


def _read(text: str) -> Iterator[Axiom]:
    for kind, terms in _LINE.findall(text):
        yield Axiom(kind, tuple(_TERM.findall(terms)))


def _unsatisfiable(axioms: Iterable[Axiom]) -> tuple[str, ...]:
    for axiom in axioms:
        if axiom.kind == "EquivalentClasses" and _NOTHING in axiom.terms:
            return tuple(term for term in axiom.terms if term != _NOTHING)
    return ()


def subclasses(report: DLReport) -> Iterator[tuple[Term, Term]]:
    """Yield the pairs of class and direct superclass in a classification."""
    for axiom in report.axioms:
        if axiom.kind == "SubClassOf":
            below, above = axiom.terms
            yield NamedNode(below), NamedNode(above)


def hierarchy(report: DLReport) -> frozenset[tuple[str, str]]:
    """Return all pairs of class and superclass that a classification implies.

    Left out are owl:Thing, owl:Nothing and what is below it, and a class as its own superclass.
    """
    above: dict[str, set[str]] = {}
    for axiom in report.axioms:
        if axiom.kind == "SubClassOf":
            above.setdefault(axiom.terms[0], set()).add(axiom.terms[1])
        elif axiom.kind == "EquivalentClasses":
            for name in axiom.terms:
                above.setdefault(name, set()).update(axiom.terms)
    # Unsatisfiable classes are below every class, which says nothing about these.
    apart = {_NOTHING, OWL + "Thing", *report.unsatisfiable}
    pairs: set[tuple[str, str]] = set()
    for name in above.keys() - apart:
        seen, queue = {name}, [name]
        while queue:
            for upper in above.get(queue.pop(), set()) - seen - apart:
                seen.add(upper)
                queue.append(upper)
        pairs.update((name, upper) for upper in seen - {name})
    return frozenset(pairs)
