"""``fvs-client download``."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from fvs_client import Client, Snapshot
from fvs_client.cli.options import JsonOption
from fvs_client.cli.output import print_json
from fvs_client.cli.progress import display, download_progress
from fvs_client.cli.session import find_scene, service


def download(
    context: typer.Context,
    what: Annotated[
        str, typer.Argument(metavar="SCENE|SNAPSHOT", help="A scene (its latest snapshot), or a snapshot.")
    ],
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="Artifacts to download.", show_default="all"),
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


def _snapshot(client: Client, what: str) -> Snapshot:
    if what.startswith("snp_"):
        return client.snapshots.get(what)
    scene = find_scene(client, what)
    snapshot = scene.snapshots.latest()
    if snapshot is None:
        raise typer.BadParameter(f"{scene.name} has no model yet; `fvs-client update {scene.id}` makes one.")
    return snapshot
