"""The command ``fvs select``."""

from typing import TYPE_CHECKING, Annotated

import typer

from fvs_engine.choices import HoldOut, InitialChoice, Quality
from fvs_engine.cli.option_groups import with_option_groups
from fvs_engine.cli.options import MAX_SEED, MAX_VIEWS, DatasetOptions, LoopOptions, OutOption, RunOptions
from fvs_schema.words import Method

if TYPE_CHECKING:
    from fvs_engine.monitor import Monitor
    from fvs_engine.pipeline.select import SelectionResult


@with_option_groups(
    poses="sfm",
    initial="10",
    radius="8 × the median distance between consecutive views",
    long_side_px="coarse 640, fine 1600",
    max_gaussians="the preset's",
)
def select(
    *,
    source: DatasetOptions,
    out: OutOption,
    method: Annotated[
        Method, typer.Option(help="How the next view is chosen; median-frequency is the paper's.")
    ] = "median-frequency",
    budget: Annotated[
        int | None,
        typer.Option(
            min=2,
            max=MAX_VIEWS,
            metavar="N",
            help="Total number of views.",
            show_default="100, or all there are",
        ),
    ] = None,
    initial_choice: Annotated[
        InitialChoice,
        typer.Option(
            help="Initial views: the first, consecutive ones from a random view, those farthest apart, "
            "or the best of a plan for the whole budget."
        ),
    ] = "first",
    test_every: Annotated[
        int,
        typer.Option(
            min=0, max=MAX_VIEWS, metavar="N", help="Hold out every n-th view for testing; 0 holds out none."
        ),
    ] = 8,
    hold_out: Annotated[
        HoldOut,
        typer.Option(
            help="Which views to hold out: every n-th, or as many at random; the same in every run."
        ),
    ] = "every",
    quality: Annotated[
        Quality, typer.Option(help="Training preset: coarse has SH degree 0, fine 3.")
    ] = "coarse",
    seed: Annotated[
        int,
        typer.Option(min=0, max=MAX_SEED, help="The same dataset and seed give the same views on the CPU."),
    ] = 0,
    stop_at_db: Annotated[
        float | None,
        typer.Option(
            min=0, max=100, metavar="DB", help="End when the expected PSNR over all views reaches this."
        ),
    ] = None,
    stop_at_gain_db: Annotated[
        float | None,
        typer.Option(
            "--stop-at-gain",
            min=0,
            max=100,
            metavar="DB",
            help="End when no view in reach is expected to add as much as this.",
        ),
    ] = None,
    loop: LoopOptions,
    run: RunOptions,
) -> None:
    """Select views of a dataset: train, choose the next view, visit it, repeat.

    Poses come from DATASET (transforms.json, or a COLMAP model in reference or sparse/0), or from --colmap
    or --transforms.

    After a stop, the same command resumes. With --poses sfm and --threads above 1 runs may differ.
    """
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    def job(monitor: "Monitor") -> "SelectionResult":
        run.limit_threads()
        from fvs_engine.lab.baselines import create_selector
        from fvs_engine.pipeline.select import select_views
        from fvs_engine.pipeline.selection_request import SelectionRequest

        request = SelectionRequest(
            method=method,
            budget=budget,
            initial_choice=initial_choice,
            test_every=test_every,
            hold_out=hold_out,
            quality=quality,
            seed=seed,
            stop_at_db=stop_at_db,
            stop_at_gain_db=stop_at_gain_db,
            threads=run.threads,
            **loop.given(),
        )
        return select_views(
            source.dataset,
            out,
            request,
            create_selector(method),
            colmap=source.colmap,
            transforms=source.transforms,
            backend=run.backend,
            monitor=monitor,
        )

    report.show_selection(run_job(job, machine=run.as_json), out, machine=run.as_json)
