"""Summary of runs: per selector and number of views, mean and confidence interval over the seeds."""

from collections.abc import Callable, Iterable, Sequence

from fvs_engine.evaluate.protocol import Protocol
from fvs_engine.evaluate.results import Calibration, Evaluation, Run
from fvs_engine.evaluate.statistics import Estimate, estimate, paired_difference
from fvs_engine.records import Record

BASELINES = ("farthest", "random")
"""The selectors that others are compared with: farthest-point sampling and random choice."""

_Value = Callable[[Evaluation], float | None]
_BySeed = dict[str, dict[int, float]]
"""A number by method and seed."""


class Row(Record):
    """One selector after ``visited`` views, over the seeds whose runs got that far.

    ``gains``: its PSNR less a baseline's, seed by seed, and ``unvisited_gains`` the same over the views that
    may still be visited. ``training_sd_db``: between models of the same views; None where each has one model.
    ``selection_s``: per choice, up to here; None when
    nothing was chosen yet. ``aligned_only``: number of test views whose pose is only that of the
    alignment, and ``worst_rms``: of the alignment in the whole run; None for known poses.
    """

    method: str
    visited: int
    psnr_db: Estimate
    ssim: Estimate
    lpips: Estimate | None
    gains: dict[str, Estimate]
    unvisited_db: Estimate | None
    unvisited_gains: dict[str, Estimate]
    training_sd_db: Estimate | None
    travel: Estimate
    selection_s: Estimate | None
    registered: Estimate
    aligned_only: Estimate | None
    worst_rms: Estimate | None


class CorrelationRow(Record):
    """Rank correlation of one selector with the true error, over the seeds, after ``visited`` views."""

    method: str
    visited: int
    all_candidates: Estimate | None
    in_reach: Estimate | None


class Summary(Record):
    """The whole table: ``rows`` by view count, best PSNR first. ``notes`` name what is missing and why."""

    dataset: str
    protocol: Protocol
    seeds: tuple[int, ...]
    rows: tuple[Row, ...]
    correlations: tuple[CorrelationRow, ...]
    notes: tuple[str, ...]
    runs: tuple[Run, ...]


def summarise(dataset: str, protocol: Protocol, runs: Sequence[Run], notes: Iterable[str] = ()) -> Summary:
    """The table of finished ``runs``."""
    ended_early = (
        f"{run.method}, seed {run.seed}, ended at {len(run.order)} views: {run.stop}"
        for run in runs
        if len(run.order) < protocol.budget
    )
    fell_back = (
        f"{run.method}, seed {run.seed}: {run.fallbacks} of {len(run.selection_s)} choices fell back, "
        "because no candidate had a score that could be compared."
        for run in runs
        if run.fallbacks
    )
    unregistered = (
        f"{run.method}, seed {run.seed}: {last.visited - last.registered} of {last.visited} visited views "
        "could not be registered."
        for run in runs
        for last in run.evaluations[-1:]
        if last.registered < last.visited
    )
    lost = (
        f"{run.method}, seed {run.seed}: after {last.visited} views these test views could not be localised "
        f"in the model, and have the poses that the alignment gives them: {', '.join(last.aligned_only)}."
        for run in runs
        for last in run.evaluations[-1:]
        if last.aligned_only
    )
    return Summary(
        dataset=dataset,
        protocol=protocol,
        seeds=tuple(sorted({run.seed for run in runs})),
        rows=_rows(runs),
        correlations=_correlations(runs),
        notes=(*notes, *ended_early, *unregistered, *lost, *fell_back),
        runs=tuple(runs),
    )


def _rows(runs: Sequence[Run]) -> tuple[Row, ...]:
    rows = []
    for visited in sorted({evaluation.visited for run in runs for evaluation in run.evaluations}):
        reached = [(run, evaluation) for run in runs if (evaluation := run.at(visited)) is not None]
        held_out, unvisited = (
            _by_seed(reached, value) for value in (lambda e: e.mean_psnr_db, lambda e: e.mean_unvisited_db)
        )
        found = [
            _row(method, visited, [pair for pair in reached if pair[0].method == method], held_out, unvisited)
            for method in held_out
        ]
        rows += sorted(found, key=lambda row: (-row.psnr_db.mean, row.method))
    return tuple(rows)


def _by_seed(reached: Sequence[tuple[Run, Evaluation]], value: _Value) -> _BySeed:
    found: _BySeed = {}
    for run, evaluation in reached:
        number = value(evaluation)
        if number is not None:
            found.setdefault(run.method, {})[run.seed] = number
    return found


def _gains(method: str, by_seed: _BySeed) -> dict[str, Estimate]:
    """The differences to the baselines, as far as they share seeds."""
    return {
        baseline: gain
        for baseline in BASELINES
        if baseline != method and method in by_seed and baseline in by_seed
        if (gain := paired_difference(by_seed[method], by_seed[baseline])) is not None
    }


def _row(
    method: str,
    visited: int,
    reached: Sequence[tuple[Run, Evaluation]],
    held_out: _BySeed,
    unvisited: _BySeed,
) -> Row:
    def over_seeds(value: _Value) -> Estimate | None:
        values = [value(evaluation) for _, evaluation in reached]
        known = [number for number in values if number is not None]
        return estimate(known) if len(known) == len(values) else None

    def required(value: Callable[[Evaluation], float]) -> Estimate:
        return estimate([value(evaluation) for _, evaluation in reached])

    rms = [run.worst_rms for run, _ in reached if run.worst_rms is not None]
    choices = [run.selection_s[: visited - run.initial] for run, _ in reached]
    return Row(
        method=method,
        visited=visited,
        psnr_db=required(lambda e: e.mean_psnr_db),
        ssim=required(lambda e: e.ssim),
        lpips=over_seeds(lambda e: e.lpips),
        gains=_gains(method, held_out),
        unvisited_db=over_seeds(lambda e: e.mean_unvisited_db),
        unvisited_gains=_gains(method, unvisited),
        training_sd_db=over_seeds(lambda e: e.training_sd_db),
        travel=required(lambda e: e.travel),
        selection_s=estimate([sum(c) / len(c) for c in choices]) if all(choices) else None,
        registered=required(lambda e: e.registered),
        aligned_only=required(lambda e: len(e.aligned_only)) if len(rms) == len(reached) else None,
        worst_rms=estimate(rms) if len(rms) == len(reached) else None,
    )


def _correlations(runs: Sequence[Run]) -> tuple[CorrelationRow, ...]:
    calibrations: list[Calibration] = [calibration for run in runs for calibration in run.calibrations]
    rows = []
    for visited in sorted({calibration.visited for calibration in calibrations}):
        found = [entry for c in calibrations if c.visited == visited for entry in c.selectors]
        for method in dict.fromkeys(entry.method for entry in found):
            mine = [entry for entry in found if entry.method == method]
            rows.append(
                CorrelationRow(
                    method=method,
                    visited=visited,
                    all_candidates=_mean_of_known(entry.all_candidates for entry in mine),
                    in_reach=_mean_of_known(entry.in_reach for entry in mine),
                )
            )
    return tuple(rows)


def _mean_of_known(values: Iterable[float | None]) -> Estimate | None:
    known = [value for value in values if value is not None]
    return estimate(known) if known else None
