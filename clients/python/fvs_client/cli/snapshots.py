"""``fvs-client download`` and ``fvs-client snapshots``."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from fvs_client import Client, Snapshot
from fvs_client.cli.options import JsonOption, SceneArgument, SnapshotArgument, YesOption
from fvs_client.cli.output import print_json, print_table
from fvs_client.cli.progress import display, download_progress
from fvs_client.cli.session import confirm, find_scene, service

snapshots = typer.Typer(help="List, pin and delete snapshots.", no_args_is_help=True)


def download(
    context: typer.Context,
    what: Annotated[
        str, typer.Argument(metavar="SCENE|SNAPSHOT", help="A scene (its latest snapshot), or a snapshot.")
    ],
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME", help="Artifacts to download.", show_default="all"),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder to write to.")] = Path(),
    as_json: JsonOption = False,
) -> None:
    """Download the artifacts of a snapshot. Interrupted downloads resume."""
    with service(context, as_json=as_json, patient=True) as client:
        snapshot = _snapshot(client, what)
        out.mkdir(parents=True, exist_ok=True)
        paths = []
        for name in names or [artifact.name for artifact in snapshot.artifacts]:
            with display("Downloading", as_json=as_json, in_bytes=True) as shown:
                progress = partial(download_progress, shown)
                paths.append(snapshot.download(name, out / name, on_progress=progress))
    if as_json:
        print_json({"snapshot_id": snapshot.id, "files": [str(path) for path in paths]})
    else:
        for path in paths:
            typer.echo(path)


@snapshots.command("list")
def list_all(context: typer.Context, scene: SceneArgument, as_json: JsonOption = False) -> None:
    """List the snapshots of a scene, newest first."""
    with service(context, as_json=as_json) as client:
        found = find_scene(client, scene)
        listed = list(found.snapshots.list())
    if as_json:
        print_json([item.model_dump(mode="json") for item in listed])
        return
    print_table(
        ("id", "kind", "images", "Gaussians", "created", ""),
        [
            (
                item.id,
                item.kind.value,
                str(item.metrics.registered),
                f"{item.metrics.gaussians:,}",
                item.created_at.strftime("%F %H:%M"),
                " ".join(["current"] * (item.id == found.snapshot_id) + ["pinned"] * item.pinned),
            )
            for item in listed
        ],
        right_aligned=("images", "Gaussians"),
    )


@snapshots.command("pin")
def pin(context: typer.Context, snapshot: SnapshotArgument) -> None:
    """Pin a snapshot, so that the scene's retention never deletes it."""
    with service(context, as_json=False) as client:
        typer.echo(f"{client.snapshots.get(snapshot).pin().id} pinned")


@snapshots.command("unpin")
def unpin(context: typer.Context, snapshot: SnapshotArgument) -> None:
    """Unpin a snapshot, so that the scene's retention may delete it."""
    with service(context, as_json=False) as client:
        typer.echo(f"{client.snapshots.get(snapshot).unpin().id} unpinned")


@snapshots.command("delete")
def delete(context: typer.Context, snapshot: SnapshotArgument, yes: YesOption = False) -> None:
    """Delete a snapshot that is neither its scene's current one nor pinned."""
    with service(context, as_json=False) as client:
        found = client.snapshots.get(snapshot)
        confirm(f"Permanently delete the snapshot {found.id}?", yes=yes)
        found.delete()
    typer.echo(f"{found.id} deleted")


def _snapshot(client: Client, what: str) -> Snapshot:
    if what.startswith("snp_"):
        return client.snapshots.get(what)
    scene = find_scene(client, what)
    snapshot = scene.snapshots.latest()
    if snapshot is None:
        raise typer.BadParameter(f"{scene.name} has no model yet; `fvs-client update {scene.id}` makes one.")
    return snapshot
