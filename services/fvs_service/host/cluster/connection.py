"""The connection of a worker to the Ray cluster, with Ray's errors in plain words."""

import logging
import os
import re
import socket
from typing import Any

import ray
from ray.exceptions import RayTaskError

from fvs_service.errors import UnavailableError

_REACH_S = 3.0
_ORIGIN = re.compile(r"\bip=([0-9A-Fa-f.:]+)")


class ClusterUnavailableError(UnavailableError):
    """The cluster cannot be reached, or refuses this program; the hint names the remedy."""


def connect(address: str, namespace: str) -> None:
    """Connect this process to the cluster; raises ``ClusterUnavailableError``."""
    os.environ["RAY_ENABLE_AUTO_CONNECT"] = "0"  # else a call before this starts a cluster on this machine
    try:
        if address.startswith("ray://"):  # Ray would wait for half a minute for a head that is not up yet
            host, _, port = address.removeprefix("ray://").rpartition(":")
            socket.create_connection((host, int(port)), _REACH_S).close()
        ray.init(address, namespace=namespace, log_to_driver=False, logging_level=logging.ERROR)
    except Exception as error:  # of many kinds
        raise ClusterUnavailableError(
            f"The Ray cluster {address} cannot be used: {plain(error)}",
            hint=_remedy(f"{type(error)} {error}"),
        ) from error


def alive_nodes() -> list[dict[str, Any]]:
    """The nodes of the cluster that are alive, as ``ray.nodes()`` has them."""
    nodes: Any = ray.nodes  # not typed
    return [node for node in nodes() if node["Alive"]]


def plain(error: Exception) -> str:
    """One of Ray's errors in one line, without the tracebacks of other processes."""
    if isinstance(error, RayTaskError):
        error = error.cause
    lines = str(error).split("\n")
    if "creation task" in lines[0] or any("Traceback" in line for line in lines):
        lines = str(error).rstrip().split("\n")[-1:]
    return " ".join(" ".join(lines).split())


def origin(error: Exception) -> str:
    """The address of the node that one of Ray's errors is from ("": it does not say)."""
    found = _ORIGIN.search(str(error))
    return "" if found is None else found[1]


def _remedy(error: str) -> str:
    if "ersion mismatch" in error:
        return (
            "Install the same versions of Ray and Python on all machines; the image of the service has them."
        )
    if "uthenticat" in error or "oken" in error:
        return "Set RAY_AUTH_MODE=token and the token of the cluster: RAY_AUTH_TOKEN or RAY_AUTH_TOKEN_PATH."
    return (
        "Check that the head runs, that FVS_CLUSTER has the port of its client server (10001), that this "
        "machine reaches it, and, if the cluster has a token, RAY_AUTH_MODE=token and RAY_AUTH_TOKEN or "
        "RAY_AUTH_TOKEN_PATH: Ray does not answer where the token is missing or wrong."
    )
