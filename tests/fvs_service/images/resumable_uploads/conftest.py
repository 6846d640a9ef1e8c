"""A gateway on a real connection, and a device that sends to it."""

from collections.abc import Callable
from typing import Any

import pytest
from tus_device import Device


@pytest.fixture
def gateway(serve: Any) -> Any:
    return serve()


@pytest.fixture
def device(gateway: Any, photograph: Callable[..., bytes]) -> Device:
    return Device(gateway.client, gateway.scene(), photograph(1, (320, 240)))


@pytest.fixture
def locked(serve: Any) -> Any:
    return serve(require_keys=True)
