"""The command ``fvs align``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fvs_engine.cli.options import JsonOption
from fvs_schema.scenes import AltitudeDatum

if TYPE_CHECKING:
    from fvs_engine.monitor import Monitor
    from fvs_engine.pipeline.control import ControlRecord


def align(
    *,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The output folder of `fvs reconstruct`.")],
    gcp: Annotated[
        Path, typer.Option(metavar="FILE", help="Surveyed points and their marks, as OpenDroneMap has them.")
    ],
    check: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="A point that is measured and not used; * stands for any letters. May be repeated.",
            show_default="those with the word check after their name",
        ),
    ] = None,
    heights: Annotated[
        AltitudeDatum | None,
        typer.Option(
            metavar="DATUM",
            help="What heights are measured from: ellipsoid, sea-level or takeoff.",
            show_default="as the CRS says, else sea-level",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Place a model on Earth by surveyed points that are marked in its photographs.

    Marks are in px of the files as they are stored. The alignment takes the place of the photographs' GPS:
    fvs export uses it.
    """
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    def job(monitor: "Monitor") -> "ControlRecord":
        from fvs_engine.pipeline.control import align_folder

        return align_folder(folder, gcp, check=check or (), heights=heights, monitor=monitor)

    from fvs_engine.pipeline.workspace import Workspace

    report.show_control(run_job(job, machine=as_json), Workspace(folder).control, machine=as_json)
