"""Let refused photographs wait again."""

from collections.abc import Sequence
from dataclasses import replace

from fvs_client.spool.folder import find_file
from fvs_client.spool.outbox import SIDECAR_REFUSED, Outbox
from fvs_client.spool.photograph import Photograph, State
from fvs_client.spool.taking import take


def retry(outbox: Outbox, numbers: Sequence[int] = ()) -> list[Photograph]:
    """Retry all refused photographs, or those with these numbers; return those that wait now.

    Sidecars that could not be used are read again. Raises ``OSError`` where a file cannot be read.
    """
    waiting = []
    for photograph in outbox.all():
        refusal = photograph.refusal
        if refusal is None or photograph.state is not State.REFUSED:
            continue
        if numbers and photograph.number not in numbers:
            continue
        if refusal.code == SIDECAR_REFUSED:
            take(outbox, replace(find_file(photograph.path), name=photograph.name), photograph.scene)
        else:
            outbox.retry(photograph.number)
        now = outbox.get(photograph.number)
        waiting += [now] if now.state is State.WAITING else []
    return waiting
