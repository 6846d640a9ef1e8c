"""Generate the synchronous client (``fvs_client/_sync``) from the asynchronous one (``fvs_client/_async``).

``--check`` writes nothing and exits with 1 when a generated file is not current. ``concurrency.py`` differs
between the two and is written by hand.
"""

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import unasync

PACKAGE = Path(__file__).resolve().parent / "python" / "fvs_client"
SOURCE, TARGET = PACKAGE / "_async", PACKAGE / "_sync"
BY_HAND = "concurrency.py"
HEADER = "# Generated from _async/{name} by `make generate`. Do not edit.\n"
REPLACEMENTS = {
    "_async": "_sync",
    "aclose": "close",
    "aiter": "iter",
    "aiter_raw": "iter_raw",
    "anext": "next",
    "aread": "read",
}


def generate(folder: Path) -> dict[str, str]:
    """Translate every file of ``SOURCE``, using ``folder`` for scratch files: content by file name."""
    sources = {path.name: path.read_text("utf-8") for path in SOURCE.glob("*.py") if path.name != BY_HAND}
    names = {name for source in sources.values() for name in re.findall(r"\b_?Async[A-Z]\w*", source)}
    renamed = {name: name.replace("Async", "", 1) for name in names}
    scratch, result = folder / "fvs_client" / "_async", folder / "fvs_client" / "_sync"
    scratch.mkdir(parents=True)
    (folder / "fvs_client" / "__init__.py").touch()  # ruff sorts imports by what the package is
    for name, source in sources.items():
        (scratch / name).write_text(HEADER.format(name=name) + source, "utf-8")
    rule = unasync.Rule(str(scratch), str(result), {**renamed, **REPLACEMENTS})
    unasync.unasync_files([str(scratch / name) for name in sources], [rule])
    shutil.copy(PACKAGE.parents[2] / "pyproject.toml", folder)  # ruff's settings
    for command in (["check", "--select", "I", "--fix"], ["format"]):
        subprocess.run([sys.executable, "-m", "ruff", *command, "--quiet", "--no-cache", result], check=True)
    return {name: (result / name).read_text("utf-8") for name in sources}


def outdated(generated: dict[str, str]) -> list[str]:
    """Names of the files in ``TARGET`` that differ from ``generated``, are missing, or have no source."""
    present = {path.name: path.read_text("utf-8") for path in TARGET.glob("*.py") if path.name != BY_HAND}
    return sorted(
        name for name in generated.keys() | present.keys() if generated.get(name) != present.get(name)
    )


def main() -> int:
    """Write the generated files, or check them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 when outdated")
    check = parser.parse_args().check
    with tempfile.TemporaryDirectory() as folder:
        generated = generate(Path(folder))
    names = outdated(generated)
    for name in names:
        if check:
            print(f"{TARGET / name} is not current: run `make generate`.", file=sys.stderr)  # noqa: T201
        elif name in generated:
            (TARGET / name).write_text(generated[name], "utf-8")
        else:
            (TARGET / name).unlink()
    return 1 if check and names else 0


if __name__ == "__main__":
    sys.exit(main())
