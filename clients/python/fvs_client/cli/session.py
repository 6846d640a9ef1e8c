"""The client of a command: connects to the service, and turns errors into messages and exit codes."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict

import typer

from fvs_client import Client, Scene
from fvs_client.cli.command_group import print_error
from fvs_client.cli.error_exit_codes import SceneNameError, exit_code_of
from fvs_client.cli.exit_codes import INTERRUPTED, USAGE
from fvs_client.cli.program import Target
from fvs_client.cli.wording import hint_in_options, in_options
from fvs_client.errors import (
    ApiError,
    ForbiddenError,
    FvsError,
    InvalidRequestError,
    JobFailedError,
    NotFoundError,
)
from fvs_client.retries import Retries
from fvs_schema.mistakes import InvalidInput
from fvs_schema.problems import Problem, ProblemField

_FEW_RETRIES = Retries(attempts=3, first_s=0.25)


@contextmanager
def service(context: typer.Context, *, as_json: bool, patient: bool = False) -> Iterator[Client]:
    """Open a client for one command; errors inside the block are printed and end it with their exit code.

    ``patient`` commands retry over bad links; the others soon report that there is no service.
    """
    target: Target = context.find_object(Target) or Target(None, None)
    try:
        client = Client(target.url, target.api_key, retries=Retries() if patient else _FEW_RETRIES)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--url") from error
    with client:
        try:
            yield client
        except FvsError as error:
            _print_error(error, _command(context), as_json=as_json)
            raise typer.Exit(exit_code_of(error)) from error
        except InvalidInput as error:
            _print_error(_refused(error), _command(context), as_json=as_json)
            raise typer.Exit(USAGE) from error
        except BrokenPipeError:  # whoever reads the output has enough
            raise
        except OSError as error:
            _print_file_error(error, as_json=as_json)
            raise typer.Exit(USAGE) from error
        except KeyboardInterrupt as error:
            _print("interrupted", "Interrupted. Jobs in the service continue.", as_json=as_json)
            raise typer.Exit(INTERRUPTED) from error


def find_scene(client: Client, name: str) -> Scene:
    """Get the scene with this id, or the only scene with this name."""
    if name.startswith("scn_"):
        return client.scenes.get(name)
    found = list(client.scenes.list(name=name))
    if len(found) == 1:
        return found[0]
    if not found:
        detail = f"There is no scene called {name!r}."
        hint = "`fvs-client scenes list` lists all; `fvs-client scenes create` creates one."
        raise NotFoundError(Problem(status=404, code=NotFoundError.code, detail=detail, hint=hint))
    ids = ", ".join(scene.id for scene in found)
    raise SceneNameError(f"{len(found)} scenes are called {name!r}.", hint=f"Give the id of one: {ids}.")


def require_free_name(client: Client, name: str) -> None:
    """Raise ``SceneNameError`` when a scene has this name: commands could not tell the two apart."""
    with suppress(ForbiddenError):  # a key that may not list scenes
        taken = [scene.id for scene in client.scenes.list(name=name)]
        if taken:
            raise SceneNameError(
                f"There is a scene called {name!r} already.",
                hint=f"Use it, by its name or by its id, {', '.join(taken)}, or choose another name.",
            )


def confirm(question: str, *, yes: bool) -> None:
    """Ask for confirmation unless it is given; ends the command without it."""
    try:
        agreed = yes or typer.confirm(question)
    except typer.Abort:  # nobody is there to answer
        agreed = False
    if not agreed:
        typer.echo("Nothing was deleted.", err=True)
        raise typer.Exit(USAGE)


def _refused(error: InvalidInput) -> InvalidRequestError:
    """The error that the service would answer with."""
    fields = tuple(ProblemField(field=one.field, message=one.message) for one in error.errors)
    hint = "GET /openapi.json describes the request."
    code = InvalidRequestError.code
    return InvalidRequestError(Problem(status=422, code=code, detail=str(error), hint=hint, errors=fields))


def _command(context: typer.Context) -> str:
    """The words of a command, without options."""
    return f"fvs-client {context.command_path.partition(' ')[2]}"


def _print_file_error(error: OSError, *, as_json: bool) -> None:
    """Print why a file cannot be read or written."""
    message = str(error)
    if error.filename is not None and error.strerror is not None:
        message = f"{error.filename}: {error.strerror}."
    _print("file-error", message if as_json else f"Error: {message}", as_json=as_json)


def _print(code: str, message: str, *, as_json: bool) -> None:
    if as_json:
        print_error(code, message, "")
    else:
        typer.echo(message, err=True)


def _print_error(error: FvsError, command: str, *, as_json: bool) -> None:
    why = error.job.error if isinstance(error, JobFailedError) else None
    code = error.code if why is None else why.code
    fields = error.errors if isinstance(error, ApiError) else ()
    message, hint = in_options(error.message), hint_in_options(error.hint, fields, command)
    if as_json:
        print_error(
            code,
            message,
            hint,
            retryable=error.retryable,
            request_id=error.request_id,
            errors=[asdict(field) for field in fields],
        )
        return
    typer.echo(f"Error: {message}", err=True)
    for field in fields[1:]:  # the message has the first one, and so those of which it says the same
        if field.message == fields[0].message:
            continue
        wrong = in_options(f"{field.field or 'request'}: {field.message}")
        typer.echo(f"       {wrong}", err=True)
    if hint:
        typer.echo(hint, err=True)
    if isinstance(error, ApiError) and error.request_id:
        typer.echo(f"(request {error.request_id})", err=True)
