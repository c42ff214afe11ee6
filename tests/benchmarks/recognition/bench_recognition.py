"""Benchmark of recognition: recall, false answers and time.

    python bench_recognition.py tables     # open set, as the robot sees
    python bench_recognition.py tables --tables 60 --products 60
    python bench_recognition.py speed      # time of every step
    python bench_recognition.py turntable  # a sixth of it, Kehoe 4.6
    python bench_recognition.py turntable --every 1 --step 5 --cache FOLDER
    python bench_recognition.py prints     # generated cartons with siblings
    python bench_recognition.py prints --save-plot FAMILY.png
    python bench_recognition.py photographs --photos FOLDER
    python bench_recognition.py photographs --photos FOLDER --cut
    python bench_recognition.py photographs --photos FOLDER --cut middle

``tables`` lays products on simulated tables, each with its own light, turns the head to both
sides, and describes what perception cut out, sent through the wire format: what robots really
exchange. Half of the products are stored from some of their views, the other half is unknown;
then every view that was not stored is asked. ``turntable`` needs the YCB models in
``$RTASK_SHARED_DATA/ycb``. ``prints`` stores two thirds of the cartons of ``generated_prints`` and
asks all: siblings of what is stored are the unknown. ``photographs`` runs the ``evaluate.py`` that
lies beside a collection of photographs, in the modes that are reported; with ``--cut``, in the
first of them, objects are cut out by colour instead (``cut_photographs``), and with ``--cut
middle`` as where nobody draws a box, in all of them but blur. Without a command: ``tables`` and
``speed``.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from features.codec import decode, encode_frame
from features.geometry import Frame
from features.recognition import (
    Recogniser,
    Recognition,
    RecognitionIndex,
    ViewFeatures,
    describe_frame,
    warm_up,
)
from features.recognition.confidence import decide
from features.recognition.metrics import expected_calibration_error, score_open_set
from tests.benchmarks.recognition.turntable import (
    described_views,
    is_fitted,
    without_depth,
    ycb_folder,
    ycb_names,
)


@dataclass(frozen=True, eq=False)
class View:
    """One view of one product, as one robot saw it."""

    product: str
    kind: str
    crop: Frame | None
    features: ViewFeatures


def views_of_tables(tables: int, products: int, seed: int, folder: Path) -> Iterator[View]:
    """Yield a view of every object that perception finds on tables of six products each."""
    from features.perception import Ignored, perceive
    from simulate.robots.nao import describe_nao
    from simulate.world.camera import Camera, Lighting
    from simulate.world.noise import SensorNoise
    from simulate.world.objects import sample_objects
    from simulate.world.robot_body import RobotBody
    from simulate.world.scene import lay
    from simulate.world.world import World

    rng = np.random.default_rng(seed)
    pool = sample_objects(rng, products)
    deck: list[int] = []
    for _ in range(tables):
        if len(deck) < 6:
            deck.extend(rng.permutation(products).tolist())
        chosen, deck = [pool[i] for i in dict.fromkeys(deck[:6])], deck[6:]
        with World() as world:
            camera, robot = Camera(world.client), RobotBody(world, describe_nao())
            world.add_table()
            boxes = [world.add_place_box(side) for side in ("right", "left")]
            ignored = tuple(Ignored(box.x_range, box.y_range) for box in boxes)
            laid = {x.body: x.placement.spec for x in lay(world, _arranged(chosen, rng), folder)}
            light = Lighting.sample(rng)
            for side in ("right", "left"):
                pose = robot.look(side)
                exact, bodies = camera.capture(pose, light)
                seen = perceive(SensorNoise().apply(exact, rng), pose, ignored)
                for found in seen.objects:
                    shown = np.bincount(bodies[found.mask] + 1).argmax() - 1
                    if int(shown) in laid:
                        crop = decode(encode_frame(found.crop))
                        assert isinstance(crop, Frame)
                        spec = laid[int(shown)]
                        yield View(spec.name, spec.kind, crop, describe_frame(crop))


def _arranged(products: list, rng: np.random.Generator) -> list:
    """Place as many of the products as the table has room for: two long pens fill one side."""
    from simulate.world.scene import arrange

    try:
        return arrange(products, rng)
    except ValueError:
        return _arranged(products[:-1], rng)


def open_set(
    views: list[View], stored: int, seed: int
) -> list[tuple[View, str | None, Recognition]]:
    """Store ``stored`` views of every other product, ask all that is left."""
    rng = np.random.default_rng(seed)
    names = rng.permutation(sorted({view.product for view in views})).tolist()
    known = set(names[: len(names) // 2])
    index, kept = RecognitionIndex(), set()
    for name in sorted(known):
        mine = [k for k, view in enumerate(views) if view.product == name]
        for k in rng.permutation(mine)[:stored].tolist():
            index.add(f"view:{k}", name, f"class:{views[k].kind}", views[k].features)
            kept.add(k)
    index.save()
    recogniser, answers = Recogniser(index), []
    for k, view in enumerate(views):
        if k not in kept:
            truth = view.product if view.product in known else None
            answers.append((view, truth, recogniser.recognise(view.features)))
    return answers


def report(title: str, answers: list[tuple[View, str | None, Recognition]]) -> None:
    scored = [(truth, answer) for _, truth, answer in answers]
    score = score_open_set(scored)
    by_kind = []
    for kind in sorted({view.kind for view, _, _ in answers}):
        mine = score_open_set([(t, a) for view, t, a in answers if view.kind == kind])
        by_kind.append(f"{kind} {mine.recall:.2f}")
    best = [(a.matches[0].confidence, a.matches[0].object_iri == t) for t, a in scored if a.matches]
    confidence, right = np.array([c for c, _ in best]), np.array([r for _, r in best])
    error = expected_calibration_error(confidence, right)
    print(
        f"{title:28s} recall {score.recall:.3f} of {score.known:4d}, "
        f"false {score.confused} known + {score.false_unknown} of {score.unknown} unknown, "
        f"calibration error {error:.3f}; " + ", ".join(by_kind)
    )


def run_tables(args: argparse.Namespace) -> None:
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        views = list(views_of_tables(args.tables, args.products, args.seed, Path(folder)))
    sides = [view.features.side_px for view in views]
    print(
        f"{len(views)} views of {len({v.product for v in views})} products on {args.tables} tables,"
        f" longer side {np.percentile(sides, 5):.0f} to {np.percentile(sides, 95):.0f} px, "
        f"{np.mean([len(v.features) for v in views]):.0f} keypoints "
        f"({time.perf_counter() - start:.0f} s)"
    )
    for stored in (1, 2, 3):
        answers = []
        for draw in range(args.draws):
            answers += open_set(views, stored, args.seed + 100 * draw + stored)
        report(f"{stored} stored views, {args.draws} draws", answers)


def run_turntable(args: argparse.Namespace) -> None:
    """Random 35 % of the views stored, the rest asked: all objects known, then a third unknown.

    The unknown are drawn twice: from the objects that fitted no constant, and from all.
    """
    folder = ycb_folder()
    if folder is None:
        print("skipped: ycb not found (78 textured objects); set RTASK_SHARED_DATA to its parent")
        return
    names = ycb_names(folder)[:: args.every]
    views = [
        View(name, "ycb", None, features)
        for name in names
        for features in described_views(folder, name, args.step, 0, args.cache)
    ]
    print(f"{len(views)} views of {len(names)} objects, draw {args.seed}")
    third = len(names) // 3
    strangers = [name for name in names if not is_fitted(name)]
    for title, pool, unknown, seen in (
        ("all known", names, 0, None),
        (f"{third} unknown, fitted nothing", strangers, third, None),
        (f"{third} unknown of all", names, third, None),
        ("all known, colour only", names, 0, without_depth),
    ):
        rng = np.random.default_rng([args.seed, unknown, len(pool)])
        absent = set(rng.permutation(pool)[:unknown].tolist())
        answers = _ask_turntable(views, absent, args.queries, rng, seen or (lambda f: f))
        report(title, answers)
        _report_thresholds(answers, rng)
        _report_confusions(answers)


def _ask_turntable(
    views: list[View],
    absent: set[str],
    queries: int,
    rng: np.random.Generator,
    seen: Callable[[ViewFeatures], ViewFeatures],
) -> list[tuple[View, str | None, Recognition]]:
    """Store 35 % of the views of what is known, ask some of the rest."""
    kept = np.array([view.product not in absent and rng.random() < 0.35 for view in views])
    index = RecognitionIndex()
    for k in np.flatnonzero(kept):
        index.add(f"view:{k}", views[k].product, "class:ycb", seen(views[k].features))
    index.save()
    recogniser, answers = Recogniser(index), []
    for k in rng.permutation(np.flatnonzero(~kept))[:queries]:
        truth = None if views[k].product in absent else views[k].product
        answers.append((views[k], truth, recogniser.recognise(seen(views[k].features))))
    return answers


def _report_thresholds(
    answers: list[tuple[View, str | None, Recognition]], rng: np.random.Generator
) -> None:
    """Print recall and false answers at Kehoe's thresholds; intervals by resampling objects."""
    products = sorted({view.product for view, _, _ in answers})
    for least in (0.5, 0.6, 0.7, 0.8, 0.9, 0.95):
        rows = {name: np.zeros(5) for name in products}
        for view, truth, answer in answers:
            rows[view.product] += _counted(truth, answer, least)
        total = sum(rows.values())
        again = np.array(
            [sum(rows[n] for n in rng.choice(products, len(products))) for _ in range(300)]
        )
        with np.errstate(invalid="ignore"):
            recalls, strange = again[:, 1] / again[:, 0], again[:, 4] / again[:, 3]
        low, high = np.nanpercentile(recalls, [2.5, 97.5])
        line = f"    c_I {least:.2f}: recall {total[1] / total[0]:.3f} ({low:.3f} to {high:.3f}), "
        line += f"false known {total[2]:.0f} of {total[0]:.0f}"
        if total[3]:
            low, high = np.nanpercentile(strange, [2.5, 97.5])
            share = total[4] / total[3]
            line += f", unknown accepted {total[4]:.0f} of {total[3]:.0f} = {share:.3f} "
            line += f"({low:.3f} to {high:.3f})"
        print(line)


def _counted(truth: str | None, answer: Recognition, least: float) -> np.ndarray:
    """Return known, recognised, false known, unknown, false unknown of one answer."""
    ranked = np.array([match.confidence for match in answer.matches])
    accepted = len(ranked) > 0 and decide(ranked, least)[1]
    right = accepted and answer.matches[0].object_iri == truth
    known = truth is not None
    return np.array(
        [known, right, known and accepted and not right, not known, not known and accepted], float
    )


def _report_confusions(answers: list[tuple[View, str | None, Recognition]]) -> None:
    """Name the wrong answers: look-alikes are worth knowing by name."""
    wrong = Counter(
        f"{view.product} as {answer.matches[0].object_iri}"
        for view, truth, answer in answers
        if answer.accepted and answer.matches[0].object_iri != truth
    )
    for pair, count in wrong.most_common(8):
        print(f"    {count} x {pair}")


def run_prints(args: argparse.Namespace) -> None:
    """Ask for cartons of families of which two thirds of the members are stored."""
    from tests.benchmarks.recognition.generated_prints import described, families

    rng = np.random.default_rng(args.seed)
    cards = families(args.families, 10_000 * args.seed)
    stored = {card.name: [described(card.print_, rng) for _ in range(5)] for card in cards}
    asked = {card.name: [described(card.print_, rng) for _ in range(2)] for card in cards}
    for count in (1, 3, 5):
        answers, told = [], 0
        for draw in range(args.draws):
            choice = np.random.default_rng([args.seed, count, draw])
            known = set(choice.permutation(sorted(stored))[: 2 * len(cards) // 3].tolist())
            index = RecognitionIndex()
            for name in sorted(known):
                for k in choice.permutation(5)[:count].tolist():
                    index.add(f"{name}/{k}", name, "class:carton", stored[name][k])
            recogniser = Recogniser(index)
            for card in cards:
                for features in asked[card.name]:
                    answer = recogniser.recognise(features)
                    truth = card.name if card.name in known else None
                    told += truth is None and answer.family.startswith(card.family)
                    answers.append((View(card.name, "carton", None, features), truth, answer))
        report(f"{count} stored views, {args.draws} draws", answers)
        print(f"    of the unknown, told to be of their family: {told}")
    if args.save_plot is not None:
        _save_family(cards, args.save_plot)


def _save_family(cards: list, path: Path) -> None:
    """Draw a carton beside its stored view, and under it a sibling that differs in one place."""
    import cv2

    from features.pictures import draw_matches
    from features.recognition import describe_view
    from features.recognition.pairs import counted_matches
    from tests.benchmarks.recognition.generated_prints import photograph

    rng = np.random.default_rng(1)
    pictures, index, seen = [], RecognitionIndex(), {}
    for k in range(3):
        image, mask = photograph(cards[1].print_, rng)
        seen[f"view:{k}"] = image, describe_view(image, mask)
        index.add(f"view:{k}", "the stored one", "class:carton", seen[f"view:{k}"][1])
    recogniser = Recogniser(index)
    for card in (cards[1], cards[0], cards[2]):
        image, mask = photograph(card.print_, rng)
        query = describe_view(image, mask)
        answer = recogniser.recognise(query)
        first = answer.matches[0]
        stored_image, stored = seen[first.view_iri]
        pairs, differs = counted_matches(query, stored), None
        verdict = "accepted" if answer.accepted else "not accepted"
        if answer.family and first.difference is not None:
            verdict = f"looks like it, but differs {first.difference.place}"
            left, top, width, height = query.mask_px.tolist()
            x, y, wide, high = first.difference.box
            differs = (left + x * width, top + y * height, wide * width, high * height)
        title = f"{first.confidence:.2f}, {verdict}, {first.inliers} matches agree"
        places = query.keypoints[pairs.first], stored.keypoints[pairs.second]
        pictures.append(draw_matches(image, stored_image, places, pairs.agreed, title, differs))
    width = max(picture.shape[1] for picture in pictures)
    rows = [np.pad(p, ((0, 6), (0, width - p.shape[1]), (0, 0))) for p in pictures]
    cv2.imwrite(str(path), np.concatenate(rows)[..., ::-1])
    print(f"saved {path}")


def run_photographs(args: argparse.Namespace) -> None:
    """Run the collection's own protocol in the modes that are reported."""
    import subprocess
    import sys

    script = args.photos.resolve() / "evaluate.py"
    modes = [[], ["--few"], ["--views", "1"], ["--views", "3"], ["--blur", "1.5"]]
    reported = {"": modes, "box": modes[:1], "middle": modes[:-1]}
    for mode in reported[args.cut]:
        # Unbuffered, so that each mode and what the adapter says of its progress is seen at once.
        command = [sys.executable, "-u", str(script)]
        command += ["--mask", "full" if args.cut == "middle" else "centre"]
        command += ["--draws", str(args.draws), "--ask", str(args.ask)]
        adapter = "CutByBestView" if args.best_view else "Cut"
        command += ["--adapter", f"cut_photographs:{adapter}"] if args.cut else []
        subprocess.run([*command, *mode], check=True, cwd=Path(__file__).parent)


def run_speed(args: argparse.Namespace) -> None:
    """Time describing, adding and recognising, on products seen through the robot's eyes."""
    with tempfile.TemporaryDirectory() as folder:
        views = list(views_of_tables(args.tables // 2, 50, args.seed, Path(folder)))
        warm_up()
        crops = [view.crop for view in views if view.crop is not None]
        print(
            f"describe a view       {_milliseconds([lambda c=c: describe_frame(c) for c in crops])}"
        )
        with RecognitionIndex(Path(folder) / "index") as index:
            for goal in (100, 1000):
                steps = []
                for k in range(len(index), goal):
                    view = views[k % len(views)]
                    steps.append(lambda k=k, v=view: index.add(f"v:{k}", f"o:{k}", "c", v.features))
                print(f"add up to {goal:5d} views  {_milliseconds(steps)}")
                index.save()
                recogniser = Recogniser(index)
                asked = [lambda r=recogniser, v=v: r.recognise(v.features) for v in views]
                print(f"recognise among {goal:5d} {_milliseconds(asked)}")


def _milliseconds(steps: list) -> str:
    wall, cpu = [], []
    for step in steps:
        w, c = time.perf_counter(), time.thread_time()
        step()
        wall.append(1e3 * (time.perf_counter() - w))
        cpu.append(1e3 * (time.thread_time() - c))
    return (
        f"median {np.median(wall):6.1f} ms, 95 % {np.percentile(wall, 95):6.1f} ms, "
        f"own thread {np.median(cpu):6.1f} ms CPU ({len(steps)} times)"
    )


_COMMANDS = ("tables", "speed", "turntable", "prints", "photographs")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", nargs="?", choices=_COMMANDS)
    parser.add_argument("--tables", type=int, default=24, help="tables of six products")
    parser.add_argument("--products", type=int, default=30, help="in the pool of tables")
    parser.add_argument("--draws", type=int, default=4, help="of what is known and stored")
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--every", type=int, default=2, help="turntable: every so many objects")
    parser.add_argument("--step", type=int, default=15, help="turntable: degrees between views")
    parser.add_argument("--cache", type=Path, help="turntable: keep described views here")
    parser.add_argument("--queries", type=int, default=400, help="turntable: views asked")
    parser.add_argument("--families", type=int, default=8, help="prints: families of three")
    parser.add_argument("--save-plot", type=Path, help="prints: picture of a family")
    parser.add_argument("--photos", type=Path, help="photographs: folder with evaluate.py")
    parser.add_argument("--ask", type=int, default=8, help="photographs: asked of each product")
    parser.add_argument(
        "--cut", nargs="?", choices=("box", "middle"), const="box", default="",
        help="photographs: masks by GrabCut, inside a box or without one",
    )  # fmt: skip
    parser.add_argument(
        "--best-view", action="store_true",
        help="with --cut middle: the best view of an object decides alone, for comparison",
    )  # fmt: skip
    args = parser.parse_args()
    if args.command == "photographs" and args.photos is None:
        parser.error("photographs needs --photos FOLDER")
    if args.best_view and args.cut != "middle":
        parser.error("--best-view goes with --cut middle")
    if args.command in (None, "tables"):
        run_tables(args)
    if args.command in (None, "speed"):
        run_speed(args)
    if args.command == "turntable":
        run_turntable(args)
    if args.command == "prints":
        run_prints(args)
    if args.command == "photographs":
        run_photographs(args)


if __name__ == "__main__":
    main()
