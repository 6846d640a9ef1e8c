"""The systemd unit that keeps a spool running."""

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from string import Template


def systemd_unit(command: Sequence[str], folder: Path, writable: Sequence[Path]) -> str:
    """A unit that runs ``command`` for the photographs in ``folder``, and may write only to ``writable``."""
    template = files("fvs_client.spool").joinpath("fvs-spool.service").read_text(encoding="utf-8")
    return Template(template).substitute(
        FOLDER=_plain(str(folder)),
        MOUNT=_quoted(str(folder)),
        COMMAND=" ".join(_quoted(argument, in_command=True) for argument in command),
        WRITABLE=" ".join(_quoted(str(path)) for path in dict.fromkeys(writable)),
    )


def _plain(text: str) -> str:
    return text.replace("%", "%%").replace("\n", " ")


def _quoted(text: str, *, in_command: bool = False) -> str:
    """Quote for systemd.syntax(7), where % begins a specifier, and in a command $ a variable."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("\n", "\\n")
    return f'"{escaped.replace("$", "$$") if in_command else escaped}"'
