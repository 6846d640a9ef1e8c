"""``fvs-client images``, ``upload``, ``originals``, ``exclude``, ``include`` and ``delete-images``."""

from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from fvs_client.cli.exit_codes import SOME_FILES
from fvs_client.cli.options import JsonOption, SceneArgument, YesOption
from fvs_client.cli.output import print_json, print_table
from fvs_client.cli.progress import describe_outcome, display, download_progress, upload_progress
from fvs_client.cli.session import confirm, find_scene, service
from fvs_client.errors import NotFoundError
from fvs_client.image_files import SUFFIXES, find_image_files
from fvs_client.uploads import UploadProgress, UploadReport
from fvs_schema.images import Image, ImageMetadata, Registration, Verdict
from fvs_schema.videos import is_video

ImageArguments = Annotated[
    list[str], typer.Argument(metavar="IMAGE", help="Names, numbers or digests of images.")
]


def images(
    context: typer.Context,
    scene: SceneArgument,
    problems: Annotated[
        bool, typer.Option("--problems", help="List only images that are not registered or have warnings.")
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
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="PATH", exists=True, help="Images and videos, and folders of them."),
    ],
    every: Annotated[
        float | None,
        typer.Option(min=0.02, max=3600.0, metavar="S", help="Spacing of videos' frames.", show_default="1"),
    ] = None,
    parallel: Annotated[int, typer.Option(min=1, max=64, help="Number of files sent at a time.")] = 8,
    as_json: JsonOption = False,
) -> None:
    """Upload images. Those that the scene has are not sent again, so repeating the command resumes it.

    A job of the service makes images from the frames of a video (`fvs-client jobs`). VIDEO.SRT beside it, the
    subtitles of a drone, tells where they were taken.
    """
    if not any(file.sent for file in find_image_files(paths)):
        where = ", ".join(map(str, paths))
        raise typer.BadParameter(f"There is no image in {where}: no file in {', '.join(sorted(SUFFIXES))}.")
    reported: set[Path] = set()
    with service(context, as_json=as_json, patient=True) as client:
        # An API key that may only upload cannot look up the scene; its id is enough.
        images = client.scenes.images(scene) if scene.startswith("scn_") else find_scene(client, scene).images
        with display("Uploading images", as_json=as_json, in_bytes=True) as shown:

            def on_progress(progress: UploadProgress) -> None:
                upload_progress(shown, progress)
                last = progress.last
                if last is not None and not last.ok and last.path not in reported:
                    reported.add(last.path)
                    shown.print(f"{last.path}: {describe_outcome(last)}")

            def describe(path: Path) -> ImageMetadata | None:
                return ImageMetadata(every_s=every) if is_video(path.name) else None

            report = images.upload(paths, parallel=parallel, on_progress=on_progress, describe=describe)
    if as_json:
        print_json(_document(report))
    else:
        for file in report.files:
            if file.path not in reported and not file.ok:
                typer.echo(f"{file.path}: {describe_outcome(file)}", err=True)
        typer.echo(_summary(report))
    if not report.ok:
        raise typer.Exit(SOME_FILES)


def originals(
    context: typer.Context,
    scene: SceneArgument,
    images: Annotated[
        list[str] | None,
        typer.Argument(metavar="IMAGE", help="Names, numbers or digests.", show_default="all"),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder to write to.")] = Path(),
    as_json: JsonOption = False,
) -> None:
    """Download accepted images as they were sent, by default all. Interrupted downloads resume."""
    with service(context, as_json=as_json, patient=True) as client:
        found = find_scene(client, scene).images
        out.mkdir(parents=True, exist_ok=True)
        listed = list(found.list())
        chosen = _named(listed, images) if images else [image for image in listed if image.accepted]
        counts = Counter(image.name for image in chosen)
        files = []
        for image in chosen:
            unique = counts[image.name] == 1
            target = out / (image.name if unique else f"{image.number:06d}-{image.name}")
            with display("Downloading", as_json=as_json, in_bytes=True) as shown:
                files.append(found.download(image, target, on_progress=partial(download_progress, shown)))
    if as_json:
        print_json({"files": [str(file) for file in files]})
    else:
        for file in files:
            typer.echo(file)


def exclude(context: typer.Context, scene: SceneArgument, images: ImageArguments) -> None:
    """Leave images out of models, from the next update on; the service keeps them."""
    with service(context, as_json=False) as client:
        found = find_scene(client, scene).images
        for image in _named(list(found.list()), images):
            typer.echo(f"{found.exclude(image.digest).name} excluded")


def include(context: typer.Context, scene: SceneArgument, images: ImageArguments) -> None:
    """Use excluded or quarantined images again, in the next update."""
    with service(context, as_json=False) as client:
        found = find_scene(client, scene).images
        for image in _named(list(found.list()), images):
            typer.echo(f"{image.name} {found.include(image.digest).registration.value}")


def delete(
    context: typer.Context, scene: SceneArgument, images: ImageArguments, yes: YesOption = False
) -> None:
    """Permanently delete images; the next update makes a model without them."""
    with service(context, as_json=False) as client:
        found = find_scene(client, scene).images
        chosen = _named(list(found.list()), images)
        confirm(f"Permanently delete {', '.join(image.name for image in chosen)}?", yes=yes)
        for image in chosen:
            with suppress(NotFoundError):  # a duplicate that went with its image
                found.delete(image.digest)
            typer.echo(f"{image.name} deleted")


def _named(listed: list[Image], wanted: list[str]) -> list[Image]:
    """The images with these names, numbers or digests."""
    chosen = {}
    for text in wanted:
        found = [image for image in listed if text in (image.name, image.digest, str(image.number))]
        if len(found) > 1:
            numbers = ", ".join(str(image.number) for image in found)
            raise typer.BadParameter(f"{len(found)} images are called {text}: give a number ({numbers}).")
        if not found:
            raise typer.BadParameter(f"The scene has no image {text}; `fvs-client images` lists them.")
        chosen[found[0].digest] = found[0]
    return list(chosen.values())


def _remarks(image: Image) -> str:
    notes = [*image.warnings, *(() if image.mask is None else ("masked",))]
    if image.verdict is Verdict.VIDEO:
        notes.append("its frames are to come" if image.frames is None else f"frames: {image.frames}")
    return " ".join(part for part in (image.reason, image.hint, ", ".join(notes)) if part)


def _summary(report: UploadReport) -> str:
    parts = [f"{len(report.sent)} sent ({report.bytes_sent / 1e6:,.1f} MB)"]
    videos = sum(file.image is not None and file.image.verdict is Verdict.VIDEO for file in report.sent)
    if videos:
        parts.append(f"{videos} of them videos: `fvs-client jobs list` shows when their frames are images")
    if report.already_there:
        parts.append(f"{len(report.already_there)} there already")
    if report.rejected:
        parts.append(f"{len(report.rejected)} cannot be used")
    if report.without_mask:
        parts.append(f"{len(report.without_mask)} without their mask")
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
                "reason": "" if file.ok else describe_outcome(file),
                "warnings": [] if file.image is None else list(file.image.warnings),
            }
            for file in report.files
        ],
    }
