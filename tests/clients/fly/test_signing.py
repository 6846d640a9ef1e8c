"""Signed links, and clients without the key."""

import socket
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from flights import begin
from fvs_client import Client
from fvs_client.cli.app import app
from fvs_client.fly.dialects import ARDUPILOT
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.survey import Survey
from fvs_client.fly.vehicle import Vehicle
from typer.testing import CliRunner

from fvs_engine.lab.simulate.mavlink.autopilot import Setup
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.signing import sign_by

pytestmark = pytest.mark.process

KEY = sha256(b"yard").digest()
SURVEY = Survey(47.3769, 8.5417, radius_m=25.0, height_m=12.0, target_height_m=5.0, count=3)


def test_a_vehicle_that_signs_is_flown_with_its_key(simulated: Any) -> None:
    with simulated(setup=Setup(signing_key=KEY)) as simulator:
        with Vehicle(simulator.url, signing_key=KEY) as vehicle:
            begin(vehicle, SURVEY.items(ARDUPILOT))
            assert vehicle.state.armed
        with Vehicle(simulator.url, signing_key=KEY) as vehicle:  # a station that connects again
            assert vehicle.version() is not None


@pytest.mark.parametrize(
    ("vehicles", "ours", "reason", "hint"),
    [
        (KEY, None, "The vehicle signs its messages", "--signing-key FILE"),
        (KEY, bytes(32), "signs its messages with another key", "passphrase in --signing-key"),
        (None, KEY, "The vehicle does not sign", "fly without --signing-key"),
    ],
)
@pytest.mark.parametrize("system", [None, 1])
def test_a_wrong_key_is_told_from_a_silent_vehicle(
    simulated: Any,
    monkeypatch: pytest.MonkeyPatch,
    vehicles: bytes | None,
    ours: bytes | None,
    reason: str,
    hint: str,
    system: int | None,
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._VERSION_2_S", 1.0)
    with (
        simulated(setup=Setup(signing_key=vehicles)) as simulator,
        pytest.raises(VehicleError, match=reason) as refused,
    ):
        Vehicle(simulator.url, system=system, signing_key=ours)
    assert hint in refused.value.hint


@pytest.mark.parametrize(("key", "obeyed"), [(None, False), (bytes(32), False), (KEY, True)])
def test_what_is_not_signed_by_the_key_commands_nothing(
    simulated: Any, key: bytes | None, obeyed: bool
) -> None:
    arms = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, *[0] * 6)
    other = mavlink.MAVLink(None, srcSystem=254)
    sign_by(key, other)
    with (
        simulated(setup=Setup(signing_key=KEY)) as simulator,
        Vehicle(simulator.url, signing_key=KEY) as ours,
    ):
        _, host, port = simulator.url.split(":")
        with socket.create_connection((host, int(port))) as link:
            link.sendall(arms.pack(other))
            for _ in range(3):  # meanwhile it has accepted the connection, and read from it
                ours.version()
            if obeyed:
                ours.wait(lambda: ours.last_state.armed, 20.0, "does not arm")
        assert ours.state.armed is obeyed


def test_the_passphrase_is_in_a_file_that_others_cannot_read(
    client: Client, url: str, tmp_path: Path, simulated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FVS_URL", url)
    monkeypatch.setenv("COLUMNS", "200")
    scene_id, file = client.scenes.create("signed").id, tmp_path / "passphrase"

    def fly(vehicle: str) -> Any:
        given = ("--photographs", str(tmp_path), "--signing-key", str(file), "--vehicle", vehicle)
        return CliRunner().invoke(app, ["fly", scene_id, "--yes", *given])

    for text, mode, reason in (("yard\n", 0o644, "Others can read"), ("\n", 0o600, "is empty")):
        file.write_text(text)
        file.chmod(mode)
        refused = fly("tcp:127.0.0.1:1")
        assert refused.exit_code == 2
        assert reason in refused.output
    file.write_text("yard\n")
    with simulated(setup=Setup(signing_key=KEY)) as simulator:
        assert "the scene has no model" in fly(simulator.url).stdout
