"""The command ``fvs plan``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fvs_engine.choices import MAX_VEHICLES
from fvs_engine.cli.options import JsonOption, TerrainOption

if TYPE_CHECKING:
    from fvs_engine.monitor import Monitor
    from fvs_engine.pipeline.plan import PlanResult
    from fvs_engine.plan.generate import Aim

MOST_VIEWS = 200
"""A plan of so many takes half a minute; a longer flight is planned again on the way."""

_COUNT = 300


def _position(text: str, alternatives: str = "") -> tuple[float, float, float]:
    from fvs_engine.geometry.validation import MAX_POSITION

    expected = f"{alternatives}X,Y,Z"
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} is not {expected}") from error
    if not all(abs(part) <= MAX_POSITION for part in (x, y, z)):
        raise typer.BadParameter(f"{text!r} is not {expected}, finite and at most {MAX_POSITION:g}")
    return x, y, z


def _aim(text: str | None, *, level: bool) -> "Aim":
    from fvs_engine.plan.generate import Aim

    if text is None or text == "middle":
        return Aim("middle", level)
    if text == "nearest":
        return Aim("nearest", level)
    return Aim(_position(text, "middle, nearest or "), level)


def plan(
    *,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The output folder of `fvs reconstruct`.")],
    views: Annotated[
        int, typer.Option(min=1, max=MOST_VIEWS, metavar="N", help="Maximum number of photographs.")
    ] = 10,
    distance: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=1e9,
            metavar="D",
            help="Maximum distance that each vehicle flies, in units of the model.",
        ),
    ] = None,
    home: Annotated[
        bool, typer.Option("--home", help="Plan the way back to where each vehicle starts.")
    ] = False,
    vehicles: Annotated[
        int,
        typer.Option(
            min=1,
            max=MAX_VEHICLES,
            metavar="K",
            help="Number of vehicles; they start at the last photograph, unless each has a --start.",
        ),
    ] = 1,
    start: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Position of a vehicle in the model frame; may be repeated.",
            show_default=False,
        ),
    ] = None,
    candidates: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Poses in the model frame as JSON, or a transforms.json."),
    ] = None,
    targets: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Poses that the model must serve well, in the same format."),
    ] = None,
    volume: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="JSON: generate candidates in a volume: box, cylinder, prism, shell, corridor.",
        ),
    ] = None,
    count: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=2_000,
            metavar="N",
            help="Number of candidates to generate in the volume.",
            show_default=str(_COUNT),
        ),
    ] = None,
    aim: Annotated[
        str | None,
        typer.Option(
            metavar="WHERE",
            help="What candidates in a volume look at: the middle of the model, its nearest part, or a "
            "point: middle, nearest or X,Y,Z.",
            show_default="middle",
        ),
    ] = None,
    level: Annotated[
        bool, typer.Option("--level", help="Keep the camera of candidates in a volume level.")
    ] = False,
    safety: Annotated[
        float | None,
        typer.Option(
            min=0, max=1e9, metavar="D", help="Minimum distance from anything in the model, also on the way."
        ),
    ] = None,
    no_fly: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE", help="JSON: a volume to stay out of; may be repeated.", show_default=False
        ),
    ] = None,
    terrain: TerrainOption = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR2", help="Where the results go.", show_default="DIR/plan")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Plan which views to photograph next, in the order of a short flight, and say what each adds.

    Without --candidates it plans with the held-out views, and with poses halfway between neighbouring
    training views. Without --targets the model must serve all views and candidates. Nothing is rendered.
    """
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    if candidates is not None and volume is not None:
        raise typer.BadParameter("Give --candidates or --volume, not both.")
    if volume is None and (aim is not None or level):
        raise typer.BadParameter("--aim and --level need a --volume: other candidates have their directions.")
    if volume is None and count is not None:
        raise typer.BadParameter("--count needs a --volume: other candidates have their number.")
    aimed = _aim(aim, level=level)
    starts = [_position(text) for text in start or []]
    if len(starts) > MAX_VEHICLES or (starts and vehicles not in (1, len(starts))):
        raise typer.BadParameter(
            f"There are {len(starts)} --start for {vehicles} --vehicles: give one for each, at most "
            f"{MAX_VEHICLES}, or none."
        )
    free = volume is not None or safety is not None or bool(no_fly)

    def job(monitor: "Monitor") -> "tuple[PlanResult, Path]":
        from fvs_engine.pipeline.plan import Flight, plan_next_views
        from fvs_engine.plan.tours import Budget

        return plan_next_views(
            folder,
            Budget(views, distance, home),
            candidates_file=candidates,
            targets_file=targets,
            starts=starts,
            vehicles=vehicles,
            flight=Flight(safety or 0.0, tuple(no_fly or ()), volume, count or _COUNT, aimed)
            if free
            else None,
            terrain=terrain,
            out=out,
            monitor=monitor,
        )

    report.show_plan(*run_job(job, machine=as_json), machine=as_json)
