"""``fvs-client control-points``."""

from pathlib import Path
from typing import Annotated

import typer

from fvs_client.cli.options import JsonOption, SceneArgument
from fvs_client.cli.output import print_json
from fvs_client.cli.session import find_scene, service
from fvs_schema.control_points import ControlPoints
from fvs_schema.gcp_list import GcpListError, read_gcp_list
from fvs_schema.text_files import decoded_text


def control_points(
    context: typer.Context,
    scene: SceneArgument,
    gcp: Annotated[
        Path,
        typer.Option(
            exists=True,
            dir_okay=False,
            metavar="FILE",
            help="Marks of surveyed points, a gcp_list.txt as OpenDroneMap reads it.",
        ),
    ],
    as_json: JsonOption = False,
) -> None:
    """Set the control points of a scene, in place of earlier ones; the next update is aligned by them."""
    points = _read(gcp)
    with service(context, as_json=as_json) as client:
        found = find_scene(client, scene).set_control_points(points)
    if as_json:
        print_json(found.model_dump(mode="json"))
        return
    checks = sum(point.check for point in found.points)
    typer.echo(f"control points  {len(found.points) - checks}")
    typer.echo(f"check points    {checks}")


def _read(file: Path) -> ControlPoints:
    try:
        return read_gcp_list(decoded_text(file.read_bytes()), file)
    except UnicodeDecodeError as error:
        raise typer.BadParameter(f"{file} is not a text file.", param_hint="--gcp") from error
    except GcpListError as error:
        raise typer.BadParameter(f"{error.message} {error.hint}", param_hint="--gcp") from error
