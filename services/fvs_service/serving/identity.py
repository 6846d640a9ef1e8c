"""The name of this machine among those that share a database: the same after every restart."""

import re
import secrets
import socket
from pathlib import Path

from fvs_engine.files.atomic import write_text_atomically

_FILE = "machine"


def machine_name(root: Path) -> str:
    """The machine name stored in ``root``, generated on first use from the host name and a random suffix.

    Two machines with one name would take each other's leases, hence the suffix. The name stays when the
    host name changes.
    """
    file = root / _FILE
    try:
        return file.read_text(encoding="utf-8").strip()
    except FileNotFoundError:
        host = re.sub("[^a-z0-9-]", "-", socket.gethostname().partition(".")[0].lower())[:40]
        write_text_atomically(file, f"{host}-{secrets.token_hex(2)}")
        return machine_name(root)
