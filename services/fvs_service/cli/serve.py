"""``fvs serve`` and ``fvs keys``: the service on this machine, and its API keys."""

import os
import sys
from collections.abc import Mapping
from datetime import timedelta
from typing import TYPE_CHECKING, Annotated

import typer

from fvs_service.cli.failures import failures_as_messages
from fvs_service.cli.options import RootOption, settings_of
from fvs_service.principal import LOCAL_TENANT, Scope

if TYPE_CHECKING:
    from fvs_service.serving.stop_signals import StopSignals

STOP_WITHIN_S = 9.5
"""Longest time from SIGTERM to the end of the last process, beyond ``drain_s``."""

keys = typer.Typer(help="Create, list and revoke API keys.", no_args_is_help=True)


def add_commands(app: typer.Typer) -> None:
    """Add ``serve``, ``keys`` and ``doctor`` to the program ``fvs`` (entry point ``fvs.commands``)."""
    from fvs_service.cli.doctor import doctor

    app.command()(serve)
    app.command()(doctor)
    app.add_typer(keys, name="keys")


def serve(
    root: RootOption = None,
    host: Annotated[
        str | None,
        typer.Option(
            help="Address to listen on; with one that is not loopback, requests need an API key.",
            show_default="127.0.0.1",
        ),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(min=0, max=65_535, help="Port of HTTP; 0 takes a free one.", show_default="8000"),
    ] = None,
    rest: Annotated[
        bool | None,
        typer.Option(
            "--rest/--no-rest", help="Serve REST; --no-rest serves gRPC alone.", show_default="--rest"
        ),
    ] = None,
    console: Annotated[
        bool | None,
        typer.Option(
            "--console/--no-console",
            help="Serve the operator's console, a page for browsers, at /.",
            show_default="--console",
        ),
    ] = None,
    grpc: Annotated[
        bool | None, typer.Option("--grpc/--no-grpc", help="Serve gRPC.", show_default="--grpc")
    ] = None,
    grpc_port: Annotated[
        int | None,
        typer.Option(
            min=0, max=65_535, help="Port of gRPC; 0 takes a free one.", show_default="the one after --port"
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, max=256, help="Number of workers on this machine.", show_default="1")
    ] = None,
    role: Annotated[
        str, typer.Option(help="What to run on this machine: all, gateway or worker.", metavar="ROLE")
    ] = "all",
    log_json: Annotated[bool, typer.Option("--log-json", help="Write logs as JSON lines.")] = False,
) -> None:
    """Start the service, with REST and gRPC, by default on loopback.

    Other settings are FVS_… variables; docs/operate/running.md lists them.
    """
    from fvs_service.serving.process_tree import kill_descendants
    from fvs_service.serving.stop_signals import StopSignals

    with StopSignals(STOP_WITHIN_S, kill_descendants) as signals:  # first: imports take seconds
        given = {
            "root": root,
            "host": host,
            "port": port,
            "rest": rest,
            "console": console,
            "grpc": grpc,
            "grpc_port": grpc_port,
        }
        _supervise(given, workers, role, signals, log_json=log_json)
        sys.stdout.flush()
        os._exit(0)  # at once: the interpreter's own end takes seconds on a busy machine


def _supervise(
    given: Mapping[str, object],
    workers: int | None,
    role: str,
    signals: "StopSignals",
    *,
    log_json: bool,
) -> None:
    from fvs_service.logs import configure_logging, log_uncaught
    from fvs_service.serving.supervisor import Role, Supervisor

    if role not in list(Role):
        raise typer.BadParameter(f"{role} is not one of {', '.join(Role)}.", param_hint="--role")
    configure_logging(machine=log_json)
    log_uncaught()
    settings = settings_of(**given)
    if workers is not None:
        shared = settings.worker.model_copy(update={"count": workers})
        settings = settings.model_copy(update={"worker": shared})
    if Role(role) is not Role.WORKER:
        signals.allow(settings.drain_s)
    with failures_as_messages(log_json=log_json):
        if not signals.stopping:
            Supervisor(settings, signals, log_json=log_json, role=Role(role)).run(announce=typer.echo)


@keys.command("create")
def create_key(
    name: Annotated[str, typer.Argument(help="A description of the key.")],
    tenant: Annotated[str, typer.Option(help="The tenant that the key belongs to.")] = LOCAL_TENANT,
    scope: Annotated[
        list[Scope] | None, typer.Option(help="Permissions of the key.", show_default="all")
    ] = None,
    scene: Annotated[
        str | None, typer.Option(help="Restrict the key to this scene of the tenant, as for a vehicle.")
    ] = None,
    days: Annotated[
        int | None, typer.Option(min=1, max=36_500, help="Days until the key expires.", show_default="never")
    ] = None,
    root: RootOption = None,
) -> None:
    """Create a key and print it. It cannot be shown again."""
    from fvs_service.application import open_storage

    with failures_as_messages(), open_storage(settings_of(root=root)) as storage:
        key = storage.keys.create(
            name,
            tenant_id=tenant,
            scopes=frozenset(scope or Scope),
            scene_id=scene,
            valid_for=None if days is None else timedelta(days=days),
        )
    typer.echo(key)


@keys.command("list")
def list_keys(root: RootOption = None) -> None:
    """List the keys, without their secrets."""
    from fvs_service.application import open_existing_storage

    settings = settings_of(root=root)
    with failures_as_messages(), open_existing_storage(settings) as storage:
        found = storage.keys.all()
        if not found:
            typer.echo(f"There are no keys in {settings.root}.", err=True)
        for key in found:
            state = (
                "revoked" if key.revoked_at else f"expires {key.expires_at:%F}" if key.expires_at else "valid"
            )
            scopes = ",".join(sorted(key.scopes))
            typer.echo(
                f"{key.id}  {key.tenant_id}  {scopes}  {key.scene_id or 'all scenes'}  {state}  {key.name}"
            )


@keys.command("revoke")
def revoke_key(
    key_id: Annotated[str, typer.Argument(metavar="ID", help="A key's id.")], root: RootOption = None
) -> None:
    """Revoke a key at once."""
    from fvs_service.application import open_existing_storage

    with failures_as_messages(), open_existing_storage(settings_of(root=root)) as storage:
        storage.keys.revoke(key_id)
