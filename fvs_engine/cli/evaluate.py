"""The command ``fvs evaluate``."""

from typing import TYPE_CHECKING, Annotated, get_args

import typer

from fvs_engine.choices import HoldOut, ProtocolName
from fvs_engine.cli.option_groups import with_option_groups
from fvs_engine.cli.options import MAX_SEED, MAX_VIEWS, DatasetOptions, LoopOptions, OutOption, RunOptions
from fvs_schema.words import Method

if TYPE_CHECKING:
    from fvs_engine.lab.evaluate.report import Summary
    from fvs_engine.monitor import Monitor


def _whole_numbers(text: str, option: str, lowest: int, highest: int) -> tuple[int, ...]:
    try:
        numbers = tuple(int(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(
            f"{text[:100]!r} is not a list of whole numbers, as in 0,1,2", param_hint=option
        ) from None
    if not all(lowest <= number <= highest for number in numbers):
        raise typer.BadParameter(f"The numbers must lie between {lowest} and {highest}.", param_hint=option)
    return numbers


def _methods(text: str) -> tuple[str, ...]:
    if text == "all":
        return get_args(Method)
    return tuple(part.strip() for part in text.split(","))


@with_option_groups(
    **dict.fromkeys(("poses", "initial", "radius", "nearest"), "the preset's"),
    long_side_px="640",
    max_gaussians="300000",
    max_travel="no limit; travel: the length of the capture",
)
def evaluate(
    *,
    source: DatasetOptions,
    out: OutOption,
    preset: Annotated[
        ProtocolName,
        typer.Option(
            help="paper: the first 10 images, a radius, 100 views, estimated poses; fisherrf: 4 far from one "
            "another, all in reach, 20 views; nearest5: 4 consecutive, the 5 nearest in reach, 20 views; "
            "travel: 4 consecutive, all in reach, as far as --max-travel, 20 views."
        ),
    ] = "fisherrf",
    methods: Annotated[str, typer.Option(metavar="A,B,…", help="The selectors to compare, or all.")] = "all",
    seeds: Annotated[
        str,
        typer.Option(
            metavar="N,…", help="Seeds, one for each run: they change the initial views and the training."
        ),
    ] = "0,1,2",
    views: Annotated[
        str | None,
        typer.Option(
            metavar="N,…",
            help="Numbers of views at which to measure; the last is the budget.",
            show_default="the preset's",
        ),
    ] = None,
    test_every: Annotated[
        int,
        typer.Option(
            min=2, max=MAX_VIEWS, metavar="N", help="Hold out every n-th view and measure on these."
        ),
    ] = 8,
    hold_out: Annotated[
        HoldOut,
        typer.Option(
            help="Which views to hold out: every n-th, or as many at random; the same in every run."
        ),
    ] = "every",
    trainings: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=100,
            metavar="N",
            help="Number of models to train from each final set of views; the report has their mean.",
            show_default="1",
        ),
    ] = None,
    calibrate: Annotated[
        bool,
        typer.Option("--calibrate", help="Also compare every selector's scores with the true errors."),
    ] = False,
    loop: LoopOptions,
    run: RunOptions,
) -> None:
    """Compare selectors: a table of selectors × seeds, with means, confidence intervals and plots.

    With --max-travel a run ends before the view that would exceed it, and the models are measured at each
    quarter of the travel.

    After a stop, the same command resumes. Further methods and seeds are added to those in DIR.
    """
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    method_names = _methods(methods)
    seed_numbers = _whole_numbers(seeds, "--seeds", 0, MAX_SEED)
    counts = None if views is None else _whole_numbers(views, "--views", 2, MAX_VIEWS)

    def job(monitor: "Monitor") -> "Summary":
        run.limit_threads()
        from fvs_engine.lab.evaluate.from_datasets import evaluate_selectors
        from fvs_engine.lab.evaluate.protocol import protocol_from_preset

        held_out = {"test_every": test_every, "hold_out": hold_out}
        protocol = protocol_from_preset(
            preset, view_counts=counts, trainings=trainings, **held_out, **loop.given()
        )
        return evaluate_selectors(
            source.dataset,
            out,
            protocol,
            method_names,
            seed_numbers,
            colmap=source.colmap,
            transforms=source.transforms,
            calibrated=calibrate,
            backend=run.backend,
            threads=run.threads,
            monitor=monitor,
        )

    report.show_experiment(run_job(job, machine=run.as_json), out, machine=run.as_json)
