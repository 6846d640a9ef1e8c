"""``fvs-client spool``: photographs go into an outbox, and from there to the service when there is a link."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from fvs_client.cli.command_group import print_error
from fvs_client.cli.exit_codes import INTERRUPTED, SOME_FILES, UNAVAILABLE, USAGE
from fvs_client.cli.options import JsonOption, TimeoutOption
from fvs_client.cli.program import Target
from fvs_client.cli.spool_status import print_status, status_document
from fvs_client.spool.connection import Target as SendTarget
from fvs_client.spool.draining import Drain
from fvs_client.spool.errors import SpoolError, unusable
from fvs_client.spool.folder import find_file
from fvs_client.spool.lock import only_sender
from fvs_client.spool.outbox import FILE_NAME, Outbox
from fvs_client.spool.photograph import State
from fvs_client.spool.quantities import bytes_of
from fvs_client.spool.retrying import forget as forget_refused
from fvs_client.spool.retrying import retry as retry_refused
from fvs_client.spool.settings import Settings
from fvs_client.spool.spool import Spool
from fvs_client.spool.taking import take
from fvs_client.spool.unit import systemd_unit
from fvs_client.spool.wholeness import is_whole

spool = typer.Typer(
    help="Keep photographs in an outbox beside them, and send them when there is a link.",
    no_args_is_help=True,
)


def _size(text: str | None) -> str | None:
    try:
        return text if text is None else str(bytes_of(text))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


def _scene(text: str) -> str:
    if not text.startswith("scn_"):
        raise typer.BadParameter(
            f"{text!r} is not a scene id, and a name can only be looked up with a link. "
            "`fvs-client scenes list` prints the ids."
        )
    return text


FolderArgument = Annotated[
    Path,
    typer.Argument(
        metavar="FOLDER", exists=True, file_okay=False, help="The folder that a camera writes to."
    ),
]
OutboxFolderArgument = Annotated[
    Path, typer.Argument(metavar="[FOLDER]", help="The folder with the photographs and their outbox.")
]
SceneOption = Annotated[str, typer.Option("--scene", metavar="ID", callback=_scene, help="The scene's id.")]
OutboxOption = Annotated[
    Path | None,
    typer.Option(
        "--outbox", metavar="FILE", dir_okay=False, help="The outbox.", show_default=f"FOLDER/{FILE_NAME}"
    ),
]
NewestFirstOption = Annotated[bool, typer.Option("--newest-first", help="Send the newest photograph next.")]
MaxRateOption = Annotated[
    str | None,
    typer.Option(
        "--max-rate",
        metavar="SIZE",
        callback=_size,
        help="Bytes per second at most, such as 100kB.",
        show_default="none",
    ),
]
DeleteSentOption = Annotated[
    bool,
    typer.Option(
        "--delete-sent", help="Delete files of accepted photographs once the service has acknowledged them."
    ),
]
MaxDiskOption = Annotated[
    str | None,
    typer.Option(
        "--max-disk",
        metavar="SIZE",
        callback=_size,
        help="With --delete-sent: delete only what exceeds this, the oldest first. Alone: only warn.",
        show_default="none",
    ),
]
NumbersOption = Annotated[
    list[int] | None,
    typer.Option(
        "--number",
        min=1,
        max=2**53,
        metavar="N",
        help="Only the photograph with this number.",
        show_default="all",
    ),
]


@spool.command()
def watch(
    context: typer.Context,
    folder: FolderArgument,
    scene: SceneOption,
    outbox: OutboxOption = None,
    newest_first: NewestFirstOption = False,
    max_rate: MaxRateOption = None,
    delete_sent: DeleteSentOption = False,
    max_disk: MaxDiskOption = None,
) -> None:
    """Send what a camera writes to a folder whenever there is a link, until Ctrl-C or SIGTERM."""
    settings = _settings(newest_first, max_rate, delete_sent, max_disk)
    with _failures():
        target = _target(context)
        made = Spool(
            folder, scene, url=target.url, api_key=target.api_key, outbox=outbox, settings=settings, say=_say
        )
        _end_at_sigterm()
        made.run()


@spool.command()
def add(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", exists=True, dir_okay=False, help="Photographs.")
    ],
    scene: SceneOption,
    outbox: OutboxOption = None,
) -> None:
    """Put photographs into the outbox of their folder; watch and send then send them."""
    refused = False
    with _failures():
        for path in files:
            with Outbox(outbox or path.parent / FILE_NAME) as opened:
                if not is_whole(path):
                    refused = True
                    _say(f"{path} has no end: it is being written, or was cut off.")
                    continue
                photograph = take(opened, find_file(path), scene)
            refused = refused or photograph.state is State.REFUSED
            why = (
                ""
                if photograph.refusal is None
                else f". {photograph.refusal.reason} {photograph.refusal.hint}"
            )
            typer.echo(f"{path}: {photograph.state.value}{why}")
    if refused:
        raise typer.Exit(SOME_FILES)


@spool.command()
def send(
    context: typer.Context,
    folder: OutboxFolderArgument = Path(),
    outbox: OutboxOption = None,
    newest_first: NewestFirstOption = False,
    max_rate: MaxRateOption = None,
    delete_sent: DeleteSentOption = False,
    max_disk: MaxDiskOption = None,
    timeout: TimeoutOption = None,
) -> None:
    """Send all photographs that wait, however long it takes, and exit."""
    settings = _settings(newest_first, max_rate, delete_sent, max_disk)
    path = _path(folder, outbox)
    ended = threading.Event()
    with _failures(), Outbox(path, create=False) as opened, only_sender(path):
        drain = Drain(opened, _target(context), settings, _say)
        _end_at_sigterm()
        if timeout is not None:
            alarm = threading.Timer(timeout, ended.set)
            alarm.daemon = True
            alarm.start()
        drain.run(ended, until_empty=True)
        counts = opened.counts()
    left = counts[State.WAITING] + counts[State.SENDING]
    typer.echo(f"{counts[State.SENT]} sent, {counts[State.REFUSED]} refused, {left} left")
    if left or counts[State.REFUSED]:
        raise typer.Exit(UNAVAILABLE if left else SOME_FILES)


@spool.command()
def status(
    folder: OutboxFolderArgument = Path(), outbox: OutboxOption = None, as_json: JsonOption = False
) -> None:
    """Show which photographs wait, are being sent, were sent, or were refused."""
    path = _path(folder, outbox)
    with _failures(as_json=as_json), Outbox(path, create=False) as opened:
        document = status_document(opened, folder)
    print_status(document, as_json=as_json)


@spool.command()
def retry(
    numbers: NumbersOption = None,
    folder: OutboxFolderArgument = Path(),
    outbox: OutboxOption = None,
) -> None:
    """Send refused photographs again, with the next watch or send."""
    with _failures(), Outbox(_path(folder, outbox), create=False) as opened:
        waiting = retry_refused(opened, numbers or ())
    for photograph in waiting:
        typer.echo(f"{photograph.name}: waiting")
    if not waiting:
        typer.echo("No refused photograph can be tried again.", err=True)


@spool.command()
def forget(
    numbers: NumbersOption = None,
    folder: OutboxFolderArgument = Path(),
    outbox: OutboxOption = None,
) -> None:
    """Forget refused photographs, such as those for a mistyped scene. Their files stay."""
    with _failures(), Outbox(_path(folder, outbox), create=False) as opened:
        forgotten = forget_refused(opened, numbers or ())
    for photograph in forgotten:
        typer.echo(f"{photograph.name}: forgotten")
    if not forgotten:
        typer.echo("No photograph is refused.", err=True)


@spool.command()
def unit(
    folder: FolderArgument,
    scene: SceneOption,
    outbox: OutboxOption = None,
    newest_first: NewestFirstOption = False,
    max_rate: MaxRateOption = None,
    delete_sent: DeleteSentOption = False,
    max_disk: MaxDiskOption = None,
) -> None:
    """Print a systemd unit that runs watch with these options."""
    path = _path(folder, outbox).resolve()
    command = [str(Path(sys.argv[0]).resolve()), "spool", "watch", str(folder.resolve()), "--scene", scene]
    command += [] if outbox is None else ["--outbox", str(path)]
    command += ["--newest-first"] if newest_first else []
    command += [] if max_rate is None else ["--max-rate", max_rate]
    command += ["--delete-sent"] if delete_sent else []
    command += [] if max_disk is None else ["--max-disk", max_disk]
    typer.echo(systemd_unit(command, folder.resolve(), [folder.resolve(), path.parent]), nl=False)


def _settings(newest_first: bool, max_rate: str | None, delete_sent: bool, max_disk: str | None) -> Settings:
    return Settings(
        newest_first=newest_first,
        max_rate_bytes_s=None if max_rate is None else float(max_rate),
        delete_sent=delete_sent,
        max_disk_bytes=None if max_disk is None else int(max_disk),
    )


def _path(folder: Path, outbox: Path | None) -> Path:
    return folder / FILE_NAME if outbox is None else outbox


def _target(context: typer.Context) -> SendTarget:
    given = context.find_object(Target) or Target(None, None)
    return SendTarget.resolve(given.url, given.api_key)


def _say(line: str) -> None:
    typer.echo(line, err=True)


def _end_at_sigterm() -> None:
    """Let SIGTERM end the command in order; it interrupts waits and requests, and nothing is lost."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))


@contextmanager
def _failures(*, as_json: bool = False) -> Iterator[None]:
    """Print what keeps the spool from working, and end with its exit code."""
    import sqlite3

    try:
        yield
    except KeyboardInterrupt as error:
        _say("Interrupted. What waits stays in the outbox.")
        raise typer.Exit(INTERRUPTED) from error
    except (SpoolError, sqlite3.Error, OSError) as error:
        found = unusable(Path(FILE_NAME), error) if isinstance(error, sqlite3.Error) else error
        hint = found.hint if isinstance(found, SpoolError) else ""
        if as_json:
            print_error("spool-error", str(found), hint)
        else:
            for line in filter(None, (f"Error: {found}", hint)):
                _say(line)
        raise typer.Exit(USAGE) from error
