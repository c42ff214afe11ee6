"""``rtask export``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option, open_to_read


@click.command()
@click.argument("target", default="-")
@data_option
@click.option("--graph", "-g", "graphs", multiple=True, help="Only this graph; may be repeated.")
@click.option("--format", "-f", "form", help="By the target's extension, else trig.")
@click.option("--inferred", is_flag=True, help="Write derived statements too.")
@click.option("--original", is_flag=True, help="The bytes that one graph was loaded from.")
def export(
    target: str,
    data: Path,
    graphs: tuple[str, ...],
    form: str | None,
    inferred: bool,
    original: bool,
) -> None:
    """Write the graph to a file, or to standard output (-)."""
    import sys

    from rtask.errors import UsageError
    from rtask.loader.export import original as write_original

    with open_to_read(data) as kb:
        if original:
            if len(graphs) != 1 or target == "-":
                raise UsageError("--original needs one --graph and a target file")
            count = write_original(kb, graphs[0], target)
            click.echo(f"{count} bytes", err=True)
            return
        out = sys.stdout.buffer if target == "-" else Path(target)
        form = form or ("trig" if target == "-" else None)
        count = kb.dump(out, form, graphs or None, inferred)
    click.echo(f"{count} statements", err=True)
