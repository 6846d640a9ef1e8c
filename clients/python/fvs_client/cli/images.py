"""``fvs-client images``."""

from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from fvs_client.cli.session import JsonOption, SceneArgument, find_scene, print_json, service
from fvs_client.models.images import Image


def images(
    context: typer.Context,
    scene: SceneArgument,
    problems: Annotated[
        bool, typer.Option("--problems", help="Only those that are not in the model, or are doubtful.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List the images of a scene as they arrived, with their verdicts and whether they found their place."""
    with service(context, as_json=as_json, patient=True) as client:
        found = [
            image
            for image in find_scene(client, scene).images.list()
            if not problems or image.registration != "registered" or image.warnings
        ]
    if as_json:
        print_json([image.model_dump(mode="json") for image in found])
        return
    table = Table(box=None, pad_edge=False)
    for heading in ("no.", "name", "verdict", "in the model", "size", "remarks"):
        table.add_column(heading, justify="right" if heading == "no." else "left")
    for image in found:
        size = "" if image.width_px is None else f"{image.width_px}×{image.height_px}"
        table.add_row(
            str(image.number),
            image.name,
            image.verdict.value,
            image.registration.value,
            size,
            _remarks(image),
        )
    Console().print(table)


def _remarks(image: Image) -> str:
    return " ".join(part for part in (image.reason, image.hint, ", ".join(image.warnings)) if part)
