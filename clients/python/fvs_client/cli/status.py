"""``fvs-client status``."""

from collections.abc import Sequence

import typer

from fvs_client.cli.error_exit_codes import exit_code_of
from fvs_client.cli.exit_codes import UNAVAILABLE
from fvs_client.cli.options import JsonOption
from fvs_client.cli.output import print_json
from fvs_client.cli.session import service
from fvs_client.errors import ApiError
from fvs_schema.service import WorkerStatus


def status(context: typer.Context, as_json: JsonOption = False) -> None:
    """Show whether uploads, jobs and workers work; the exit status is 4 if something does not."""
    problem: ApiError | None = None
    with service(context, as_json=as_json) as client:
        found = client.capabilities()
        try:
            client.health()
        except ApiError as error:
            problem = error
    takes_jobs = any(worker.takes_jobs for worker in found.workers)
    if as_json:
        states = {"uploads": problem is None, "jobs": takes_jobs}
        print_json({**found.model_dump(mode="json"), "works": states})
    else:
        typer.echo(f"{client.url} runs fvs {found.version}")
        typer.echo(f"uploads     {'work' if problem is None else f'do not work: {problem.message}'}")
        typer.echo(f"jobs        {_jobs(found.workers)}")
        for worker in found.workers:
            typer.echo(f"worker      {_worker(worker)}")
        typer.echo(f"methods     {', '.join(found.methods)}")
        typer.echo(f"generators  {', '.join(found.generators)}")
        typer.echo(f"formats     {', '.join(found.image_formats)}")
    if problem is not None:
        raise typer.Exit(exit_code_of(problem))
    if not takes_jobs:
        raise typer.Exit(UNAVAILABLE)


def _jobs(workers: Sequence[WorkerStatus]) -> str:
    alive = [worker for worker in workers if worker.alive]
    if not alive:
        return "wait: no worker is alive; rankings of scenes that are not loaded wait too"
    if any(worker.takes_jobs for worker in alive):
        return "run"
    if all(worker.disk_full for worker in alive):
        return "wait: the workers' disk is full"
    return "wait: the Ray cluster cannot be reached; see the log of fvs serve --role worker"


def _worker(worker: WorkerStatus) -> str:
    if not worker.alive:
        return f"{worker.id} has been silent for {worker.heartbeat_age_s:.0f} s"
    room = ", its disk is full" if worker.disk_full else ""
    if worker.slots == 0:
        room += ", it cannot reach its Ray cluster"
    memory = f"{worker.runners} models loaded in {worker.runner_bytes / 1e6:,.0f} MB"
    return f"{worker.id} is alive ({worker.backend}): {memory}{room}"
