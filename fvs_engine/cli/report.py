"""Results on stdout: tables for people, JSON for machines."""

import contextlib
import json
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from fvs_engine.lab.evaluate.report import AnyRow, Summary
    from fvs_engine.lab.evaluate.statistics import Estimate
    from fvs_engine.pipeline.control import ControlRecord
    from fvs_engine.pipeline.info import FolderInfo
    from fvs_engine.pipeline.plan import PlanResult
    from fvs_engine.pipeline.rank import RankingResult
    from fvs_engine.pipeline.select import SelectionResult

_UNWRAPPED_COLUMNS = 10_000


@contextlib.contextmanager
def _stdout() -> Iterator[TextIO]:
    """Standard output for results; a closed pipe (``| head``) ends ``fvs`` as it ends other programs."""
    sigpipe = signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    try:
        yield sys.stdout
        sys.stdout.flush()
    finally:
        signal.signal(signal.SIGPIPE, sigpipe)


def _console(stdout: TextIO) -> Console:
    """Lines are wrapped for a terminal only: ``grep`` and logs want them whole."""
    return Console(file=stdout, width=None if stdout.isatty() else _UNWRAPPED_COLUMNS)


def show_folder(folder: Path, *, machine: bool) -> None:
    """Describe an output folder; raises ``EngineError`` when it is not one."""
    from fvs_engine.pipeline.info import folder_info

    info = folder_info(folder)
    table = Table.grid(padding=(0, 2))
    for name, value in _facts(info):
        table.add_row(Text(name, "bold"), Text(value))
    with _stdout() as stdout:
        if machine:
            stdout.write(info.model_dump_json() + "\n")
        else:
            _console(stdout).print(table)


def show_ranking(ranking: "RankingResult", folder: Path, *, top: int | None, machine: bool) -> None:
    """Print the first ``top`` candidates and where the files are."""
    shown = ranking.candidates[:top]
    if machine:
        document = ranking.model_copy(update={"candidates": shown}).model_dump(mode="json")
        with _stdout() as stdout:
            stdout.write(json.dumps({**document, "folder": str(folder)}) + "\n")
        return
    table = Table("rank", "id", "score", "coverage", "chance", "status", box=None, header_style="bold")
    for column in (0, 2, 3, 4):
        table.columns[column].justify = "right"
    for candidate in shown:
        table.add_row(
            "" if candidate.rank is None else str(candidate.rank),
            Text(candidate.name),
            "" if candidate.score is None else f"{'≈ ' * candidate.estimated}{candidate.score:.3f}",
            "" if candidate.coverage is None else f"{candidate.coverage:.0%}",
            "" if candidate.chance is None else f"{candidate.chance:.0%}",
            candidate.status.value,
        )
    with _stdout() as stdout:
        _console(stdout).print(table)
        if len(shown) < len(ranking.candidates):
            stdout.write(f"… and {len(ranking.candidates) - len(shown)} more in ranking.json\n")
    show_files([folder / "ranking.json", folder / "contact_sheet.png"], machine=False)


def show_plan(result: "PlanResult", folder: Path, *, machine: bool) -> None:
    """Print the tours, what they bring, and where the files are."""
    if machine:
        with _stdout() as stdout:
            stdout.write(json.dumps({**result.model_dump(mode="json"), "folder": str(folder)}) + "\n")
        return
    table = Table("vehicle", "stop", "id", "distance", "travel", "expected dB", box=None, header_style="bold")
    for column in (0, 1, 3, 4, 5):
        table.columns[column].justify = "right"
    for vehicle, tour in enumerate(result.plan.tours, start=1):
        for number, stop in enumerate(tour.stops, start=1):
            forecast = stop.after.forecast
            expected = (
                f"{forecast.db:.1f} ({forecast.low_db:.1f} to {forecast.high_db:.1f})" if forecast else ""
            )
            table.add_row(
                str(vehicle),
                str(number),
                Text(stop.name),
                f"{stop.distance:.3f}",
                f"{stop.travel:.3f}",
                expected,
            )
    with _stdout() as stdout:
        _console(stdout).print(table)
        stdout.write(f"{result.summary}\n")
    show_files([folder / "plan.json", folder / "plan.png"], machine=False)


def show_selection(result: "SelectionResult", folder: Path, *, machine: bool) -> None:
    """Print the views in the order of their visit, why the selection ended, and where the files are."""
    if machine:
        document = result.model_dump(mode="json")
        with _stdout() as stdout:
            stdout.write(json.dumps({**document, "folder": str(folder)}) + "\n")
        return
    several = len(result.flown) > 1
    table = Table("view", "name", "score", "distance", "travel", "", box=None, header_style="bold")
    for column in (0, 2, 3, 4):
        table.columns[column].justify = "right"
    for view in result.views:
        notes = ["initial"] if view.initial else []
        notes += [f"vehicle {view.vehicle}"] if several and view.vehicle else []
        notes += [f"fallback: {view.fallback}"] if view.fallback else []
        notes += [] if view.registered else ["not registered"]
        table.add_row(
            str(view.order),
            Text(view.name),
            "" if view.score is None else f"{view.score:.4g}",
            f"{view.distance:.3f}",
            f"{view.travel:.3f}",
            ", ".join(notes),
        )
    with _stdout() as stdout:
        _console(stdout).print(table)
        stdout.write(
            f"{result.stop.message} Travel {result.travel:.4g}; all views in order of capture: "
            f"{result.travel_of_capture:.4g}.\n"
        )
        if several:
            flown = ", ".join(f"{length:.4g}" for length in result.flown)
            stdout.write(f"Flown by each vehicle after the initial views: {flown}.\n")
        if (forecast := result.expected.forecast) is not None:
            stdout.write(
                f"Expected PSNR over all views that could be visited: {forecast.db:.1f} dB, "
                f"{forecast.low_db:.1f} to {forecast.high_db:.1f} in four of five cases.\n"
            )
        for name in ("result.json", "trajectory.png", "point_cloud.ply"):
            stdout.write(f"{folder / name}\n")


def show_experiment(summary: "Summary", folder: Path, *, machine: bool) -> None:
    """Print the selectors' results at the last view count or travel, the notes, and the files."""
    if machine:
        with _stdout() as stdout:
            stdout.write(json.dumps({**summary.model_dump(mode="json"), "folder": str(folder)}) + "\n")
        return
    rows: Sequence[AnyRow]
    if summary.travel_rows:
        share = max(row.share for row in summary.travel_rows)
        rows = [row for row in summary.travel_rows if row.share == share]
        reached = f"Within a travel of {share * (summary.protocol.max_travel or 0.0):.4g}"
    else:
        last = max(row.visited for row in summary.rows)
        rows = [row for row in summary.rows if row.visited == last]
        reached = f"After {last} views"
    table = Table("selector", "PSNR dB", "SSIM", "travel", "s per selection", box=None, header_style="bold")
    for column in table.columns[1:]:
        column.justify = "right"
    for row in rows:
        table.add_row(
            row.method,
            _estimate(row.psnr_db, 2),
            _estimate(row.ssim, 3),
            _estimate(row.travel, 2),
            _estimate(row.selection_s, 3),
        )
    with _stdout() as stdout:
        stdout.write(f"{reached}, seeds {', '.join(map(str, summary.seeds))}:\n")
        _console(stdout).print(table)
        stdout.writelines(f"{note}\n" for note in summary.notes)
        stdout.writelines(f"{path}\n" for path in sorted(folder.glob("*.png")))
        stdout.write(f"{folder / 'report.md'}\n")


def _estimate(estimate: "Estimate | None", decimals: int) -> str:
    if estimate is None:
        return ""
    mean = f"{estimate.mean:.{decimals}f}"
    return mean if estimate.half_width is None else f"{mean} ± {estimate.half_width:.{decimals}f}"


def show_control(record: "ControlRecord", file: Path, *, machine: bool) -> None:
    """Print the residual of every control and check point, and where the file is."""
    if machine:
        with _stdout() as stdout:
            stdout.write(record.model_dump_json() + "\n")
        return
    table = Table(
        *("point", "status", "east mm", "north mm", "up mm", "off mm", "marks", "px"),
        box=None,
        header_style="bold",
    )
    for column in range(2, 8):
        table.columns[column].justify = "right"
    for point in record.residuals.points:
        lengths = (point.east_m, point.north_m, point.up_m, point.distance_m)
        table.add_row(
            Text(point.name),
            point.status.value,
            *("" if length is None else f"{1e3 * length:,.1f}" for length in lengths),
            f"{point.marks - len(point.wrong_marks)} of {point.marks}",
            "" if point.reprojection_px is None else f"{point.reprojection_px:.2f}",
        )
    check_m = record.residuals.check_rms_m
    checks = "" if check_m is None else f", of the check points {1e3 * check_m:,.1f} mm"
    with _stdout() as stdout:
        _console(stdout).print(table)
        stdout.write(f"RMS of the control points {1e3 * record.residuals.control_rms_m:,.1f} mm{checks}\n")
    show_files([file], machine=False)


def show_files(paths: Sequence[Path], *, machine: bool) -> None:
    """Print the paths of files that were written."""
    with _stdout() as stdout:
        if machine:
            stdout.write(json.dumps({"files": [str(path) for path in paths]}) + "\n")
        else:
            stdout.writelines(f"{path}\n" for path in paths)


def _facts(info: "FolderInfo") -> list[tuple[str, str]]:
    manifest, metrics = info.manifest, info.metrics
    photographs = manifest.images.photographs
    masked = sum(photograph.masked for photograph in photographs)
    facts = [
        ("folder", f"{info.folder} ({info.disk_bytes / 1e6:,.0f} MB, {info.stage})"),
        (
            "photographs",
            f"{len(photographs)} used{f' ({masked} masked)' if masked else ''}, "
            f"{len(manifest.images.rejected)} left out",
        ),
    ]
    if manifest.cameras is not None:
        cameras = manifest.cameras
        facts.append(
            (
                "cameras",
                f"{len(cameras.registered)} registered from {cameras.source}, "
                f"{len(cameras.unregistered)} not, {cameras.points:,} points",
            )
        )
        facts.append(("evidence", f"{cameras.report['mapper']} cameras, {cameras.report['verdict']}"))
        if any(cameras.origin):
            facts.append(("origin", "{:.12g}, {:.12g}, {:.12g}".format(*cameras.origin)))
        if cameras.unregistered:
            facts.append(("not registered", ", ".join(cameras.unregistered)))
    if manifest.training is not None:
        training = manifest.training
        rate = training.iterations / training.seconds if training.seconds > 0 else 0.0
        facts.append(
            (
                "training",
                f"{manifest.settings.quality}, {training.iterations:,} of {training.target_iterations:,} "
                f"iterations at {training.width_px}×{training.height_px} px, "
                f"{training.gaussians:,} Gaussians, {rate:.1f} iterations/s",
            )
        )
    if metrics is not None:
        facts.append(("peak memory", f"{metrics.peak_memory_bytes / 1e9:.2f} GB"))
    if metrics is not None and metrics.psnr_db is not None:
        facts.append(
            (
                "held-out views",
                f"PSNR {metrics.psnr_db:.2f} dB, SSIM {metrics.ssim:.3f} over {len(metrics.views)} "
                f"after {metrics.iterations:,} iterations",
            )
        )
    return facts
