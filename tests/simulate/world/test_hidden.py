"""Products with a secret: it is fixed by the name, no camera sees it, and physics obeys it."""

from __future__ import annotations

import itertools
from dataclasses import replace

import click
import numpy as np
import pytest

from rtask.errors import UsageError
from simulate.fleet.study_commands import attempts
from simulate.study.attempt_table import attempt_study, attempt_trial, read_attempts
from simulate.world.hidden import HIDDEN_KINDS, UNFORESEEN_KINDS, HiddenKind, Part
from simulate.world.objects import PRODUCTS, product, sample_products, spec_of
from simulate.world.world import World


def _is_odd(part: Part) -> bool:
    return part.breaks_at_n < 10 or part.lateral is not None


@pytest.mark.parametrize("kind", HIDDEN_KINDS)
def test_the_name_fixes_the_secret_and_either_end_may_have_it(kind: str) -> None:
    specs = [product(kind, number) for number in range(20)]  # type: ignore[arg-type]
    assert specs == [product(kind, number) for number in range(20)]  # type: ignore[arg-type]
    if specs[0].secret.parts:
        ends = [next(p for p in s.secret.parts if _is_odd(p)).position[0] for s in specs]
    else:
        ends = [s.secret.mass_offset_m + s.secret.travel_m for s in specs]
    assert min(ends) < 0 < max(ends) or kind in ("brittle", "ribbed")  # whose ends both break
    for spec, end in zip(specs, ends, strict=True):
        assert abs(end) < spec.dims[0] / 2
        assert spec.shape == "box"


@pytest.mark.parametrize("kind", HIDDEN_KINDS)
def test_a_look_alike_has_its_secret_at_the_other_end(kind: str) -> None:
    spec, other = spec_of(f"{kind}-3"), spec_of(f"{kind}-3", look_alike=True)
    assert replace(other, secret=spec.secret) == spec
    assert other.secret != spec.secret == other.secret.mirrored()
    assert [p.position[0] for p in other.secret.parts] == [
        -p.position[0] for p in spec.secret.parts
    ]


def test_the_hard_set_hides_most_of_what_it_holds() -> None:
    specs = sample_products("hard", np.random.default_rng(0), 8)
    assert sum(spec.kind in HIDDEN_KINDS for spec in specs) == 7
    assert len({spec.name for spec in specs}) == 8
    assert sorted(spec.kind for spec in specs) == sorted(PRODUCTS["hard"])
    with pytest.raises(UsageError, match="unknown products 'odd'"):
        sample_products("odd", np.random.default_rng(0), 1)


def test_the_light_set_is_offered_and_weighs_what_a_weak_hand_lifts() -> None:
    specs = sample_products("light", np.random.default_rng(0), 12)
    assert {spec.kind for spec in specs} == {"carton", "rod"}
    assert max(spec.mass for spec in specs) <= 0.15  # a Nao lifts 0.3 kg with its centre held
    option = next(p for p in attempts.params if p.name == "products")
    assert isinstance(option.type, click.Choice)
    assert set(option.type.choices) == set(PRODUCTS)


def test_the_pose_of_a_product_is_that_of_its_middle_wherever_its_mass_is() -> None:
    spec = product("bar", 1)
    with World("fast") as world:
        world.add_table()
        body = world.spawn(spec, (0.2, 0.1), yaw=0.7)
        centre, _ = world.client.getBasePositionAndOrientation(body)
        offset = np.array(centre[:2]) - [0.2, 0.1]
        along = [np.cos(0.7), np.sin(0.7)]
        assert offset @ along == pytest.approx(spec.secret.mass_offset_m, abs=1e-6)
        world.step(0.3)
        pose = world.object_pose(body)
        # Physics lets a body sink into the table by a fraction of a millimetre.
        assert pose.position[:2] == pytest.approx([0.2, 0.1], abs=1e-3)
        assert pose.z == pytest.approx(world.table_height + spec.rest_height, abs=1e-3)


def test_a_pressed_weak_end_breaks_and_the_product_stays_on_the_table() -> None:
    spec = product("carton", 0)
    with World("fast") as world:
        world.add_table()
        body = world.spawn(spec, (0.2, 0.0))
        world.step(0.3)
        assert body not in world.broken  # its own weight does not break it
        weak = next(p for p in spec.secret.parts if p.breaks_at_n < 10)
        stamp = world.spawn(product("bar", 1), (0.2 + weak.position[0], 0.0, 0.40))
        world.step(0.5)
        assert body in world.broken
        world.remove(stamp)
        world.step(0.5)
        assert world.object_pose(body).z == pytest.approx(
            world.table_height + spec.rest_height, abs=0.003
        )


@pytest.mark.parametrize("kind", [k for k in UNFORESEEN_KINDS if k != "shifting"])
def test_the_parts_of_a_product_fill_it_from_end_to_end(kind: HiddenKind) -> None:
    spec = product(kind, 5)
    parts = sorted(spec.secret.parts, key=lambda part: part.position[0])
    ends = [(p.position[0] - p.size[0] / 2, p.position[0] + p.size[0] / 2) for p in parts]
    assert (ends[0][0], ends[-1][1]) == pytest.approx((-spec.dims[0] / 2, spec.dims[0] / 2))
    for (_, end), (start, _) in itertools.pairwise(ends):
        assert start == pytest.approx(end)


def test_a_band_is_as_slippery_as_its_part_says_and_the_rest_is_not() -> None:
    spec = product("banded", 3)
    with World("fast") as world:
        body = world.spawn(spec, (0.2, 0.0, 0.5))
        rub = [world.client.getDynamicsInfo(body, link)[1] for link in (-1, 0, 1)]
    assert rub == pytest.approx([spec.secret.parts[0].lateral, *[spec.friction.lateral] * 2])


def test_a_loose_weight_slides_to_the_lower_end() -> None:
    spec = product("shifting", 1)
    with World("fast") as world:
        body = world.spawn(spec, (0.2, 0.0, 0.5))
        start = world.client.getJointState(body, 0)[0]
        assert start == pytest.approx(spec.secret.travel_m)
        # Held so that the other end is the lower one.
        turned = world.client.getQuaternionFromEuler((0.0, -np.sign(start) * 0.9, 0.0))
        world.put(body, (0.2, 0.0, 0.5), turned)
        world.client.createConstraint(
            body, -1, -1, -1, world.client.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0.2, 0.0, 0.5],
            [0, 0, 0, 1], turned,
        )  # fmt: skip
        world.step(0.4)
        assert world.client.getJointState(body, 0)[0] * start < 0


@pytest.mark.slow
def test_a_hand_holds_a_carton_by_its_strong_end_and_a_bar_near_its_mass() -> None:
    study = attempt_study(8, "hard", "panda", grasps=5, tries=3, seed=0)
    specs = sample_products("hard", np.random.default_rng(np.random.SeedSequence((0, 60))), 8)
    held: dict[bool, list[bool]] = {True: [], False: []}
    for number, spec in enumerate(specs):
        if spec.kind not in ("carton", "bar") or len(held[True]) > 8:
            continue
        found = attempt_trial(study.settings, number)
        assert found["product"] == spec.name
        good = spec.secret.mass_offset_m
        if spec.kind == "carton":
            good = next(p for p in spec.secret.parts if p.breaks_at_n > 10).position[0]
        for arm in found["arms"]:
            if abs(arm["x"]) >= 0.029:
                held[bool(arm["x"] * good > 0)].extend(arm["held"])
    assert np.mean(held[True]) > 0.8
    assert np.mean(held[False]) < 0.2


def test_what_is_no_table_of_attempts_is_refused_with_the_command_that_makes_one(tmp_path) -> None:
    path = tmp_path / "attempts.json"
    for text in ("", "{}", '{"format": 1, "products": []}'):
        path.write_text(text)
        with pytest.raises(UsageError, match="rtask study attempts --out FOLDER"):
            read_attempts(path)
    with pytest.raises(UsageError, match="at least 2 grasps and 3 tries"):
        attempt_study(4, "hard", "panda", grasps=5, tries=1, seed=0)
