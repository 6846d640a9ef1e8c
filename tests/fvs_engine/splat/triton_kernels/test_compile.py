"""Every kernel compiles for the GPUs that are served, without a device, and stays within its registers.

The other tests run the kernels in Triton's interpreter, which takes programs that the compiler refuses. Which
of the two it shall be is asked when a kernel is defined: a process of its own compiles.
"""

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

PACKAGE = "fvs_engine.splat.triton_kernels"
ARCHITECTURES = (80, 90, 100)


@dataclass(frozen=True)
class Kernel:
    """A kernel as its launcher calls it. None may spill; ``registers`` is the most that a thread may use.

    ``types``: those of the arguments in Triton's words, in order: "*fp32", "i32", …; pointers are aligned.
    """

    name: str  # module.function
    types: str
    registers: int
    num_warps: int
    constants: dict[str, object] = field(default_factory=dict)

    def __str__(self) -> str:
        return " ".join([self.name, *(f"{key}={value}" for key, value in self.constants.items())])


KERNELS: list[Kernel] = [
    Kernel(
        "projection.project_kernel",
        "*fp32 *fp32 *fp32 *fp32 *fp32 *fp32 *fp32 i32 i32 i32 i32 *fp32 *fp32",
        registers=96,
        num_warps=4,
        constants={"DEGREE": 3, "REST": 15, "BLOCK": 128},
    ),
    Kernel(
        "colors_backward.colors_backward_kernel",
        "*fp32 *fp32 *fp32 i32 *fp32 *fp32 *fp32 *fp32 *fp32 *fp32",
        registers=104,
        num_warps=4,
        constants={"DEGREE": 3, "REST": 15, "ADD": False, "BLOCK": 128},
    ),
    Kernel(
        "projection_backward.project_backward_kernel",
        "*fp32 *fp32 *fp32 *fp32 i32 i32 i32 i32 " + "*fp32 " * 7,
        registers=104,
        num_warps=4,
        constants={"BLOCK": 128},
    ),
    Kernel(
        "squares.blend_squares_kernel",
        "*fp32 *i32 *i32 *i32 *fp32 *fp32 i32 i32 i32 i32",
        registers=80,
        num_warps=1,
    ),
    Kernel(
        "squares.square_kernel",
        "*fp32 *fp32 *fp32 *fp32 i32 i32 i32 *fp32 *fp32 *fp32 " + "*fp32 " * 5,
        registers=120,
        num_warps=4,
        constants={"DEGREE": 3, "REST": 15, "BLOCK": 128},
    ),
    Kernel(
        "sums.sum_hits_kernel",
        "*fp32 *i64 *i64 *fp32 i32 i32 i32",
        registers=104,
        num_warps=1,
        constants={"COLUMNS": 10, "SPLATS": 16, "LANES": 2},
    ),
    Kernel(
        "photometric.ssim_rows",
        "*fp32 *u8 *fp32 i32 i32 *fp32 *fp32",
        168,
        4,
        {"MASKED": False, "LANES": 128, "ROWS": 32},
    ),
    Kernel(
        "photometric.gradient_rows",
        "*fp32 *u8 *fp32 i32 i32 *fp32 fp32 fp32 *fp32 *fp32",
        96,
        4,
        {"MASKED": False, "LANES": 128, "ROWS": 32},
    ),
    Kernel(
        "photometric.ssim_rows",
        "*fp32 *u8 *fp32 i32 i32 *fp32 *fp32",
        168,
        4,
        {"MASKED": True, "LANES": 128, "ROWS": 32},
    ),
    Kernel(
        "photometric.gradient_rows",
        "*fp32 *u8 *fp32 i32 i32 *fp32 fp32 fp32 *fp32 *fp32",
        96,
        4,
        {"MASKED": True, "LANES": 128, "ROWS": 32},
    ),
    Kernel(
        "photometric.loss_of_sums",
        "*fp32 i32 fp32 fp32 fp32 *fp32 *i32",
        64,
        4,
        {"GUARDED": True, "SUMS": 1024},
    ),
    Kernel(
        "adam.adam",
        "*fp32 *fp32 *fp32 *fp32 *fp32 *i32 i32 i32 fp32 fp32 fp32 fp32 fp32",
        96,
        4,
        {"WIDTH": 1, "SPARSE": False, "BLOCK": 1024},
    ),
    Kernel(
        "adam.adam",
        "*fp32 *fp32 *fp32 *fp32 *fp32 *i32 i32 i32 fp32 fp32 fp32 fp32 fp32",
        96,
        4,
        {"WIDTH": 45, "SPARSE": True, "BLOCK": 1024},
    ),
    Kernel("adam.gradient_norms", "*fp32 *fp32 *fp32 *fp32 *i32 i32 i32 fp32 fp32", 96, 4, {"BLOCK": 1024}),
    Kernel("median.clamped_planes", "*fp32 *fp64 i32 i32", 64, 4, {"BLOCK": 1024}),
    Kernel(
        "median.count_digits",
        "*fp64 *i32 *i32 *i32 i32 i32 i32 i32 i32",
        96,
        4,
        {"FIRST": True, "EDGE_COLUMNS": 1, "BINS": 256, "BLOCK": 1024},
    ),
    Kernel(
        "median.count_digits",
        "*fp64 *i32 *i32 *i32 i32 i32 i32 i32 i32",
        96,
        4,
        {"FIRST": True, "EDGE_COLUMNS": 2, "BINS": 256, "BLOCK": 1024},
    ),
    Kernel(
        "median.count_digits",
        "*fp64 *i32 *i32 *i32 i32 i32 i32 i32 i32",
        96,
        4,
        {"FIRST": False, "EDGE_COLUMNS": 1, "BINS": 512, "BLOCK": 1024},
    ),
    Kernel(
        "median.count_digits",
        "*fp64 *i32 *i32 *i32 i32 i32 i32 i32 i32",
        96,
        4,
        {"FIRST": False, "EDGE_COLUMNS": 2, "BINS": 512, "BLOCK": 1024},
    ),
    Kernel("median.find_digits", "*i32 *i32 *i32 i32 i32 i32 i32", 64, 4, {"FIRST": True, "BINS": 256}),
    Kernel("median.find_digits", "*i32 *i32 *i32 i32 i32 i32 i32", 64, 4, {"FIRST": False, "BINS": 512}),
    Kernel("binning._count_hits", "*fp32 *fp32 *i64 *i32 i32 i32 i32 i32", 32, 4, {"BLOCK": 256}),
    Kernel(
        "binning._deal_hits",
        "*fp32 *i64 *i64 *i16 *i32 i32 i32 i32 i32 i32 i32 i32 *i32",
        72,
        2,
        {"BLOCK": 256},
    ),
    Kernel("binning._list_hits", "*i64 *i32 *i32 *i32 i32 i32", 32, 4, {"BLOCK": 256}),
    # 64 registers let 32 blocks of one warp, all that a multiprocessor takes, run at once.
    Kernel("blending._blend", "*fp32 *i32 *i32 *fp32 *fp32 i32 i32 i32 i32 *fp32", 64, 1),
    Kernel("blending._blend", "*fp32 *i32 *i32 *fp32 *fp32 i32 i32 i32 i32", 64, 1, {"depth_image": None}),
    Kernel(
        "blending_backward._blend_backward",
        "*fp32 *i32 *i32 *i32 *fp32 *fp32 *fp32 i32 i32 i32 i32 *fp32 *fp32 *fp32 *fp32",
        80,
        1,
    ),
    Kernel(
        "blending_backward._blend_backward",
        "*fp32 *i32 *i32 *i32 *fp32 *fp32 *fp32 i32 i32 i32 i32",
        72,
        1,
        dict.fromkeys(("alpha_image", "alpha_gradient", "depth_image", "depth_gradient")),
    ),
    Kernel("blending_backward._clear_missed", "*i32 *i32 *i64 *fp32 i32 i32 i32 i32", 32, 4, {"BLOCK": 64}),
]


@cache
def compiled() -> dict[str, dict[str, int]]:
    """What a process without the interpreter prints: "kernel, architecture" → registers and stack."""
    environment = {key: value for key, value in os.environ.items() if key != "TRITON_INTERPRET"}
    environment["TRITON_DEFAULT_FP_FUSION"] = "1"  # as it was before there was this choice
    child = [sys.executable, __file__]
    printed = subprocess.run(child, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout
    return json.loads(printed)


@pytest.mark.process
@pytest.mark.system
@pytest.mark.parametrize("kernel", KERNELS, ids=str)
def test_compiles_without_spills_within_its_registers(kernel):
    for architecture in ARCHITECTURES:
        found = compiled()[f"{kernel}, {architecture}"]
        assert found["STACK"] == found["LOCAL"] == 0, f"sm_{architecture} spills: {found}"
        assert found["REG"] <= kernel.registers, f"sm_{architecture}"


def _compile(kernel: Kernel, architecture: int) -> dict[str, int]:
    import triton
    from triton.backends.compiler import GPUTarget
    from triton.compiler import ASTSource

    module, function = kernel.name.split(".")
    jitted = getattr(import_module(f"{PACKAGE}.{module}"), function)
    types = dict(zip(jitted.arg_names, kernel.types.split(), strict=False))
    signature = types | dict.fromkeys(kernel.constants, "constexpr")
    assert list(signature) == jitted.arg_names, f"{kernel.name}{tuple(jitted.arg_names)}"
    aligned = {(i,): [["tt.divisibility", 16]] for i, kind in enumerate(types.values()) if kind[0] == "*"}
    source = ASTSource(jitted, signature, kernel.constants, aligned)
    target = GPUTarget("cuda", architecture, 32)
    binary = triton.compile(source, target=target, options={"num_warps": kernel.num_warps}).asm["cubin"]
    return _resources(binary)


def _resources(binary: bytes) -> dict[str, int]:
    """Registers of a thread, and bytes of its stack and of shared memory, as the toolkit's own tool says."""
    import triton.backends.nvidia

    tool = Path(triton.backends.nvidia.__file__).parent / "bin" / "cuobjdump"
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(binary)
        file.flush()
        said = subprocess.run(
            [tool, "--dump-resource-usage", file.name], check=True, capture_output=True, text=True
        ).stdout
    words = [
        word.split(":") for word in said.split() if word.startswith(("REG:", "STACK:", "SHARED:", "LOCAL:"))
    ]
    return {name: int(value) for name, value in words}


if __name__ == "__main__":
    wanted = sys.argv[1:]  # parts of names; all kernels without
    chosen = [kernel for kernel in KERNELS if not wanted or any(part in str(kernel) for part in wanted)]
    sys.stdout.write(
        json.dumps({f"{k}, {a}": _compile(k, a) for k in chosen for a in ARCHITECTURES}, indent=1)
    )
