"""``rtask objects``: people correct what the graph holds about objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import click

from rtask.cli.connection import connection, open_graph, open_to_read, read_address
from rtask.cli.options import (
    agent_option,
    announce_undo,
    confirm_final,
    data_option,
    json_option,
    listing_option,
    print_json,
    print_listing,
    server_option,
    shown_parts,
    shown_rows,
    yes_option,
)
from rtask.cli.things import name_or_iri, no_object, resolve_object

__all__ = ["objects"]

_OBJECTS = """
SELECT ?object (SAMPLE(?called) AS ?name) (SAMPLE(?label) AS ?kind)
  (COALESCE(SAMPLE(?seen), 0) AS ?views) (COALESCE(SAMPLE(?tried), 0) AS ?grasps)
WHERE {
  GRAPH ?graph { ?object rt:objectId ?id }
  OPTIONAL { ?object rt:name ?called }
  OPTIONAL {
    GRAPH ?graph { ?object a ?class } ?class rdfs:label ?label
    FILTER(?class != rt:ManipulableObject && LANGMATCHES(LANG(?label), "en"))
  }
  OPTIONAL { SELECT ?object (COUNT(?view) AS ?seen) { ?object rt:hasView ?view }
    GROUP BY ?object }
  OPTIONAL { SELECT ?object (COUNT(?grasp) AS ?tried) { ?object rt:hasGrasp ?grasp }
    GROUP BY ?object }
} GROUP BY ?object ORDER BY ?name ?object"""

_agent_option = agent_option(
    "Person who makes the change, and whose graph it goes to. A server knows it by the token.",
)


@click.group()
def objects() -> None:
    """List, show, name, merge, split and forget objects, find twins, and undo such changes.

    The NAME of an object is the one that it was given, or its IRI.
    """


@objects.command("list")
@data_option
@server_option
@listing_option
@json_option
def list_(data: Path, server: str | None, limit: int | None, as_json: bool) -> None:
    """List the known objects, with the numbers of their views and grasps."""
    from rtask.rdf.namespaces import PREFIXES

    with open_graph(data, server) as kb:
        rows = kb.select(PREFIXES + _OBJECTS).to_dicts()

    def line(row: Mapping[str, Any]) -> str:
        kind = f" ({row['kind']})" if row["kind"] else ""
        counts = f"{row['views']:4d} views  {row['grasps']:4d} grasps"
        return f"{counts}  {row['name'] or '-'}{kind}  {row['object']}"

    print_listing(rows, limit, as_json, line, "no objects yet; `rtask teach` shows one")


@objects.command()
@click.argument("name")
@data_option
@server_option
@listing_option
@json_option
def show(name: str, data: Path, server: str | None, limit: int | None, as_json: bool) -> None:
    """Show what is stored about the object NAME; an IRI may be one that it had before a merge."""
    from rtask.engine.curation.merging import present_name
    from rtask.engine.networks.printed_words import words_of_objects
    from rtask.engine.stored import stored_models
    from rtask.errors import UnknownTermError
    from rtask.rdf.namespaces import RT
    from rtask.rdf.terms import iri, python_value

    with open_graph(data, server) as kb:
        name = resolve_object(lambda text: kb.select(text).to_dicts(), name)
        object_iri = iri(present_name(kb, name))
        if not kb.match(object_iri, RT.objectId):
            raise UnknownTermError(no_object(lambda text: kb.select(text).to_dicts(), object_iri))
        models = stored_models(kb, object_iri)
        by_view = words_of_objects(kb, [object_iri.value])
        shown = {
            "object": object_iri.value,
            "names": sorted({str(python_value(q.object)) for q in kb.match(object_iri, RT.name)}),
            "views": sorted(str(q.object)[1:-1] for q in kb.match(object_iri, RT.hasView)),
            "grasps": sorted(str(q.object)[1:-1] for q in kb.match(object_iri, RT.hasGrasp)),
            "words": sorted({f'"{word.text}"' for words in by_view.values() for word in words}),
            "model": models[0].blob if models else None,
            "views_in_model": len(models[0].views) if models else 0,
            "formerly": sorted(
                str(q.subject)[1:-1] for q in kb.match(None, RT.mergedInto, object_iri)
            ),
        }
    shown = shown_parts(shown, limit, as_json)
    if as_json:
        print_json(shown)
        return
    for key, value in shown.items():
        for line in value if isinstance(value, list) else [value]:
            click.echo(f"{key:15s} {line}")


@objects.command("name")
@click.argument("name")
@click.option("--as", "new_name", help="Name of this very object.")
@click.option("--kind", help="Kind of thing, in words; unknown words create a new class.")
@data_option
@server_option
@_agent_option
@json_option
def name_(
    name: str,
    new_name: str | None,
    kind: str | None,
    data: Path,
    server: str | None,
    agent: str | None,
    as_json: bool,
) -> None:
    """Give the object NAME a name or a kind, in place of earlier ones."""
    _carry_out(
        (data, server), as_json, "teach_object", operation="teach", object=name, name=new_name,
        class_description=kind, operator=agent,
    )  # fmt: skip


@objects.command()
@click.argument("name")
@click.argument("into")
@data_option
@server_option
@_agent_option
@json_option
def merge(
    name: str, into: str, data: Path, server: str | None, agent: str | None, as_json: bool
) -> None:
    """Merge the object NAME into the object INTO: they are one and the same."""
    _curate((data, server), as_json, operation="merge", object=name, into=into, operator=agent)


@objects.command()
@click.option("--views", default=4, show_default=True, type=click.IntRange(min=1),
              help="Views of each object that are tried, oldest first.")  # fmt: skip
@click.option("--merge", "merges", is_flag=True, help="Merge them, each into the earlier object.")
@data_option
@_agent_option
@listing_option
@json_option
def twins(
    views: int, merges: bool, data: Path, agent: str | None, limit: int | None, as_json: bool
) -> None:
    """Find products that are stored twice: each is recognised as the other. Exit code 1 if any.

    Look at both before merging: what looks alike may differ in what no camera sees.
    """
    from rtask.cli.progress import Working
    from rtask.engine.curation.twins import count_untried, find_twins, merges_of
    from rtask.extras import naming_extras

    with open_to_read(data) as kb, naming_extras("rtask objects twins"), Working("comparing"):
        pairs, untried = find_twins(kb, views), count_untried(kb, views)
    commits = list[str]()
    if merges and pairs:
        author = {} if agent is None else {"operator": agent}
        with connection(data, None) as client:
            for other, survivor in merges_of(pairs):
                request: dict[str, Any] = {"object": other, "into": survivor, **author}
                commits.append(
                    str(client.call("curate_object", operation="merge", **request)["commit"])
                )
    shown = shown_rows(pairs, limit, as_json)
    if as_json:
        print_json(
            {
                "twins": [asdict(pair) for pair in shown],
                "commits": commits,
                "views_untried": untried,
            }
        )
    else:
        for pair in shown:
            click.echo(f"{pair.confidence:.2f}  {pair.first}  {pair.second}")
        if shown:
            pages = urlencode({"iri": shown[0].second, "into": shown[0].first})
            click.echo(f"why: `rtask serve`, then its page /object/merge?{pages}#why", err=True)
        for commit in commits:
            click.echo(f"merged: {commit}")
        if commits:
            announce_undo("undo", *reversed(commits))
        if not pairs and not untried:
            click.echo("no twins: no object is recognised as another", err=True)
        if untried:
            rest = "1 view was" if untried == 1 else f"{untried} views were"
            click.echo(
                f"{'further twins' if pairs else 'twins'}: not decided, {rest} not tried; "
                f"try more of each object with --views {2 * views}",
                err=True,
            )
    if pairs and not merges:
        raise SystemExit(1)


@objects.command()
@click.argument("name")
@click.argument("views", nargs=-1, required=True)
@click.option("--as", "new_name", help="Name of the new object.")
@data_option
@server_option
@_agent_option
@json_option
def split(
    name: str,
    views: tuple[str, ...],
    new_name: str | None,
    data: Path,
    server: str | None,
    agent: str | None,
    as_json: bool,
) -> None:
    """Move VIEWS of the object NAME to a new object."""
    _curate(
        (data, server), as_json, operation="split", object=name, views=list(views), name=new_name,
        operator=agent,
    )  # fmt: skip


@objects.command()
@click.argument("name")
@click.argument("views", nargs=-1)
@click.option("--purge", is_flag=True, help="Delete its attempts too, and its blobs at once.")
@data_option
@server_option
@_agent_option
@yes_option
@json_option
def forget(
    name: str,
    views: tuple[str, ...],
    purge: bool,
    data: Path,
    server: str | None,
    agent: str | None,
    yes: bool,
    as_json: bool,
) -> None:
    """Delete the object NAME, or only some VIEWS of it."""
    if purge:
        confirm_final("what --purge deletes is gone; backups made before have it still", yes)
    _curate(
        (data, server), as_json, operation="forget", object=name, views=list(views), purge=purge,
        operator=agent,
    )  # fmt: skip


@objects.command()
@click.argument("commit")
@data_option
@server_option
@_agent_option
@json_option
def undo(commit: str, data: Path, server: str | None, agent: str | None, as_json: bool) -> None:
    """Undo a merge, a split or a deletion, named by its COMMIT."""
    _curate((data, server), as_json, operation="undo", commit=commit, operator=agent)


@objects.command()
@click.argument("name")
@click.option(
    "--out",
    "target",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Also write the surface to this PLY file.",
)
@click.option("--again", is_flag=True, help="Reconstruct it even if no view came since.")
@data_option
@server_option
@json_option
def mesh(
    name: str, target: Path | None, again: bool, data: Path, server: str | None, as_json: bool
) -> None:
    """Reconstruct the surface of the object NAME from its views, and say how good it is.

    The surface is closed. What no view showed is filled in, and counts as not seen.
    """
    with connection(data, server) as client:
        object_iri = resolve_object(client.query, name)
        done = client.call("reconstruct_mesh", object=object_iri, again=again)
    if target is not None:
        target.write_bytes(_mesh_bytes(done["object"], data, server))
    if as_json:
        print_json(done)
        return
    click.echo(
        f"{done['mesh']}: {done['seen_share']:.0%} of it seen in "
        f"{done['views']} view{'' if done['views'] == 1 else 's'}, "
        f"{'closed' if done['watertight'] else 'not closed'}; measured points lie "
        f"{done['median_residual'] * 1000:.1f} mm off it, 90 % of them within "
        f"{done['residual_90'] * 1000:.1f} mm"
    )
    if done["commit"]:
        announce_undo("undo", done["commit"])
    else:
        click.echo("known already: no view has come since; --again reconstructs it", err=True)


def _mesh_bytes(object_iri: str, data: Path, server: str | None) -> bytes:
    """Return the PLY file of an object's surface."""
    from rtask.rdf.terms import iri
    from rtask.world.surfaces import stored_mesh

    if server:
        return read_address(server, "/object/mesh.ply", {"iri": object_iri})
    with open_to_read(data) as kb:
        stored = stored_mesh(kb, iri(object_iri))
        assert stored is not None
        return kb.blobs.read(stored.blob)


def _curate(where: tuple[Path, str | None], as_json: bool, /, **request: Any) -> None:
    _carry_out(where, as_json, "curate_object", **request)


def _carry_out(
    where: tuple[Path, str | None], as_json: bool, called: str, /, **request: Any
) -> None:
    given = {name: value for name, value in request.items() if value is not None}
    with connection(*where) as client:
        for role in given.keys() & {"object", "into"}:
            given[role] = resolve_object(client.query, given[role])
        if "views" in given:
            given["views"] = [name_or_iri(view, *where) for view in given["views"]]
        done = client.call(called, **given)
    if as_json:
        print_json(done)
    elif "added" in done:
        click.echo(
            f"{done['commit']}: +{done['added']} -{done['removed']} {done['object']}".rstrip()
        )
        if not given.get("purge"):
            announce_undo("objects", "undo", done["commit"])
    else:
        (named,) = done["objects"]
        click.echo(f"{done['commit'] or 'known already'}: {named['label']} {named['object']}")
        if done["commit"]:
            announce_undo("objects", "undo", done["commit"])
