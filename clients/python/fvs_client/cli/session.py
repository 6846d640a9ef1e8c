"""What every command does: reach the service, and say what went wrong in words."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from fvs_client import Client, Scene
from fvs_client.cli.exit_codes import INTERRUPTED, USAGE, exit_code_of
from fvs_client.errors import ApiError, FvsError, JobFailedError, NotFoundError, Problem
from fvs_client.retries import Retries

JsonOption = Annotated[
    bool, typer.Option("--json", help="The result as JSON on stdout; progress and errors as JSON on stderr.")
]
SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A scene's id, or its name.")]
WaitOption = Annotated[bool, typer.Option("--wait/--no-wait", help="Stay until it has ended.")]
TimeoutOption = Annotated[
    float | None,
    typer.Option("--timeout", min=0, metavar="S", help="Wait at most so long.", show_default="ever"),
]

_IMPATIENT = Retries(attempts=3, first_s=0.25)


@dataclass(frozen=True)
class Target:
    """Where the service is, as the options before the command say."""

    url: str | None
    api_key: str | None


@contextmanager
def service(context: typer.Context, *, as_json: bool, patient: bool = False) -> Iterator[Client]:
    """A client for one command; what it meets ends the program with a status of its own.

    ``patient`` commands go on over bad links; the others soon say that there is no service.
    """
    target: Target = context.find_object(Target) or Target(None, None)
    try:
        client = Client(target.url, target.api_key, retries=Retries() if patient else _IMPATIENT)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--url") from error
    with client:
        try:
            yield client
        except FvsError as error:
            _show(error, as_json=as_json)
            raise typer.Exit(exit_code_of(error)) from error
        except OSError as error:
            typer.echo(f"Error: {error}", err=True)
            raise typer.Exit(USAGE) from error
        except KeyboardInterrupt as error:
            typer.echo("Stopped. What the service was asked to do goes on.", err=True)
            raise typer.Exit(INTERRUPTED) from error


def find_scene(client: Client, name: str) -> Scene:
    """The scene with this id, or with this name if only one has it."""
    if name.startswith("scn_"):
        return client.scenes.get(name)
    found = [scene for scene in client.scenes.list() if scene.name == name]
    if len(found) == 1:
        return found[0]
    if not found:
        told = f"There is no scene called {name!r}."
        hint = "`fvs-client scenes list` shows all; `fvs-client scenes create` makes one."
        raise NotFoundError(Problem(status=404, code=NotFoundError.code, detail=told, hint=hint))
    raise typer.BadParameter(
        f"{len(found)} scenes are called {name!r}: {', '.join(scene.id for scene in found)}; give an id."
    )


def print_json(document: Any) -> None:
    """One JSON document on stdout."""
    typer.echo(json.dumps(document, ensure_ascii=False, indent=2))


def _show(error: FvsError, *, as_json: bool) -> None:
    code = error.problem.code if isinstance(error, ApiError) else type(error).__name__
    if isinstance(error, JobFailedError) and error.job.error is not None:
        code = error.job.error.code
    fields = error.errors if isinstance(error, ApiError) else ()
    if as_json:
        document = {
            "error": {
                "code": code,
                "message": error.message,
                "hint": error.hint,
                "retryable": error.retryable,
                "request_id": error.request_id,
                "errors": [field.model_dump() for field in fields],
            }
        }
        typer.echo(json.dumps(document, ensure_ascii=False), err=True)
        return
    typer.echo(f"Error: {error.message}", err=True)
    for field in fields[1:] if len(fields) > 1 else ():
        typer.echo(f"       {field.field or 'request'}: {field.message}", err=True)
    if error.hint:
        typer.echo(error.hint, err=True)
    if isinstance(error, ApiError) and error.request_id:
        typer.echo(f"(request {error.request_id})", err=True)
