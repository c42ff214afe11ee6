"""``rtask explain``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option, open_to_read, term


@click.command()
@click.argument("subject")
@click.argument("predicate")
@click.argument("value", metavar="OBJECT")
@data_option
def explain(subject: str, predicate: str, value: str, data: Path) -> None:
    """Say why a statement holds: who asserts it, or from what it follows.

    Terms are written as in Turtle: <IRI>, prefix:name, "text", 0.3. Exit code 1 if it does not
    hold.
    """
    with open_to_read(data) as kb:
        predicate = "rdf:type" if predicate == "a" else predicate
        triple = [term(part, kb.base) for part in (subject, predicate, value)]
        graphs = [str(quad.graph_name) for quad in kb.match(*triple)]
        asserted = [name for name in graphs if name != str(kb.graphs.inferred)]
        for name in asserted:
            click.echo(f"asserted in {name}")
        if asserted:
            return
        proof = kb.explain(*triple)
        if proof is None:
            click.echo("does not hold", err=True)
            raise SystemExit(1)
        click.echo(proof.render())
