"""The curves of an experiment: quality and travel against views, and rank correlations of the scores.

Every selector has one colour (Okabe and Ito's, distinguishable with any colour vision) and one mark,
and its name beside its curve instead of a legend.
"""

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fvs_engine.files.atomic import replacing
from fvs_engine.lab.evaluate.report import AnyRow, CorrelationRow, Summary, TravelRow
from fvs_engine.lab.evaluate.statistics import Estimate

_COLORS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#000000",
    "#E69F00",
    "#56B4E9",
    "#7F5B2E",
    "#8A8A8A",
)
_MARKS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
_GREY = "#6B6B6B"
_DPI = 160
_LABEL_GAP = 0.046
"""The least vertical distance of two labels, as a share of the axes."""

Style = tuple[str, str]
"""Colour and mark of a selector."""


def styles(methods: Sequence[str]) -> dict[str, Style]:
    """Colour and mark of each method, by its index in the list; no two methods share both."""
    return {
        method: (_COLORS[i % len(_COLORS)], _MARKS[(i + i // len(_COLORS)) % len(_MARKS)])
        for i, method in enumerate(methods)
    }


def plot_quality(path: Path, summary: Summary, styled: Mapping[str, Style]) -> None:
    """PSNR against views (or the travel allowed), and where each selector ends, with its interval; a PNG."""
    figure = Figure(figsize=(11.5, 5.2))
    curves, ends = figure.subplots(1, 2, width_ratios=(1.45, 1))
    figure.subplots_adjust(left=0.06, right=0.98, bottom=0.1, top=0.9, wspace=0.72)
    rows: Sequence[AnyRow] = summary.travel_rows or summary.rows
    _draw_curves(curves, rows, styled, lambda row: row.psnr_db)
    curves.set_ylabel("PSNR of the test views / dB")
    last = max((row.place for row in rows), default=0)
    final = [row for row in rows if row.place == last]
    _draw_intervals(ends, [(row.method, row.psnr_db) for row in reversed(final)], styled, ".2f")
    if summary.travel_rows:
        ends.set_xlabel(f"PSNR within {last:.4g} / dB, with its 95 % interval")
    else:
        ends.set_xlabel(f"PSNR after {last} views / dB, with its 95 % interval")
    _save(figure, path, f"{_title(summary)}: quality of the model")


def plot_travel(path: Path, summary: Summary, styled: Mapping[str, Style]) -> None:
    """Travel against views (or views against the travel allowed), and PSNR against travel; a PNG."""
    figure = Figure(figsize=(11.5, 5.2))
    travel, worth = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.06, right=0.87, bottom=0.1, top=0.9, wspace=0.5)
    if summary.travel_rows:
        _draw_curves(travel, summary.travel_rows, styled, _views)
        travel.set_ylabel("visited views")
    else:
        _draw_curves(travel, summary.rows, styled, lambda row: row.travel)
        travel.set_ylabel("travel / units of the dataset")
    rows: Sequence[AnyRow] = summary.travel_rows or summary.rows
    _draw_curves(worth, rows, styled, lambda row: row.psnr_db, lambda row: row.travel.mean)
    worth.set_xlabel("travel / units of the dataset")
    worth.set_ylabel("PSNR of the test views / dB")
    _save(figure, path, f"{_title(summary)}: travel, and quality over travel")


def plot_calibration(path: Path, summary: Summary, styled: Mapping[str, Style]) -> None:
    """Rank correlation of every selector with the true error, one panel per number of views; a PNG."""
    counts = list(dict.fromkeys(row.visited for row in summary.correlations))
    figure = Figure(figsize=(2.2 + 2.7 * len(counts), 4.6), layout="constrained")
    panels = figure.subplots(1, len(counts), sharex=True, sharey=True, squeeze=False)[0]
    order = _by_mean_correlation(summary.correlations)
    for panel, visited in zip(panels, counts, strict=True):
        rows = {row.method: row for row in summary.correlations if row.visited == visited}
        panel.axvline(0, color=_GREY, linewidth=0.8)
        entries = [(method, rows[method].all_candidates if method in rows else None) for method in order]
        _draw_intervals(panel, entries, styled, "+.2f")
        panel.set_xlim(-1.05, 1.05)
        panel.set_title(f"{visited} views", fontsize=10)
    figure.supxlabel(
        "rank correlation with the true error at the candidates: +1 ranks the worst render first",
        fontsize=10,
    )
    _save(figure, path, f"{_title(summary)}: does the score know where the model is wrong?")


def _by_mean_correlation(rows: Sequence[CorrelationRow]) -> list[str]:
    """Methods, the one with the lowest correlation first: it is drawn at the bottom."""
    found: dict[str, list[float]] = {}
    for row in rows:
        found.setdefault(row.method, []).append(row.all_candidates.mean if row.all_candidates else -2.0)
    return sorted(found, key=lambda method: (sum(found[method]) / len(found[method]), method))


def _views(row: AnyRow) -> Estimate:
    assert isinstance(row, TravelRow)
    return row.views


def _draw_curves(
    axes: Axes,
    rows: Sequence[AnyRow],
    styled: Mapping[str, Style],
    value: Callable[[AnyRow], Estimate],
    abscissa: Callable[[AnyRow], float] = lambda row: row.place,
) -> None:
    """One curve of means per method, labelled where it ends."""
    ends: dict[str, tuple[float, float]] = {}
    for method, (color, mark) in styled.items():
        mine = sorted((row for row in rows if row.method == method), key=lambda row: row.place)
        if not mine:
            continue
        xs, ys = [abscissa(row) for row in mine], [value(row).mean for row in mine]
        axes.plot(xs, ys, color=color, marker=mark, markersize=5, linewidth=1.6, label=method)
        ends[method] = (xs[-1], ys[-1])
    by_travel = any(isinstance(row, TravelRow) for row in rows)
    axes.set_xlabel("travel of a vehicle, at most / units of the dataset" if by_travel else "visited views")
    places = sorted({row.place for row in rows})
    if places and all(abscissa(row) == row.place for row in rows):
        axes.set_xticks(places)
    _tidy(axes)
    axes.grid(axis="y", color="#E4E4E4", linewidth=0.8)
    _label_ends(axes, ends, styled)


def _label_ends(axes: Axes, ends: Mapping[str, tuple[float, float]], styled: Mapping[str, Style]) -> None:
    """Names at the right edge, in the order of the curves' ends and apart from each other."""
    axes.margins(x=0.04, y=0.06)
    axes.autoscale_view()
    to_share = axes.transAxes.inverted()
    points = {m: to_share.transform(axes.transData.transform(end)) for m, end in ends.items()}
    order = sorted(points, key=lambda method: float(points[method][1]))
    heights = spread_out([float(points[method][1]) for method in order], _LABEL_GAP)
    for method, height in zip(order, heights, strict=True):
        axes.annotate(
            method,
            xy=ends[method],
            xytext=(1.05, height),
            textcoords="axes fraction",
            color=styled[method][0],
            fontsize=9,
            va="center",
            arrowprops={"arrowstyle": "-", "color": styled[method][0], "linewidth": 0.6, "alpha": 0.6},
        )


def spread_out(wanted: Sequence[float], gap: float) -> list[float]:
    """Positions nearest to the ``wanted`` ones (ascending) in least squares that are at least ``gap`` apart.

    Neighbours that collide form a block, centred on the mean of its members' offsets.
    """
    blocks: list[tuple[float, int]] = []  # the wanted position of a block's first label, and its length
    for place in wanted:
        blocks.append((place, 1))
        while len(blocks) > 1 and blocks[-2][0] + gap * blocks[-2][1] > blocks[-1][0]:
            (start, count), (next_start, next_count) = blocks[-2], blocks[-1]
            total = count * start + next_count * (next_start - gap * count)
            blocks[-2:] = [(total / (count + next_count), count + next_count)]
    return [start + gap * i for start, count in blocks for i in range(count)]


def _draw_intervals(
    axes: Axes,
    entries: Sequence[tuple[str, Estimate | None]],
    styled: Mapping[str, Style],
    form: str,
) -> None:
    """A dot and its interval per entry, from bottom to top, named at the left."""
    for height, (method, estimate) in enumerate(entries):
        if estimate is None:
            continue
        color, mark = styled[method]
        if estimate.half_width is not None:
            span = [estimate.mean - estimate.half_width, estimate.mean + estimate.half_width]
            axes.plot(span, [height, height], color=color, linewidth=1.4, alpha=0.75)
        axes.plot([estimate.mean], [height], color=color, marker=mark, markersize=7, linestyle="none")
        text = format(estimate.mean, form).replace("-", "−")
        axes.annotate(
            text,
            (estimate.mean, height),
            (0, 8),
            textcoords="offset points",
            ha="center",
            fontsize=8,
            color=color,
        )
    axes.set_yticks(range(len(entries)), [method for method, _ in entries])
    axes.set_ylim(-0.6, len(entries) - 0.2)
    colors = {method: color for method, (color, _) in styled.items()}
    for label in axes.get_yticklabels():
        label.set_color(colors.get(label.get_text(), _GREY))
    _tidy(axes)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color="#E4E4E4", linewidth=0.8)
    axes.set_axisbelow(True)


def _tidy(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9)


def _title(summary: Summary) -> str:
    seeds = f"{len(summary.seeds)} seed" + ("s" if len(summary.seeds) != 1 else "")
    return f"{summary.dataset}, {summary.protocol.name}, {seeds}"


def _save(figure: Figure, path: Path, title: str) -> None:
    figure.suptitle(title, fontsize=12, x=0.01, ha="left")
    save_figure(figure, path)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a PNG, whole or not at all; raises ``StorageError``."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI)
    with replacing(path) as temporary:
        temporary.write_bytes(buffer.getvalue())
