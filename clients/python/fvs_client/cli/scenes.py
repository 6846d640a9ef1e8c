"""``fvs-client scenes``."""

from typing import Annotated

import typer

from fvs_client.cli.options import JsonOption, SceneArgument, YesOption, within
from fvs_client.cli.output import describe_metrics, print_json, print_table
from fvs_client.cli.session import confirm, find_scene, require_free_name, service
from fvs_client.models.resources import world_text
from fvs_schema.scenes import (
    AutomaticWorld,
    CameraPrior,
    EnuWorld,
    LocalWorld,
    Origin,
    Policy,
    Trigger,
    World,
)

_ORIGIN_RANGES = ((-90, 90), (-180, 180), (-12_000, 100_000))
_FOCAL_RANGES = ((1e-3, 1e7), (32, 32_768))

scenes = typer.Typer(
    help="Create, list, show, change and delete scenes (one per capture).", no_args_is_help=True
)


@scenes.command("create")
def create(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="Name of the scene.")],
    origin: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="LAT LON ALT",
            help="Origin of the world: degrees, degrees, metres above sea level.",
            callback=within(*_ORIGIN_RANGES),
        ),
    ] = None,
    local: Annotated[
        bool, typer.Option("--local", help="The world is a frame of your own, in metres.")
    ] = False,
    every: Annotated[
        int | None,
        typer.Option(
            min=1, max=10_000, metavar="K", help="Update the model automatically after every K images."
        ),
    ] = None,
    first: Annotated[
        int,
        typer.Option(
            min=2, max=10_000, metavar="N", help="With --every: the first update waits for N images."
        ),
    ] = Policy().first,
    focal_length: Annotated[
        tuple[float, int] | None,
        typer.Option(
            metavar="PX WIDTH",
            callback=within(*_FOCAL_RANGES),
            help="Focal length in px at an image width in px, for images without one in their EXIF data.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Create a scene and print its id. Its name must be new: commands take it in place of the id."""
    if origin is not None and local:
        raise typer.BadParameter("Give --origin or --local, not both.")
    world: World = AutomaticWorld()
    if origin is not None:
        latitude, longitude, altitude = origin
        world = EnuWorld(origin=Origin(latitude_deg=latitude, longitude_deg=longitude, altitude_m=altitude))
    elif local:
        world = LocalWorld()
    policy = Policy() if every is None else Policy(trigger=Trigger.EVERY_K_IMAGES, k=every, first=first)
    camera = None
    if focal_length is not None:
        focal_px, width_px = focal_length
        camera = CameraPrior(focal_length_px=focal_px, width_px=width_px)
    with service(context, as_json=as_json) as client:
        require_free_name(client, name)
        scene = client.scenes.create(name, world=world, camera=camera, policy=policy)
    if as_json:
        print_json(scene.model_dump(mode="json", by_alias=True))
    else:
        typer.echo(scene.id)


@scenes.command("list")
def list_all(
    context: typer.Context,
    name: Annotated[str | None, typer.Option(help="Only scenes with this name.", show_default="all")] = None,
    search: Annotated[
        str | None,
        typer.Option(metavar="TEXT", help="Only those whose name contains it.", show_default="all"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the scenes, newest first."""
    with service(context, as_json=as_json) as client:
        found = list(client.scenes.list(name=name, search=search))
    if as_json:
        print_json([scene.model_dump(mode="json", by_alias=True) for scene in found])
        return
    print_table(
        ("id", "name", "images", "model", "job", "created"),
        [
            (
                scene.id,
                scene.name,
                str(scene.image_counts.received),
                scene.snapshot_id or "none yet",
                "" if scene.job is None else f"{scene.job.kind.value} {scene.job.state.value}",
                scene.created_at.strftime("%F %H:%M"),
            )
            for scene in found
        ],
        right_aligned=("images",),
    )


@scenes.command("show")
def show(context: typer.Context, scene: SceneArgument, as_json: JsonOption = False) -> None:
    """Show a scene: its image counts, world and model."""
    with service(context, as_json=as_json) as client:
        found = find_scene(client, scene)
        snapshot, size = found.snapshots.latest(), found.size()
    if as_json:
        print_json(found.model_dump(mode="json", by_alias=True))
        return
    counts = found.image_counts
    lines = {
        "scene": f"{found.id}  {found.name}",
        "images": f"{counts.received} received, {counts.accepted} accepted, {counts.rejected} rejected, "
        f"{counts.pending} pending",
        "world": world_text(found),
        "model": "none yet",
    }
    if snapshot is not None:
        lines["model"] = f"{snapshot.id}  {snapshot.kind.value}, {describe_metrics(snapshot.metrics)}"
        lines["files"] = ", ".join(artifact.name for artifact in snapshot.artifacts)
    lines["size"] = (
        f"{_megabytes(size.total_bytes)}: images {_megabytes(size.images_bytes)}, "
        f"artifacts {_megabytes(size.artifacts_bytes)}, working files {_megabytes(size.working_bytes)}"
    )
    for name, text in lines.items():
        typer.echo(f"{name:<8}{text}")


@scenes.command("change")
def change(
    context: typer.Context,
    scene: SceneArgument,
    name: Annotated[str | None, typer.Option(help="New name.", show_default="unchanged")] = None,
    every: Annotated[
        int | None,
        typer.Option(
            min=0, max=10_000, metavar="K", help="Update after every K images; 0 updates on request only."
        ),
    ] = None,
    snapshots: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=100_000,
            metavar="N",
            help="Keep the newest N snapshots; 0 keeps as many as the service's setting says.",
        ),
    ] = None,
    days: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=36_500,
            metavar="D",
            help="Keep snapshots for D days; 0 keeps them as long as the service's setting says.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Rename a scene, or change when it is updated and how many snapshots it keeps."""
    if name is None and every is None and snapshots is None and days is None:
        raise typer.BadParameter("Give --name, --every, --snapshots or --days.")
    with service(context, as_json=as_json) as client:
        found = find_scene(client, scene)
        if name is not None and name != found.name:
            require_free_name(client, name)
        policy = retention = None
        if every is not None:
            trigger = Trigger.EVERY_K_IMAGES if every else Trigger.ON_REQUEST
            policy = found.policy.model_copy(update={"trigger": trigger, "k": every or found.policy.k})
        if snapshots is not None or days is not None:
            given = {"snapshots": snapshots, "snapshot_days": days}
            numbers = {key: value or None for key, value in given.items() if value is not None}
            retention = found.retention.model_copy(update=numbers)
        changed = found.change(name=name, policy=policy, retention=retention)
    if as_json:
        print_json(changed.model_dump(mode="json", by_alias=True))
    else:
        typer.echo(f"{changed.id}  {changed.name}")


@scenes.command("delete")
def delete(context: typer.Context, scene: SceneArgument, yes: YesOption = False) -> None:
    """Permanently delete a scene with its images, jobs, snapshots and rankings; running jobs stop."""
    with service(context, as_json=False) as client:
        found = find_scene(client, scene)
        images = found.image_counts.received
        confirm(f"Permanently delete the scene {found.id} ({found.name}) with {images} images?", yes=yes)
        found.delete()
    typer.echo(f"{found.id} deleted")


def _megabytes(size_bytes: int) -> str:
    return f"{size_bytes / 1e6:.1f} MB"
