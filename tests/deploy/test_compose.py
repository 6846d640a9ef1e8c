"""The deployment's files agree with each other and with the service's settings and metrics."""

import importlib
import json
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import pytest
import typer
import yaml
from fvs_service.environment import variables_of
from fvs_service.jobs.fleet_metrics import FleetCollector
from fvs_service.settings import Settings
from fvs_service.storage.database import Database
from fvs_service.telemetry import Metrics

from fvs_engine.cli.app import app

_REPOSITORY = Path(__file__).resolve().parents[2]
Compose = dict[str, Any]

_FILES = (_REPOSITORY / "docker-compose.yml", _REPOSITORY / "deploy" / "cluster" / "compose.yml")
_COMPOSE: dict[str, dict[str, Any]] = {
    file.parent.name if file.parent.name == "cluster" else "machine": yaml.safe_load(file.read_text("utf-8"))
    for file in _FILES
}
_SERVICES = {
    f"{which}-{name}": service
    for which, compose in _COMPOSE.items()
    for name, service in compose["services"].items()
}
_OURS = {name: service for name, service in _SERVICES.items() if service["image"].startswith("fvs:")}
_SUFFIXES = ("_total", "_bucket", "_sum", "_count")


@pytest.mark.process
@pytest.mark.parametrize("file", [*_FILES, _REPOSITORY / "deploy" / "cuda.yml"], ids=str)
def test_files_are_valid(file: Path) -> None:
    check = (sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec")
    subprocess.run([*check, file], check=True)


@pytest.mark.parametrize("service", _OURS.values(), ids=_OURS)
def test_variables_are_settings(service: Compose) -> None:
    ours = {variable for variable in service.get("environment", {}) if variable.startswith("FVS_")}
    assert {variable.removesuffix("_FILE") for variable in ours} <= set(variables_of(Settings))


@pytest.mark.parametrize("service", _OURS.values(), ids=_OURS)
def test_commands_exist(service: Compose) -> None:
    words = [*service.get("entrypoint", ()), *service["command"]]
    if words[0] == "ray":
        known = importlib.import_module("ray.scripts.scripts").cli.commands[words[1]]
    else:
        known = cast("Any", typer.main.get_command(app)).commands[words[0]]
    options = {
        option for parameter in known.params for option in (*parameter.opts, *parameter.secondary_opts)
    }
    assert {word.partition("=")[0] for word in words if word.startswith("--")} <= options


@pytest.mark.parametrize("compose", _COMPOSE.values(), ids=_COMPOSE)
def test_every_secret_is_made_and_every_reference_exists(compose: Compose) -> None:
    made = (_REPOSITORY / "deploy" / "make_secrets.sh").read_text(encoding="utf-8")
    folder = _folder(compose)
    for name, secret in compose["secrets"].items():
        assert (folder / secret["file"]).resolve() == _REPOSITORY / "deploy" / "secrets" / name
        assert f"make {name} " in made
    for service in compose["services"].values():
        assert set(service.get("secrets", ())) <= set(compose["secrets"])
        for value in map(str, service.get("environment", {}).values()):
            if value.startswith("/run/secrets/"):
                assert value.removeprefix("/run/secrets/") in service["secrets"]
        for volume in service.get("volumes", ()):
            source = volume.partition(":")[0]
            assert source.startswith("/") or source in compose["volumes"] or (folder / source).exists()
        assert set(service.get("depends_on", ())) <= set(compose["services"])


@pytest.mark.parametrize("name", _SERVICES)
def test_containers_are_confined_and_watched(name: str) -> None:
    service = _SERVICES[name]
    assert service["read_only"]
    assert service["cap_drop"] == ["ALL"]
    assert service.get("cap_add", []) == (["NET_BIND_SERVICE"] if name.endswith("-proxy") else [])
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["image"].startswith("fvs:") or service["user"]
    assert {"mem_limit", "pids_limit", "healthcheck"} <= set(service)


@pytest.mark.process
def test_other_users_of_the_machine_cannot_read_secrets(tmp_path: Path) -> None:
    shutil.copy(_REPOSITORY / "deploy" / "make_secrets.sh", tmp_path)
    secrets = tmp_path / "secrets"
    secrets.mkdir(0o755)  # as an earlier version of the script made it
    for _ in range(2):
        subprocess.run(["sh", tmp_path / "make_secrets.sh"], check=True)
        assert stat.S_IMODE(secrets.stat().st_mode) == 0o700
        # The users of the containers are others than the owner.
        assert {stat.S_IMODE(file.stat().st_mode) for file in secrets.iterdir()} == {0o644}
    assert {file.name for file in secrets.iterdir()} == {
        name for compose in _COMPOSE.values() for name in compose["secrets"]
    }


def test_ports_match() -> None:
    prometheus = yaml.safe_load(
        (_REPOSITORY / "deploy/prometheus/prometheus.yml").read_text(encoding="utf-8")
    )
    (scraped,) = prometheus["scrape_configs"][0]["dns_sd_configs"]
    (exposed,) = re.findall(
        r"^EXPOSE (.*)$", (_REPOSITORY / "Dockerfile").read_text(encoding="utf-8"), re.MULTILINE
    )
    for which, name in (("machine", "fvs"), ("cluster", "gateway")):
        services = _COMPOSE[which]["services"]
        service, proxy = services[name], services["proxy"]["environment"]
        ports = [service["environment"][f"FVS_{port}"] for port in ("PORT", "GRPC_PORT")]
        assert exposed.split() == ports
        assert [proxy["PROXY_REST"], proxy["PROXY_GRPC"]] == [f"{name} {port}" for port in ports]
        assert f":{ports[0]}/livez" in service["healthcheck"]["test"]
        aliases = service.get("networks", {}).get("default", {}).get("aliases", [name])
        assert (scraped["names"], str(scraped["port"])) == (aliases, ports[0])
    services = _COMPOSE["cluster"]["services"]
    store, url = services["store"]["command"], services["gateway"]["environment"]["FVS_BLOBS__ENDPOINT"]
    assert f"-s3.port={url.rpartition(':')[2]}" in store


def test_alerts_and_dashboards_ask_for_metrics_that_exist(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path / 'fvs.sqlite3'}")
    database.migrate()
    families = [*Metrics().registry.collect(), *FleetCollector(database, tmp_path, lambda: None).collect()]
    database.close()
    known = {family.name for family in families}
    files = (_REPOSITORY / "deploy/prometheus/alerts.yml", _REPOSITORY / "deploy/grafana/dashboards/fvs.json")
    for file in files:
        asked = set(re.findall(r"\bfvs_[a-z_]+", file.read_text(encoding="utf-8")))
        assert asked
        assert {_family(name) for name in asked} <= known
    panels = json.loads(files[1].read_text(encoding="utf-8"))["panels"]
    assert len({panel["title"] for panel in panels}) == len(panels)


def _folder(compose: Compose) -> Path:
    """What its paths are relative to."""
    return next(
        file.parent for file, known in zip(_FILES, _COMPOSE.values(), strict=True) if known is compose
    )


def _family(name: str) -> str:
    for suffix in _SUFFIXES:
        name = name.removesuffix(suffix)
    return name
