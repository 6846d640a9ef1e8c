"""``fvs-client plan``."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

import typer

from fvs_client import Expectation, Plan, Tour
from fvs_client.cli.options import (
    AimOption,
    ForVehicleOption,
    JsonOption,
    LevelOption,
    NoFlyOption,
    SceneArgument,
    VolumeOption,
)
from fvs_client.cli.output import print_json, print_table, with_unit
from fvs_client.cli.poses import (
    FrameName,
    GeneratorName,
    generator_asked,
    pose_text,
    read_candidates,
    read_pose,
    read_volume,
)
from fvs_client.cli.session import find_scene, service


def plan(
    context: typer.Context,
    scene: SceneArgument,
    candidates: Annotated[
        Path | None,
        typer.Option(exists=True, dir_okay=False, metavar="FILE", help='JSON: [{"id": …, "pose": {…}}, …].'),
    ] = None,
    generator: Annotated[
        GeneratorName | None, typer.Option(help="Generator of candidates.", show_default="orbit")
    ] = None,
    count: Annotated[
        int | None,
        typer.Option(min=1, max=2_000, help="Number of candidates for orbit and --volume."),
    ] = None,
    volume: VolumeOption = None,
    aim: AimOption = None,
    level: LevelOption = False,
    safety: Annotated[
        float | None,
        typer.Option(
            min=0, max=2e7, metavar="M", help="Minimum distance from anything in the model, also on the way."
        ),
    ] = None,
    no_fly: NoFlyOption = None,
    targets: Annotated[
        Path | None,
        typer.Option(
            exists=True, dir_okay=False, metavar="FILE", help="JSON: poses that the model must serve well."
        ),
    ] = None,
    views: Annotated[int, typer.Option(min=1, max=100, metavar="N", help="Number of photographs.")] = 10,
    distance: Annotated[
        float | None,
        typer.Option(min=0, max=2e7, metavar="M", help="Maximum distance that each vehicle flies."),
    ] = None,
    home: Annotated[
        bool, typer.Option("--home", help="Plan the way back to where each vehicle is now.")
    ] = False,
    vehicle: Annotated[
        list[Path] | None,
        typer.Option(
            exists=True,
            dir_okay=False,
            metavar="FILE",
            help="JSON: the pose of a vehicle; may be repeated.",
            show_default="the last image",
        ),
    ] = None,
    for_vehicle: ForVehicleOption = None,
    frame: Annotated[
        FrameName | None,
        typer.Option(
            help="Frame of the poses in the result.", show_default="as asked; geodetic if georeferenced"
        ),
    ] = None,
    snapshot: Annotated[
        str | None, typer.Option(metavar="ID", help="Snapshot to plan for.", show_default="the latest")
    ] = None,
    timeout: Annotated[
        float | None,
        typer.Option(min=0, max=31_536_000, metavar="S", help="Wait at most S seconds.", show_default="180"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Plan which views to photograph next, in the order of a short flight, and say what each adds."""
    wanted = generator_asked(candidates, generator, count, volume, aim, level=level)
    listed, served = read_candidates(candidates), read_candidates(targets)
    vehicles = [read_pose(path) for path in vehicle] if vehicle else None
    with service(context, as_json=as_json) as client:
        made = find_scene(client, scene).plan(
            listed,
            generator=wanted,
            targets=served,
            views=views,
            distance_m=distance,
            home=home,
            safety_m=safety,
            no_fly=[read_volume(path) for path in no_fly] if no_fly else None,
            vehicles=vehicles,
            for_vehicle=for_vehicle,
            frame=None if frame is None else frame.value,
            snapshot_id=snapshot,
            timeout_s=timeout,
        )
    if as_json:
        print_json(made.model_dump(mode="json"))
    else:
        _print(made)


def _print(made: Plan) -> None:
    chances = {terms.id: terms.chance for terms in made.candidates}
    distance, travel = (with_unit(what, made.alignment) for what in ("distance", "travel"))
    print_table(
        ("vehicle", "stop", "id", distance, travel, "registered", "expected", "pose"),
        [row for tour in made.tours for row in _rows(tour, chances)],
        right_aligned=("vehicle", "stop", distance, travel, "registered", "expected"),
    )
    typer.echo(f"{made.summary} On {made.snapshot_id}.")
    for warning in made.warnings:
        typer.echo(f"Warning: {warning.message} {warning.hint}", err=True)


def _rows(tour: Tour, chances: Mapping[str, float | None]) -> Iterator[tuple[str, ...]]:
    """A row for each stop of a tour, after one for each way point that leads there."""
    vehicle = str(tour.vehicle)
    for number, stop in enumerate(tour.stops, start=1):
        yield from ((vehicle, "", "via", "", "", "", "", pose_text(pose)) for pose in stop.via)
        yield (
            vehicle,
            str(number),
            stop.id,
            f"{stop.distance_m:.2f}",
            f"{stop.travel_m:.2f}",
            "" if (chance := chances.get(stop.id)) is None else f"{chance:.0%}",
            _expected(stop.after),
            pose_text(stop.pose),
        )
    yield from ((vehicle, "", "via, home", "", "", "", "", pose_text(pose)) for pose in tour.via_home)


def _expected(expectation: Expectation) -> str:
    if expectation.psnr_db is None:
        return f"variance {expectation.variance:.3f}"
    return f"{expectation.psnr_db:.1f} dB"
