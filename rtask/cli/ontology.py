"""``rtask ontology``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option, json_option, open_to_read, print_json

_LOADED = """
PREFIX owl: <http://www.w3.org/2002/07/owl#>
SELECT ?ontology ?version ?statements {
  ?ontology a rt:OntologyGraph ; rt:tripleCount ?statements .
  OPTIONAL { ?ontology owl:versionInfo ?version }
} ORDER BY ?ontology
"""


@click.group()
def ontology() -> None:
    """Ontologies: which are loaded, where they lie."""


@ontology.command("list")
@data_option
@json_option
def list_loaded(data: Path, as_json: bool) -> None:
    """List the ontologies of a knowledge base."""
    import ontology as vocabulary
    from rtask.kb.terms import prologue

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
