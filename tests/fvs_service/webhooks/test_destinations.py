"""Webhooks go to the hosts of the setting alone, at addresses that it allows."""

import asyncio
import socket
from typing import Any

import pytest
from fvs_service.cli.options import settings_of
from fvs_service.errors import InvalidRequestError
from fvs_service.webhooks.destinations import Destination, Destinations, RefusedDestinationError
from typer import Exit

_ALLOWED = ("hooks.example", "10.1.0.0/16", "192.168.7.7", "2001:db8::/32")
_LOCAL = (
    *("127.0.0.1", "127.8.8.8", "0.0.0.0", "10.2.0.1", "172.16.0.1", "192.168.7.8", "169.254.169.254"),
    *("100.64.0.1", "224.0.0.1", "255.255.255.255", "192.0.2.1", "198.18.0.1"),
    *("::1", "::", "fe80::1", "fc00::1", "ff02::1", "::ffff:127.0.0.1", "::ffff:10.2.0.1"),
    *("64:ff9b::7f00:1", "64:ff9b::a02:1", "2002:7f00:1::", "2001::1"),
)


def _resolved(addresses: tuple[str, ...], url: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """The address for ``url`` where its name has ``addresses``."""

    async def resolve() -> str:
        async def getaddrinfo(host: str, port: int, **_: Any) -> list[Any]:
            numeric = addresses if host == "hooks.example" else (host,)
            return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (one, port)) for one in numeric]

        monkeypatch.setattr(asyncio.get_running_loop(), "getaddrinfo", getaddrinfo)
        return await Destinations(_ALLOWED).resolve(Destination.of(url))

    return asyncio.run(resolve())


@pytest.mark.parametrize("address", _LOCAL)
def test_a_name_does_not_lead_into_the_network(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RefusedDestinationError, match="not public"):
        _resolved((address,), "https://hooks.example/", monkeypatch)


@pytest.mark.parametrize(
    "address", ["93.184.216.34", "2606:4700::1", "10.1.2.3", "::ffff:10.1.2.3", "192.168.7.7"]
)
def test_a_name_leads_to_public_and_to_listed_addresses(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert _resolved((address,), "https://hooks.example/", monkeypatch) == address
    assert _resolved(("127.0.0.1", address), "https://hooks.example/", monkeypatch) == address


@pytest.mark.parametrize(
    "url",
    [
        *("https://hooks.example", "http://HOOKS.example:8080/a?b=c", "https://hooks.example./"),
        *("http://10.1.9.9/", "http://192.168.7.7/", "http://[2001:db8::1]:80/"),
    ],
)
def test_listed_hosts_are_accepted(url: str) -> None:
    Destinations(_ALLOWED).check(url)


@pytest.mark.parametrize(
    "url",
    [
        *("https://example.com/", "https://hooks.example.evil.example/", "https://a.hooks.example/"),
        *(
            "http://93.184.216.34/",
            "http://127.0.0.1/",
            "http://10.2.0.1/",
            "http://[::1]/",
            "http://2130706433/",
        ),
        *("https://hooks.example@evil.example/", "https://u:p@hooks.example/", "https://hooks.example/#a"),
        *(
            "https://hooks.example:99999/",
            "https://:80/",
            "https://[/",
            "https://hooks.example\\@evil.example/",
        ),
    ],
)
def test_other_hosts_are_refused(url: str) -> None:
    with pytest.raises(InvalidRequestError) as refused:
        Destinations(_ALLOWED).check(url)
    assert refused.value.errors[0].field == "url"
    assert "FVS_WEBHOOK_HOSTS" in refused.value.hint


def test_without_the_setting_webhooks_are_off() -> None:
    assert Destinations(()).none
    with pytest.raises(InvalidRequestError, match="Webhooks are off"):
        Destinations(()).check("https://hooks.example/")


@pytest.mark.parametrize("wrong", ["*", "https://hooks.example", "hooks.example:80", "10.1.0.5/16", "a b"])
def test_what_is_no_host_is_refused(
    wrong: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FVS_WEBHOOK_HOSTS", f"hooks.example,{wrong}")
    with pytest.raises(Exit):
        settings_of()
    assert f"{wrong} is neither a name nor an address nor a network" in capsys.readouterr().err
    monkeypatch.setenv("FVS_WEBHOOK_HOSTS", "Hooks.Example, 10.0.0.1, ::1/128")
    assert settings_of().webhook_hosts == ("hooks.example", "10.0.0.1/32", "::1/128")
