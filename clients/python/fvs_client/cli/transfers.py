"""``fvs-client upload`` and ``download``."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from fvs_client import Client, Snapshot
from fvs_client.cli.exit_codes import SOME_FILES
from fvs_client.cli.progress import display, download_progress, upload_progress, verdict_of
from fvs_client.cli.session import JsonOption, SceneArgument, find_scene, print_json, service
from fvs_client.image_files import SUFFIXES, find_image_files
from fvs_client.uploads import UploadedFile, UploadProgress, UploadReport


def upload(
    context: typer.Context,
    scene: SceneArgument,
    paths: Annotated[list[Path], typer.Argument(metavar="PATH...", exists=True, help="Folders and files.")],
    parallel: Annotated[int, typer.Option(min=1, max=64, help="So many at the same time.")] = 8,
    as_json: JsonOption = False,
) -> None:
    """Send photographs. What the scene has already is not sent again, so the same command goes on."""
    if not any(photograph.readable for photograph in find_image_files(paths)):
        where = ", ".join(map(str, paths))
        raise typer.BadParameter(
            f"There is no photograph in {where}: no file in {', '.join(sorted(SUFFIXES))}."
        )
    with service(context, as_json=as_json, patient=True) as client:
        # A device's key may only send: with the scene's id there is nothing to look up.
        images = client.scenes.images(scene) if scene.startswith("scn_") else find_scene(client, scene).images
        with display("Sending photographs", as_json=as_json, in_bytes=True) as shown:

            def on_progress(progress: UploadProgress) -> None:
                upload_progress(shown, progress)
                last = progress.last
                if last is not None and not _fine(last) and last not in told:
                    told.append(last)
                    shown.say(f"{last.path}: {verdict_of(last)}")

            told: list[UploadedFile] = []
            report = images.upload(paths, parallel=parallel, on_progress=on_progress)
    if as_json:
        print_json(_document(report))
    else:
        for file in report.files:
            if file not in told and not _fine(file):
                typer.echo(f"{file.path}: {verdict_of(file)}", err=True)
        typer.echo(_summary(report))
    if not report.ok:
        raise typer.Exit(SOME_FILES)


def download(
    context: typer.Context,
    what: Annotated[
        str, typer.Argument(metavar="SCENE|SNAPSHOT", help="A scene (its newest model), or a snapshot.")
    ],
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Which files.", show_default="all")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where they go.")] = Path(),
    as_json: JsonOption = False,
) -> None:
    """Download a model's files. What was broken off goes on where it ended."""
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


def _fine(file: UploadedFile) -> bool:
    return file.error is None and (file.image is None or file.image.accepted)


def _summary(report: UploadReport) -> str:
    parts = [f"{len(report.sent)} sent ({report.bytes_sent / 1e6:,.1f} MB)"]
    if report.already_there:
        parts.append(f"{len(report.already_there)} there already")
    if report.rejected:
        parts.append(f"{len(report.rejected)} cannot be used")
    if report.failed:
        parts.append(f"{len(report.failed)} failed")
    return ", ".join(parts)


def _document(report: UploadReport) -> dict[str, object]:
    return {
        "bytes_sent": report.bytes_sent,
        "files": [
            {
                "path": str(file.path),
                "outcome": file.outcome.value,
                "digest": file.digest,
                "verdict": None if file.image is None else file.image.verdict.value,
                "reason": verdict_of(file) if not _fine(file) else "",
                "warnings": [] if file.image is None else list(file.image.warnings),
            }
            for file in report.files
        ],
    }
