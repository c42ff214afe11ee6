"""``rtask ontology`` and ``rtask model``: look after ontologies, and generate Python classes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from rtask.cli.connection import open_graph, open_to_change
from rtask.cli.options import (
    announce_undo,
    data_option,
    json_option,
    listing_option,
    print_json,
    print_listing,
    resource,
    server_option,
    shown_parts,
    shown_rows,
)
from rtask.cli.progress import Working, announce_compilation

if TYPE_CHECKING:
    from rtask.ontology_docs import Module, Term, Vocabulary

_LOADED = """
PREFIX owl: <http://www.w3.org/2002/07/owl#>
SELECT ?ontology ?version ?statements {
  ?ontology a rt:OntologyGraph ; rt:tripleCount ?statements .
  OPTIONAL { ?ontology owl:versionInfo ?version }
} ORDER BY ?ontology
"""

source_option = click.option(
    "--source",
    default="bundled",
    show_default=True,
    metavar="SOURCE",
    help="A file, a folder, the folder of a knowledge base, or 'bundled' for RTASK's ontology.",
)


@click.group()
def ontology() -> None:
    """List, show, document, compare, upgrade and unload ontologies."""


@ontology.command("list")
@data_option
@server_option
@listing_option
@json_option
def list_loaded(data: Path, server: str | None, limit: int | None, as_json: bool) -> None:
    """List the ontologies that a knowledge base holds."""
    import ontology as vocabulary
    from rtask.rdf.terms import prologue

    with open_graph(data, server) as kb:
        loaded = kb.select(prologue({"rt": vocabulary.NS}) + _LOADED).to_dicts()

    def line(row: Mapping[str, Any]) -> str:
        return f"{row['statements']:6d}  {row['version'] or '-':8s}  {row['ontology']}"

    print_listing(loaded, limit, as_json, line, "no ontologies")


@ontology.command()
@click.argument("source", metavar="FILE | IRI")
@data_option
@click.option("--dry-run", is_flag=True, help="Say what would be done, and do nothing.")
@click.option("--no-migration", is_flag=True, help="Leave replaced terms in data as they are.")
@click.option("--no-patches", is_flag=True, help="Keep known faults of published ontologies.")
@click.option("--undo", is_flag=True, help="Take the last upgrade of the ontology IRI back.")
@listing_option
@json_option
def upgrade(
    source: str,
    data: Path,
    dry_run: bool,
    no_migration: bool,
    no_patches: bool,
    undo: bool,
    limit: int | None,
    as_json: bool,
) -> None:
    """Replace a loaded ontology by the version in FILE, and rewrite the data to its terms.

    Terms that the new version replaces (dcterms:isReplacedBy, dcterms:replaces, or deprecated and
    equivalent to another) are rewritten in all data. Terms that it removes without replacement are
    reported with the number of statements that use them. All is one commit; --undo takes it back.
    """
    from rtask.asking.terms import reader_of
    from rtask.ontology_docs.upgrading import undo_upgrade
    from rtask.ontology_docs.upgrading import upgrade as run

    with announce_compilation(), open_to_change(data) as kb:
        if undo:
            upgraded_iri = reader_of(kb).resource(source).value
            commit = undo_upgrade(kb, upgraded_iri)
            if as_json:
                print_json({"ontology": upgraded_iri, "commit": commit.seq})
            else:
                click.echo(f"undone: +{commit.added} -{commit.removed} statements")
                announce_undo("undo", str(commit.seq))
            return
        upgraded = run(
            kb, Path(source), migrate=not no_migration, dry_run=dry_run, patches=not no_patches
        )
    if as_json:
        facts = upgraded.to_dict()
        facts["difference"] = shown_parts(facts["difference"], limit, as_json)
        print_json(facts)
        return
    for line in shown_rows(upgraded.lines(), limit, as_json):
        click.echo(line)
    if upgraded.commit is not None:
        click.echo(f"commit {upgraded.commit.seq}")
        announce_undo("ontology", "upgrade", "--undo", upgraded.ontology)


@ontology.command()
@click.argument("iri")
@data_option
@click.option("--dry-run", is_flag=True, help="Say what uses it, and do nothing.")
@click.option("--force", is_flag=True, help="Unload it although it is in use.")
@listing_option
@json_option
def unload(
    iri: str, data: Path, dry_run: bool, force: bool, limit: int | None, as_json: bool
) -> None:
    """Remove an ontology from a knowledge base, with what follows from it.

    Refused while other ontologies import it or data use its terms, unless --force is given.
    """
    from rtask.asking.terms import reader_of
    from rtask.ontology_docs.unloading import unload as run

    with announce_compilation(), open_to_change(data) as kb:
        graph = reader_of(kb).resource(iri).value
        unloaded = run(kb, graph, force=force, dry_run=dry_run)
    used = shown_rows(list(unloaded.used.items()), limit, as_json, what="terms")
    if as_json:
        print_json({**unloaded.to_dict(), "used": dict(used)})
        return
    for importer in unloaded.importers:
        click.echo(f"imported by {importer}")
    for term, count in used:
        click.echo(f"{count} statements use {term}")
    click.echo(f"{'would remove' if dry_run else 'removed'} {unloaded.statements} statements")
    if unloaded.commit is not None:
        announce_undo("undo", str(unloaded.commit.seq))


@ontology.command()
@listing_option
@json_option
def patches(limit: int | None, as_json: bool) -> None:
    """List the known faults of published ontologies, which loading leaves out.

    `rtask load --no-patches` keeps them.
    """
    from rtask.loader.patches import patches as shipped_patches

    listed = shown_rows([patch.to_dict() for patch in shipped_patches()], limit, as_json)
    if as_json:
        print_json(listed)
        return
    for patch in listed:
        click.echo(f"{patch['name']}  {patch['ontology']} ({patch['edition']})")
        click.echo(f"  {patch['reason']}")
        for line in patch["removes"]:
            click.echo(f"  - {line}")


@ontology.command()
@click.argument("iri")
@json_option
def path(iri: str, as_json: bool) -> None:
    """Print where the file of a bundled ontology is, given its IRI or name ("grasp")."""
    from rtask.errors import UnknownTermError
    from rtask.loader.catalogue import OntologyCatalogue
    from rtask.ontology_docs import Vocabulary, read_source

    module = None if ":" in iri else Vocabulary(read_source("bundled")).module(iri)
    iri = resource(iri, "") if module is None else module.iri
    file = OntologyCatalogue().find(iri)
    if file is None:
        raise UnknownTermError(f"{iri} does not come with RTASK")
    if as_json:
        print_json({"iri": iri, "path": str(file)})
    else:
        click.echo(str(file))


@ontology.command()
@click.argument("name", required=False)
@source_option
@data_option
@server_option
@listing_option
@json_option
@click.pass_context
def show(
    context: click.Context,
    name: str | None,
    source: str,
    data: Path,
    server: str | None,
    limit: int | None,
    as_json: bool,
) -> None:
    """Show all modules, the terms of one, or the definition of a term.

    NAME is a module ("grasp") or a term ("Mug", "rt:mass", an IRI). Without it, all modules are
    listed. With --data or --server, show the card of a term: what it means, how that knowledge base
    uses it, and a query with it; without NAME, all classes and properties.
    """
    from rtask.ontology_docs import Vocabulary, read_source

    if server is not None or context.get_parameter_source("data") is ParameterSource.COMMANDLINE:
        _show_card(name, data, server, limit, as_json)
        return

    vocabulary = Vocabulary(read_source(source))
    module = vocabulary.module(name) if name else None
    if name is None:
        modules = shown_rows(vocabulary.modules, limit, as_json)
        facts: Any = [_module_facts(vocabulary, m) for m in modules]
        lines = [f"{f['terms']:5d}  {f['version']:7s} {f['name']:28s} {f['title']}" for f in facts]
    elif module is not None:
        members = shown_rows(vocabulary.members(module), limit, as_json)
        facts = _module_facts(vocabulary, module) | {"members": [t.iri for t in members]}
        lines = [f"{module.title} {module.version}", module.comment, ""]
        lines += [f"{t.name:34s} {t.kinds[0]:18s} {t.comment or t.label}" for t in members]
    else:
        facts = shown_parts(_term_facts(vocabulary, vocabulary.find(name)), limit, as_json)
        lines = _term_lines(facts)
    if as_json:
        print_json(facts)
    else:
        click.echo("\n".join(lines))


def _show_card(
    name: str | None, data: Path, server: str | None, limit: int | None, as_json: bool
) -> None:
    """Print the card of a term as a knowledge base uses it, or all its terms."""
    from dataclasses import asdict

    from rtask.asking.cards import card_of, find_term, list_terms

    with open_graph(data, server) as kb:
        if name is not None:
            card = card_of(kb.select, find_term(kb.select, name))
            facts: Any = card.to_dict()
            lines = card.lines()
        else:
            terms = shown_rows(list_terms(kb.select), limit, as_json)
            facts = [asdict(line) for line in terms]
            lines = [
                f"{line.term:40s} {line.kind:9s} {line.comment or line.label}" for line in terms
            ]
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
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder to write the pages to.",
)
@source_option
@json_option
def docs(out: Path, source: str, as_json: bool) -> None:
    """Write self-contained HTML pages, one for each module, with diagrams and an index."""
    from rtask.ontology_docs import Vocabulary, read_source, write_pages

    with Working("writing pages"):
        files = write_pages(Vocabulary(read_source(source)), out)
    if as_json:
        print_json([str(file) for file in files])
    else:
        click.echo(f"{len(files)} pages; start at {out / 'index.html'}")


@ontology.command()
@click.argument("old")
@click.argument("new", default="bundled")
@listing_option
@json_option
def diff(old: str, new: str, limit: int | None, as_json: bool) -> None:
    """Compare two versions of an ontology: terms and axioms that were added or removed.

    OLD and NEW are files, folders, the folder of a knowledge base, or "bundled" (the default of
    NEW). A knowledge base is compared with the ontologies that it would load. Exit code 1 if data
    or queries written for OLD may not fit NEW.
    """
    from rtask.ontology_docs.difference import comparable, compare
    from rtask.ontology_docs.source import read_source

    difference = compare(*comparable(read_source(old), read_source(new), (old, new)))
    if as_json:
        print_json(shown_parts(difference.to_dict(), limit, as_json))
    else:
        *lines, level = difference.lines()
        click.echo("\n".join([*shown_rows(lines, limit, as_json), level]))
    if difference.is_breaking:
        raise click.exceptions.Exit(1)


@click.group()
def model() -> None:
    """Generate Python classes from ontologies."""


@model.command()
@click.argument("ontology", default="bundled")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File to write.  [default: standard output]",
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print what was written as JSON; needs --out."
)
def generate(ontology: str, out: Path | None, as_json: bool) -> None:
    """Generate typed classes, so that editors and mypy know every field.

    ONTOLOGY is a file, a folder, the folder of a knowledge base, or "bundled" for RTASK's own
    vocabulary (as in rtask.model.RTASK). Classes that RTASK has already are imported from there.
    """
    from rtask.errors import UsageError
    from rtask.model.generate import generate_for, generate_rtask
    from rtask.ontology_docs import read_source

    if as_json and out is None:
        raise UsageError("--json needs --out: the classes go to standard output")
    text = generate_rtask() if ontology == "bundled" else generate_for(read_source(ontology))
    if out is None:
        click.echo(text, nl=False)
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{out}: {error.strerror}") from error
    if as_json:
        print_json({"path": str(out), "lines": text.count("\n")})
    else:
        click.echo(f"wrote {out}")
