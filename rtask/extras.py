"""Optional parts of RTASK: which extra brings which library.

The graph, the loader, the endpoint and the client come with ``pip install rtask-kg``; libraries
that are large, or built for few versions of Python, come with an extra. They are imported where
they are used, and the borders of the core (command line, engine, endpoint) turn the failed import
into an error that names the extra.
"""

from __future__ import annotations

import importlib.util
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

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
    "open3d": "perception",
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


def needs_extra(extra: str, subject: str) -> MissingExtraError:
    """Return the error that something needs an extra.

    Parameters
    ----------
    subject
        What needs it; begins the message.

    Examples
    --------
    >>> str(needs_extra("simulate", "this page"))
    "this page needs the extra 'simulate': pip install 'rtask-kg[simulate]'"
    """
    return MissingExtraError(
        f"{subject} needs the extra {extra!r}: pip install 'rtask-kg[{extra}]'", extra=extra
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
    >>> str(missing_extra(error, "rtask recognise"))
    "rtask recognise needs the extra 'perception': pip install 'rtask-kg[perception]'"
    >>> missing_extra(ModuleNotFoundError("No module named 'mine'", name="mine"), "this") is None
    True
    """
    library = (error.name or "").partition(".")[0]
    extra = EXTRA_OF.get(library)
    if extra is None or not isinstance(error, ModuleNotFoundError):
        return None
    if extra == "perception" and "simulate" in _packages_passed(error):
        extra = "simulate"  # brings perception, and the caller will need both
    return MissingExtraError(
        f"{subject} needs the extra {extra!r}: pip install 'rtask-kg[{extra}]'",
        extra=extra,
        library=library,
    )


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
