"""Catalogue of local ontology files, which resolves ``owl:imports`` without the network.

The search order is: the places given by the caller, the folder of the importing file, the
ontologies bundled with RTASK. A place is a folder, an OASIS ``catalog-v001.xml`` or a
``catalog.toml``.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import ontology
from rtask.errors import DataError, ParseError
from rtask.loader.headers import peek
from rtask.rdf.documents import Document
from rtask.rdf.formats import FORMATS
from rtask.rdf.guards import check_xml
from rtask.ros_packages import in_packages, workspace_folders

__all__ = ["OntologyCatalogue", "loadable_files"]

_OASIS_FILE = "catalog-v001.xml"
_OASIS = "{urn:oasis:names:tc:entity:xmlns:xml:catalog}"
# Bounds of a search in a folder for a missing import; catalogues are not bounded.
MAX_PEEKED_FILES = 1_000
MAX_PEEKED_BYTES = 16 << 20
_EXTENSIONS = {ext for form in FORMATS for ext in form.extensions} | {"owl", "xml"}


def loadable_files(folder: Path) -> list[Path]:
    """Return the loadable files below a folder, sorted, without hidden ones."""
    files = []
    for path in sorted(folder.rglob("*")):
        hidden = any(part.startswith(".") for part in path.relative_to(folder).parts)
        if path.is_file() and not hidden and path.name != _OASIS_FILE:
            extension = Document(path.name, path).extension
            if extension in _EXTENSIONS:
                files.append(path)
    return files


class OntologyCatalogue:
    """Finds the local file of an ontology.

    Parameters
    ----------
    places
        Folders and catalogue files given by the caller.
    """

    def __init__(self, places: Iterable[Path] = ()) -> None:
        self._places = [Path(place) for place in places]
        self._bundled = ontology.path("catalog.toml")
        self._read: dict[Path, dict[str, list[Path]]] = {}

    def find(self, iri: str, beside: Path | None = None) -> Path | None:
        """Return the file of an ontology, or ``None``.

        Parameters
        ----------
        beside
            The importing file, whose folder is searched, too.

        Raises
        ------
        DataError
            If two files of one folder claim the IRI with different content.
        """
        for place in self.searched(beside):
            entries = self._entries(place)
            paths = entries.get(iri) or entries.get(iri.rstrip("#/")) or []
            if paths:
                return _choose(paths, iri, beside)
        scheme, _, inside = iri.partition("://")
        return self._in_package(inside, beside) if scheme == "package" else None

    def _in_package(self, inside: str, beside: Path | None) -> Path | None:
        """Return the file of ``package://``, by which robotic ontologies import one another.

        Such an address says where a file lies, not what its ontology is called. Packages were
        renamed and merged since; then a file of the same name in a folder that the caller gave
        is what is left to find it by.
        """
        folders = [place for place in self.searched(beside) if place.is_dir()]
        # Whoever wrote the ontology names nothing outside of packages.
        if ".." not in Path(inside).parts:
            for path in in_packages(inside, (*folders, *workspace_folders()), above=beside):
                if path.is_file():
                    return path
        name = Path(inside).name
        entries = [paths for folder in folders for paths in self._entries(folder).values()]
        alike = [path for paths in entries for path in paths if path.name == name]
        return _choose(alike, f"package://{inside}", beside) if alike else None

    def resembling(self, iri: str, beside: Path | None = None) -> tuple[Path, str] | None:
        """Return the file that an import may mean, and the IRI that its ontology has instead.

        It has the name that ends the IRI, or its own IRI differs in capitals alone.
        """
        name = iri.rstrip("#/").rpartition("/")[2].lower()
        for place in self.searched(beside):
            for other, paths in self._entries(place).items():
                if iri.lower() == other.lower() or (name and paths[0].name.lower() == name):
                    return paths[0], other
        return None

    def searched(self, beside: Path | None = None) -> list[Path]:
        """Return the places that are searched, in order."""
        places = list(self._places)
        if beside is not None:
            places.append(beside.parent)
        return [*places, self._bundled]

    def _entries(self, place: Path) -> dict[str, list[Path]]:
        if place not in self._read:
            if place.is_dir():
                self._read[place] = _scan(place)
            elif place.suffix == ".toml":
                self._read[place] = _read_toml(place)
            else:
                self._read[place] = _read_oasis(place)
        return self._read[place]


def _scan(folder: Path) -> dict[str, list[Path]]:
    """Read the folder's catalogue, or else the headers of its files.

    A folder may hold anything, such as archives of many gigabytes in a home folder, so only the
    beginning of each file is decompressed.
    """
    listed = folder / _OASIS_FILE
    entries = _read_oasis(listed) if listed.is_file() else {}
    named = set(entries)
    for path in loadable_files(folder)[:MAX_PEEKED_FILES]:
        header = peek(Document(str(path), path, max_unpacked=MAX_PEEKED_BYTES))
        for name in {header.iri, header.version_iri} - {None}:
            assert name is not None
            if name.value not in named:
                entries.setdefault(name.value, []).append(path)
    return entries


def _choose(paths: list[Path], iri: str, beside: Path | None) -> Path:
    """Choose among files of the same name, which hold one ontology in several syntaxes."""
    alike = [path for path in paths if beside is not None and path.suffix == beside.suffix]
    chosen = (alike or paths)[0]
    for other in paths:
        if other.stem != chosen.stem and not _same(chosen, other):
            raise DataError(
                f"{chosen} and {other} both claim to be {iri} but differ; remove one of them"
            )
    return chosen


def _same(first: Path, other: Path) -> bool:
    digests = [hashlib.sha256(path.read_bytes()).digest() for path in (first, other)]
    return digests[0] == digests[1]


def _read_toml(path: Path) -> dict[str, list[Path]]:
    """Read ``[[ontology]]`` tables with ``iri`` and ``file``."""
    try:
        record = tomllib.loads(path.read_text("utf-8"))
        return {entry["iri"]: [path.parent / entry["file"]] for entry in record["ontology"]}
    except (ValueError, KeyError, TypeError) as error:
        raise ParseError(f"{path}: not a catalogue: {error}") from error


def _read_oasis(path: Path) -> dict[str, list[Path]]:
    """Read ``uri`` entries of an OASIS XML catalogue, without network addresses."""
    with path.open("rb") as stream:
        check_xml(stream, str(path))
    entries = {}
    for element in ElementTree.parse(path).iter(_OASIS + "uri"):
        name, target = element.get("name"), element.get("uri", "")
        if name and "://" not in target:
            entries[name] = [(path.parent / target).resolve()]
    return entries
