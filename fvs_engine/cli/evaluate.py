"""The command ``fvs evaluate``."""

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
    ThreadsOption,
    limit_threads,
)
from fvs_engine.cli.select import Method, Poses

if TYPE_CHECKING:
    from fvs_engine.cli.jobs import Say
    from fvs_engine.evaluate.report import Summary
    from fvs_engine.monitor import Monitor


class Preset(StrEnum):
    """The protocols."""

    PAPER = "paper"
    FISHERRF = "fisherrf"
    NEAREST5 = "nearest5"


def _whole_numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a list of whole numbers, as in 0,1,2") from None


def _methods(text: str) -> tuple[str, ...]:
    if text == "all":
        return tuple(method.value for method in Method)
    return tuple(part.strip() for part in text.split(","))


def evaluate(
    dataset: DatasetArgument,
    out: OutOption,
    preset: Annotated[
        Preset,
        typer.Option(
            help="paper: the first 10 images, a radius, 100 views, estimated poses; fisherrf: 4 far from one "
            "another, all may be next, 20 views; nearest5: 4 in a row, the 5 nearest, 20 views."
        ),
    ] = Preset.FISHERRF,
    methods: Annotated[str, typer.Option(metavar="A,B,…", help="The selectors to compare, or all.")] = "all",
    seeds: Annotated[
        str, typer.Option(metavar="N,…", help="One run each: other initial views, other training.")
    ] = "0,1,2",
    views: Annotated[
        str | None,
        typer.Option(
            metavar="N,…",
            help="Measure at so many views; the last is the budget.",
            show_default="the preset's",
        ),
    ] = None,
    poses: Annotated[
        Poses | None,
        typer.Option(
            help="sfm: estimated from the visited photographs only; known: those of the dataset.",
            show_default="the preset's",
        ),
    ] = None,
    initial: Annotated[
        int | None, typer.Option(min=2, metavar="M", help="Views to begin with.", show_default="the preset's")
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option(
            metavar="R",
            help="How far the camera flies in one step, in the dataset's unit.",
            show_default="the preset's",
        ),
    ] = None,
    nearest: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="K", help="Choose among the K nearest views.", show_default="the preset's"
        ),
    ] = None,
    test_every: Annotated[
        int, typer.Option(min=2, metavar="N", help="Hold out every n-th view and measure on these.")
    ] = 8,
    initial_iterations: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Training iterations at the start.", show_default="1000"),
    ] = None,
    iterations_per_view: Annotated[
        int | None,
        typer.Option(min=0, metavar="N", help="Further iterations per view added.", show_default="100"),
    ] = None,
    long_side: Annotated[
        int | None,
        typer.Option(
            min=64, metavar="PX", help="Learn from images reduced to this long side.", show_default="640"
        ),
    ] = None,
    max_gaussians: Annotated[
        int | None,
        typer.Option(min=1_000, metavar="N", help="Never have more Gaussians.", show_default="300000"),
    ] = None,
    time_limit: Annotated[
        float | None,
        typer.Option(metavar="S", help="Begin no step that would end a run later than this many seconds."),
    ] = None,
    calibrate: Annotated[
        bool,
        typer.Option("--calibrate", help="Also compare every selector's scores with the true errors."),
    ] = False,
    colmap: DatasetColmapOption = None,
    transforms: DatasetTransformsOption = None,
    backend: BackendOption = Backend.AUTO,
    threads: ThreadsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compare ways to choose views: a table of selectors × seeds, with means, intervals and plots.

    After a stop, the same command goes on. Further methods and seeds join those that are in DIR.
    """
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    method_names, seed_numbers = _methods(methods), _whole_numbers(seeds)
    counts = None if views is None else _whole_numbers(views)

    def job(monitor: "Monitor", say: "Say") -> "Summary":
        limit_threads(threads)
        from fvs_engine.evaluate.protocol import protocol_from_preset
        from fvs_engine.pipeline.evaluate import evaluate_selectors

        protocol = protocol_from_preset(
            preset.value,
            view_counts=counts,
            poses=None if poses is None else poses.value,
            initial=initial,
            radius=radius,
            nearest=nearest,
            test_every=test_every,
            initial_iterations=initial_iterations,
            iterations_per_view=iterations_per_view,
            long_side_px=long_side,
            max_gaussians=max_gaussians,
            time_limit_s=time_limit,
        )
        return evaluate_selectors(
            dataset,
            out,
            protocol,
            method_names,
            seed_numbers,
            colmap=colmap,
            transforms=transforms,
            calibrated=calibrate,
            backend=backend.value,
            threads=threads,
            monitor=monitor,
            warn=say,
        )

    report.show_experiment(run_job(job, machine=as_json), out, machine=as_json)
