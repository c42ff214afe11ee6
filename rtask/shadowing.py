"""Notice files of the user's that hide RTASK's own packages.

A file ``grasp.py`` or a folder ``ontology`` in the working directory comes before installed
packages on Python's search path. Without this check it would be imported in the place of ours and
fail much later, with an error about a name that it does not have.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

PACKAGES = ("ontology", "reasoner", "features", "grasp", "simulate", "endpoint")


def check_packages() -> None:
    """Check that RTASK's packages are the ones that stand beside ``rtask``; imports none of them.

    Raises
    ------
    ImportError
        Another file would be imported in the place of one; names the file and says what to do.
    """
    home = Path(__file__).resolve().parent.parent
    for name in PACKAGES:
        try:
            spec = importlib.util.find_spec(name)
        except ValueError:  # a module made by hand, without a spec
            continue
        if spec is None or spec.origin is None:
            continue
        origin = Path(spec.origin).resolve()
        if origin.parent != home / name:
            raise ImportError(
                f"{origin} hides RTASK's own package {name!r} ({home / name}): "
                "rename that file, or start Python in another folder",
                name=name,
                path=str(origin),
            )
