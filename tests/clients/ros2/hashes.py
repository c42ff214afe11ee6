"""Prints definitions and type hashes of ``rtask_msgs`` as a sourced ROS 2 has built it.

    python3 -m tests.clients.ros2.hashes > tests/rtask/interop/ros/jazzy_hashes.json

The golden vectors of the hashes that RTASK computes without ROS 2. They need not be made anew when
an operation changes: the definitions that they were made of stand beside them.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

PACKAGE = "rtask_msgs"


def golden(folder):
    """Return the definitions of a package's share folder, and the hash of each type."""
    definitions, hashes = {}, {}
    for kind in ("msg", "srv", "action"):
        for file in sorted(folder.glob(f"{kind}/*.{kind}")):
            definitions[file.relative_to(folder).as_posix()] = file.read_text("utf-8")
    for file in sorted(folder.glob("*/*.json")):
        for entry in json.loads(file.read_text("utf-8")).get("type_hashes", ()):
            if entry["type_name"].startswith(f"{PACKAGE}/"):
                hashes[entry["type_name"]] = entry["hash_string"]
    return {"definitions": definitions, "hashes": dict(sorted(hashes.items()))}


if __name__ == "__main__":
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    shares = [Path(prefix) / "share" / PACKAGE for prefix in prefixes if prefix]
    found = next((share for share in shares if share.is_dir()), None)
    if found is None:
        sys.exit(f"no {PACKAGE} in this shell; source the workspace in which it was built")
    json.dump(golden(found), sys.stdout, indent=0)
    sys.stdout.write("\n")
