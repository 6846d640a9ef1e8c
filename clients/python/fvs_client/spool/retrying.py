"""Retry or forget refused photographs."""

from collections.abc import Sequence
from dataclasses import replace

from fvs_client.spool.folder import find_file
from fvs_client.spool.outbox import CUT_OFF, SIDECAR_REFUSED, TEST, Outbox
from fvs_client.spool.photograph import Photograph, State
from fvs_client.spool.taking import take


def retry(outbox: Outbox, numbers: Sequence[int] = ()) -> list[Photograph]:
    """Retry all refused photographs, or those with these numbers; return those that wait now.

    Sidecars that have changed since, or could not be used, are read again. Raises ``OSError`` where a file
    cannot be read.
    """
    waiting = []
    for photograph in _refused(outbox, numbers):
        now = _with_its_sidecar(outbox, photograph)
        if now.refusal is not None and now.refusal.code != SIDECAR_REFUSED:
            outbox.retry(now.number)
            now = outbox.get(now.number)
        waiting += [now] if now.state is State.WAITING else []
    return waiting


def forget(outbox: Outbox, numbers: Sequence[int] = ()) -> list[Photograph]:
    """Remove all refused photographs, or those with these numbers, from the outbox; return them.

    Their files stay. Who watches the folder for the same scene takes them again when the spool starts.
    """
    forgotten = _refused(outbox, numbers)
    for photograph in forgotten:
        outbox.forget(photograph.number)
    return forgotten


def _with_its_sidecar(outbox: Outbox, photograph: Photograph) -> Photograph:
    """The photograph with the metadata of its sidecar, if that has changed or could not be used."""
    try:
        file = replace(find_file(photograph.path), name=photograph.name)
    except FileNotFoundError:
        return photograph
    known = outbox.has(file.path, photograph.scene, file.size_bytes, file.mtime_ns, file.sidecar_state)
    unusable = photograph.refusal is not None and photograph.refusal.code == SIDECAR_REFUSED
    cut_off = photograph.refusal is not None and photograph.refusal.code == CUT_OFF
    if unusable or not known:
        taken = take(outbox, file, photograph.scene)
        return taken if cut_off else outbox.get(photograph.number)
    return photograph


def _refused(outbox: Outbox, numbers: Sequence[int]) -> list[Photograph]:
    """Those with these numbers, or all but test photographs."""
    return [
        one
        for one in outbox.all()
        if one.refusal is not None and (one.number in numbers if numbers else one.refusal.code != TEST)
    ]
