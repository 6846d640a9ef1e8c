"""The command ``fvs simulate``: photographs of a synthetic scene."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fvs_engine.choices import LookAlike
from fvs_engine.cli.options import MAX_SEED, JsonOption

if TYPE_CHECKING:
    from fvs_engine.monitor import Monitor


def simulate(
    out: Annotated[Path, typer.Argument(metavar="DIR", help="Where the photographs go.")],
    images: Annotated[int, typer.Option(min=1, max=10_000, metavar="N", help="Number of photographs.")] = 24,
    size: Annotated[str, typer.Option(metavar="WxH", help="Size of the photographs in px.")] = "640x480",
    radius: Annotated[
        float | None,
        typer.Option(min=2.5, max=3.7, metavar="M", help="Radius of the orbit in m.", show_default="3"),
    ] = None,
    turns: Annotated[
        float | None, typer.Option(min=0.01, max=20.0, help="Turns of the orbit.", show_default="1")
    ] = None,
    from_above: Annotated[
        bool, typer.Option("--survey", help="Photograph houses from above, in rows, instead.")
    ] = False,
    look_alike: Annotated[
        LookAlike | None,
        typer.Option(
            metavar="WALLS",
            help="Walls that look alike: all four, two opposite ones, or rows of one window.",
            show_default="none",
        ),
    ] = None,
    outwards: Annotated[
        bool, typer.Option("--outwards", help="Look from the middle at the walls, not across the courtyard.")
    ] = False,
    exposure: Annotated[
        float, typer.Option(min=-20.0, max=20.0, metavar="EV", help="Exposure; +1 is twice as bright.")
    ] = 0.0,
    noise: Annotated[
        float, typer.Option(min=0.0, max=10.0, help="Sensor noise; 1 is a small drone's.")
    ] = 1.0,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the scene.")] = 0,
    as_json: JsonOption = False,
) -> None:
    """Photograph a synthetic courtyard from an orbit: DIR/images, true poses in DIR/transforms.json.

    With --survey, a settlement from 30 m above, in parallel rows. With --look-alike, a courtyard whose walls
    are mistaken for one another.
    """
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    shape = re.fullmatch(r"([1-9]\d{1,3})x([1-9]\d{1,3})", size)
    if shape is None:
        raise typer.BadParameter(
            f"{size!r} is not a size in px; write for example 640x480, with two to four digits each.",
            param_hint="--size",
        )

    if from_above and (radius is not None or turns is not None or look_alike is not None or outwards):
        raise typer.BadParameter(
            "A survey has no orbit: leave out --radius, --turns, --look-alike and --outwards.",
            param_hint="--survey",
        )
    if outwards and radius is not None:
        raise typer.BadParameter("The radius is of the orbit: leave it out.", param_hint="--outwards")

    def job(monitor: "Monitor") -> tuple[Path, ...]:
        from fvs_engine.lab.simulate import SimulatedCamera, write_photographs
        from fvs_engine.lab.simulate.facades import lookalike_courtyard
        from fvs_engine.lab.simulate.tours import look_around, orbit, survey
        from fvs_engine.lab.simulate.world import courtyard, settlement

        width, height = int(shape[1]), int(shape[2])
        camera = SimulatedCamera.like_a_drone(width, height, exposure_ev=exposure, noise=noise)
        if from_above:
            world, poses = settlement(seed), survey(images, seed=seed)
        else:
            world = courtyard(seed) if look_alike is None else lookalike_courtyard(look_alike, seed)
            if outwards:
                poses = look_around(images, turns=turns or 1.0)
            else:
                poses = orbit(images, radius or 3.0, turns=turns or 1.0)
        return tuple(write_photographs(out, world, camera, poses, monitor, seed=seed))

    report.show_files(run_job(job, machine=as_json), machine=as_json)
