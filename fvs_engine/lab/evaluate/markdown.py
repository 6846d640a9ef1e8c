"""The report of an experiment as Markdown."""

from collections.abc import Callable, Iterator, Sequence

from fvs_engine.lab.evaluate.protocol import Protocol
from fvs_engine.lab.evaluate.report import BASELINES, CorrelationRow, Measures, Summary, TravelRow
from fvs_engine.lab.evaluate.statistics import CONFIDENCE, Estimate

_NONE = "–"
_Column = tuple[str, Callable[[Measures], Estimate | None], str]


def markdown(summary: Summary) -> str:
    """The whole report: the protocol, tables by travel and by number of views, rank correlations, notes."""
    return "\n".join(_lines(summary)) + "\n"


def _lines(summary: Summary) -> Iterator[str]:
    yield f"# {summary.dataset}: which selector gains most from a view"
    yield ""
    yield from _protocol(summary.protocol, summary.seeds)
    if summary.travel_rows:
        yield from _by_travel(summary.travel_rows)
    for share in reversed(list(dict.fromkeys(row.share for row in summary.travel_rows))):
        rows = [row for row in summary.travel_rows if row.share == share]
        yield ""
        yield f"## Within a travel of {_share(rows[0])}"
        yield ""
        yield from _table(rows)
    counts = list(dict.fromkeys(row.visited for row in summary.rows))
    for visited in reversed(counts):  # the last count is the result, so it comes first
        yield ""
        yield f"## {visited} views"
        yield ""
        yield from _table([row for row in summary.rows if row.visited == visited])
    if summary.correlations:
        yield ""
        yield from _correlations(summary.correlations)
    if summary.notes:
        yield ""
        yield "## Notes"
        yield ""
        yield from (f"- {note}" for note in summary.notes)


def _protocol(protocol: Protocol, seeds: Sequence[int]) -> Iterator[str]:
    initial = {
        "first": f"the first {protocol.initial} of the capture",
        "consecutive": f"{protocol.initial} consecutive ones from an index that the seed draws",
        "farthest": f"{protocol.initial} far from one another, the first drawn by the seed",
        "planned": f"{protocol.initial} of a plan for all {protocol.budget} views",
    }[protocol.initial_choice]
    radius = "a radius derived from the dataset" if protocol.radius is None else f"{protocol.radius:g} units"
    reach = {
        "all": "all unvisited views",
        "radius": f"those within {radius} of the current camera",
        "nearest": f"the {protocol.nearest} nearest to the current camera",
    }[protocol.reach]
    poses = {"known": "those of the dataset", "sfm": "estimated from the visited images"}[protocol.poses]
    differs = "training and random choices differ"
    if protocol.initial_choice in ("consecutive", "farthest"):
        differs = f"initial views, {differs}"
    repeated = f"; {protocol.trainings} models of the last views" if protocol.trainings > 1 else ""
    held_out = {
        "every": f"every {protocol.test_every}th photograph is test",
        "random": f"one photograph in {protocol.test_every}, drawn at random, is test",
    }[protocol.hold_out]
    facts = (
        ("preset", protocol.name),
        ("initial views", initial),
        ("candidates", reach),
        *_travel(protocol),
        ("camera poses", poses),
        ("images", f"long side {protocol.long_side_px} px; {held_out}"),
        (
            "training",
            f"{protocol.iterations_per_view} iterations per view, at least {protocol.initial_iterations}, "
            "from coarse to fine; quick models, which choose, a share of it; "
            f"at most {protocol.max_gaussians:,} Gaussians of degree 0{repeated}",
        ),
        ("PSNR, unvisited", "of the test views, and of the views that may still be visited"),
        (
            "seeds",
            f"{', '.join(map(str, seeds))}: {differs}",
        ),
        (
            "over farthest, over random",
            "PSNR less that selector's, seed by seed: both began with the same views",
        ),
        ("travel, RMS", "in the unit of the dataset's poses"),
        ("**bold**", "best mean of the selectors with the most runs"),
        ("±", f"half the {CONFIDENCE:.0%} confidence interval over the seeds (Student's t)"),
    )
    yield "| | |"
    yield "|---|---|"
    for name, value in facts:
        yield f"| {name} | {value} |"


def _travel(protocol: Protocol) -> Iterator[tuple[str, str]]:
    vehicles = f"{protocol.vehicles} vehicles, the one that has flown least next" * (protocol.vehicles > 1)
    if protocol.max_travel is not None:
        each = "each vehicle" if vehicles else "the vehicle"
        yield (
            "travel",
            f"{each} flies at most {protocol.max_travel:.4g} after the initial views, to at most "
            f"{protocol.budget} views in all; a share of it ends before the view that would exceed it. "
            "The column has the initial views, too",
        )
    if vehicles:
        yield "vehicles", f"{vehicles}; all begin at the last initial view"


def _share(row: TravelRow) -> str:
    """A share of the travel, and how far that is."""
    return f"{row.limit:.4g} ({row.share:.0%})"


def _by_travel(rows: Sequence[TravelRow]) -> Iterator[str]:
    """PSNR of each selector at each share of the travel."""
    shares = {row.share: _share(row) for row in rows}
    found = {(row.method, row.share): row for row in rows}
    last = [row.method for row in rows if row.share == max(shares)]
    methods = dict.fromkeys([*last, *(row.method for row in rows)])
    kinds: tuple[_Column, ...] = (_COLUMNS[0], next(c for c in _COLUMNS if c[0] == "unvisited dB"))
    for title, value, form in kinds:
        if all(value(row) is None for row in rows):
            continue
        yield ""
        yield f"## {title} within a travel"
        yield ""
        yield "| selector | " + " | ".join(shares.values()) + " |"
        yield "|---|" + "---:|" * len(shares)
        for method in methods:
            cells = []
            for share in shares:
                row = found.get((method, share))
                views = "" if row is None else f" ({row.views.mean:.3g} views)"
                cells.append(_shown(value(row) if row else None, form) + views)
            yield f"| {method} | {' | '.join(cells)} |"


def _table(rows: Sequence[Measures]) -> Iterator[str]:
    offered = (*_COLUMNS, *_vehicles(max(len(row.flown) for row in rows)))
    columns = [column for column in offered if any(column[1](row) is not None for row in rows)]
    # Only rows with all seeds compete: the finished ones may be the easy ones.
    complete = [row for row in rows if row.psnr_db.count == max(r.psnr_db.count for r in rows)]
    best = {
        title: pick(means)
        for title, value, _ in columns
        if (pick := _BEST.get(title)) is not None
        and (means := [e.mean for row in complete if (e := value(row)) is not None])
    }
    yield "| selector | " + " | ".join(title for title, _, _ in columns) + " | runs |"
    yield "|---|" + "---:|" * (len(columns) + 1)
    for row in rows:
        cells = []
        for title, value, form in columns:
            shown = _shown(value(row), form)
            estimate = value(row)
            is_best = estimate is not None and row in complete and estimate.mean == best.get(title)
            cells.append(f"**{shown}**" if is_best and len(rows) > 1 else shown)
        yield f"| {row.method} | {' | '.join(cells)} | {row.psnr_db.count} |"


def _correlations(rows: Sequence[CorrelationRow]) -> Iterator[str]:
    yield "## Does the score know where the model is wrong?"
    yield ""
    yield (
        "Spearman's rank correlation between a selector's scores of the candidates and the true error of "
        "their renders (−PSNR against the photographs). +1: it ranks first what is rendered worst; "
        "0: no relation; −1: it ranks first what is rendered best. All selectors score the same models."
    )
    with_reach = any(row.in_reach is not None for row in rows)
    counts = list(dict.fromkeys(row.visited for row in rows))
    yield ""
    heads = [f"{n} views" for n in counts]
    if with_reach:
        heads = [head for n in counts for head in (f"{n} views", f"{n} views, in reach")]
    yield "| selector | " + " | ".join(heads) + " |"
    yield "|---|" + "---:|" * len(heads)
    for method in dict.fromkeys(row.method for row in rows):
        cells = []
        for visited in counts:
            row = next((r for r in rows if r.method == method and r.visited == visited), None)
            cells.append(_shown(row.all_candidates if row else None, "+.2f"))
            if with_reach:
                cells.append(_shown(row.in_reach if row else None, "+.2f"))
        yield f"| {method} | {' | '.join(cells)} |"


def _shown(estimate: Estimate | None, form: str) -> str:
    if estimate is None:
        return _NONE
    mean = format(estimate.mean, form).replace("-", "−")
    return (
        mean if estimate.half_width is None else f"{mean} ± {format(estimate.half_width, form.lstrip('+'))}"
    )


def _vehicles(count: int) -> tuple[_Column, ...]:
    """A column for what each vehicle has flown."""

    def flown(number: int) -> Callable[[Measures], Estimate | None]:
        return lambda row: row.flown[number] if number < len(row.flown) else None

    return tuple((f"flown by vehicle {number + 1}", flown(number), ".2f") for number in range(count))


def _gain_over(baseline: str) -> Callable[[Measures], Estimate | None]:
    return lambda row: row.gains.get(baseline)


def _unvisited_over(baseline: str) -> Callable[[Measures], Estimate | None]:
    return lambda row: row.unvisited_gains.get(baseline)


_COLUMNS: tuple[_Column, ...] = (
    ("PSNR dB", lambda row: row.psnr_db, ".2f"),
    *((f"dB over {baseline}", _gain_over(baseline), "+.2f") for baseline in BASELINES),
    ("unvisited dB", lambda row: row.unvisited_db, ".2f"),
    *((f"unvisited, over {baseline}", _unvisited_over(baseline), "+.2f") for baseline in BASELINES),
    ("SD of trainings, dB", lambda row: row.training_sd_db, ".2f"),
    ("SSIM", lambda row: row.ssim, ".3f"),
    ("LPIPS", lambda row: row.lpips, ".3f"),
    ("views", lambda row: row.views if isinstance(row, TravelRow) else None, ".1f"),
    ("travel", lambda row: row.travel, ".2f"),
    ("s per selection", lambda row: row.selection_s, ".3f"),
    ("registered views", lambda row: row.registered if row.aligned_only is not None else None, ".1f"),
    ("test views only aligned", lambda row: row.aligned_only, ".1f"),
    ("worst alignment RMS", lambda row: row.worst_rms, ".4f"),
)
_BEST: dict[str, Callable[..., float]] = {
    "PSNR dB": max,
    "unvisited dB": max,
    "SSIM": max,
    "LPIPS": min,
    "travel": min,
}
