"""``rtask teach``: show an object to the knowledge base by photographs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import connection
from rtask.cli.options import (
    agent_option,
    announce_undo,
    data_option,
    json_option,
    print_json,
    server_option,
)
from rtask.cli.perception.cutting import segmentation_option
from rtask.cli.perception.selecting import selection_options
from rtask.cli.perception.view_options import View, camera_options
from rtask.cli.progress import Working, announce_compilation
from rtask.cli.things import find_object
from rtask.errors import UnknownTermError, UsageError

if TYPE_CHECKING:
    from rtask.client import Client

__all__ = ["teach"]

_PHOTOS = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff")
_FEW = 10  # agreeing keypoints that the engine asks for where nothing else is stored


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
    its IRI, the views are added to it, but for those that it has. Where one of the files cannot be
    read, nothing is stored. --mask may be a folder with a mask of each photograph's name (.png or
    .json).
    """
    if not name.strip():
        raise UsageError("NAME is blank: give the object a name, or the IRI of a known one")
    files = _files(photos)
    with (
        announce_compilation(),
        Working("learning"),
        connection(data, server, agent, creates=True) as client,
    ):
        target = find_object(client.query, name)
        if target is None and "://" in name:
            raise UnknownTermError(
                f"the graph has no object {name}; `rtask objects list` shows what there is"
            )
        shown = [_shown(file, view, preset, _mask_of(mask, file), box) for file in files]
        entries = []
        for photo in shown:
            entry = _inserted(client, photo, target, name, kind)
            target = entry["object"]
            entries.append({"file": str(photo.file), **entry})
    if as_json:
        print_json(entries)
        return
    for photo, entry in zip(shown, entries, strict=True):
        click.echo(f"{photo.file}: {_insertion_line(photo, entry)}")
    for message in dict.fromkeys(entry["message"] for entry in entries if entry.get("message")):
        click.echo(message)
    what = "new" if entries[0]["new"] else "known"
    stored = sum(entry["stored"] for entry in entries)
    click.echo(f"{stored} view{'' if stored == 1 else 's'} of {name} ({what}): {target}")
    if entries[0]["new"]:
        announce_undo("objects", "forget", str(target))
    elif stored:
        taught = [entry["view"] for entry in entries if entry["stored"]]
        announce_undo("objects", "forget", str(target), *taught)


@dataclass(frozen=True)
class _Shown:
    """The crop of the object in a file, encoded.

    Parameters
    ----------
    data
        As robots send it.
    is_flat
        Whether it has no depth.
    """

    file: Path
    data: bytes
    is_flat: bool


def _insertion_line(photo: _Shown, entry: Mapping[str, Any]) -> str:
    """Return what became of a file."""
    if not entry["stored"]:
        return "stored already"
    keypoints = f"{entry['features']} keypoints"
    if photo.is_flat and entry["features"] < _FEW:
        return f"{keypoints}; too few to be recognised: without depth, the print must show"
    return keypoints


def _files(photos: Sequence[Path]) -> list[Path]:
    """Return the files, each folder of photographs in place of itself."""
    photo_files: list[Path] = []
    for path in photos:
        if path.is_dir() and not (path / "metadata.yaml").is_file():
            inside = sorted(file for file in path.iterdir() if file.suffix.lower() in _PHOTOS)
            if not inside:
                raise UsageError(f"{path}: no photographs in this folder ({', '.join(_PHOTOS)})")
            photo_files += inside
        else:
            photo_files.append(path)
    return photo_files


def _mask_of(mask: Path | None, file: Path) -> Path | None:
    if mask is None or not mask.is_dir():
        return mask
    for suffix in (".png", ".json"):
        named = mask / (file.stem + suffix)
        if named.is_file():
            return named
    raise UsageError(f"{mask}: no {file.stem}.png or {file.stem}.json, the mask of {file}")


def _shown(
    file: Path,
    view: View,
    preset: str,
    mask: Path | None,
    box: tuple[float, float, float, float] | None,
) -> _Shown:
    from features.codec import encode_frame
    from rtask.cli.perception.selecting import Selection, objects_in

    # What is taught is stored with its sizes, and a later view of another size is refused for them.
    _, crops = objects_in(file, replace(view, is_stored=True), preset, Selection(mask, box))
    if len(crops) != 1:
        raise UsageError(
            f"{file} shows {len(crops) or 'no'} objects; say which one by --box or --mask"
        )
    crop = crops[0][1]
    return _Shown(file, encode_frame(crop, 92), not (crop.depth_m > 0).any())


def _inserted(
    client: Client, shown: _Shown, target: str | None, name: str, kind: str | None
) -> dict[str, Any]:
    item: dict[str, Any] = {"data": shown.data}
    if target is None:
        # It has a name of its own: what it looks like is no reason to take it for something else.
        item |= {"name": name, "class_description": kind, "merge": False}
    else:
        item |= {"object": target}
    given = {key: value for key, value in item.items() if value is not None}
    answer = client.call("insert_object", objects=[given])
    (entry,) = answer["objects"]
    return {**entry, "stored": answer["stored"]}
