"""What hides in a product, learned from the products before it."""

from __future__ import annotations

import numpy as np

from grasp.learning.causes import hidden_share
from grasp.learning.hypotheses import MIRRORED, PRIOR, allowed, log_likelihood
from grasp.learning.population import Population, evidence_of

SIZE = (0.1, 0.03, 0.04)
ALONG = np.array([-0.3, -0.15, 0.0, 0.15, 0.3])
NOTHING_TRIED = (np.zeros(0), np.zeros(0), np.zeros(0))


def evidence(name, *tries, size=SIZE):
    """Return what attempts (place, held) say of a product."""
    places, held = np.array(tries, np.float64).reshape(-1, 2).T
    return evidence_of(name, size, places, 0.1, held, np.ones(len(held)))


def brittle(count, size=SIZE):
    """Return products of which both ends and the middle break, and one place beside it holds."""
    tries = ((0.0, False), (0.3, False), (-0.3, False), (-0.15, False), (0.15, True))
    return [evidence(f"brittle-{k}", *tries, size=size) for k in range(count)]


def test_the_hypotheses_are_closed_under_exchange_of_the_ends() -> None:
    assert np.array_equal(np.sort(MIRRORED), np.arange(len(PRIOR)))
    np.testing.assert_allclose(PRIOR[MIRRORED], PRIOR)
    np.testing.assert_allclose(allowed(ALONG, 0.1)[MIRRORED], allowed(-ALONG, 0.1))


def test_without_other_products_the_prior_is_the_general_one() -> None:
    assert np.array_equal(Population().prior_of(SIZE), PRIOR)
    share = hidden_share(ALONG, 0.1, *NOTHING_TRIED, prior=PRIOR)
    assert share.tolist() == [1.0] * len(ALONG)


def test_a_family_that_no_cause_explains_is_learned_for_either_end() -> None:
    prior = Population(brittle(4)).prior_of(SIZE)
    share = hidden_share(ALONG, 0.1, *NOTHING_TRIED, prior=prior)
    np.testing.assert_allclose(share, share[::-1], atol=1e-6)
    assert share[1] == 1.0
    assert share[[0, 2, 4]].max() < 0.75
    # After a failure in the middle the ends are not where to look, as they are without lessons.
    failed = (np.zeros(1), np.zeros(1), np.ones(1))
    assert hidden_share(ALONG, 0.1, *failed)[4] > 0.9
    assert hidden_share(ALONG, 0.1, *failed, prior=prior)[4] < 0.6


def test_products_that_hold_anywhere_make_it_likely_that_nothing_hides() -> None:
    plain = [evidence(f"box-{k}", (0.0, True)) for k in range(6)]
    assert Population(plain).prior_of(SIZE)[0] > PRIOR[0]


def test_products_of_another_size_say_little_and_what_is_asked_about_nothing() -> None:
    others = Population(brittle(4, size=(0.3, 0.1, 0.1)))
    np.testing.assert_allclose(others.prior_of(SIZE), PRIOR, atol=0.01)
    assert np.array_equal(Population(brittle(4)).prior_of(SIZE, lambda name: True), PRIOR)


def test_the_order_of_products_does_not_matter() -> None:
    products = [*brittle(3), evidence("box-1", (0.0, True))]
    assert np.array_equal(
        Population(products).prior_of(SIZE), Population(products[::-1]).prior_of(SIZE)
    )


def test_an_attempt_of_no_weight_says_nothing() -> None:
    shares = allowed(np.array([0.0]), 0.1)
    assert not log_likelihood(shares, np.zeros(1), np.zeros(1)).any()
