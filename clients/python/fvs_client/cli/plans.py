"""``fvs-client plan``."""

from pathlib import Path
from typing import Annotated

import typer

from fvs_client import Plan
from fvs_client.cli.ground import GroundOption, ground_of
from fvs_client.cli.options import (
    AimOption,
    AnswerTimeoutOption,
    CandidatesOption,
    ForVehicleOption,
    JsonOption,
    LevelOption,
    NoFlyOption,
    SceneArgument,
    SnapshotOption,
    VolumeOption,
    YesOption,
)
from fvs_client.cli.output import print_json, print_table
from fvs_client.cli.poses import (
    GENERATOR,
    FrameOption,
    PlanGenerator,
    generator_asked,
    read_candidates,
    read_pose,
    read_volume,
)
from fvs_client.cli.session import confirm, find_scene, service
from fvs_client.models.plans import plan_table

plans = typer.Typer(help="List, show and delete plans.", no_args_is_help=True)

_PlanArgument = Annotated[str, typer.Argument(metavar="PLAN", help="A plan's id.")]


def plan(
    context: typer.Context,
    scene: SceneArgument,
    candidates: CandidatesOption = None,
    generator: Annotated[PlanGenerator | None, GENERATOR] = None,
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
    terrain: GroundOption = None,
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
    frame: FrameOption = None,
    snapshot: SnapshotOption = None,
    timeout: AnswerTimeoutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Plan which views to photograph next, in the order of a short flight, and say what each adds."""
    wanted = generator_asked(candidates, generator, count, volume, aim, level=level)
    listed, served = read_candidates(candidates), read_candidates(targets)
    vehicles = [read_pose(path) for path in vehicle] if vehicle else None
    with service(context, as_json=as_json) as client:
        found = find_scene(client, scene)
        made = found.plan(
            listed,
            generator=wanted,
            targets=served,
            views=views,
            distance_m=distance,
            home=home,
            safety_m=safety,
            no_fly=[read_volume(path) for path in no_fly] if no_fly else None,
            terrain=ground_of(terrain, found, listed or ()),
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


@plans.command("list")
def list_all(context: typer.Context, scene: SceneArgument, as_json: JsonOption = False) -> None:
    """List the plans of a scene, newest first."""
    with service(context, as_json=as_json) as client:
        found = list(find_scene(client, scene).plans.list())
    if as_json:
        print_json([item.model_dump(mode="json") for item in found])
        return
    print_table(
        ("id", "plan", "snapshot", "created"),
        [(item.id, item.summary, item.snapshot_id, item.created_at.strftime("%F %H:%M")) for item in found],
    )


@plans.command("show")
def show(context: typer.Context, plan: _PlanArgument, as_json: JsonOption = False) -> None:
    """Show a plan."""
    with service(context, as_json=as_json) as client:
        found = client.plans.get(plan)
    if as_json:
        print_json(found.model_dump(mode="json"))
    else:
        _print(found)


@plans.command("delete")
def delete(context: typer.Context, plan: _PlanArgument, yes: YesOption = False) -> None:
    """Delete a plan."""
    with service(context, as_json=False) as client:
        found = client.plans.get(plan)
        confirm(f"Permanently delete the plan {found.id}?", yes=yes)
        found.delete()
    typer.echo(f"{found.id} deleted")


def _print(made: Plan) -> None:
    table = plan_table(made)
    print_table(table.headings, table.rows, right_aligned=table.right_aligned)
    typer.echo(f"{made.summary} {made.id} on {made.snapshot_id}.")
    for warning in made.warnings:
        typer.echo(f"Warning: {warning.message} {warning.hint}", err=True)
