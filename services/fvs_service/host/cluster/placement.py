"""The states of hosts, and which of them have room on the nodes of the cluster: arithmetic without Ray.

                     ┌──────── room ────────┐
    made ──────▶ starting ── no room ──▶ waiting
                     │ opened               │ opened
                     ├──────────────────────┘
                   ready ◀──── in use ────┐
                     └── asked to leave ─▶ leaving

    any ── refused, lost, deaf, withdrawn, or has left ──▶ gone

A host that is ready is working while it has users, which are turns and starts of its runner; else it is idle.
"""

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

from fvs_service.host.cluster.resources import Resources
from fvs_service.host.cluster.scene_host import HostOpened, HostStatus

_START_S = 60.0
"""A host that has not opened after this time counts as one that waits: other programs may have the room."""
_IDLE_S = 5.0
"""A host that was idle for this long makes room for one that waits for a place."""
_DEAF = 20
_DEAF_UNKNOWN = 10
_DEAF_LEAVING = 5


class State(Enum):
    """See the module."""

    STARTING = auto()
    WAITING = auto()
    READY = auto()
    LEAVING = auto()
    GONE = auto()


@dataclass(eq=False)
class Host:
    """A scene's host; ``resources`` are None for one of the dispatcher before this one, until it answers."""

    scene_id: str
    actor: Any
    resources: Resources | None
    asked: Any
    """Ray's reference to the answer that it owes: of ``open``, ``status`` or ``leave``."""
    avoids: frozenset[str] = frozenset()
    """The nodes on which Ray may not place it."""
    state: State = State.STARTING
    node_id: str = ""
    users: int = 0
    idle_s: float = 0.0
    status: HostStatus | None = None
    unanswered: int = 0
    """The number of looks since it owes the answer."""
    failed: bool = False
    """It could not start."""
    made: float = field(default_factory=time.monotonic)
    wanted: float = field(default_factory=time.monotonic)

    @property
    def placed(self) -> bool:
        """Whether its node is known."""
        return self.state in (State.READY, State.LEAVING)

    @property
    def deaf(self) -> bool:
        """Whether it has answered nothing in too many looks; Ray does not ask whether actors answer."""
        match self.state:
            case State.READY:
                return self.unanswered > _DEAF
            case State.LEAVING:
                return self.unanswered > _DEAF_LEAVING
        return self.resources is None and self.unanswered > _DEAF_UNKNOWN

    @property
    def spare(self) -> bool:
        """Whether it can give up its place."""
        return self.state is State.READY and not self.users and self.idle_s > _IDLE_S

    def ask(self, state: State, reference: Any) -> None:
        """Record that it owes an answer in this state."""
        self.state, self.asked, self.unanswered = state, reference, 0

    def open(self, opened: HostOpened) -> None:
        """Record that it has a place."""
        self.state, self.node_id, self.resources = State.READY, opened.node_id, opened.resources


class Room:
    """What the nodes have left beside the hosts that have, or are getting, a place.

    Tells the hosts that Ray is starting, because a node has room for them, from those that wait; the oldest
    come first. Other programs' actors do not count.
    """

    def __init__(self, nodes: Mapping[str, Resources], hosts: Collection[Host]) -> None:
        self._nodes, self._hosts = nodes, hosts
        self._left = dict(nodes)
        for host in hosts:
            if host.placed and host.resources is not None and host.node_id in nodes:
                self._left[host.node_id] = self._left[host.node_id].minus(host.resources)
        for host in sorted(hosts, key=lambda host: host.made):
            if not host.placed and host.resources is not None:
                starts = self._place(host, host.resources) and time.monotonic() - host.made < _START_S
                host.state = State.STARTING if starts else State.WAITING

    def fitting(self, need: Resources) -> set[str]:
        """The nodes that have what is needed, in use or not."""
        return {node_id for node_id, node in self._nodes.items() if node.cover(need)}

    def lacks_gpus(self, need: Resources) -> bool:
        """Whether the GPUs are in use of all nodes that have what is needed."""
        return all(self._left[node_id].gpus < need.gpus for node_id in self.fitting(need))

    def victim(self) -> Host | None:
        """The spare host that was idle for longest of those whose places one that waits can use.

        None while another one is leaving.
        """
        if any(host.state is State.LEAVING for host in self._hosts):
            return None
        for host in self._hosts:
            if host.state is State.WAITING and host.resources is not None:
                found = self._in_the_way(host.resources, host.avoids)
                if found:
                    return max(found, key=lambda one: one.idle_s)
        return None

    def _place(self, host: Host, need: Resources) -> bool:
        for node_id, left in self._left.items():
            if node_id not in host.avoids and left.cover(need):
                self._left[node_id] = left.minus(need)
                return True
        return False

    def _in_the_way(self, need: Resources, avoids: Collection[str]) -> list[Host]:
        """The spare hosts that have something of what is short on nodes where all of them leave enough."""
        found: list[Host] = []
        for node_id, left in self._left.items():
            spare = {
                host: host.resources
                for host in self._hosts
                if host.node_id == node_id and host.spare and host.resources is not None
            }
            freed = left
            for resources in spare.values():
                freed = freed.plus(resources)
            if node_id not in avoids and freed.cover(need):
                short = need.minus(left)
                found += [host for host, resources in spare.items() if resources.help(short)]
        return found
