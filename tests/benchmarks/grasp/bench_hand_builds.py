"""Hands of sixteen builds, drawn at random: in how many is a hand found, and how far off is it?

    python bench_hand_builds.py --draws 25

Each draw has another size, arm, mount (also on a bracket that leads aside), axes and limits.
Counted are files in which just one hand is found; of builds whose fingers agree on a direction, how
far the approach is from it. Builds that are no hands must give none.
"""

from __future__ import annotations

import argparse
import random
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from simulate.onboarding.hands import find_hands
from simulate.onboarding.measured_hand import MeasuredHand
from simulate.robots.robot_files import bare_robot

Vector = tuple[float, float, float]
Box = tuple[Vector, Vector]
PALM: Box = ((0.06, 0.09, 0.05), (0, 0, 0.025))
SIDES = (("p", 1), ("q", -1))
_MOUNTS: tuple[Vector, ...] = ((0, 0, 0), (0, np.pi / 2, 0), (np.pi / 2, 0, 0), (0, 0, np.pi / 4))
_ARM: tuple[Vector, ...] = (
    (0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)
)  # fmt: skip


def _words(numbers: Sequence[float]) -> str:
    return " ".join(f"{number:.5f}" for number in numbers)


class Draw:
    """A hand that is being built: boxes (size, middle) and joints in m, the palm's z ahead."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.scale = self.rng.uniform(0.6, 1.5)
        self.mount: Vector = (0, 0, 0)
        self.parts: list[str] = []

    def link(self, name: str, *boxes: Box) -> None:
        shapes = "".join(
            f'<collision><origin xyz="{_words([self.scale * m for m in middle])}"/><geometry>'
            f'<box size="{_words([self.scale * side for side in size])}"/></geometry></collision>'
            for size, middle in boxes
        )
        self.parts.append(f'<link name="{name}">{shapes}</link>')

    def joint(
        self, parent: str, child: str, at: Vector, axis: Vector = (0, 0, 1),
        limits: tuple[float, float] = (0, 1), kind: str = "revolute", follows: str = "",
    ) -> None:  # fmt: skip
        """Add a joint; ``follows`` is a link and a multiplier."""
        by = self.scale if kind == "prismatic" else 1.0
        source, _, factor = follows.partition(" ")
        mimic = f'<mimic joint="to_{source}" multiplier="{factor or 1}"/>' if source else ""
        self.parts.append(
            f'<joint name="to_{child}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{_words([self.scale * x for x in at])}"/>'
            f'<axis xyz="{_words(axis)}"/><limit lower="{by * limits[0]:.5f}" '
            f'upper="{by * limits[1]:.5f}" velocity="2" effort="20"/>{mimic}</joint>'
        )

    def on_an_arm(self) -> str:
        """Return the URDF, with an arm of four to six joints and a bracket before the palm."""
        hand, self.parts, size, self.scale = self.parts, [], self.scale, 1.0
        count = self.rng.choice([4, 5, 6])
        self.link("b0", ((0.1, 0.1, 0.1), (0, 0, 0.05)))
        for i in range(count):
            length = 0.16 if i + 1 < count else 0.03
            self.link(f"b{i + 1}", ((0.05, 0.05, length), (0, 0, length / 2)))
            self.joint(f"b{i}", f"b{i + 1}", (0, 0, 0.17), _ARM[i], (-2.6, 2.6))
        any_way: Vector = (
            self.rng.uniform(-3, 3),
            self.rng.uniform(-3, 3),
            self.rng.uniform(-3, 3),
        )
        self.mount = self.rng.choice([*_MOUNTS, any_way])
        self.parts.append(
            f'<joint name="bracket" type="fixed"><parent link="b{count}"/><child link="palm"/>'
            f'<origin xyz="0 0 {0.03 * size:.5f}" rpy="{_words(self.mount)}"/></joint>'
        )
        return f'<robot name="drawn">{"".join(self.parts + hand)}</robot>'


def _sliding(d: Draw) -> None:
    d.link("palm", PALM)
    is_closed_at_zero = d.rng.random() < 0.5
    for name, side in SIDES:
        d.link(name, ((0.02, 0.012, 0.06), (0, 0, 0.03)))
        out = side if is_closed_at_zero else -side
        y = 0.006 if is_closed_at_zero else 0.045
        limits = (0.0, 0.038)
        if d.rng.random() < 0.4:
            out, limits = -out, (-0.038, 0.0)
        d.joint("palm", name, (0, side * y, 0.05), (0, out, 0), limits, "prismatic")


def _one_slides(d: Draw) -> None:
    d.link("palm", PALM, ((0.02, 0.012, 0.06), (0, -0.03, 0.08)))
    d.link("p", ((0.02, 0.012, 0.06), (0, 0, 0.03)))
    d.joint("palm", "p", (0, 0.04, 0.05), (0, -1, 0), (0, 0.056), "prismatic")


def _turning(d: Draw) -> None:
    d.link("palm", PALM)
    for name, side in SIDES:
        length = d.rng.uniform(0.05, 0.09)
        d.link(name, ((0.018, 0.014, length), (0, 0, length / 2)))
        axis, limits = (side, 0, 0), (-0.7, 0.35)
        if d.rng.random() < 0.5:
            axis, limits = (-side, 0, 0), (-0.35, 0.7)
        d.joint("palm", name, (0, side * 0.03, 0.05), axis, limits)


def _bent(d: Draw, count: int, lengths: float, follows: bool) -> None:
    d.link("palm", PALM)
    for name, side in SIDES:
        parent, at = "palm", (0.0, side * 0.037, 0.05)
        for i in range(count):
            child = f"{name}{i}"
            d.link(child, ((0.02, 0.012, lengths), (0, 0, lengths / 2)))
            led = "p0 .7" if follows and (i or name == "q") else ""
            limits = (0.0, 0.7) if i else (-0.4, 0.6)
            d.joint(parent, child, at, (side, 0, 0), limits, follows=led)
            parent, at = child, (0.0, 0.0, lengths + 0.001)


def _jaw(d: Draw) -> None:
    d.link("palm", PALM, ((0.022, 0.008, 0.09), (0, -0.012, 0.095)))
    length, way = d.rng.uniform(0.07, 0.1), d.rng.choice([1, -1])
    d.link("p", ((0.02, 0.007, length), (0, 0.003, length / 2)))
    limits = (-1.6, 0.15) if way > 0 else (-0.15, 1.6)
    d.joint("palm", "p", (0, 0.014, 0.055), (way, 0, 0), limits)


def _jaw_beside(d: Draw) -> None:
    d.link("palm", ((0.05, 0.06, 0.05), (0, 0, 0.025)), ((0.03, 0.01, 0.08), (0, -0.02, 0.09)))
    d.link("p", ((0.03, 0.01, 0.08), (0, 0, 0.045)), ((0.03, 0.03, 0.02), (0, 0, 0.005)))
    d.joint("palm", "p", (0, 0, 0.05), (-1, 0, 0), (-0.17, 1.75))


def _parallel_bars(d: Draw) -> None:
    d.link("palm", PALM)
    for name, side in SIDES:
        bar, pad = f"{name}_bar", f"{name}_pad"
        d.link(bar, ((0.01, 0.01, 0.05), (0, 0, 0.025)))
        d.link(pad, ((0.02, 0.01, 0.05), (0, -side * 0.004, 0.025)))
        led = "" if name == "p" else "p_bar"
        d.joint("palm", bar, (0, side * 0.025, 0.05), (-side, 0, 0), (-0.45, 0.45), follows=led)
        d.joint(bar, pad, (0, 0, 0.05), (-side, 0, 0), (-0.9, 0.9), follows="p_bar -1")


def _around(d: Draw, kind: str) -> None:
    d.link("palm", ((0.09, 0.09, 0.05), (0, 0, 0.025)))
    start = d.rng.uniform(0, 1)
    for i in range(3):
        x, y = np.cos(start + i * 2 * np.pi / 3), np.sin(start + i * 2 * np.pi / 3)
        d.link(f"t{i}", ((0.014, 0.014, 0.07), (0, 0, 0.035)))
        at = (0.042 * x, 0.042 * y, 0.05)
        if kind == "prismatic":
            d.joint("palm", f"t{i}", at, (-x, -y, 0), (0, 0.033), kind)
        else:
            d.joint("palm", f"t{i}", at, (y, -x, 0), (-0.4, 0.45), follows="t0" if i else "")


def _two_against_one(d: Draw) -> None:
    d.link("palm", ((0.07, 0.09, 0.05), (0, 0, 0.025)))
    for name, x, side in (("f1", 0.025, 1), ("f2", -0.025, 1), ("f3", 0.0, -1)):
        first, second = f"{name}a", f"{name}b"
        d.link(first, ((0.016, 0.014, 0.05), (0, 0, 0.025)))
        d.link(second, ((0.014, 0.012, 0.04), (0, 0, 0.02)))
        d.joint("palm", first, (x, side * 0.04, 0.05), (side, 0, 0), (-0.2, 1.2))
        d.joint(first, second, (0, 0, 0.052), (side, 0, 0), (0, 1))


def _thumb(d: Draw, fingers: int) -> None:
    d.link("palm", ((0.09, 0.03, 0.08), (0, 0, 0.04)))
    for i, x in enumerate(np.linspace(-0.033, 0.033, fingers).tolist()):
        parent, at = "palm", (x, 0.0, 0.085)
        for j in range(d.rng.choice([2, 3])):
            child = f"f{i}{j}"
            d.link(child, ((0.015, 0.015, 0.035), (0, 0, 0.0175)))
            d.joint(parent, child, at, (-1, 0, 0), (0, 1.5), follows=f"f{i}0" if j else "")
            parent, at = child, (0.0, 0.0, 0.037)
    d.link("h0", ((0.016, 0.016, 0.02), (0, 0.02, 0)))
    d.link("h1", ((0.016, 0.016, 0.04), (0, 0, 0.02)))
    d.link("h2", ((0.014, 0.014, 0.03), (0, 0, 0.015)))
    d.joint("palm", "h0", (0.03, 0.02, 0.03), (0, 0, 1), (-0.5, 0.8))
    d.joint("h0", "h1", (0, 0.03, 0), (1, 0, 0), (-0.4, 0.9))
    d.joint("h1", "h2", (0, 0, 0.042), (1, 0, 0), (0, 1.2))


def _rack(d: Draw) -> None:
    d.link("palm", PALM)
    d.link("gear", ((0.01, 0.01, 0.01), (0, 0, 0)))
    d.joint("palm", "gear", (0, 0, 0.02), (0, 0, 1), (0, 2))
    for name, side in SIDES:
        d.link(name, ((0.02, 0.012, 0.06), (0, 0, 0.03)))
        led = f"gear {0.019 * d.scale:.5f}"
        at = (0, side * 0.045, 0.05)
        d.joint("palm", name, at, (0, -side, 0), (0, 0.038), "prismatic", led)


def _scissors(d: Draw) -> None:
    d.link("palm", PALM)
    for name, side in SIDES:
        d.link(name, ((0.02, 0.008, 0.09), (0, side * 0.006, 0.045)))
        led = "p" if name == "q" else ""
        d.joint("palm", name, (0, side * 0.001, 0.06), (-side, 0, 0), (0, 0.7), follows=led)


def _wide(d: Draw) -> None:
    d.link("palm", ((0.1, 0.2, 0.06), (0, 0, 0.03)))
    gap = d.rng.uniform(0.002, 0.015)
    for name, side in SIDES:
        d.link(name, ((0.03, 0.02, 0.07), (0, 0, 0.035)))
        at, led = (0, side * (0.01 + gap / 2), 0.06), "p" if name == "q" else ""
        d.joint("palm", name, at, (0, side, 0), (0, 0.07), "prismatic", led)


def _pan_and_tilt(d: Draw) -> None:
    d.link("palm", PALM)
    d.link("c1", ((0.03, 0.03, 0.03), (0, 0, 0.015)))
    d.link("c2", ((0.06, 0.03, 0.03), (0, 0, 0.015)))
    d.joint("palm", "c1", (0, 0, 0.06), (0, 0, 1), (-1, 1))
    d.joint("c1", "c2", (0, 0, 0.04), (0, 1, 0), (-1, 1))


def _wheels(d: Draw) -> None:
    d.link("palm", ((0.3, 0.2, 0.05), (0, 0, 0)))
    for i, (x, y) in enumerate(((0.1, 0.13), (0.1, -0.13), (-0.1, 0.13), (-0.1, -0.13))):
        d.link(f"w{i}", ((0.08, 0.03, 0.08), (0, 0, 0)))
        d.joint("palm", f"w{i}", (x, y, 0), (0, 1, 0), (-3.14, 3.14))


def _sensors(d: Draw) -> None:
    d.link("palm", PALM)
    for name, side in SIDES:
        d.link(name, ((0.03, 0.03, 0.03), (0, 0, 0.015)))
        d.joint("palm", name, (0, side * 0.06, 0.05), (0, 0, 1), (-3, 3))


AHEAD: dict[str, Callable[[Draw], None]] = {
    "two slide": _sliding, "one slides": _one_slides, "two turn": _turning,
    "two links each": lambda d: _bent(d, 2, 0.045, follows=d.rng.random() < 0.5),
    "three links each": lambda d: _bent(d, 3, 0.03, follows=True),
    "parallel bars": _parallel_bars, "three turn": lambda d: _around(d, "revolute"),
    "three slide": lambda d: _around(d, "prismatic"), "two against one": _two_against_one,
    "rack": _rack, "scissors": _scissors, "wide": _wide, "jaw": _jaw, "jaw beside": _jaw_beside,
}  # fmt: skip
"""Hands whose approach is the palm's z."""
OPPOSED: dict[str, Callable[[Draw], None]] = {
    "thumb and four": lambda d: _thumb(d, 4), "thumb and three": lambda d: _thumb(d, 3)
}  # fmt: skip
NONE: dict[str, Callable[[Draw], None]] = {
    "bare wrist": lambda d: d.link("palm", PALM), "pan and tilt": _pan_and_tilt,
    "wheels": _wheels, "sensors": _sensors,
}  # fmt: skip


def hands_of(build: Callable[[Draw], None], seed: int) -> tuple[list[MeasuredHand], Vector]:
    """Return the hands that are found in a draw of a build, and how its palm is mounted (rpy)."""
    draw = Draw(seed)
    build(draw)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drawn.urdf"
        path.write_text(draw.on_an_arm(), "utf-8")
        return list(find_hands(bare_robot(path, name="drawn")[0])), draw.mount


def main() -> None:
    """Print a line for each build."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=25)
    parser.add_argument("--seed", type=int, default=0, help="of the first draw")
    args = parser.parse_args()
    seeds = range(args.seed, args.seed + args.draws)
    recognised = 0
    for name, build in (AHEAD | OPPOSED).items():
        drawn = [hands_of(build, seed) for seed in seeds]
        single = [(hands[0], mount) for hands, mount in drawn if len(hands) == 1]
        recognised += len(single)
        off = [
            float(np.degrees(np.arccos(np.clip(_ahead(mount) @ hand.approach, -1, 1))))
            for hand, mount in single
        ]
        tilt = f", approach off by {np.median(off):.0f}, at most {max(off):.0f} degrees"
        shown = tilt if name in AHEAD and off else ""
        print(f"{name:18s} {len(single)} of {len(drawn)}{shown}", flush=True)
    print(f"in all {recognised} of {len(AHEAD | OPPOSED) * len(seeds)}")
    for name, build in NONE.items():
        false = sum(bool(hands_of(build, seed)[0]) for seed in seeds)
        print(f"no hand: {name:12s} {false} of {len(seeds)} taken for one", flush=True)


def _ahead(mount: Vector) -> np.ndarray:
    return np.asarray(Rotation.from_euler("xyz", mount).apply([0.0, 0.0, 1.0]))


if __name__ == "__main__":
    main()
