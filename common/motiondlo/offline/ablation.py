"""What each ingredient of a tracker earns: recordings tracked in full and with one ingredient taken out at a time."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from motiondlo.errors import ConfigError
from motiondlo.frames.types import Segmentation
from motiondlo.offline.ablation_table import Component, FrameCut, components_of
from motiondlo.offline.evaluation import Evaluation, evaluate
from motiondlo.offline.ground_truth import GroundTruth, load_ground_truth
from motiondlo.offline.hybrid_loop import FrameBranch, Segment
from motiondlo.offline.options import TrackMode, TrackOptions
from motiondlo.offline.progress import Progress, no_progress
from motiondlo.offline.run_track import prepare, profile_used, rows_of
from motiondlo.offline.tracks import Tracks
from motiondlo.recording.layout import FrameEntry, Recording, open_recording

LOST_MM = 5.0
"""What a DLO that is lost all the time is taken to be off by."""

FULL = Component("full", "nothing taken out")


@dataclass(frozen=True)
class Figures:
    """How one run went: means over the DLOs that move; None where nothing could be measured."""

    ptc_mm: float | None
    e_mm: float | None
    lost_fraction: float
    id_switches: int
    """Sum over the DLOs."""
    nees: float | None
    unchanged: bool = False
    """The estimates are those of the full run to the bit: the component had no part in this recording."""

    @property
    def cost_mm(self) -> float:
        """Point-to-curve and paired error, and 5 mm for time lost: what components are compared by."""
        ptc_mm = LOST_MM if self.ptc_mm is None else self.ptc_mm
        return ptc_mm + (LOST_MM if self.e_mm is None else self.e_mm) + LOST_MM * self.lost_fraction

    def as_json(self) -> dict[str, Any]:
        """Rounded to 0.1 um."""
        return {
            "ptc_mm": _rounded(self.ptc_mm),
            "e_mm": _rounded(self.e_mm),
            "lost_fraction": _rounded(self.lost_fraction),
            "id_switches": self.id_switches,
            "nees": _rounded(self.nees),
            "unchanged": self.unchanged,
        }


@dataclass(frozen=True)
class Row:
    """One component over all recordings, in their order."""

    component: Component
    runs: tuple[Figures, ...]
    mean: Figures
    earns_mm: float
    """By how much ``cost_mm`` grows when it is taken out; negative: it does harm."""

    def as_json(self) -> dict[str, Any]:
        """With one entry a recording."""
        return {
            "component": self.component.name,
            "description": self.component.description,
            "earns_mm": round(self.earns_mm, 4),
            "mean": self.mean.as_json(),
            "recordings": [run.as_json() for run in self.runs],
        }


@dataclass(frozen=True)
class Ablation:
    """The table; ``rows`` sorted by what they earn, the most valuable first."""

    profile: str
    recordings: tuple[str, ...]
    full: Row
    rows: tuple[Row, ...]
    other: Row | None
    """The full run of the other profile; None where there is none."""

    def as_json(self) -> dict[str, Any]:
        """The document of ``eval --ablate --json``."""
        return {
            "profile": self.profile,
            "recordings": list(self.recordings),
            "full": self.full.as_json(),
            "without": [row.as_json() for row in self.rows],
            "other_profile": None if self.other is None else self.other.as_json(),
        }


class Trials:
    """One recording, opened once: its truth, and each frame's segmentation, which no tracker's parameter changes."""

    def __init__(self, recording: Recording) -> None:
        """Raises RecordingError without ground truth."""
        self.recording = recording
        self.truth: GroundTruth = load_ground_truth(recording.path / "ground_truth.npz")
        self._shapes: dict[str, Segmentation] = {}

    def run(self, options: TrackOptions, component: Component = FULL) -> tuple[Tracks, Evaluation]:
        """Track without ``component`` and judge."""
        options = replace(options, tracker={**options.tracker, **component.tracker})
        track_run = prepare(self.recording, options, partial(self._cut, component.frames))
        tracks = rows_of(track_run.states())
        return tracks, evaluate(tracks, self.truth)

    def _cut(self, cut: FrameCut, branch: FrameBranch) -> FrameBranch:
        segment = partial(self._remembered, branch.segment)
        if cut is FrameCut.APPEARANCE:
            return replace(branch, segment=lambda entry: _without_appearance(segment(entry)))
        return replace(branch, segment=segment, frames=branch.frames[:1] if cut is FrameCut.LATE else branch.frames)

    def _remembered(self, segment: Segment, entry: FrameEntry) -> Segmentation:
        if entry.name not in self._shapes:
            self._shapes[entry.name] = segment(entry)
        return self._shapes[entry.name]


def ablate(
    recordings: Sequence[Recording],
    options: TrackOptions,
    jobs: int = 1,
    progress: Progress = no_progress,
    components: Sequence[Component] | None = None,
) -> Ablation:
    """Run every component of the profile on every recording, and the other profile in full.

    ``jobs``: so many recordings at once, each in a process of its own. Raises as
    :func:`motiondlo.offline.run_track.prepare`, RecordingError without ground truth, ConfigError in frame mode.
    """
    if options.mode is TrackMode.FRAME:
        raise ConfigError("--ablate: frame mode has no tracker to take apart.", "Use --mode hybrid or event.")
    profile = profile_used(options)
    parts = tuple(components_of(profile) if components is None else components)
    other = None if options.mode is TrackMode.EVENT else {"default": "paper", "paper": "default"}[profile]
    work = partial(_recording_runs, options=options, components=parts, other=other)
    results = _results([recording.path for recording in recordings], work, jobs, len(parts) + 2, progress)
    columns = [[result[k] for result in results] for k in range(len(parts) + 2)]
    full = _row(FULL, columns[0], columns[0])
    rows = [_row(part, column, columns[0]) for part, column in zip(parts, columns[1:-1], strict=True)]
    return Ablation(
        profile=profile,
        recordings=tuple(recording.name for recording in recordings),
        full=full,
        rows=tuple(sorted(rows, key=lambda row: -row.earns_mm)),
        other=None if other is None else _row(replace(FULL, name=other), columns[-1], columns[0]),
    )


_Work = Callable[..., Iterator[Figures]]


def _results(paths: Sequence[Any], work: _Work, jobs: int, runs: int, progress: Progress) -> list[list[Figures]]:
    """One list of figures a recording, in the recordings' order."""
    if jobs == 1 or len(paths) == 1:
        results: list[list[Figures]] = []
        for k, path in enumerate(paths):
            results.append([])
            for figures in work(path):
                results[k].append(figures)
                progress((k * runs + len(results[k])) / (runs * len(paths)))
        return results
    # Not forked: a fork copies numba's and BLAS's threads in whatever state they are.
    with ProcessPoolExecutor(min(jobs, len(paths)), multiprocessing.get_context("spawn")) as pool:
        futures = [pool.submit(_all, work, path) for path in paths]
        for done, _ in enumerate(as_completed(futures), start=1):
            progress(done / len(paths))
        return [future.result() for future in futures]


def _all(work: _Work, path: Any) -> list[Figures]:
    return list(work(path))


def _recording_runs(
    path: Any, options: TrackOptions, components: Iterable[Component], other: str | None
) -> Iterator[Figures]:
    """The full run, one without each component, and the other profile's (the last again, where there is none)."""
    trials = Trials(open_recording(path))
    full, evaluation = trials.run(options)
    yield figures_of(evaluation)
    for component in components:
        tracks, judged = trials.run(options, component)
        yield replace(figures_of(judged), unchanged=_same(full, tracks))
    if other is not None:
        _, evaluation = trials.run(replace(options, profile=other, tracker={}))
    yield figures_of(evaluation)


def figures_of(evaluation: Evaluation) -> Figures:
    """The figures of the DLOs that move (of all, where none does)."""
    judged = evaluation.moved or evaluation.verdicts
    return Figures(
        ptc_mm=_mean(verdict.ptc_mm.mean for verdict in judged),
        e_mm=_mean(verdict.e_mm.mean for verdict in judged),
        lost_fraction=float(np.mean([verdict.lost_fraction for verdict in judged])) if judged else 0.0,
        id_switches=sum(verdict.id_switches for verdict in judged),
        nees=_mean(verdict.nees for verdict in judged),
    )


def _row(component: Component, runs: Sequence[Figures], full: Sequence[Figures]) -> Row:
    mean = Figures(
        ptc_mm=_mean(run.ptc_mm for run in runs),
        e_mm=_mean(run.e_mm for run in runs),
        lost_fraction=float(np.mean([run.lost_fraction for run in runs])),
        id_switches=sum(run.id_switches for run in runs),
        nees=_mean(run.nees for run in runs),
        unchanged=all(run.unchanged for run in runs),
    )
    earned = [run.cost_mm - whole.cost_mm for run, whole in zip(runs, full, strict=True)]
    return Row(component, tuple(runs), mean, float(np.mean(earned)))


def _without_appearance(segmentation: Segmentation) -> Segmentation:
    bare = tuple(replace(instance, appearance=None) for instance in segmentation.instances)
    return replace(segmentation, instances=bare)


def _same(a: Tracks, b: Tracks) -> bool:
    return np.array_equal(a.times_us, b.times_us) and all(
        np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in ("nodes", "sigma_px")
    )


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
