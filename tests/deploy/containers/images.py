"""Images without a registry: bases of Debian's packages under the names that Dockerfiles ask for."""

import configparser
import re
import shutil
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[3]
_HERE = Path(__file__).parent
_BASES = ("docker.io/library/python:3.11-slim-bookworm", "docker.io/library/debian:bookworm-slim")
_INCLUDED = "ca-certificates,python-is-python3,python3,python3-pip,python3-venv"
_STAND_INS = {
    "caddy": "docker.io/library/caddy:2.10",
    "postgres": "docker.io/library/postgres:15-bookworm",
    "prometheus": "docker.io/prom/prometheus:v3.5.0",
    "seaweedfs": "docker.io/chrislusf/seaweedfs:4.48",
}


class Images:
    """The images of the project and of what it runs beside, in the store that the environment names.

    The builds use this machine's settings of apt and pip: ``folder`` has copies of them.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def build(self, *targets: str) -> None:
        """Build the bases, the stand-ins, and these targets of the Dockerfile as ``fvs:target``."""
        if not _exists(_BASES[0]):
            self._bootstrap()
        volumes = self._volumes()
        for name, tag in _STAND_INS.items():
            _build(volumes, tag, _HERE / f"{name}.Dockerfile", _HERE)
        for target in targets:
            tag = f"docker.io/library/fvs:{target}"
            _build(["--target", target, *volumes], tag, REPOSITORY / "Dockerfile", REPOSITORY)

    def _bootstrap(self) -> None:
        archive = self._folder / "base.tar"
        sources = sorted(map(str, Path("/etc/apt").glob("sources.list*/**/*.sources")))
        _run(
            "mmdebstrap",
            "--quiet",
            "--variant=minbase",
            "--hook-dir=/usr/share/mmdebstrap/hooks/merged-usr",
            f"--include={_INCLUDED}",
            *(f"--dpkgopt=path-exclude=/usr/share/{what}/*" for what in ("doc", "locale", "man")),
            "bookworm",
            str(archive),
            *sources,
        )
        image = _run("podman", "import", "--quiet", str(archive)).strip()
        _run("podman", "tag", image, *_BASES)
        archive.unlink()

    def _volumes(self) -> list[str]:
        settings = self._folder / "settings"
        shutil.rmtree(settings, ignore_errors=True)
        shutil.copytree("/etc/apt", settings / "apt")
        shutil.copytree("/etc/ssl/certs", settings / "certs", ignore_dangling_symlinks=True)
        pip = configparser.RawConfigParser()
        for line in _run(sys.executable, "-m", "pip", "config", "list").splitlines():
            name, _, value = line.partition("=")
            section, _, option = name.replace(":env:", "global").rpartition(".")
            if not pip.has_section(section):
                pip.add_section(section)
            pip.set(section, option, value.strip("'").replace("\\n", "\n"))
        with (settings / "pip.conf").open("w", encoding="utf-8") as file:
            pip.write(file)
        mounts = {
            settings / "apt": "/etc/apt",
            settings / "certs": "/etc/ssl/certs",
            settings / "pip.conf": "/etc/pip.conf",
        }
        # Packages that lie on this machine, and lists of versions. An index on disk names files beside it.
        text = (settings / "pip.conf").read_text(encoding="utf-8")
        paths = [Path(path).parent for path in re.findall(r"file://(/\S+)", text)]
        paths += [Path(path) for path in re.findall(r"(?:^|[\s=])(/\S+)", text)]
        mounts |= {path: str(path) for path in paths if path.exists() and "ssl" not in path.parts}
        return [word for source, target in mounts.items() for word in ("--volume", f"{source}:{target}")]


def _build(options: list[str], tag: str, file: Path, context: Path) -> None:
    print(f"Building {tag}", flush=True)
    fixed = ("--isolation", "chroot", "--pull-never", "--layers", "--tag", tag, "--file", str(file))
    _run("buildah", "build", *fixed, *options, str(context))


def _exists(tag: str) -> bool:
    return subprocess.run(["podman", "image", "exists", tag]).returncode == 0


def _run(*command: str) -> str:
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stdout[-4000:]}")
    return done.stdout
