"""The folder of the GPU slots, which the runners of a machine's user share (``runner.gpu_slots``)."""

from pathlib import Path

from fvs_engine.files.private_folder import private_folder


def gpu_slots_folder() -> Path:
    """The folder; raises ``StorageError`` when it cannot be used."""
    return private_folder("fvs-gpu-slots")
