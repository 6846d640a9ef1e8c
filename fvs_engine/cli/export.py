"""The command ``fvs export``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from fvs_engine.choices import ExportFormat, ExportFrame
from fvs_engine.cli.options import JsonOption

if TYPE_CHECKING:
    from fvs_engine.monitor import Monitor


_FORMATS: tuple[ExportFormat, ...] = get_args(ExportFormat)


def _known_formats(text: str) -> tuple[ExportFormat, ...]:
    """The formats of a list; none for all."""
    if text == "all":
        return ()
    parts = [part.strip() for part in text.split(",")]
    unknown = [part for part in parts if part not in _FORMATS]
    if unknown:
        raise typer.BadParameter(f"{unknown[0]!r} is none of {', '.join(_FORMATS)}.", param_hint="--format")
    return tuple(kind for kind in _FORMATS if kind in parts)


def _geoid(text: str | None) -> Path | float | None:
    """A height in metres, or a file."""
    if text is None:
        return None
    try:
        height = float(text)
    except ValueError:
        return Path(text)
    if not abs(height) <= 120.0:
        raise typer.BadParameter(
            f"{text}: the geoid is at most 120 m from the ellipsoid.", param_hint="--geoid"
        )
    return height


def export(
    *,
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="The output folder of `fvs reconstruct`, or of `fvs-client download`."
        ),
    ],
    formats: Annotated[
        str,
        typer.Option(
            "--format", metavar="LIST", help=f"What to write: all, or some of {', '.join(_FORMATS)}."
        ),
    ] = "all",
    frame: Annotated[
        ExportFrame,
        typer.Option(
            help="world: metres east, north and up of the photographs' positions; model: its own frame."
        ),
    ] = "world",
    epsg: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=999_999,
            metavar="CODE",
            help="A projected CRS for points.",
            show_default="UTM, at the poles UPS",
        ),
    ] = None,
    geoid: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="A grid of geoid heights (GTX or GeoTIFF), or the height there in metres: altitudes above "
            "sea level become those above the ellipsoid, which globes have.",
        ),
    ] = None,
    clean: Annotated[
        bool,
        typer.Option(
            "--clean",
            help="Leave out floaters: Gaussians in the air near a camera that one photograph alone shows. "
            "Models of --quality fine have none.",
        ),
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR2", help="Where the files go.", show_default="DIR/export")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write Gaussians, cameras and points for other programs, where they are on Earth.

    Coordinates are small, in metres from an origin: georeference.json says where it is, above which datum
    heights are, and how to lay the files into a CRS.
    """
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    if frame == "model" and (epsg is not None or geoid is not None):
        raise typer.BadParameter("--epsg and --geoid need --frame world.")
    wanted, height = _known_formats(formats), _geoid(geoid)

    def job(monitor: "Monitor") -> tuple[Path, ...]:
        from fvs_engine.pipeline.export import export_model

        return export_model(
            folder,
            formats=wanted,
            frame=frame,
            epsg=epsg,
            geoid=height,
            clean=clean,
            out=out,
            monitor=monitor,
        )

    report.show_files(run_job(job, machine=as_json), machine=as_json)
