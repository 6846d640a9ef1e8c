"""The commands of ``fvs``: each reads its arguments, runs one job of the engine and prints the result.

The engine is imported inside the commands: torch, Numba and pycolmap take seconds to load, and ``--help`` and
invalid arguments must be answered at once.
"""

import importlib.metadata
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from fvs_client.cli.command_group import Program

from fvs_engine.choices import CameraModel, Quality, RankingMethod, ViewGroup
from fvs_engine.cli.align import align
from fvs_engine.cli.evaluate import evaluate
from fvs_engine.cli.export import export
from fvs_engine.cli.frames import frames
from fvs_engine.cli.option_groups import with_option_groups
from fvs_engine.cli.options import (
    MAX_ITERATIONS,
    MAX_SEED,
    MAX_SIDE_PX,
    MAX_VIEWS,
    JsonOption,
    OutOption,
    RunOptions,
    TerrainOption,
)
from fvs_engine.cli.plan import plan
from fvs_engine.cli.select import select
from fvs_engine.cli.simulate import simulate
from fvs_engine.cli.simulate_vehicle import simulate_vehicle
from fvs_engine.errors import ContradictedModelsError, ContradictedPositionsError, EngineError
from fvs_schema.names import readable_name

if TYPE_CHECKING:
    from fvs_engine.monitor import Monitor
    from fvs_engine.pipeline.rank import RankingResult

COMMANDS = "fvs.commands"
"""Entry point group: functions that are called with ``app`` and add commands to it."""


class _Fvs(Program):
    """The group of commands: what they write names the folders that they got, as UTF-8."""

    def check(self, arguments: Sequence[str]) -> None:
        """See ``Program``."""
        for word in arguments:
            if readable_name(word) != word:
                raise typer.BadParameter(
                    f"{readable_name(word)} has bytes (%…) that are not UTF-8. Rename it, or link to it."
                )


app = typer.Typer(
    cls=_Fvs,
    help="Reconstruct photographs as 3D Gaussian splats, and rank the views to photograph next.\n\n"
    "Options may stand before or after the command.",
    epilog="Exit statuses: 0 done, 2 wrong usage, 130 stopped; the others: docs/reference/exit-statuses.md.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


_CAMERA_OPTIONS = (
    "The options are --intrinsics, --camera-model OPENCV, which allows for stretched images, and --colmap or "
    "--transforms. The evidence against each model is in sfm/rejected.json of the output folder."
)
_POSITION_OPTIONS = (
    "--no-gps leaves them out. The evidence against each model is in sfm/rejected.json of the output folder."
)
_REMEDIES: Mapping[type[EngineError], str] = {
    ContradictedModelsError: _CAMERA_OPTIONS,
    ContradictedPositionsError: _POSITION_OPTIONS,
}
_Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The output folder of `fvs reconstruct`.")]
_Candidates = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Poses in the model frame as JSON, or a transforms.json."),
]


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"fvs {importlib.metadata.version('fvs')}")
        raise typer.Exit


@app.callback()
def _fvs(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


@app.command()
@with_option_groups()
def reconstruct(
    *,
    images: Annotated[Path, typer.Argument(metavar="IMAGES", help="A folder of photographs.")],
    out: OutOption,
    quality: Annotated[
        Quality,
        typer.Option(
            help="coarse: quick, colours do not depend on the view; fine: the final quality, they do."
        ),
    ] = "coarse",
    iterations: Annotated[
        int | None,
        typer.Option(
            min=1, max=MAX_ITERATIONS, metavar="N", help="Training iterations.", show_default="the preset's"
        ),
    ] = None,
    long_side: Annotated[
        int | None,
        typer.Option(
            min=64,
            max=MAX_SIDE_PX,
            metavar="PX",
            help="Train on images reduced to this long side.",
            show_default="coarse 640, fine 1600",
        ),
    ] = None,
    colmap: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Take the cameras from a COLMAP model of IMAGES.")
    ] = None,
    transforms: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Take the cameras from a transforms.json of IMAGES.")
    ] = None,
    intrinsics: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The calibration of the camera: a COLMAP cameras.txt, or JSON."),
    ] = None,
    camera_model: Annotated[
        CameraModel | None,
        typer.Option(
            case_sensitive=False,
            metavar="MODEL",
            help="Camera model to estimate: SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV. Only OPENCV "
            "allows for pixels that are not square.",
            show_default="SIMPLE_RADIAL; from ten images on RADIAL with its principal point",
        ),
    ] = None,
    gps: Annotated[
        bool,
        typer.Option(
            "--gps/--no-gps",
            help="Use the positions in the photographs' metadata; --no-gps ignores them, for example because "
            "they are wrong.",
        ),
    ] = True,
    test_every: Annotated[
        int,
        typer.Option(
            min=0, max=MAX_VIEWS, metavar="N", help="Hold out every n-th view for testing; 0 holds out none."
        ),
    ] = 8,
    seed: Annotated[
        int,
        typer.Option(
            min=0,
            max=MAX_SEED,
            help="Seed of the training: the same cameras and seed train the same model on the CPU.",
        ),
    ] = 0,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Delete an earlier result in DIR and start again.")
    ] = False,
    run: RunOptions,
) -> None:
    """Reconstruct photographs: estimate cameras and train a model. After a stop, the same command resumes."""
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    def job(monitor: "Monitor") -> None:
        run.limit_threads()
        from fvs_engine.pipeline.manifest import ReconstructionSettings
        from fvs_engine.pipeline.reconstruct import reconstruct_folder
        from fvs_engine.sfm.colmap.intrinsics import read_intrinsics

        settings = ReconstructionSettings(
            quality=quality,
            iterations=iterations,
            long_side_px=long_side,
            test_every=test_every,
            seed=seed,
            backend=run.backend,
            colmap=str(colmap.absolute()) if colmap else None,
            transforms=str(transforms.absolute()) if transforms else None,
            camera_model=camera_model,
            intrinsics=read_intrinsics(intrinsics) if intrinsics else None,
            gps=gps,
        )
        reconstruct_folder(images, out, settings, overwrite=overwrite, monitor=monitor, threads=run.threads)

    run_job(job, machine=run.as_json, remedies=_REMEDIES)
    report.show_folder(out, machine=run.as_json)


@app.command()
@with_option_groups()
def rank(
    *,
    folder: _Folder,
    candidates: _Candidates = None,
    top: Annotated[
        int | None,
        typer.Option(min=1, max=MAX_VIEWS, metavar="K", help="Show only the first K.", show_default="all"),
    ] = None,
    method: Annotated[
        RankingMethod,
        typer.Option(
            help="How candidates are scored: with -fast only the first K (or 10) scores are exact, with "
            "-estimate none is."
        ),
    ] = "median-frequency",
    safety: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=1e9,
            metavar="LENGTH",
            help="Least distance from matter, in units of the model.",
            show_default="half of that from which the nearest photographs saw it",
        ),
    ] = 0.0,
    rank_all: Annotated[
        bool,
        typer.Option(
            "--all", help="Rank also candidates in matter, too close to it, or unlikely to be registered."
        ),
    ] = False,
    terrain: TerrainOption = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR2", help="Where the results go.", show_default="DIR/ranking"),
    ] = None,
    run: RunOptions,
) -> None:
    """Rank candidate poses: the lowest median frequency first.

    Without --candidates: the held-out views, and poses halfway between neighbouring training views.
    A candidate in matter, too close to it or unlikely to be registered gets no rank (see status).
    Writes ranking.json (all candidates) and contact_sheet.png (the first K, or 12; at most 48).
    """
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    def job(monitor: "Monitor") -> "tuple[RankingResult, Path]":
        run.limit_threads()
        from fvs_engine.pipeline.rank import rank_candidates

        return rank_candidates(
            folder,
            candidates,
            out=out,
            top=top,
            method=method,
            safety=safety,
            rank_all=rank_all,
            terrain=terrain,
            backend=run.backend,
            monitor=monitor,
        )

    report.show_ranking(*run_job(job, machine=run.as_json), top=top, machine=run.as_json)


@app.command()
@with_option_groups()
def render(
    *,
    folder: _Folder,
    views: Annotated[
        ViewGroup, typer.Option(help="Which views; path: a smooth path through the training views.")
    ] = "held-out",
    candidates: _Candidates = None,
    frames: Annotated[
        int, typer.Option(min=2, max=MAX_VIEWS, metavar="N", help="Number of frames of a path.")
    ] = 120,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR2", help="Where the PNGs go.", show_default="DIR/renders")
    ] = None,
    run: RunOptions,
) -> None:
    """Render views of the model, candidates or a path through the views to PNG files."""
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    def job(monitor: "Monitor") -> tuple[Path, ...]:
        run.limit_threads()
        from fvs_engine.pipeline.render import render_views

        return render_views(
            folder,
            group=views,
            candidates_file=candidates,
            frames=frames,
            out=out,
            backend=run.backend,
            monitor=monitor,
        )

    report.show_files(run_job(job, machine=run.as_json), machine=run.as_json)


@app.command()
def info(folder: _Folder, as_json: JsonOption = False) -> None:
    """Describe an output folder: photographs, cameras, training, quality."""
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import fail
    from fvs_engine.errors import EngineError

    try:
        report.show_folder(folder, machine=as_json)
    except EngineError as error:
        fail(error, machine=as_json)


app.command()(frames)
app.command()(plan)
app.command()(align)
app.command()(export)
app.command()(select)
app.command()(simulate)
app.command("simulate-vehicle")(simulate_vehicle)
app.command()(evaluate)
for entry_point in importlib.metadata.entry_points(group=COMMANDS):
    entry_point.load()(app)
