"""What ``fvs-client spool status`` shows."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

from fvs_client.spool.folder import find_files
from fvs_client.spool.lock import has_sender
from fvs_client.spool.outbox import Outbox
from fvs_client.spool.photograph import Photograph, State
from fvs_schema.names import readable_name

_ARRIVING = "arriving"
"""A file that is not complete yet, or that no one watches for."""


def status_document(outbox: Outbox, folder: Path) -> dict[str, Any]:
    """The state of an outbox, and the files in its folder that it has not taken."""
    photographs = outbox.all()
    trouble = outbox.trouble()
    arriving = _arriving(photographs, folder)
    counts = {_ARRIVING: len(arriving), **{state.value: count for state, count in outbox.counts().items()}}
    return {
        "outbox": str(outbox.path),
        "sender": has_sender(outbox.path),
        "trouble": None if trouble is None else {"message": trouble[0], "hint": trouble[1]},
        "counts": counts,
        "photographs": [_described(photograph) for photograph in photographs],
        _ARRIVING: arriving,
    }


def print_status(document: Mapping[str, Any], *, as_json: bool) -> None:
    """Print the document as JSON, or as a table of all that is not sent."""
    from fvs_client.cli.output import print_json, print_table  # rich; the commands that stay do without

    if as_json:
        print_json(document)
        return
    rows = [
        (
            str(photograph["number"]),
            photograph["name"],
            photograph["state"],
            _size(photograph),
            _remarks(photograph),
        )
        for photograph in document["photographs"]
        if photograph["state"] != State.SENT
    ]
    rows += [("", name, _ARRIVING, "", "") for name in document[_ARRIVING]]
    if rows:
        print_table(("no.", "name", "state", "MB", "remarks"), rows, right_aligned=("no.", "MB"))
    typer.echo(", ".join(f"{count} {state}" for state, count in document["counts"].items()))
    if not document["sender"]:
        typer.echo("No spool is running here. Start `fvs-client spool watch` or `send`.")
    elif document["trouble"] is not None:
        typer.echo(" ".join(filter(None, document["trouble"].values())))


def _described(photograph: Photograph) -> dict[str, Any]:
    refusal = photograph.refusal
    return {
        "number": photograph.number,
        "name": photograph.name,
        "path": readable_name(str(photograph.path)),
        "scene": photograph.scene,
        "digest": f"sha256:{photograph.digest}",
        "state": photograph.state.value,
        "size_bytes": photograph.size_bytes,
        "offset_bytes": photograph.offset_bytes,
        "verdict": photograph.verdict,
        "refusal": None
        if refusal is None
        else {"code": refusal.code, "reason": refusal.reason, "hint": refusal.hint},
        "deleted": photograph.deleted,
    }


def _arriving(photographs: list[Photograph], folder: Path) -> list[str]:
    known = {(photograph.name, photograph.size_bytes, photograph.mtime_ns) for photograph in photographs}
    try:
        files = find_files(folder)
    except OSError:
        return []
    return [file.name for file in files if (file.name, file.size_bytes, file.mtime_ns) not in known]


def _size(photograph: Mapping[str, Any]) -> str:
    size = f"{photograph['size_bytes'] / 1e6:,.1f}"
    sent = f"{photograph['offset_bytes'] / 1e6:,.1f} of "
    return (sent if photograph["state"] == State.SENDING and photograph["offset_bytes"] else "") + size


def _remarks(photograph: Mapping[str, Any]) -> str:
    refusal = photograph["refusal"]
    return "" if refusal is None else f"{refusal['reason']} {refusal['hint']}".strip()
