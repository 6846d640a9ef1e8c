"""Generate the service's Python code from the protos, in `services/fvs/v1`: messages, their types, stubs.

The protos' package is its path, so that its imports are right as they come.

``--check`` writes nothing and exits with 1 when a generated file is not current, when `buf` finds a fault of
form or style, or when the protos break callers of the released contract, `proto/released.binpb`, or that is
missing.

``--release`` writes the released contract too. Run it when a version is released, and never to silence the
check: what it holds, callers have.
"""

import argparse
import subprocess
import sys
import tempfile
from importlib.resources import files
from pathlib import Path

PROTO = Path(__file__).resolve().parent
CODE = PROTO.parent / "services"
RELEASED = PROTO / "released.binpb"
PACKAGE = "fvs/v1"
BUF = Path(sys.executable).parent / "buf"


def generate(folder: Path) -> dict[Path, bytes]:
    """Generate everything below ``folder``: content by the path it belongs to."""
    command = [
        *(sys.executable, "-m", "grpc_tools.protoc"),
        f"--proto_path={PROTO}",
        f"--proto_path={files('grpc_tools') / '_proto'}",
        *(f"--{kind}_out={folder}" for kind in ("python", "pyi", "grpc_python")),
        *(str(path) for path in sorted((PROTO / PACKAGE).glob("*.proto"))),
    ]
    subprocess.run(command, check=True)
    return {CODE / path.relative_to(folder): path.read_bytes() for path in (folder / PACKAGE).iterdir()}


def outdated(generated: dict[Path, bytes]) -> list[Path]:
    """The files that differ from ``generated``, are missing, or have no source."""
    present = {path: path.read_bytes() for path in (CODE / PACKAGE).glob("*_pb2*")}
    return sorted(
        path for path in generated.keys() | present.keys() if generated.get(path) != present.get(path)
    )


def _faults() -> int:
    """Lint the protos and compare them with the released ones: the number of checks that failed."""
    checks = (
        ["format", "--diff", "--exit-code"],
        ["lint"],
        ["breaking", "--against", RELEASED.name],  # fails, too, when there is no such file
    )
    return sum(subprocess.run([BUF, *check], cwd=PROTO, check=False).returncode != 0 for check in checks)


def _release() -> None:
    """Make the protos the released contract."""
    command = [BUF, "build", "--exclude-source-info", "--output", RELEASED.name]
    subprocess.run(command, cwd=PROTO, check=True)


def main() -> int:
    """Write the generated files, or check them and the protos."""
    parser = argparse.ArgumentParser(description=__doc__)
    modes = parser.add_mutually_exclusive_group()
    modes.add_argument("--check", action="store_true", help="write nothing; exit with 1 when outdated")
    modes.add_argument("--release", action="store_true", help="write the released contract, too")
    given = parser.parse_args()
    check: bool = given.check
    with tempfile.TemporaryDirectory() as folder:
        generated = generate(Path(folder))
    paths = outdated(generated)
    for path in paths:
        if check:
            print(f"{path} is not current: run `make generate`.", file=sys.stderr)  # noqa: T201
        elif path in generated:
            path.write_bytes(generated[path])
        else:
            path.unlink()
    if given.release:
        _release()
    return 1 if check and (_faults() or paths) else 0


if __name__ == "__main__":
    sys.exit(main())
