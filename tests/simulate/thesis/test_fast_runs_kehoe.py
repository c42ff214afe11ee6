"""Each run about Kehoe 2014 gives figures or pictures in its fast form."""

from __future__ import annotations

import pytest

from tests.simulate.thesis.fast_runs import fast_run_gives_what_it_promises, runs_of


@pytest.mark.deep
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("run", runs_of("kehoe"))
def test_every_run_gives_figures_or_pictures_in_its_fast_form(run: str) -> None:
    fast_run_gives_what_it_promises(run)
