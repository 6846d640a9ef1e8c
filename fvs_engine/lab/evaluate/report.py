"""Summary of runs: per selector and number of views or travel, mean and interval over the seeds."""

from collections.abc import Callable, Iterable, Sequence

from fvs_engine.lab.evaluate.protocol import Protocol
from fvs_engine.lab.evaluate.results import Calibration, Evaluation, Run
from fvs_engine.lab.evaluate.statistics import Estimate, estimate, paired_difference
from fvs_engine.records import Record

BASELINES = ("farthest", "random")
"""The selectors that others are compared with: farthest-point sampling and random choice."""

_Value = Callable[[Evaluation], float | None]
_Reached = Sequence[tuple[Run, Evaluation]]
"""Runs with their measurements at one number of views, or one share of the travel."""
_BySeed = dict[str, dict[int, float]]
"""A number by method and seed."""


class Measures(Record):
    """Measurements of one selector, over the seeds whose runs got that far.

    ``gains``: its PSNR less a baseline's, seed by seed, and ``unvisited_gains`` the same over the views that
    may still be visited. ``training_sd_db``: between models of the same views; None where each has one model.
    ``selection_s``: per choice, up to here; None when
    nothing was chosen yet. ``aligned_only``: number of test views whose pose is only that of the
    alignment, and ``worst_rms``: of the alignment in the whole run; None for known poses. ``travel``: of all
    vehicles, initial views included; ``flown``: of each of several vehicles after them.
    """

    method: str
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
    flown: tuple[Estimate, ...] = ()


class Row(Measures):
    """One selector after ``visited`` views."""

    visited: int

    @property
    def place(self) -> float:
        """Its position in tables and plots: the number of views."""
        return self.visited


class TravelRow(Measures):
    """One selector before a vehicle flew beyond ``limit``, a ``share`` of the travel; ``views``: visited."""

    share: float
    limit: float
    views: Estimate

    @property
    def place(self) -> float:
        """Its position in tables and plots: the allowed travel."""
        return self.limit


AnyRow = Row | TravelRow


class CorrelationRow(Record):
    """Rank correlation of one selector with the true error, over the seeds, after ``visited`` views."""

    method: str
    visited: int
    all_candidates: Estimate | None
    in_reach: Estimate | None


class Summary(Record):
    """The whole table: ``rows`` by view count, best PSNR first. ``notes`` name what is missing and why.

    ``travel_rows``: the same by share of the travel, where that is a budget.
    """

    dataset: str
    protocol: Protocol
    seeds: tuple[int, ...]
    rows: tuple[Row, ...]
    correlations: tuple[CorrelationRow, ...]
    notes: tuple[str, ...]
    runs: tuple[Run, ...]
    travel_rows: tuple[TravelRow, ...] = ()


def summarise(dataset: str, protocol: Protocol, runs: Sequence[Run], notes: Iterable[str] = ()) -> Summary:
    """The table of finished ``runs``."""
    ended_early = (
        f"{run.method}, seed {run.seed}, ended at {len(run.order)} views: {run.stop}"
        for run in runs
        if len(run.order) < protocol.budget and run.stop_kind != "travel"
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
        rows=_rows(runs, protocol),
        travel_rows=_travel_rows(runs, protocol),
        correlations=_correlations(runs),
        notes=(*notes, *ended_early, *unregistered, *lost, *fell_back),
        runs=tuple(runs),
    )


def _rows(runs: Sequence[Run], protocol: Protocol) -> tuple[Row, ...]:
    counts = {evaluation.visited for run in runs for evaluation in run.evaluations}
    if protocol.travel_shares:  # runs end, and are measured, at any number of views
        counts &= set(protocol.view_counts)
    rows: list[Row] = []
    for visited in sorted(counts):
        reached = [(run, evaluation) for run in runs if (evaluation := run.at(visited)) is not None]
        rows += (Row(visited=visited, **dict(measures)) for measures, _ in _measured(reached))
    return tuple(rows)


def _travel_rows(runs: Sequence[Run], protocol: Protocol) -> tuple[TravelRow, ...]:
    rows: list[TravelRow] = []
    for share in protocol.travel_shares:
        reached = [(run, evaluation) for run in runs if (evaluation := run.at_share(share)) is not None]
        rows += (
            TravelRow(
                share=share,
                limit=share * (protocol.max_travel or 0.0),
                views=estimate([evaluation.visited for _, evaluation in mine]),
                **dict(measures),
            )
            for measures, mine in _measured(reached)
        )
    return tuple(rows)


def _measured(reached: _Reached) -> list[tuple[Measures, _Reached]]:
    """Each method's ``Measures`` with their runs; best PSNR first."""
    held_out, unvisited = (
        _by_seed(reached, value) for value in (lambda e: e.mean_psnr_db, lambda e: e.mean_unvisited_db)
    )
    found = []
    for method in held_out:
        mine = [pair for pair in reached if pair[0].method == method]
        found.append((_measures(method, mine, held_out, unvisited), mine))
    return sorted(found, key=lambda pair: (-pair[0].psnr_db.mean, pair[0].method))


def _by_seed(reached: _Reached, value: _Value) -> _BySeed:
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


def _measures(method: str, reached: _Reached, held_out: _BySeed, unvisited: _BySeed) -> Measures:
    def over_seeds(value: _Value) -> Estimate | None:
        values = [value(evaluation) for _, evaluation in reached]
        known = [number for number in values if number is not None]
        return estimate(known) if len(known) == len(values) else None

    def required(value: Callable[[Evaluation], float]) -> Estimate:
        return estimate([value(evaluation) for _, evaluation in reached])

    rms = [run.worst_rms for run, _ in reached if run.worst_rms is not None]
    choices = [run.selection_s[: evaluation.visited - run.initial] for run, evaluation in reached]
    flown = [evaluation.flown for _, evaluation in reached]
    by_vehicle = list(zip(*flown, strict=True)) if len({len(lengths) for lengths in flown}) == 1 else []
    return Measures(
        method=method,
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
        flown=tuple(map(estimate, by_vehicle)) if len(by_vehicle) > 1 else (),
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
