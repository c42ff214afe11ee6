"""Speed, the bound against simulation, that against Box2D, Sobol points against chance."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial

import numpy as np

from grasp.push import PushTest, Tolerance, as_part, sample_grasps
from grasp.push.mechanics.quasistatic import NO_POINTS, simulate, simulate_on_points
from grasp.push.parts import BRACKETS, SHAPES, TAPE_DISPENSER_COM, stand_in
from grasp.push.pose import PoseTrials, centred_grasp
from grasp.push.trials import Trials
from simulate.thesis.materials.outlines import CONFIGURATIONS, timed, trials_of, usual
from tests.grasp.push.in_box2d import is_available, simulate_in_box2d
from tests.grasp.push.soft_contact import OUTLINES, compared


def speed() -> None:
    """Evaluations per second and core."""
    for setting in CONFIGURATIONS:
        trials = trials_of("A", setting, 0)
        _, spent, _ = timed(partial(trials, 0, 400))
        rate = len(trials.rows) * 400 / spent
        print(f"{setting}: {rate / 1e6:.2f} M evaluations/s/core (target 1)")


def bound() -> None:
    """The bound against the simulator, on an ellipsoid and on supports of three points."""
    rng = np.random.default_rng(0)
    names = (*SHAPES, *BRACKETS)
    sets = {name: _accepted(name, 30) for name in names}
    feet = {name: np.array([_tripod(vx, vy, rng) for vx, vy in zip(x, y, strict=True)])
            for name, (_, _, x, y, _) in sets.items()}  # fmt: skip
    for step in (0.008, 0.004, 0.002, 0.001):
        accepted, missed, on_feet = 0, 0, 0
        for name, (trials, g, x, y, mass) in sets.items():
            size = (trials.width, 0.7, trials.diameter, step * trials.diameter)
            out = np.empty(len(g), np.int8)
            none = np.repeat(NO_POINTS[None], len(g), axis=0)
            simulate_on_points(x, y, mass, trials.rows[g], *size, none, out)
            accepted, missed = accepted + len(g), missed + int((out <= 0).sum())
            simulate_on_points(x, y, mass, trials.rows[g], *size, feet[name], out)
            on_feet += int((out <= 0).sum())
        print(f"step {step} D: not closed on an ellipsoid {missed} of {accepted} "
              f"({missed / accepted:.3%}), on three points {on_feet} ({on_feet / accepted:.3%})",
              flush=True)  # fmt: skip
    kept = []
    for name in names:
        part, test, tolerance = usual(name)
        both = [
            int((Trials.of(part, sample_grasps(part), replace(test, method=m), tolerance, 1)(0, 20)
                 > 0).sum())
            for m in ("bound", "simulation")
        ]  # fmt: skip
        kept.append(f"{name} {both[0] / both[1]:.0%}")
    print("share of the simulated success that the bound keeps:", ", ".join(kept))


def soft() -> None:
    """The bound against soft contacts with inertia, which share no line with the own solver."""
    for name, ring in OUTLINES.items():
        accepted, closed, anyway = compared(ring, samples=30, most=150)
        print(f"{name:16s} closes on {closed} of {accepted} that the bound accepts, and on "
              f"{anyway:.0%} of those it refuses", flush=True)  # fmt: skip


def _accepted(name: str, samples: int):  # type: ignore[no-untyped-def]
    """Return trials, and grasp, outline and centre of mass of each that the bound accepts."""
    part, test, tolerance = usual(name)
    trials = Trials.of(part, sample_grasps(part), test, tolerance, 1)
    vx, vy, mass, valid = trials.parts(0, samples)
    g, k = np.nonzero((trials(0, samples) > 0) & valid)
    return trials, g, vx[k], vy[k], mass[k]


def _tripod(x: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> np.ndarray:  # type: ignore[type-arg]
    half = np.array([np.ptp(x), np.ptp(y)]) / 2
    while True:
        triangle = rng.uniform(-1, 1, (3, 2)) * half
        system = np.vstack([triangle.T, np.ones(3)])
        if abs(np.linalg.det(system)) > 0.05:
            weights = np.linalg.solve(system, [0.0, 0.0, 1.0])
            if np.all(weights > 0.03):
                return np.column_stack([triangle, weights])


def box2d(count: int = 100) -> None:
    """The own solver against Box2D, trial by trial; each also against itself at half the step."""
    if not is_available():
        print("skipped: pip install box2d")
        return
    cases = [("tape", (0, 1), 0.35), ("tape", (1, 0), 0.35)]
    cases += [(n, d, 0.25) for n in ("rectangle", "ell", "A", "B", "C", "E", "K", "L")
              for d in ((0, 1), (1, 0))]  # fmt: skip
    agreed = []
    for name, direction, share in cases:
        part = as_part(stand_in(name), TAPE_DISPENSER_COM if name == "tape" else None)
        width = share * part.diameter
        grasp = centred_grasp(part, direction, width)
        trials = Trials.of(part, grasp, PushTest(width), Tolerance(0.0), 0)
        spread = 0.1 if name == "tape" else 0.06
        task = PoseTrials(trials, np.array([spread * trials.diameter]), np.array([0.4]), 600)
        moved = task.moved(task.poses(500, count)[1])
        found, spans = {}, {}
        for label, run in (("own", _own), ("Box2D", _box2d)):
            run(trials, *(values[:1] for values in moved), 0.004)
            began = time.process_time()
            found[label, 1] = run(trials, *moved, 0.004)
            spans[label] = time.process_time() - began
            found[label, 2] = run(trials, *moved, 0.002)
        agreed.append(float((found["own", 1] == found["Box2D", 1]).mean()))
        itself = [f"{(found[k, 1] == found[k, 2]).mean():.0%}" for k in ("own", "Box2D")]
        print(
            f"{name:9s} {direction}: own {found['own', 1].mean():.2f}, Box2D "
            f"{found['Box2D', 1].mean():.2f}, agree {agreed[-1]:.0%}; with themselves "
            f"{' and '.join(itself)}; {count / spans['own']:.0f} and {count / spans['Box2D']:.0f} "
            "per s", flush=True
        )  # fmt: skip
    enough = sum(share >= 0.95 for share in agreed)
    print(f"agreement: mean {np.mean(agreed):.1%}, least {min(agreed):.0%}, {enough} of "
          f"{len(agreed)} grasps at least 95 %")  # fmt: skip


def _own(trials: Trials, vx, vy, mass, step: float):  # type: ignore[no-untyped-def]
    out = np.empty((1, len(vx)), np.int8)
    size = (trials.width, 0.7, 0.16, trials.diameter, step * trials.diameter)
    simulate(vx, vy, mass, np.ones(len(vx), bool), trials.rows, *size, out)
    return out[0] > 0


def _box2d(trials: Trials, vx, vy, mass, step: float):  # type: ignore[no-untyped-def]
    size = (trials.width, 0.7, 0.16, trials.diameter, step * trials.diameter)
    rings = np.stack([vx, vy], axis=2)
    return np.array([
        simulate_in_box2d(ring, m, trials.rows[0], *size) > 0
        for ring, m in zip(rings, mass, strict=True)
    ])  # fmt: skip


def sobol() -> None:
    """Root mean square error of Q over all grasps and 20 draws, against 20,000 perturbations."""
    print("part  perturbations  random  Sobol  random ones for the same error")
    ratios = []
    for name in BRACKETS:
        part, test, tolerance = usual(name)
        grasps = sample_grasps(part)
        truth = (Trials.of(part, grasps, test, tolerance, 99)(0, 20_000) > 0).mean(axis=1)
        for count in (64, 128, 256):
            error = {}
            for sampling in ("random", "sobol"):
                kind = replace(test, sampling=sampling)
                runs = (Trials.of(part, grasps, kind, tolerance, k)(0, count) for k in range(20))
                off = np.array([(codes > 0).mean(axis=1) for codes in runs]) - truth
                error[sampling] = float(np.sqrt(np.mean(off**2)))
            ratios.append((error["random"] / error["sobol"]) ** 2)
            print(f"{name:4s}  {count:13d}  {error['random']:.4f}  {error['sobol']:.4f}  "
                  f"{ratios[-1]:.1f} x", flush=True)  # fmt: skip
    print(f"least {min(ratios):.1f} x, median {np.median(ratios):.1f} x, most {max(ratios):.1f} x")
