"""Builds the console: the types of the service's interface, and the page that the service sends, compressed.

With ``--check`` it fails when what is checked in differs from what the sources make.
"""

import gzip
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from fvs_service.host.worker.runners import LeasedRunners
from fvs_service.serving.rest_app import create_app
from fvs_service.settings import Settings

WEB = Path(__file__).parent
TYPES = WEB / "src" / "api" / "schema.d.ts"
BUILT = WEB.parent.parent / "services" / "fvs_service" / "console" / "built"


def main() -> None:
    """Build in place, or check."""
    with tempfile.TemporaryDirectory() as folder:
        types, page = Path(folder, TYPES.name), Path(folder, "built")
        _write_types(Path(folder, "openapi.json"), types)
        check = "--check" in sys.argv[1:]
        if not check:
            shutil.copy(types, TYPES)
        _npx("vite", "build", "--logLevel", "warn", "--outDir", str(page))
        made = {f"{path.relative_to(page)}.gz": path.read_bytes() for path in page.rglob("*.*")}
        kept = {str(path.relative_to(BUILT)): path for path in BUILT.rglob("*.gz")}
        # By content: other versions of zlib compress otherwise.
        stale = sorted(
            name
            for name in made.keys() | kept.keys()
            if name not in kept or gzip.decompress(kept[name].read_bytes()) != made.get(name)
        )
        if check:
            if types.read_bytes() != TYPES.read_bytes():
                stale.append(TYPES.name)
            if stale:
                raise SystemExit(f"Run make generate: these differ from their sources: {', '.join(stale)}")
            return
        for name in stale:
            if name in made:
                BUILT.joinpath(name).parent.mkdir(parents=True, exist_ok=True)
                BUILT.joinpath(name).write_bytes(gzip.compress(made[name], mtime=0))
            else:
                kept[name].unlink()


def _write_types(document: Path, types: Path) -> None:
    document.write_text(json.dumps(create_app(Settings(), LeasedRunners).openapi()))
    _npx("openapi-typescript", str(document), "--output", str(types))


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
