"""``fvs-client images`` and ``upload``."""

from pathlib import Path
from typing import Annotated

import typer

from fvs_client.cli.exit_codes import SOME_FILES
from fvs_client.cli.options import JsonOption, SceneArgument
from fvs_client.cli.output import print_json, print_table
from fvs_client.cli.progress import describe_outcome, display, upload_progress
from fvs_client.cli.session import find_scene, service
from fvs_client.image_files import SUFFIXES, find_image_files
from fvs_client.models.images import Image, Registration
from fvs_client.uploads import UploadedFile, UploadProgress, UploadReport


def images(
    context: typer.Context,
    scene: SceneArgument,
    problems: Annotated[
        bool, typer.Option("--problems", help="Only images that are not registered or have warnings.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List the images of a scene in order of arrival, with verdict and registration."""
    with service(context, as_json=as_json, patient=True) as client:
        found = [
            image
            for image in find_scene(client, scene).images.list()
            if not problems or image.registration is not Registration.REGISTERED or image.warnings
        ]
    if as_json:
        print_json([image.model_dump(mode="json") for image in found])
        return
    print_table(
        ("no.", "name", "verdict", "registration", "size", "remarks"),
        [
            (
                str(image.number),
                image.name,
                image.verdict.value,
                image.registration.value,
                "" if image.width_px is None else f"{image.width_px}×{image.height_px}",
                _remarks(image),
            )
            for image in found
        ],
        right_aligned=("no.",),
    )


def upload(
    context: typer.Context,
    scene: SceneArgument,
    paths: Annotated[list[Path], typer.Argument(metavar="PATH...", exists=True, help="Folders and files.")],
    parallel: Annotated[int, typer.Option(min=1, max=64, help="Number of files sent at a time.")] = 8,
    as_json: JsonOption = False,
) -> None:
    """Upload images. Those that the scene has are not sent again, so repeating the command resumes it."""
    if not any(file.readable for file in find_image_files(paths)):
        where = ", ".join(map(str, paths))
        raise typer.BadParameter(f"There is no image in {where}: no file in {', '.join(sorted(SUFFIXES))}.")
    reported: list[UploadedFile] = []
    with service(context, as_json=as_json, patient=True) as client:
        # An API key that may only upload cannot look up the scene; its id is enough.
        images = client.scenes.images(scene) if scene.startswith("scn_") else find_scene(client, scene).images
        with display("Uploading images", as_json=as_json, in_bytes=True) as shown:

            def on_progress(progress: UploadProgress) -> None:
                upload_progress(shown, progress)
                last = progress.last
                if last is not None and not last.usable and last not in reported:
                    reported.append(last)
                    shown.print(f"{last.path}: {describe_outcome(last)}")

            report = images.upload(paths, parallel=parallel, on_progress=on_progress)
    if as_json:
        print_json(_document(report))
    else:
        for file in report.files:
            if file not in reported and not file.usable:
                typer.echo(f"{file.path}: {describe_outcome(file)}", err=True)
        typer.echo(_summary(report))
    if not report.ok:
        raise typer.Exit(SOME_FILES)


def _remarks(image: Image) -> str:
    return " ".join(part for part in (image.reason, image.hint, ", ".join(image.warnings)) if part)


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
                "reason": "" if file.usable else describe_outcome(file),
                "warnings": [] if file.image is None else list(file.image.warnings),
            }
            for file in report.files
        ],
    }
