"""``rtask ontology``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import data_option, json_option, open_to_read, print_json

if TYPE_CHECKING:
    from rtask.ontology_docs import Module, Term, Vocabulary

_LOADED = """
PREFIX owl: <http://www.w3.org/2002/07/owl#>
SELECT ?ontology ?version ?statements {
  ?ontology a rt:OntologyGraph ; rt:tripleCount ?statements .
  OPTIONAL { ?ontology owl:versionInfo ?version }
} ORDER BY ?ontology
"""
_BREAKING = 3

source_option = click.option(
    "--source",
    default="bundled",
    show_default=True,
    help="A file, a folder, a knowledge base's folder, or 'bundled': the ontology of RTASK.",
)


@click.group()
def ontology() -> None:
    """Ontologies: print, document, compare; which are loaded, where they lie."""


@ontology.command("list")
@data_option
@json_option
def list_loaded(data: Path, as_json: bool) -> None:
    """List the ontologies of a knowledge base."""
    import ontology as vocabulary
    from rtask.rdf.terms import prologue

    with open_to_read(data) as kb:
        rows = kb.select(prologue({"rt": vocabulary.NS}) + _LOADED).to_dicts()
    if as_json:
        print_json(rows)
        return
    for row in rows:
        version = row["version"] or "-"
        click.echo(f"{row['statements']:6d}  {version:8s}  {row['ontology']}")


@ontology.command()
@click.argument("iri")
def path(iri: str) -> None:
    """Print the file of an ontology that comes with RTASK."""
    from rtask.errors import UnknownTermError
    from rtask.loader.catalogue import OntologyCatalogue

    found = OntologyCatalogue().find(iri)
    if found is None:
        raise UnknownTermError(f"{iri} does not come with RTASK")
    click.echo(str(found))


@ontology.command()
@click.argument("name", required=False)
@source_option
@json_option
def show(name: str | None, source: str, as_json: bool) -> None:
    """Print the modules, the terms of a module, or what is said of a term.

    NAME is a module ("grasp"), a term ("Mug", "rt:mass", an IRI), or nothing for all modules.
    """
    from rtask.ontology_docs import Vocabulary, read_source

    vocabulary = Vocabulary(read_source(source))
    module = vocabulary.module(name) if name else None
    if name is None:
        facts: Any = [_module_facts(vocabulary, m) for m in vocabulary.modules]
        lines = [f"{f['terms']:5d}  {f['version']:7s} {f['name']:28s} {f['title']}" for f in facts]
    elif module is not None:
        members = vocabulary.members(module)
        facts = _module_facts(vocabulary, module) | {"members": [t.iri for t in members]}
        lines = [f"{module.title} {module.version}", module.comment, ""]
        lines += [f"{t.name:34s} {t.kinds[0]:18s} {t.comment or t.label}" for t in members]
    else:
        facts = _term_facts(vocabulary, vocabulary.find(name))
        lines = _term_lines(facts)
    if as_json:
        print_json(facts)
    else:
        click.echo("\n".join(lines))


def _module_facts(vocabulary: Vocabulary, module: Module) -> dict[str, Any]:
    return {
        "name": module.name,
        "iri": module.iri,
        "title": module.title,
        "version": module.version,
        "comment": module.comment,
        "terms": len(vocabulary.members(module)),
    }


def _term_facts(vocabulary: Vocabulary, term: Term) -> dict[str, Any]:
    from rtask.ontology_docs.source import prefixed

    return {
        "iri": term.iri,
        "name": term.name,
        "kinds": list(term.kinds),
        "module": term.module,
        "label": term.label,
        "comment": term.comment,
        "unit": term.unit,
        "deprecated": term.deprecated,
        "axioms": [str(axiom) for axiom in term.axioms],
        "below": [prefixed(iri) for iri in vocabulary.below(term.iri)],
        "used by": [str(axiom) for axiom in vocabulary.used_by(term.iri)],
        "examples": vocabulary.examples(term.iri),
    }


def _term_lines(facts: dict[str, Any]) -> list[str]:
    old = "  (deprecated)" if facts["deprecated"] else ""
    lines = [f"{facts['name']}  {facts['label']!r}  {', '.join(facts['kinds'])}{old}"]
    lines += [facts["comment"], f"<{facts['iri']}>  in {facts['module']}"]
    lines += [f"unit  {facts['unit']}"] if facts["unit"] else []
    for heading in ("axioms", "below", "used by", "examples"):
        if facts[heading]:
            lines += ["", f"{heading}:", *(f"  {line}" for line in facts[heading])]
    return lines


@ontology.command()
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True)
@source_option
@json_option
def docs(out: Path, source: str, as_json: bool) -> None:
    """Write one self-contained HTML page a module, with diagrams, and an index."""
    from rtask.ontology_docs import Vocabulary, read_source, write_pages

    files = write_pages(Vocabulary(read_source(source)), out)
    if as_json:
        print_json([str(file) for file in files])
    else:
        click.echo(f"{len(files)} pages, begin with {out / 'index.html'}")


@ontology.command()
@click.argument("old")
@click.argument("new", default="bundled")
@json_option
def diff(old: str, new: str, as_json: bool) -> None:
    """Compare two versions of ontologies: terms and axioms that came or went.

    OLD and NEW are files, folders, a knowledge base's folder, or "bundled" (NEW's default).
    A knowledge base is compared with what one loads. Exit code 3 if data or queries that fit OLD
    may not fit NEW.
    """
    from rtask.ontology_docs.difference import comparable, compare
    from rtask.ontology_docs.source import read_source

    found = compare(*comparable(read_source(old), read_source(new), (old, new)))
    if as_json:
        print_json(found.to_dict())
    else:
        click.echo("\n".join(found.lines()))
    if found.is_breaking:
        raise click.exceptions.Exit(_BREAKING)
