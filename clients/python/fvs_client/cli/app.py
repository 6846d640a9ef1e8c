"""The commands of ``fvs-client``."""

from typing import Annotated

import typer

from fvs_client.cli import (
    control_points,
    fly,
    images,
    jobs,
    missions,
    plans,
    rankings,
    scenes,
    snapshots,
    spool,
    status,
    visits,
    webhooks,
)
from fvs_client.cli.options import JsonOption, SceneArgument
from fvs_client.cli.program import program
from fvs_client.cli.session import find_scene, service

app = program()
app.add_typer(scenes.scenes, name="scenes")
app.command("upload")(images.upload)
app.command("images")(images.images)
app.command("originals")(images.originals)
app.command("exclude")(images.exclude)
app.command("include")(images.include)
app.command("delete-images")(images.delete)
app.command("control-points")(control_points.control_points)
app.command("update")(jobs.update)
app.command("fine")(jobs.fine)
app.command("rank")(rankings.rank)
app.command("plan")(plans.plan)
app.command("fly")(fly.fly)
app.command("visit")(visits.visit)
app.command("visits")(visits.visits)
app.command("mission")(missions.mission)
app.command("download")(snapshots.download)
app.add_typer(snapshots.snapshots, name="snapshots")
app.add_typer(rankings.rankings, name="rankings")
app.add_typer(plans.plans, name="plans")
app.add_typer(jobs.jobs, name="jobs")
app.add_typer(webhooks.webhooks, name="webhooks")


@app.command("events")
def events(
    context: typer.Context,
    scene: SceneArgument,
    after: Annotated[
        int, typer.Option(min=0, max=2**53, metavar="N", help="Start after event number N.")
    ] = 0,
    tail: Annotated[bool, typer.Option("--tail", help="Print only new events.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Print the events of a scene as they happen, until Ctrl-C; with --json one JSON object per line."""
    with service(context, as_json=as_json, patient=True) as client:
        for event in find_scene(client, scene).events(None if tail else after):
            if as_json:
                typer.echo(event.model_dump_json())
            else:
                details = " ".join(
                    f"{name}={value}" for name, value in event.data.items() if value not in (None, "", [])
                )
                typer.echo(f"{event.number:>6}  {event.created_at:%F %T}  {event.kind.value:<16}  {details}")


app.command("status")(status.status)
app.add_typer(spool.spool, name="spool")
