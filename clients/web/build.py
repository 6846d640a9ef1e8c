"""Builds the console: the types of the service's interface, and the page that the service sends.

With ``--check`` it fails when what is checked in differs from what the sources make.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from fvs_service.serving.rest_app import create_app
from fvs_service.settings import Settings

WEB = Path(__file__).parent
TYPES = WEB / "src" / "api" / "schema.d.ts"
BUILT = WEB.parent.parent / "services" / "fvs_service" / "console" / "built"


def main() -> None:
    """Build in place, or check."""
    check = "--check" in sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        types = Path(folder, TYPES.name) if check else TYPES
        built = Path(folder, "built") if check else BUILT
        _write_types(Path(folder, "openapi.json"), types)
        _npx("vite", "build", "--logLevel", "warn", "--outDir", str(built), "--emptyOutDir")
        if check:
            stale = [] if _same(types, TYPES) else [str(TYPES)]
            stale += _differences(built, BUILT)
            if stale:
                raise SystemExit(f"Run make generate: these differ from their sources: {', '.join(stale)}")


def _write_types(document: Path, types: Path) -> None:
    def no_runners(*_: Any) -> Any:
        raise NotImplementedError  # an application that only describes itself starts none

    document.write_text(json.dumps(create_app(Settings(), no_runners).openapi()))
    _npx("openapi-typescript", str(document), "--output", str(types))


def _differences(made: Path, checked_in: Path) -> list[str]:
    names = {
        path.relative_to(folder)
        for folder in (made, checked_in)
        for path in folder.rglob("*")
        if path.is_file()
    }
    return [str(checked_in / name) for name in sorted(names) if not _same(made / name, checked_in / name)]


def _same(one: Path, other: Path) -> bool:
    return one.is_file() and other.is_file() and one.read_bytes() == other.read_bytes()


def _npx(*command: str) -> None:
    programs = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    done = subprocess.run(
        ["npx", "--no-install", *command],
        cwd=WEB,
        env={**os.environ, "PATH": programs},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")


if __name__ == "__main__":
    main()
