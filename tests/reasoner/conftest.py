"""Make the oracles of this folder importable, and keep hypothesis from writing into the tree."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from hypothesis.configuration import set_hypothesis_home_dir

sys.path.insert(0, str(Path(__file__).parent))
set_hypothesis_home_dir(Path(tempfile.gettempdir()) / "rtask-hypothesis")
