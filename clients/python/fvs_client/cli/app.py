"""The commands of ``fvs-client``."""

from typing import Annotated

import typer

from fvs_client.cli import images, jobs, rankings, scenes, transfers
from fvs_client.cli.session import JsonOption, SceneArgument, Target, find_scene, print_json, service
from fvs_client.connection import DEFAULT_URL

app = typer.Typer(
    help="Send photographs to an fvs service, watch the model grow, and ask which view to photograph next.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.callback()
def options(
    context: typer.Context,
    url: Annotated[
        str | None, typer.Option(envvar="FVS_URL", help="Where the service is.", show_default=DEFAULT_URL)
    ] = None,
    api_key: Annotated[
        str | None,
        typer.Option(
            envvar="FVS_API_KEY", show_default=False, help="Your key; better given by the variable."
        ),
    ] = None,
) -> None:
    """Where the service is, and who asks."""
    context.obj = Target(url, api_key)


app.add_typer(scenes.scenes, name="scenes")
app.command("upload")(transfers.upload)
app.command("images")(images.images)
app.command("update")(jobs.update)
app.command("fine")(jobs.fine)
app.command("rank")(rankings.rank)
app.command("download")(transfers.download)
app.add_typer(jobs.jobs, name="jobs")


@app.command("events")
def events(
    context: typer.Context,
    scene: SceneArgument,
    after: Annotated[int, typer.Option(min=0, metavar="N", help="Begin after event number N.")] = 0,
    tail: Annotated[bool, typer.Option("--tail", help="Leave out the past.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Print what happens in a scene, as it happens, until Ctrl-C; with --json one event per line."""
    with service(context, as_json=as_json, patient=True) as client:
        for event in find_scene(client, scene).events(None if tail else after):
            if as_json:
                typer.echo(event.model_dump_json())
            else:
                told = " ".join(
                    f"{name}={value}" for name, value in event.data.items() if value not in (None, "", [])
                )
                typer.echo(f"{event.number:>6}  {event.created_at:%F %T}  {event.kind.value:<16}  {told}")


@app.command("status")
def status(context: typer.Context, as_json: JsonOption = False) -> None:
    """Say whether the service runs, and what it can do."""
    with service(context, as_json=as_json) as client:
        client.health()
        found = client.capabilities()
    if as_json:
        print_json(found.model_dump(mode="json"))
        return
    typer.echo(f"{client.url} runs fvs {found.version} and is ready")
    typer.echo(f"methods     {', '.join(found.methods)}")
    typer.echo(f"generators  {', '.join(found.generators)}")
    typer.echo(f"formats     {', '.join(found.image_formats)}")
