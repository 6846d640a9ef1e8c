"""The command ``fvs select``."""

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from fvs_engine.cli.options import (
    Backend,
    BackendOption,
    DatasetArgument,
    DatasetColmapOption,
    DatasetTransformsOption,
    JsonOption,
    OutOption,
    Quality,
    ThreadsOption,
    limit_threads,
)

if TYPE_CHECKING:
    from fvs_engine.cli.jobs import Say
    from fvs_engine.monitor import Monitor
    from fvs_engine.pipeline.select import SelectionResult


class Method(StrEnum):
    """The selectors."""

    MEDIAN_FREQUENCY = "median-frequency"
    RANDOM = "random"
    UNIFORM = "uniform"
    FARTHEST = "farthest"
    NEAREST = "nearest"
    FISHER = "fisher"
    D_OPTIMAL = "d-optimal"
    COVERAGE = "coverage"
    SPECTRAL_MEDIAN = "spectral-median"


class Poses(StrEnum):
    """Where the cameras of visited views come from."""

    SFM = "sfm"
    KNOWN = "known"


class Initial(StrEnum):
    """Which views a selection begins with."""

    FIRST = "first"
    CONSECUTIVE = "consecutive"
    FARTHEST = "farthest"


def select(
    dataset: DatasetArgument,
    out: OutOption,
    method: Annotated[
        Method, typer.Option(help="How the next view is chosen; median-frequency is the paper's.")
    ] = Method.MEDIAN_FREQUENCY,
    budget: Annotated[
        int | None,
        typer.Option(min=2, metavar="N", help="Views in all.", show_default="100, or all there are"),
    ] = None,
    initial: Annotated[int, typer.Option(min=2, metavar="M", help="Views to begin with.")] = 10,
    initial_choice: Annotated[
        Initial,
        typer.Option(
            help="The first of the capture, as many in a row from a seeded place, or the most spread."
        ),
    ] = Initial.FIRST,
    radius: Annotated[
        float | None,
        typer.Option(
            metavar="R",
            help="How far the camera flies in one step, in the dataset's unit.",
            show_default="8 × the median distance between consecutive views",
        ),
    ] = None,
    nearest: Annotated[
        int | None,
        typer.Option(min=1, metavar="K", help="Choose among the K nearest views instead of a radius."),
    ] = None,
    test_every: Annotated[
        int, typer.Option(min=0, metavar="N", help="Hold out every n-th view for testing; 0 holds out none.")
    ] = 8,
    poses: Annotated[
        Poses,
        typer.Option(help="sfm: estimated from the visited photographs only; known: those of the dataset."),
    ] = Poses.SFM,
    colmap: DatasetColmapOption = None,
    transforms: DatasetTransformsOption = None,
    quality: Annotated[
        Quality, typer.Option(help="What is learned: coarse has SH degree 0, fine 3.")
    ] = Quality.COARSE,
    initial_iterations: Annotated[
        int, typer.Option(min=1, metavar="N", help="Training iterations on the initial views.")
    ] = 1_000,
    iterations_per_view: Annotated[
        int, typer.Option(min=0, metavar="N", help="Further iterations for every view added.")
    ] = 100,
    long_side: Annotated[
        int | None,
        typer.Option(
            min=64,
            metavar="PX",
            help="Learn from images reduced to this long side.",
            show_default="coarse 640, fine 1600",
        ),
    ] = None,
    max_gaussians: Annotated[
        int | None,
        typer.Option(min=1_000, metavar="N", help="Never have more Gaussians.", show_default="the preset's"),
    ] = None,
    time_limit: Annotated[
        float | None,
        typer.Option(metavar="S", help="Begin no step that would end later than this many seconds."),
    ] = None,
    backend: BackendOption = Backend.AUTO,
    seed: Annotated[
        int, typer.Option(min=0, help="The same dataset and seed give the same views on the CPU.")
    ] = 0,
    threads: ThreadsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Choose which photographs to take: learn a little, choose the next view, fly there, again.

    Poses are found in DATASET (transforms.json, a COLMAP model in reference or sparse/0) or named.

    After a stop, the same command goes on. With --poses sfm and --threads above 1 runs may differ.
    """
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    def job(monitor: "Monitor", say: "Say") -> "SelectionResult":
        limit_threads(threads)
        from fvs_engine.pipeline.select import loop_settings, scene_settings, select_views

        scene = scene_settings(
            poses=poses.value,
            quality=quality.value,
            long_side_px=long_side,
            initial_iterations=initial_iterations,
            iterations_per_view=iterations_per_view,
            max_gaussians=max_gaussians,
            seed=seed,
            threads=threads,
        )
        return select_views(
            dataset,
            out,
            lambda found: loop_settings(
                found,
                scene=scene,
                method=method.value,
                budget=budget,
                initial=initial,
                initial_choice=initial_choice.value,
                radius=radius,
                nearest=nearest,
                test_every=test_every,
                seed=seed,
                time_limit_s=time_limit,
            ),
            colmap=colmap,
            transforms=transforms,
            backend=backend.value,
            monitor=monitor,
            warn=say,
        )

    report.show_selection(run_job(job, machine=as_json), out, machine=as_json)
