"""``fvs-client scenes``."""

from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from fvs_client.cli.quality import in_words
from fvs_client.cli.session import JsonOption, SceneArgument, find_scene, print_json, service
from fvs_client.models.scenes import (
    AutomaticWorld,
    CameraPrior,
    EnuWorld,
    LocalWorld,
    Origin,
    Policy,
    SceneData,
    Trigger,
    World,
)

scenes = typer.Typer(help="Make and show scenes: one per capture.", no_args_is_help=True)


@scenes.command("create")
def create(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="What to call it.")],
    origin: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="LAT LON ALT", help="Zero of the world: degrees, degrees, metres above the sea."
        ),
    ] = None,
    local: Annotated[bool, typer.Option("--local", help="The world is a frame of yours, in metres.")] = False,
    every: Annotated[
        int | None, typer.Option(min=1, metavar="K", help="Update the model after every K images by itself.")
    ] = None,
    first: Annotated[
        int,
        typer.Option(min=2, metavar="N", help="With --every: the first update waits for N images."),
    ] = Policy().first,
    focal_length: Annotated[
        tuple[float, int] | None,
        typer.Option(
            metavar="PX WIDTH",
            help="Focal length in px, in images so many px wide: of images whose EXIF does not tell.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make a scene and print its id."""
    if origin is not None and local:
        raise typer.BadParameter("A world has an origin on earth, or is local.")
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
        scene = client.scenes.create(name, world=world, camera=camera, policy=policy)
    if as_json:
        print_json(scene.model_dump(mode="json", by_alias=True))
    else:
        typer.echo(scene.id)


@scenes.command("list")
def list_all(context: typer.Context, as_json: JsonOption = False) -> None:
    """List the scenes, the oldest first."""
    with service(context, as_json=as_json) as client:
        found = list(client.scenes.list())
    if as_json:
        print_json([scene.model_dump(mode="json", by_alias=True) for scene in found])
        return
    table = Table(box=None, pad_edge=False)
    for heading in ("id", "name", "images", "model", "made"):
        table.add_column(heading, justify="right" if heading == "images" else "left", no_wrap=heading == "id")
    for scene in found:
        made = scene.created_at.strftime("%F %H:%M")
        table.add_row(
            scene.id, scene.name, str(scene.image_counts.received), scene.snapshot_id or "none yet", made
        )
    Console().print(table)


@scenes.command("show")
def show(context: typer.Context, scene: SceneArgument, as_json: JsonOption = False) -> None:
    """Show a scene: its counts, its model, and its place in the world."""
    with service(context, as_json=as_json) as client:
        found = find_scene(client, scene)
        snapshot = found.snapshots.latest()
    if as_json:
        print_json(found.model_dump(mode="json", by_alias=True))
        return
    counts = found.image_counts
    lines = {
        "scene": f"{found.id}  {found.name}",
        "images": f"{counts.received} received, {counts.accepted} accepted, {counts.rejected} not, "
        f"{counts.pending} not yet in the model",
        "world": _world(found),
        "model": "none yet",
    }
    if snapshot is not None:
        lines["model"] = f"{snapshot.id}  {snapshot.kind.value}, {in_words(snapshot.metrics)}"
        lines["files"] = ", ".join(artifact.name for artifact in snapshot.artifacts)
    for name, text in lines.items():
        typer.echo(f"{name:<8}{text}")


def _world(scene: SceneData) -> str:
    alignment = scene.alignment
    origin = scene.origin
    place = f"ENU about {origin.latitude_deg:.6f}, {origin.longitude_deg:.6f}; " if origin is not None else ""
    if alignment is None:
        return f"{place}{scene.world.kind}, no model to place yet"
    rms = (
        "" if alignment.rms_m is None else f", RMS {alignment.rms_m:.3f} m over {alignment.inliers} positions"
    )
    return f"{place}{alignment.status.value}{rms}"
