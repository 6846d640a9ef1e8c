"""Folders that the user names."""

from pathlib import Path

from fvs_engine.errors import InvalidInputError


def require_folder(folder: Path, hint: str) -> None:
    """Raise ``InvalidInputError`` with ``hint`` when ``folder`` is missing, or is no folder."""
    if not folder.exists():
        raise InvalidInputError(f"The folder {folder} does not exist.", hint=hint, path=folder)
    if not folder.is_dir():
        raise InvalidInputError(f"{folder} is not a folder.", hint=hint, path=folder)
