"""Make the oracles of this folder importable, and keep hypothesis from writing into the tree."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from hypothesis.configuration import set_hypothesis_home_dir

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "benchmarks")]
set_hypothesis_home_dir(Path(tempfile.gettempdir()) / "rtask-hypothesis")
