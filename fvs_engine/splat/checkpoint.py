"""Checkpoints: the whole training state, in one safetensors file (no pickle)."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from fvs_engine.errors import StorageError
from fvs_engine.files.atomic import replacing

FORMAT = "fvs-training-1"


def write_checkpoint(path: Path, tensors: Mapping[str, Tensor], state: Mapping[str, Any]) -> None:
    """Write tensors and JSON-serialisable state; the file appears whole or not at all.

    Raises ``StorageError`` when it cannot be written; an earlier checkpoint is then still there.
    """
    stored = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with replacing(path) as temporary:
        try:
            save_file(stored, temporary, {"format": FORMAT, "state": json.dumps(state)})
        except SafetensorError as error:
            raise OSError(str(error)) from error


def read_checkpoint(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read what ``write_checkpoint`` wrote.

    Raises ``StorageError`` when the file is missing, damaged, or not a checkpoint.
    """
    with _opened(path) as (file, state):
        return {name: file.get_tensor(name) for name in file.keys()}, state  # noqa: SIM118


def read_checkpoint_state(path: Path) -> dict[str, Any]:
    """Read the state alone, without the tensors; raises as ``read_checkpoint``."""
    with _opened(path) as (_, state):
        return state


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, dict[str, Any]]]:
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            if metadata.get("format") != FORMAT:
                raise StorageError(
                    f"{path} is not a training checkpoint of this version.",
                    hint="Train again: delete it, or start again with --overwrite.",
                    path=path,
                )
            yield file, json.loads(metadata["state"])
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        raise StorageError(
            f"{path} cannot be read as a checkpoint: {error}", hint="Delete it and train again.", path=path
        ) from error
