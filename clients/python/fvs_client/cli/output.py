"""Results on stdout: JSON documents, tables, and a model's metrics in words."""

import json
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import typer
from rich.console import Console
from rich.table import Table

from fvs_schema.snapshots import SnapshotMetrics


def print_json(document: Any) -> None:
    """Print one JSON document."""
    typer.echo(json.dumps(document, ensure_ascii=False, indent=2))


def print_table(
    headings: Sequence[str], rows: Iterable[Sequence[str]], *, right_aligned: Collection[str] = ()
) -> None:
    """Print a table without a frame; ids are never wrapped."""
    table = Table(box=None, pad_edge=False)
    for heading in headings:
        justify = "right" if heading in right_aligned else "left"
        table.add_column(heading, justify=justify, no_wrap=heading == "id")  # type: ignore[arg-type]
    for row in rows:
        table.add_row(*row)
    Console().print(table)


def describe_metrics(metrics: SnapshotMetrics) -> str:
    """One line with the size and all measures of quality of a model."""
    parts = [f"{metrics.registered} images registered"]
    if metrics.unregistered:
        parts.append(f"{metrics.unregistered} unregistered")
    parts.append(f"{metrics.gaussians:,} Gaussians after {metrics.iterations:,} iterations")
    if metrics.psnr_db is not None and metrics.ssim is not None:
        parts.append(f"PSNR {metrics.psnr_db:.2f} dB and SSIM {metrics.ssim:.3f} on held-out views")
    if metrics.new_images_psnr_db is not None:
        parts.append(f"{metrics.new_images_psnr_db:.2f} dB on the new images before training on them")
    return ", ".join(parts)
