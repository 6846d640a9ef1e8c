"""The deployment's files agree with each other and with the service's settings and metrics."""

import json
import re
import shutil
import stat
import subprocess
from pathlib import Path
from typing import Any

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
_COMPOSE: dict[str, Any] = yaml.safe_load((_REPOSITORY / "docker-compose.yml").read_text(encoding="utf-8"))
_OURS = ("gateway",)
_SUFFIXES = ("_total", "_bucket", "_sum", "_count")


@pytest.mark.parametrize("name", _OURS)
def test_variables_are_settings(name: str) -> None:
    named = {variable.removesuffix("_FILE") for variable in _COMPOSE["services"][name]["environment"]}
    assert named <= set(variables_of(Settings))


@pytest.mark.parametrize("name", _OURS)
def test_commands_exist(name: str) -> None:
    service = _COMPOSE["services"][name]
    words = service["command"]
    command: Any = typer.main.get_command(app).commands[words[0]]
    options = {option for parameter in command.params for option in parameter.opts}
    assert {word for word in words if word.startswith("--")} <= options


def test_every_secret_is_made_and_every_reference_exists() -> None:
    made = (_REPOSITORY / "deploy" / "make_secrets.sh").read_text(encoding="utf-8")
    for name, secret in _COMPOSE["secrets"].items():
        assert secret["file"] == f"deploy/secrets/{name}"
        assert f"make {name} " in made
    for service in _COMPOSE["services"].values():
        assert set(service.get("secrets", ())) <= set(_COMPOSE["secrets"])
        for value in map(str, service.get("environment", {}).values()):
            if value.startswith("/run/secrets/"):
                assert value.removeprefix("/run/secrets/") in service["secrets"]
        for volume in service.get("volumes", ()):
            source = volume.partition(":")[0]
            assert source.startswith("/") or source in _COMPOSE["volumes"] or (_REPOSITORY / source).exists()


@pytest.mark.parametrize("name", _COMPOSE["services"])
def test_containers_are_confined_and_watched(name: str) -> None:
    service = _COMPOSE["services"][name]
    assert service["read_only"]
    assert name in _OURS or service["user"]
    assert "healthcheck" in service or name == "bucket"  # which ends at once


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
    assert {file.name for file in secrets.iterdir()} == set(_COMPOSE["secrets"])


def test_ports_match() -> None:
    gateway, settings = _COMPOSE["services"]["gateway"], _COMPOSE["services"]["gateway"]["environment"]
    published = {port.rpartition(":")[2] for port in gateway["ports"]}
    assert published == {settings["FVS_PORT"], settings["FVS_GRPC_PORT"]}
    assert f":{settings['FVS_PORT']}/livez" in gateway["healthcheck"]["test"][-1]
    prometheus = yaml.safe_load(
        (_REPOSITORY / "deploy/prometheus/prometheus.yml").read_text(encoding="utf-8")
    )
    (scraped,) = prometheus["scrape_configs"][0]["dns_sd_configs"]
    assert (scraped["names"], str(scraped["port"])) == (["gateway"], settings["FVS_PORT"])
    store, url = _COMPOSE["services"]["store"]["command"], settings["FVS_BLOBS__ENDPOINT"]
    assert f"-s3.port={url.rpartition(':')[2]}" in store
    exposed = re.findall(
        r"^EXPOSE (.*)$", (_REPOSITORY / "Dockerfile").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert [set(ports.split()) for ports in exposed] == [published]


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


def _family(name: str) -> str:
    for suffix in _SUFFIXES:
        name = name.removesuffix(suffix)
    return name
