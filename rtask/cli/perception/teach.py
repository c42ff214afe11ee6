"""``rtask teach``: show an object to the knowledge base by photographs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import connection
from rtask.cli.options import agent_option, data_option, json_option, print_json, server_option
from rtask.cli.perception.cutting import segmentation_option
from rtask.cli.perception.scene_file import View, camera_options, read_view
from rtask.cli.perception.selecting import selection_options
from rtask.cli.progress import Working, announce_compilation
from rtask.cli.things import find_object
from rtask.errors import UsageError

if TYPE_CHECKING:
    from features.geometry import Frame
    from rtask.client import Client

__all__ = ["teach"]

_PHOTOS = (".jpg", ".jpeg", ".png")


@click.command()
@click.argument("name")
@click.argument(
    "photos", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path)
)  # fmt: skip
@click.option("--kind", help="Kind of thing, in words; unknown words create a new class.")
@data_option
@server_option
@agent_option("On whose behalf; whose graph the views go to. A server knows it by the token.")
@camera_options
@selection_options
@segmentation_option
@json_option
def teach(
    name: str,
    photos: tuple[Path, ...],
    kind: str | None,
    data: Path,
    server: str | None,
    agent: str | None,
    view: View,
    mask: Path | None,
    box: tuple[float, float, float, float] | None,
    preset: str,
    as_json: bool,
) -> None:
    """Show the object NAME to the knowledge base, so that it is recognised.

    PHOTOS are files as `rtask recognise` reads them, or folders of photographs, each of one object.
    One is enough; more sides make the answers better. If an object has the name already, or NAME is
    its IRI, the views are added to it. --mask may be a folder with a mask of each photograph's name
    (.png or .json).
    """
    files = _files(photos)
    with (
        announce_compilation(),
        Working("learning"),
        connection(data, server, agent, creates=True) as client,
    ):
        thing = find_object(client.query, name)
        entries = []
        for file in files:
            crop = _crop(file, view, preset, _mask_of(mask, file), box)
            entry = _inserted(client, crop, thing, name, kind)
            thing = entry["object"]
            entries.append({"file": str(file), **entry})
    if as_json:
        print_json(entries)
        return
    for entry in entries:
        click.echo(f"{entry['file']}: {entry['features']} keypoints")
    for message in dict.fromkeys(entry["message"] for entry in entries if entry.get("message")):
        click.echo(message)
    what = "new" if entries[0]["new"] else "known"
    click.echo(f"{len(entries)} view{'' if len(entries) == 1 else 's'} of {name} ({what}): {thing}")


def _files(photos: Sequence[Path]) -> list[Path]:
    """Return the files, each folder of photographs in place of itself."""
    found: list[Path] = []
    for path in photos:
        if path.is_dir() and not (path / "metadata.yaml").is_file():
            inside = sorted(one for one in path.iterdir() if one.suffix.lower() in _PHOTOS)
            if not inside:
                raise UsageError(f"{path}: no photographs in this folder ({', '.join(_PHOTOS)})")
            found += inside
        else:
            found.append(path)
    return found


def _mask_of(mask: Path | None, file: Path) -> Path | None:
    if mask is None or not mask.is_dir():
        return mask
    for suffix in (".png", ".json"):
        named = mask / (file.stem + suffix)
        if named.is_file():
            return named
    raise UsageError(f"{mask}: no {file.stem}.png or {file.stem}.json, the mask of {file}")


def _crop(
    file: Path,
    view: View,
    preset: str,
    mask: Path | None,
    box: tuple[float, float, float, float] | None,
) -> Frame:
    from rtask.cli.perception.selecting import Selection, objects_in

    _, crops = objects_in(file, read_view(file, view), preset, Selection(mask, box))
    if len(crops) != 1:
        raise UsageError(
            f"{file} shows {len(crops) or 'no'} objects; say which one by --box or --mask"
        )
    return crops[0][1]


def _inserted(
    client: Client, crop: Frame, thing: str | None, name: str, kind: str | None
) -> dict[str, Any]:
    from features.codec import encode_frame

    item: dict[str, Any] = {"data": encode_frame(crop, 92)}
    if thing is None:
        # It has a name of its own: what it looks like is no reason to take it for something else.
        item |= {"name": name, "class_description": kind, "merge": False}
    else:
        item |= {"object": thing}
    given = {key: value for key, value in item.items() if value is not None}
    (entry,) = client.call("insert_object", objects=[given])["objects"]
    told: dict[str, Any] = dict(entry)
    return told
