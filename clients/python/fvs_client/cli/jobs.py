"""``fvs-client jobs``, and ``update`` and ``fine``, which queue one."""

from typing import Annotated

import typer

from fvs_client import Job
from fvs_client.cli.options import (
    IterationsOption,
    JobArgument,
    JsonOption,
    LongSideOption,
    SceneArgument,
    TestEveryOption,
    TimeoutOption,
    WaitOption,
)
from fvs_client.cli.output import describe_metrics, print_json, print_table
from fvs_client.cli.progress import describe_waiting, display, job_progress
from fvs_client.cli.session import find_scene, service
from fvs_schema.jobs import JobKind, JobRequest, JobState

jobs = typer.Typer(help="List, show, wait for, cancel and retry jobs.", no_args_is_help=True)


def update(
    context: typer.Context,
    scene: SceneArgument,
    iterations: IterationsOption = None,
    long_side: LongSideOption = None,
    wait: WaitOption = True,
    timeout: TimeoutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Register all pending images and train the model anew."""
    request = JobRequest(kind=JobKind.UPDATE, iterations=iterations, long_side_px=long_side)
    _queue(context, scene, request, wait=wait, timeout=timeout, as_json=as_json)


def fine(
    context: typer.Context,
    scene: SceneArgument,
    iterations: IterationsOption = None,
    long_side: LongSideOption = None,
    test_every: TestEveryOption = None,
    wait: WaitOption = True,
    timeout: TimeoutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Train the final model."""
    request = JobRequest(
        kind=JobKind.FINE, iterations=iterations, long_side_px=long_side, test_every=test_every
    )
    _queue(context, scene, request, wait=wait, timeout=timeout, as_json=as_json)


@jobs.command("list")
def list_all(
    context: typer.Context,
    scene: SceneArgument,
    state: Annotated[
        list[JobState] | None,
        typer.Option(help="Only jobs in this state; may be repeated.", show_default="all"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the jobs of a scene, newest first."""
    with service(context, as_json=as_json, patient=True) as client:
        found = list(find_scene(client, scene).jobs.list(state=state or ()))
    if as_json:
        print_json([job.model_dump(mode="json") for job in found])
        return
    print_table(
        ("id", "kind", "state", "progress", "stage", "created"),
        [
            (
                job.id,
                job.kind.value,
                job.state.value,
                f"{job.progress:.0%}",
                job.stage or "" if job.waiting is None else f"waits: {job.waiting.reason.value}",
                job.created_at.strftime("%F %H:%M"),
            )
            for job in found
        ],
        right_aligned=("progress",),
    )


@jobs.command("show")
def show(context: typer.Context, job: JobArgument, as_json: JsonOption = False) -> None:
    """Show a job and its progress."""
    with service(context, as_json=as_json, patient=True) as client:
        _print(client.jobs.get(job), as_json=as_json)


@jobs.command("wait")
def wait_for(
    context: typer.Context, job: JobArgument, timeout: TimeoutOption = None, as_json: JsonOption = False
) -> None:
    """Wait until a job has ended."""
    with service(context, as_json=as_json, patient=True) as client:
        _print(_wait(client.jobs.get(job), timeout, as_json=as_json), as_json=as_json)


@jobs.command("cancel")
def cancel(context: typer.Context, job: JobArgument, as_json: JsonOption = False) -> None:
    """Cancel a job."""
    with service(context, as_json=as_json, patient=True) as client:
        _print(client.jobs.get(job).cancel(), as_json=as_json)


@jobs.command("retry")
def retry(
    context: typer.Context,
    job: JobArgument,
    wait: WaitOption = True,
    timeout: TimeoutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Queue a failed or canceled job again; finished stages are not repeated."""
    with service(context, as_json=as_json, patient=True) as client:
        again = client.jobs.get(job).retry()
        _print(_wait(again, timeout, as_json=as_json) if wait else again, as_json=as_json)


def _queue(
    context: typer.Context,
    scene: str,
    request: JobRequest,
    *,
    wait: bool,
    timeout: float | None,
    as_json: bool,
) -> None:
    with service(context, as_json=as_json, patient=True) as client:
        found = find_scene(client, scene)
        job = found.jobs.create(
            request.kind,
            iterations=request.iterations,
            long_side_px=request.long_side_px,
            test_every=request.test_every,
        )
        _print(_wait(job, timeout, as_json=as_json) if wait else job, as_json=as_json)


def _wait(job: Job, timeout_s: float | None, *, as_json: bool) -> Job:
    label = {
        JobKind.UPDATE: "Updating the model",
        JobKind.FINE: "Training the final model",
        JobKind.FRAMES: "Taking frames from videos",
    }.get(job.kind, job.kind)
    with display(label, as_json=as_json) as shown:
        return job.wait(timeout_s=timeout_s, on_progress=lambda now: job_progress(shown, now))


def _print(job: Job, *, as_json: bool) -> None:
    if as_json:
        print_json(job.model_dump(mode="json"))
        return
    stage = f" ({job.stage})" if job.stage and not job.ended else ""
    typer.echo(f"{job.id}  {job.kind.value}  {job.state.value}  {job.progress:.0%}{stage}")
    if job.waiting is not None:
        typer.echo(describe_waiting(job.waiting))
    elif job.stage is None and not job.ended:
        typer.echo("Its runner starts. On a new machine it first compiles, for some minutes.")
    if job.error is not None:
        typer.echo(f"{job.error.message} {job.error.hint}".rstrip())
    for warning in job.warnings:
        typer.echo(f"{warning.severity}: {warning.message} {warning.hint}")
    snapshot = job.snapshot()
    if snapshot is not None:
        typer.echo(f"{snapshot.id}  {describe_metrics(snapshot.metrics)}")
