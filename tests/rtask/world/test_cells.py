"""What is near is found by cells as by comparing everything."""

from __future__ import annotations

import numpy as np
import pytest

from rtask.world.index.cells import CELL_M, Cells, cell_of, cells_around


@pytest.mark.parametrize("seed", range(3))
def test_cells_hold_all_that_is_near_once(seed):
    rng = np.random.default_rng(seed)
    frames = rng.integers(-1, 3, 400).astype(np.int32)
    spots = rng.uniform(-1.0, 1.0, (400, 3)).astype(np.float32)
    times_s = rng.integers(0, 50, 400).astype(float)
    cells = Cells(frames, spots, times_s)
    for number in range(0, 400, 20):
        here = spots[number].astype(float)
        cell = cell_of(int(frames[number]), *here.tolist())
        rows = cells.rows_near(cell, 10.0, 30.0)
        assert len(set(rows.tolist())) == len(rows)
        is_near = np.linalg.norm(spots - here, axis=1) <= CELL_M
        is_between = (times_s > 10.0) & (times_s <= 30.0)
        wanted = np.flatnonzero(is_near & is_between & (frames == frames[number]))
        assert set(wanted.tolist()) <= set(rows.tolist())
        assert len(cells_around(cell)) == 27
        around = set(cells_around(cell))
        assert all(cell_of(int(frames[k]), *spots[k].tolist()) in around for k in wanted)
