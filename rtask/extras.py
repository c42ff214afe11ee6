"""Optional parts of RTASK: which extra brings which library.

The graph, the loader, the endpoint and the client come with the base; libraries that are large, or
built for few versions of Python, come with an extra. They are imported where they are used, and the
borders of the core (command line, engine, endpoint) turn the failed import into an error that names
the extra and the command that installs it from where this RTASK came.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote, urlsplit

from rtask.errors import MissingExtraError

EXTRA_OF = {
    "cv2": "perception",
    "ezdxf": "perception",
    "faiss": "perception",
    "gymnasium": "perception",
    "h5py": "hdf5",
    "matplotlib": "perception",
    "numba": "perception",
    "onnxruntime": "embed",
    "open3d": "surfaces",
    "scipy": "perception",
    "trimesh": "perception",
    "pybullet": "simulate",
    "pybullet_data": "simulate",
    "pybullet_utils": "simulate",
    "rich": "simulate",
    "tomlkit": "simulate",
    "collada": "simulate",
    "rosbags": "recordings",
    "pyarrow": "lerobot",
    "qi": "naoqi",
    "cyclonedds": "dds",
    "sklearn": "classifier",
    "ray": "ray",
    "rapidocr": "words",
}


@cache
def missing_libraries(extra: str) -> tuple[str, ...]:
    """Return the libraries of an extra that are not installed, without importing any.

    Parameters
    ----------
    extra
        Name of the extra, such as ``perception``.
    """
    return tuple(
        library
        for library, brought_by in EXTRA_OF.items()
        if brought_by == extra and importlib.util.find_spec(library) is None
    )


def install_command(extra: str = "") -> str:
    """Return how an extra, or the base, is installed from where this RTASK came.

    Errors carry it to callers over HTTP too, so it names no folder of this machine.

    Parameters
    ----------
    extra
        Name of the extra; "" = the base.
    """
    bracket = f"[{extra}]" if extra else ""
    return _command_for(_origin(), bracket)


def _command_for(origin: Mapping[str, Any] | None, bracket: str) -> str:
    """Return the command for an origin.

    Parameters
    ----------
    origin
        As in ``direct_url.json`` (PEP 610); None for a package index.
    bracket
        The extra in brackets, or "".

    Examples
    --------
    >>> _command_for(None, "[simulate]")
    "pip install 'rtask-kg[simulate]'"
    >>> _command_for({"url": "file:///src/rtask", "dir_info": {}}, "[simulate]")
    "in the checkout, pip install '.[simulate]'"
    >>> wheel = {"url": "file:///tmp/rtask_kg-0.1.0-py3-none-any.whl", "archive_info": {}}
    >>> _command_for(wheel, "[simulate]")
    "beside the wheel, pip install './rtask_kg-0.1.0-py3-none-any.whl[simulate]'"
    >>> git = {"url": "https://example.org/rtask.git", "vcs_info": {"vcs": "git"}}
    >>> _command_for(git, "[simulate]")
    "pip install 'rtask-kg[simulate] @ git+https://example.org/rtask.git'"
    """
    if origin is None:
        return f"pip install 'rtask-kg{bracket}'"
    url = str(origin["url"])
    if "dir_info" in origin:
        return f"in the checkout, pip install '.{bracket}'"
    if "vcs_info" in origin:
        return f"pip install 'rtask-kg{bracket} @ {origin['vcs_info']['vcs']}+{url}'"
    if urlsplit(url).scheme == "file":
        return f"beside the wheel, pip install './{PurePosixPath(unquote(url)).name}{bracket}'"
    return f"pip install 'rtask-kg{bracket} @ {url}'"


@cache
def _origin() -> Mapping[str, Any] | None:
    """Return where this RTASK was installed from, as in PEP 610; None for a package index."""
    # A checkout that is only on the path has no distribution, or one of another installation.
    if (Path(__file__).parents[1] / "pyproject.toml").is_file():
        return {"url": "", "dir_info": {}}
    try:
        written = importlib.metadata.distribution("rtask-kg").read_text("direct_url.json")
    except importlib.metadata.PackageNotFoundError:
        return None
    origin: Mapping[str, Any] | None = json.loads(written) if written else None
    return origin


def needs_extra(extra: str, subject: str, library: str = "") -> MissingExtraError:
    """Return the error that something needs an extra.

    Parameters
    ----------
    subject
        What needs it; begins the message.

    library
        The one whose import failed; "" if none was tried.

    Examples
    --------
    >>> str(needs_extra("simulate", "this page")).partition(":")[0]
    "this page needs the extra 'simulate'"
    """
    return MissingExtraError(
        f"{subject} needs the extra {extra!r}: {install_command(extra)}",
        extra=extra,
        library=library,
    )


def missing_extra(error: ImportError, subject: str) -> MissingExtraError | None:
    """Return the error that names the extra, if a library of one is what is missing.

    Parameters
    ----------
    error
        A failed import.
    subject
        What needs the library; begins the message.

    Examples
    --------
    >>> error = ModuleNotFoundError("No module named 'cv2'", name="cv2")
    >>> str(missing_extra(error, "rtask recognise")).partition(":")[0]
    "rtask recognise needs the extra 'perception'"
    >>> missing_extra(ModuleNotFoundError("No module named 'mine'", name="mine"), "this") is None
    True
    """
    library = (error.name or "").partition(".")[0]
    extra = EXTRA_OF.get(library)
    if extra is None or not isinstance(error, ModuleNotFoundError):
        return None
    if extra == "perception" and "simulate" in _packages_passed(error):
        extra = "simulate"  # brings perception, and the caller will need both
    return needs_extra(extra, subject, library)


def _packages_passed(error: BaseException) -> set[str]:
    """Return the top-level packages that an error came through."""
    return {
        str(frame.f_globals.get("__name__")).partition(".")[0]
        for frame, _ in traceback.walk_tb(error.__traceback__)
    }


@contextmanager
def naming_extras(subject: str) -> Iterator[None]:
    """Turn the import of a library that is not installed into an error that names its extra.

    Raises
    ------
    MissingExtraError
        A library of an extra could not be imported in the block.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        missing = missing_extra(error, subject)
        if missing is None:
            raise
        raise missing from error
