"""The CUDA device that the backends of GPUs run on, and why there is none."""

import os
import threading
from typing import Any

import torch

from fvs_engine.errors import BackendUnavailableError


def cuda_device() -> torch.device:
    """The current CUDA device, where Triton has made ready to launch kernels; in its interpreter the CPU.

    Raises ``BackendUnavailableError`` where its kernels cannot run.
    """
    if os.environ.get("TRITON_INTERPRET") == "1":
        return torch.device("cpu")
    other = "ROCm" if torch.version.hip else "Intel GPUs" if torch.xpu.is_available() else None
    if other is not None:
        raise BackendUnavailableError(
            f"The backends of GPUs were never tried on {other}.", hint="Use the backend 'cpu'."
        )
    if not torch.cuda.is_available():
        raise BackendUnavailableError(
            "The backends of GPUs need a CUDA device that PyTorch can use.",
            hint="See what torch.cuda.is_available() warns of (a driver too old for this PyTorch, or its CPU "
            "build), or use the backend 'cpu'.",
        )
    try:
        import triton
    except ModuleNotFoundError as error:
        raise BackendUnavailableError(
            "The backends of GPUs need the package triton.",
            hint="PyTorch's CUDA builds for Linux bring it; or use the backend 'cpu'.",
        ) from error
    try:
        triton.runtime.driver.active.get_current_target()  # compiles what launches kernels
    except Exception as error:  # whatever the compiler and the driver raise
        raise BackendUnavailableError(
            f"Triton cannot use the CUDA device: {error}",
            hint="It needs a C compiler and Python's headers (Debian: gcc libc6-dev python3-dev), or use the "
            "backend 'cpu'.",
        ) from error
    load_kernels_one_at_a_time()
    return torch.device("cuda")


def load_kernels_one_at_a_time() -> None:
    """Let no thread launch a kernel that another one is just loading onto the device.

    Triton shows how to launch a kernel before it has its function, for as long as the driver loads that. A
    thread that comes meanwhile launches None: a ranking, say, beside a training (triton-lang/triton#11518).
    """
    from triton.compiler import CompiledKernel

    CompiledKernel.run = property(_loaded)


_loading = threading.RLock()


def _loaded(kernel: Any) -> Any:
    """What launches a kernel: ``CompiledKernel.run``."""
    if kernel.function is None:
        with _loading:
            kernel._init_handles()  # returns at once where another thread has loaded it
    return kernel._run
