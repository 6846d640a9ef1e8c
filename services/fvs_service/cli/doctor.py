"""``fvs doctor``: reports faults of a deployment, and what crashes and restored backups leave behind."""

import contextlib
from collections.abc import Iterable
from datetime import timedelta
from typing import TYPE_CHECKING, Annotated

import typer

from fvs_service.cli.failures import failures_as_messages
from fvs_service.cli.options import RootOption, settings_of

if TYPE_CHECKING:
    from fvs_service.doctor.deployment import Trouble
    from fvs_service.doctor.examination import Finding

_EXIT_FOUND = 13


def doctor(
    repair: Annotated[
        bool, typer.Option("--repair", help="Repair what is found instead of only reporting it.")
    ] = False,
    grace: Annotated[
        float,
        typer.Option(
            min=0, max=31_536_000, metavar="S", help="Ignore files that are younger than S seconds."
        ),
    ] = 900.0,
    root: RootOption = None,
) -> None:
    """Check the database, the object store, clocks, workers, keys, disks, and whether rows and blobs match.

    It finds blobs without rows, rows without blobs, folders without a scene, unfinished deletions and jobs
    of lost workers, and says whether requests need a key.
    If the database does not answer, it checks what does not need it. It may run beside the service.
    Without --repair it changes nothing. The exit status is 0 when nothing is found, else 13.
    """
    from fvs_service.application import open_existing_storage
    from fvs_service.doctor.deployment import troubles, troubles_without_database
    from fvs_service.doctor.examination import examine, examine_without_database
    from fvs_service.errors import ForbiddenError, StorageUnavailableError
    from fvs_service.gateway.protection import access_of

    settings = settings_of(root=root)
    age = timedelta(seconds=grace)
    with failures_as_messages(_EXIT_FOUND), contextlib.ExitStack() as opened:
        try:
            storage = opened.enter_context(open_existing_storage(settings, migrate=repair))
        except StorageUnavailableError as error:
            _show(troubles_without_database(settings, error))
            _report(examine_without_database(settings, age), repair=repair)
            typer.echo("Everything else needs the database, and was not examined.", err=True)
            raise typer.Exit(_EXIT_FOUND) from error
        with contextlib.suppress(ForbiddenError):  # which is a trouble
            typer.echo(access_of(storage), err=True)
        wrong = _show(troubles(storage))
        if any(trouble.serious for trouble in wrong):
            raise typer.Exit(_EXIT_FOUND)
        found = _report(examine(storage, age), repair=repair)
    typer.echo(f"{found} found{', and repaired' if found and repair else ''}", err=True)
    if found or wrong:
        if found and not repair:
            typer.echo("Run it again with --repair to repair them.", err=True)
        raise typer.Exit(_EXIT_FOUND)


def _show(troubles: "Iterable[Trouble]") -> "tuple[Trouble, ...]":
    """Print each trouble as it is found; returns them."""
    found = []
    for trouble in troubles:
        typer.echo(f"{trouble.what} {trouble.hint}")
        found.append(trouble)
    return tuple(found)


def _report(findings: "Iterable[Finding]", *, repair: bool) -> int:
    """Print, and perhaps repair, each finding; returns their number."""
    found = 0
    for finding in findings:
        found += 1
        if repair:
            finding.repair()
        typer.echo(f"{finding.kind}: {finding.what} ({'did' if repair else 'would'}: {finding.remedy})")
    return found
