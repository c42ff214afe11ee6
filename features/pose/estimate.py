"""The pose in six degrees of freedom of an object whose model is stored (Kehoe 2014, 4.4).

Every hypothesis about which pixels are the object's gives poses; the free space of the depth image
decides among them. The best ones collect the points that the segmenter left out, and are judged
again. Of poses that are nearly as good, the one counts for more that explains what stands beside
the segment.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame
from features.pose.colour import ColourChoice, choose_by_colour, colour_misfits
from features.pose.hypotheses import Hypothesis
from features.pose.model import PoseModel
from features.pose.result import PoseAlternative, PoseEstimate, PoseParams
from features.pose.rotations import angle_between
from features.pose.surface import SAME_SURFACE_M, surface_distance
from features.pose.task import MIN_POINTS, PoseTask, ScoredPose

__all__ = ["PoseAlternative", "PoseEstimate", "PoseParams", "estimate_pose"]

log = logging.getLogger(__name__)

_EXPLAINED_M = 0.008
_MAX_ALTERNATIVES = 5


def estimate_pose(
    model: PoseModel,
    frame: Frame,
    labels: NDArray[np.int32],
    label: int,
    params: PoseParams | None = None,
    plane: NDArray[np.float64] | None = None,
    initial: NDArray[np.float64] | None = None,
    is_matched: bool = False,
) -> PoseEstimate | None:
    """Find the pose of an object of which one segment is known.

    Parameters
    ----------
    model
        Of the object.
    frame
        Depth with its camera.
    labels : (h, w) int32
        Segments of the frame, 0 = none; a mask alone will do.
    label
        The object's.
    plane : (4,) float64, optional
        Unit normal and offset of the table in the camera's frame, the camera above it.
    initial : (k, 4, 4) float64, optional
        Poses ``camera_from_object`` to begin with. When one leaves nothing to explain it is the
        answer.
    is_matched
        The first initial pose comes from matched keypoints. Print tells apart what shape cannot,
        and what a model of few views gets wrong, which knows one side only: the answer is turned
        as that pose is, if any is, and colours are not asked.

    Returns
    -------
    PoseEstimate or None
        None when fewer than 30 points have depth; the log says so.
    """
    params = params or PoseParams()
    if labels.shape != frame.depth_m.shape:
        raise ValueError(f"labels {labels.shape} and depth {frame.depth_m.shape} differ in shape")
    started = time.perf_counter()
    task = PoseTask(model, frame, np.asarray(labels, np.int32), label, params, plane)
    if len(task.judged) < MIN_POINTS:
        log.info("no pose: segment %d has %d points with depth", label, len(task.judged))
        return None
    begun = np.asarray([] if initial is None else initial, np.float64).reshape(-1, 4, 4)
    matched = begun[0, :3, :3] if is_matched and len(begun) else None
    pool = task.given(begun) if len(begun) else []
    if pool and task.is_enough(pool):
        pool.sort(key=lambda scored: -scored.score)
        pool[0] = task.completed(pool[0])
        return _answer(task, pool, True, matched)
    complete = True
    for k, guess in enumerate(_guesses(task, pool)):
        late = (
            params.time_limit_s is not None and time.perf_counter() - started > params.time_limit_s
        )
        if k and late:
            # What was found so far is kept and said to be incomplete: not known is not no.
            complete = False
            break
        more = params.more_starts // 2 if guess.is_part else params.more_starts
        pool += task.poses(guess, params.starts if k == 0 else more)
    if matched is not None:
        # A print that matched says how the object is turned, which its shape may not; never to the
        # point of having no pose.
        pool = task.turned_alike(pool, matched) or pool
    pool.sort(key=lambda scored: -scored.score)
    # Surroundings cost another look at each pose: only where poses compete, or none explains
    # enough.
    bound = pool[0].score - params.doubt
    torn = task.distinct([scored for scored in pool if scored.score > bound], params.recollected)
    if len(torn) > 1 or not task.is_enough(pool):
        pool = task.with_surroundings(pool)
        likely = pool if not task.is_enough(pool) else task.distinct(pool, params.recollected)
        for scored in likely[: params.recollected]:
            pool += task.recollected(scored)
        pool = task.with_surroundings(pool)
    return _answer(task, pool, complete, matched)


def _guesses(task: PoseTask, pool: list[ScoredPose]) -> Iterator[Hypothesis]:
    """Yield guesses at the object's pixels as long as the poses so far leave something open."""
    for k, guess in enumerate(task.guesses()):
        if k == 1 and task.is_enough(pool):
            return
        yield guess
    if not task.is_enough(pool):
        yield from task.parted()
    if task.leaves_much(pool):
        yield from task.halves()


def _answer(
    task: PoseTask, pool: list[ScoredPose], complete: bool, matched: NDArray[np.float64] | None
) -> PoseEstimate:
    """Choose among the poses of a sorted pool and say how sure the choice is."""
    best, *others = task.distinct(pool, 1 + _MAX_ALTERNATIVES)
    alike = [o for o in others if best.score - o.score < task.params.as_good]
    candidates = [best, *alike]
    choice = (
        _by_colour(task, candidates) if matched is None else _nearest(task, candidates, matched)
    )
    rivals = choice.rivals
    winner = candidates[choice.candidate]
    others = [scored for scored in (best, *others) if scored is not winner]
    best = winner
    if choice.candidate or choice.variant:
        close = task.varied(winner, choice.variant)
        if matched is None:
            best = close[int(np.argmin(np.nan_to_num(_misfits(task, close), nan=np.inf)))]
        else:
            # Among variants that symmetry makes equal, the one that a print was matched with.
            best = min(close, key=lambda scored: angle_between(scored.rotation, matched))
    away = task.distances(task.judged.places, best.rotation, best.translation)
    explained = float((away < _EXPLAINED_M + task.model.cell_m / 2).mean())
    constants = task.params.confidence
    pose = task.pose_of(best)
    is_same = [
        surface_distance(task.model, pose, task.pose_of(o)) < SAME_SURFACE_M
        for o in (candidates if rivals else ())
        if o is not winner
    ]
    sure = constants.of(best.fit, best.violation, explained, rivals)
    return PoseEstimate(
        camera_from_object=pose,
        confidence=sure,
        accepted=sure >= constants.threshold,
        fit=best.fit,
        violation=best.violation,
        coverage=best.coverage,
        explained=explained,
        alternatives=tuple(PoseAlternative(task.pose_of(o), o.score) for o in others),
        ambiguous=rivals > 0,
        is_turn_free=rivals > 0 and all(is_same),
        symmetric_axes=task.model.symmetric_axes,
        segments_used=best.labels,
        is_complete=complete,
        decided_by_colour=choice.is_decided or choice.candidate > 0,
    )


def _by_colour(task: PoseTask, candidates: list[ScoredPose]) -> ColourChoice:
    """Let colours choose among poses as good by shape, and among those that symmetry allows."""
    model, turns = task.model, task.turns()
    undecided = ColourChoice(0, 0, len(candidates) - 1, False)
    if model.colours is None or task.rgb is None or len(candidates) * len(turns) < 2:
        return undecided
    each = [replace(f, rotation=f.rotation @ turn) for f in candidates for turn in turns]
    return choose_by_colour(_misfits(task, each).reshape(len(candidates), -1), turns)


def _misfits(task: PoseTask, poses: list[ScoredPose]) -> NDArray[np.float64]:
    """Return how far the colours that each pose predicts are from the image's, (n,)."""
    model = task.model
    if model.colours is None or task.rgb is None:
        return np.zeros(len(poses))
    placed = np.stack([f.rotation for f in poses]), np.stack([f.translation for f in poses])
    return colour_misfits(model.samples, model.colours, placed, task.depth, task.rgb, task.camera)


def _nearest(
    task: PoseTask, candidates: list[ScoredPose], matched: NDArray[np.float64]
) -> ColourChoice:
    """Choose, as colours do, the pose and variant that is turned least from a matched one."""
    rotations = np.stack([scored.rotation for scored in candidates])
    off = np.einsum("cij,sjk,ik->cs", rotations, task.turns(), matched)
    candidate, variant = np.unravel_index(int(off.argmax()), off.shape)
    return ColourChoice(int(candidate), int(variant), 0, False)
