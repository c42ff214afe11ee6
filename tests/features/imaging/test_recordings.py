"""Recordings of ROS that are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from features.codec.limits import CloudFormatError
from features.imaging.recordings import first_view

pytest.importorskip("rosbags")


@pytest.mark.parametrize("name", ["junk.bag", "junk.mcap", "junk.db3"])
@pytest.mark.parametrize("start", [b"", b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
def test_bytes_that_are_no_recording_are_told_in_one_line(
    tmp_path: Path, name: str, start: bytes
) -> None:
    path = tmp_path / name
    path.write_bytes(start + np.random.default_rng(3).bytes(400))
    with pytest.raises(CloudFormatError, match="no recording of ROS"):
        first_view(path)
