"""Objects with one print: how often they are reported, rightly and wrongly.

    python bench_twins.py                  # generated prints
    python bench_twins.py --photos FOLDER  # photographs too, cut by colour

Views are stored one by one, as ``rtask teach`` stores them, and after each the index is asked which
other objects carry its print. A *pair* counts once, however many of its views say so. Generated:
families of three cards (``generated_prints.families``) and, of each first one, the same print under
a second name. Photographs: ``stored/PRODUCT/*.jpg`` under masks by GrabCut; pairs of products, but
for the soy milk that is sold under two names, carry two prints; for twins, each product's
photographs are dealt out to two names in turn. Intervals are Wilson's at 95 %.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from itertools import combinations
from pathlib import Path

import numpy as np

from features.imaging.photo import read_photo
from features.imaging.selection import frame_of_photo
from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, warm_up
from features.recognition.views.view import describe_frame
from tests.benchmarks.perception.bench_pose import wilson
from tests.benchmarks.recognition.generated_prints import described, families

Named = list[tuple[str, ViewFeatures]]
ONE_PRINT = frozenset({"Alpro-Fresh-Soy-Milk", "Alpro-Shelf-Soy-Milk"})


def told(views: Iterable[tuple[str, ViewFeatures]]) -> set[frozenset[str]]:
    """Store views and return the pairs of names that were told to carry one print."""
    index, pairs = RecognitionIndex(), set()
    recogniser = Recogniser(index)
    for k, (name, view) in enumerate(views):
        index.add(f"view:{k}", name, "class:any", view)
        recogniser.prepare([f"view:{k}"])
        pairs |= {frozenset((name, other)) for other in recogniser.same_print(f"view:{k}")}
    return pairs


def halves(views: Named) -> Named:
    """Deal out the views of each name to two names in turn."""
    counts: dict[str, int] = {}
    dealt = []
    for name, view in views:
        counts[name] = counts.get(name, 0) + 1
        dealt.append((f"{name} #{counts[name] % 2}", view))
    return dealt


def report(title: str, held: int, of: int) -> None:
    """Print one line."""
    print(f"{title:60s} {held} of {of}: {wilson(held, of)}", flush=True)


def generated(count: int, views: int, seed: int) -> None:
    """Measure families of which the first card is stored under two names."""
    rng = np.random.default_rng(seed)
    cards = families(count, 10_000 * seed)
    named = [(card.name, card.print_) for card in cards]
    named += [(f"{card.name} again", card.print_) for card in cards[::3]]
    pairs = told((name, described(print_, rng)) for name, print_ in named for _ in range(views))
    twins = {frozenset((card.name, f"{card.name} again")) for card in cards[::3]}
    siblings = sum(
        first[: first.index(",")] == second[: second.index(",")]
        for first, second in combinations([name for name, _ in named], 2)
    )
    print(f"generated, {views} views of each")
    report("   the same print under two names", len(pairs & twins), len(twins))
    report("   siblings told to be one", len(pairs - twins), siblings - len(twins))


def photographed(folder: Path, most: int, brand: str) -> None:
    """Measure products, and products whose photographs are dealt out to two names."""
    views = []
    for product in sorted((folder / "stored").glob(f"{brand}*")):
        for photo in sorted(product.glob("*.jpg"))[:most]:
            frame = frame_of_photo(read_photo(photo.read_bytes()))
            views.append((product.name, describe_frame(frame)))
    names = {name for name, _ in views}
    pairs = told(views)
    print(f"photographs, {len(views)} of {len(names)} products, cut by colour")
    other = len(names) * (len(names) - 1) // 2 - (names >= ONE_PRINT)
    report("   two products told to be one", len(pairs - {ONE_PRINT}), other)
    if names >= ONE_PRINT:
        print(f"   the soy milk under two names: {'told' if ONE_PRINT in pairs else 'missed'}")
    pairs = told(halves(views))
    twins = {frozenset((f"{name} #0", f"{name} #1")) for name in names}
    report("   one product under two names", len(pairs & twins), len(twins))


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--families", type=int, default=12)
    parser.add_argument("--views", type=int, default=3, help="of each generated card")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--photos", type=Path, help="folder with stored/PRODUCT/*.jpg")
    parser.add_argument("--brand", default="", help="photographs: products whose names begin so")
    parser.add_argument("--most", type=int, default=12, help="photographs of each product")
    args = parser.parse_args()
    warm_up()
    if args.families:
        generated(args.families, args.views, args.seed)
    if args.photos:
        photographed(args.photos, args.most, args.brand)


if __name__ == "__main__":
    main()
