"""``rtask objects``: people put objects right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rtask.cli.options import data_option, json_option, open_to_read, print_json

__all__ = ["objects"]

operator_option = click.option("--operator", help="Who says so; writes into that person's graph.")


@click.group()
def objects() -> None:
    """Show an object, name one, merge two, split one, forget one, or take that back."""


@objects.command()
@click.argument("name")
@data_option
@json_option
def show(name: str, data: Path, as_json: bool) -> None:
    """Say what is stored of an object: NAME is an IRI, also a former one."""
    from rtask.engine.curation.merging import present_name
    from rtask.engine.stored import stored_models
    from rtask.errors import UnknownTermError
    from rtask.rdf.namespaces import RT
    from rtask.rdf.terms import iri, python_value

    with open_to_read(data) as kb:
        thing = iri(present_name(kb, name))
        if not kb.match(thing, RT.objectId):
            raise UnknownTermError(f"the graph knows no object {name}")
        models = stored_models(kb, thing)
        shown = {
            "object": thing.value,
            "names": sorted({str(python_value(q.object)) for q in kb.match(thing, RT.name)}),
            "views": sorted(str(q.object)[1:-1] for q in kb.match(thing, RT.hasView)),
            "grasps": sorted(str(q.object)[1:-1] for q in kb.match(thing, RT.hasGrasp)),
            "model": models[0].blob if models else None,
            "views_in_model": len(models[0].views) if models else 0,
            "formerly": sorted(str(q.subject)[1:-1] for q in kb.match(None, RT.mergedInto, thing)),
        }
    if as_json:
        print_json(shown)
        return
    for key, value in shown.items():
        for line in value if isinstance(value, list) else [value]:
            click.echo(f"{key:15s} {line}")


@objects.command("name")
@click.argument("name")
@click.option("--as", "new_name", help="What people call this one object.")
@click.option("--kind", help="What kind of thing it is, in words; new words make a new kind.")
@data_option
@operator_option
@json_option
def name_(
    name: str,
    new_name: str | None,
    kind: str | None,
    data: Path,
    operator: str | None,
    as_json: bool,
) -> None:
    """Say what the object NAME is; what was guessed or said before goes."""
    _carry_out(
        data, as_json, "teach_object", operation="teach", object=name, name=new_name,
        class_description=kind, operator=operator,
    )  # fmt: skip


@objects.command()
@click.argument("name")
@click.argument("into")
@data_option
@operator_option
@json_option
def merge(name: str, into: str, data: Path, operator: str | None, as_json: bool) -> None:
    """Say that the object NAME turned out to be the object INTO."""
    _curate(data, as_json, operation="merge", object=name, into=into, operator=operator)


@objects.command()
@click.argument("name")
@click.argument("views", nargs=-1, required=True)
@click.option("--as", "new_name", help="What people call the new object.")
@data_option
@operator_option
@json_option
def split(
    name: str,
    views: tuple[str, ...],
    new_name: str | None,
    data: Path,
    operator: str | None,
    as_json: bool,
) -> None:
    """Say that VIEWS of the object NAME show another object."""
    _curate(
        data, as_json, operation="split", object=name, views=list(views), name=new_name,
        operator=operator,
    )  # fmt: skip


@objects.command()
@click.argument("name")
@click.argument("views", nargs=-1)
@click.option("--purge", is_flag=True, help="With all that was tried on it, and the bytes at once.")
@data_option
@operator_option
@json_option
def forget(
    name: str,
    views: tuple[str, ...],
    purge: bool,
    data: Path,
    operator: str | None,
    as_json: bool,
) -> None:
    """Forget the object NAME, or only some VIEWS of it."""
    _curate(
        data, as_json, operation="forget", object=name, views=list(views), purge=purge,
        operator=operator,
    )  # fmt: skip


@objects.command()
@click.argument("commit")
@data_option
@operator_option
@json_option
def undo(commit: str, data: Path, operator: str | None, as_json: bool) -> None:
    """Take back a merging, splitting or forgetting by its COMMIT."""
    _curate(data, as_json, operation="undo", commit=commit, operator=operator)


def _curate(data: Path, as_json: bool, /, **request: Any) -> None:
    _carry_out(data, as_json, "curate_object", **request)


def _carry_out(data: Path, as_json: bool, called: str, /, **request: Any) -> None:
    import rtask
    from rtask.engine import Engine

    with rtask.open(data) as kb, Engine(kb) as engine:
        done = engine.call(called, request)
    if as_json:
        print_json(done)
    elif "added" in done:
        click.echo(
            f"{done['commit']}: +{done['added']} -{done['removed']} {done['object']}".rstrip()
        )
    else:
        (named,) = done["objects"]
        click.echo(f"{done['commit'] or 'known already'}: {named['label']} {named['object']}")
