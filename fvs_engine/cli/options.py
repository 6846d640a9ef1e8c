"""Options that several commands share."""

import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import typer

from fvs_engine.choices import MAX_VEHICLES, Backend, Poses
from fvs_schema.words import POINTS

OutOption = Annotated[Path, typer.Option(metavar="DIR", help="Where the results go.")]
MAX_SEED = 2**31 - 1
MAX_VIEWS, MAX_ITERATIONS, MAX_GAUSSIANS, MAX_THREADS = 100_000, 10_000_000, 100_000_000, 1_024
MAX_SIDE_PX = 32_768  # images.limits, which takes too long to import for a command line's help
YEAR_S = 31_536_000

JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print the result as JSON; progress and errors as JSON on stderr."),
]


def _terrain(given: str | None) -> str | None:
    if given not in (None, POINTS) and not Path(given).is_file():
        raise typer.BadParameter(f"There is no file {given}; `{POINTS}` means the model's sparse points.")
    return given


TerrainOption = Annotated[
    str | None,
    typer.Option(
        "--terrain",
        metavar=f"FILE|{POINTS}",
        help="Leave out candidates under the ground: by a height model, such as a GeoTIFF in any CRS (needs "
        "the extra `terrain`), whose heights have the datum of the photographs' altitudes, or by the sparse "
        f"points ({POINTS}).",
        callback=_terrain,
        show_default=False,
    ),
]


@dataclass(frozen=True)
class RunOptions:
    """Backend, threads and output format of a command."""

    backend: Annotated[Backend, typer.Option(help="Rasteriser; auto: gsplat if it can run, else cpu.")] = (
        "auto"
    )
    threads: Annotated[
        int | None,
        typer.Option(min=1, max=MAX_THREADS, help="Threads to compute with.", show_default="one per core"),
    ] = None
    as_json: JsonOption = False

    def limit_threads(self) -> None:
        """Set the size of the process's thread pools; call it before those libraries are imported."""
        if self.threads is not None:
            for pool in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
                os.environ[pool] = str(self.threads)


@dataclass(frozen=True)
class DatasetOptions:
    """A dataset and the source of its poses."""

    dataset: Annotated[
        Path, typer.Argument(metavar="DATASET", help="A folder of photographs (or of images/) with poses.")
    ]
    colmap: Annotated[
        Path | None, typer.Option(metavar="DIR", help="The COLMAP model with the dataset's poses.")
    ] = None
    transforms: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The transforms.json with the dataset's poses.")
    ] = None


@dataclass(frozen=True)
class LoopOptions:
    """Settings of the selection loop; None takes the default of the command or its preset."""

    poses: Annotated[
        Poses | None,
        typer.Option(help="sfm: estimated from the visited images only; known: those of the dataset."),
    ] = None
    priors: Annotated[
        bool | None,
        typer.Option(
            help="With sfm: use the dataset's poses, with noise, as a vehicle's expected poses.",
            show_default="priors",
        ),
    ] = None
    position_noise_percent: Annotated[
        float | None,
        typer.Option(
            "--position-noise",
            min=0,
            max=100,
            metavar="PERCENT",
            help="Noise of each coordinate of an expected pose, in % of the spread of the dataset's cameras.",
            show_default="2",
        ),
    ] = None
    orientation_noise_deg: Annotated[
        float | None,
        typer.Option(
            "--orientation-noise",
            min=0,
            max=180,
            metavar="DEG",
            help="Noise of an expected pose's angle about each axis.",
            show_default="5",
        ),
    ] = None
    initial: Annotated[
        int | None, typer.Option(min=2, max=MAX_VIEWS, metavar="M", help="Number of initial views.")
    ] = None
    radius: Annotated[
        float | None,
        typer.Option(
            min=0, max=1e9, metavar="R", help="Maximum distance of one step, in the dataset's unit."
        ),
    ] = None
    nearest: Annotated[
        int | None,
        typer.Option(
            min=1, max=MAX_VIEWS, metavar="K", help="Choose among the K nearest views instead of a radius."
        ),
    ] = None
    max_travel: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=1e9,
            metavar="D",
            help="How far each vehicle flies after the initial views, in the dataset's unit.",
            show_default="no limit",
        ),
    ] = None
    vehicles: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MAX_VEHICLES,
            metavar="N",
            help="Number of vehicles, which all start at the last initial view; the one that has flown least "
            "is next.",
            show_default="1",
        ),
    ] = None
    registrable: Annotated[
        bool | None,
        typer.Option(
            help="With sfm: choose only among views that are likely to be registered.",
            show_default="registrable",
        ),
    ] = None
    initial_iterations: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MAX_ITERATIONS,
            metavar="N",
            help="Minimum number of training iterations of the full model.",
            show_default="1000",
        ),
    ] = None
    iterations_per_view: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=MAX_ITERATIONS,
            metavar="N",
            help="Training iterations per view of the full model; quick models, which choose, have a fifth.",
            show_default="100",
        ),
    ] = None
    long_side_px: Annotated[
        int | None,
        typer.Option(
            "--long-side",
            min=64,
            max=MAX_SIDE_PX,
            metavar="PX",
            help="Train on images reduced to this long side.",
        ),
    ] = None
    max_gaussians: Annotated[
        int | None,
        typer.Option(
            min=1_000, max=MAX_GAUSSIANS, metavar="N", help="Upper limit of the number of Gaussians."
        ),
    ] = None
    time_limit_s: Annotated[
        float | None,
        typer.Option(
            "--time-limit",
            min=0,
            max=YEAR_S,
            metavar="S",
            help="Start no step that would end after S seconds.",
        ),
    ] = None

    def given(self) -> dict[str, Any]:
        """The options that were given, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None}
