"""When requests need an API key: the same rule over REST and gRPC."""

from collections.abc import Callable
from datetime import timedelta
from typing import Any

import grpc
import pytest
from fvs.v1.scenes_pb2 import ListScenesRequest
from fvs.v1.scenes_pb2_grpc import SceneServiceStub

Open = Callable[..., tuple[Any, grpc.Channel]]
_PROXIED = {"Host": "ground.example"}


def _served(gateway: Any, channel: grpc.Channel, key: str | None, host: dict[str, str]) -> tuple[bool, bool]:
    """Whether REST and gRPC answer; both refuse for want of a key, and for nothing else."""
    bearer = {} if key is None else {"Authorization": f"Bearer {key}"}
    answer = gateway.client.get("/v1/scenes", headers={**host, **bearer})
    assert answer.status_code in (200, 401), answer.text
    metadata = tuple((name.lower(), value) for name, value in bearer.items())
    code = SceneServiceStub(channel).ListScenes.future(ListScenesRequest(), metadata=metadata).code()
    assert code in (grpc.StatusCode.OK, grpc.StatusCode.UNAUTHENTICATED)
    return answer.status_code == 200, code is grpc.StatusCode.OK


@pytest.mark.parametrize(
    ("settings", "host", "needed"),
    [
        ({}, {}, False),
        ({"host": "::1"}, {}, False),
        ({"allowed_hosts": ("localhost", "127.0.0.2:8000")}, {}, False),
        ({"allowed_hosts": ("ground.example",)}, _PROXIED, True),
        ({"allowed_hosts": ("ground.example",)}, {}, True),
        ({"host": "0.0.0.0"}, _PROXIED, True),
        ({"host": "192.0.2.1"}, {}, True),
        ({"require_keys": True}, {}, True),
        ({"allowed_hosts": ("ground.example",), "require_keys": False}, _PROXIED, False),
        ({"host": "0.0.0.0", "allowed_hosts": ("ground.example",), "require_keys": False}, _PROXIED, False),
    ],
)
def test_requests_from_elsewhere_need_a_key(
    settings: dict[str, Any], host: dict[str, str], needed: bool, open_both: Open
) -> None:
    # gRPC listens on loopback all the same: the rule, not the socket, is what is tested.
    gateway, channel = open_both(**settings)
    assert gateway.client.get("/livez", headers=host).status_code == 200
    if not needed:
        assert _served(gateway, channel, None, host) == (True, True)
        return
    assert _served(gateway, channel, None, host) == (False, False)
    key = gateway.application.storage.keys.create("a")
    assert _served(gateway, channel, None, host) == (False, False)
    assert _served(gateway, channel, key, host) == (True, True)
    assert _served(gateway, channel, key[:-1] + "?", host) == (False, False)


@pytest.mark.parametrize("gone", [False, True])
def test_a_key_closes_the_service_at_once_and_for_good(gone: bool, open_both: Open) -> None:
    gateway, channel = open_both()
    keys = gateway.application.storage.keys
    assert _served(gateway, channel, None, {}) == (True, True)
    assert gateway.client.get("/v1/capabilities").json()["keys_required"] is False
    key = keys.create("a", valid_for=timedelta(seconds=-1) if gone else None)
    assert _served(gateway, channel, None, {}) == (False, False)
    assert _served(gateway, channel, key, {}) == (not gone, not gone)
    keys.revoke(key.split("_")[1])
    assert _served(gateway, channel, None, {}) == (False, False)
    assert _served(gateway, channel, key, {}) == (False, False)
    listed = gateway.client.get("/v1/capabilities", headers={"Authorization": f"Bearer {keys.create('b')}"})
    assert listed.json()["keys_required"] is True


def test_one_setting_says_that_keys_are_not_needed(open_both: Open) -> None:
    gateway, channel = open_both(require_keys=False)
    key = gateway.application.storage.keys.create("a")
    assert _served(gateway, channel, None, {}) == (True, True)
    assert _served(gateway, channel, key, {}) == (True, True)
    assert _served(gateway, channel, key[:-1] + "?", {}) == (False, False), "a wrong key is no missing one"
    assert gateway.client.get("/v1/capabilities").json()["keys_required"] is False
