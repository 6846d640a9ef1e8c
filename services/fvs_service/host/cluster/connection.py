"""The connection of a worker to the Ray cluster, with Ray's errors in plain words."""

import logging
import os
from typing import Any

import ray

from fvs_service.errors import UnavailableError


class ClusterUnavailableError(UnavailableError):
    """The cluster cannot be reached, or refuses this program; the hint names the remedy."""


def connect(address: str, namespace: str) -> None:
    """Connect this process to the cluster; raises ``ClusterUnavailableError``."""
    os.environ["RAY_ENABLE_AUTO_CONNECT"] = "0"  # else a call before this starts a cluster on this machine
    try:
        ray.init(address, namespace=namespace, log_to_driver=False, logging_level=logging.ERROR)
    except Exception as error:  # of many kinds
        raise ClusterUnavailableError(
            f"The Ray cluster at {address} cannot be used: {error}", hint=_remedy(f"{type(error)} {error}")
        ) from error


def alive_nodes() -> list[dict[str, Any]]:
    """The nodes of the cluster that are alive, as ``ray.nodes()`` has them."""
    nodes: Any = ray.nodes  # not typed
    return [node for node in nodes() if node["Alive"]]


def _remedy(error: str) -> str:
    if "ersion mismatch" in error:
        return (
            "Install the same versions of Ray and Python on all machines; the image of the service has them."
        )
    if "uthenticat" in error or "oken" in error:
        return "Set RAY_AUTH_MODE=token and the token of the cluster: RAY_AUTH_TOKEN or RAY_AUTH_TOKEN_PATH."
    return "Check FVS_CLUSTER, that the head runs (ray status), and that this machine reaches it."
