"""The leases of a scene's host, which ends as soon as there is a newer host of its scene.

All hosts of the cluster lease as one worker, so a new host need not wait until the lease of a dead one
expires. Ray may call a host dead that is only frozen, or cut off; when it goes on, it must neither commit,
which its stale token prevents, nor acquire the lease again.
"""

from collections.abc import Callable
from typing import NoReturn

from fvs_service.errors import StaleLeaseError
from fvs_service.scenes.lease import Lease, Leases
from fvs_service.storage.database import Database


class HostLeases(Leases):
    """Acquires the lease unless another host has since this one began; ``replaced`` then ends this one."""

    def __init__(
        self, database: Database, duration_s: float, scene_id: str, replaced: Callable[[], NoReturn]
    ) -> None:
        super().__init__(database, duration_s)
        self._replaced = replaced
        self._newest = self.newest_token(scene_id)

    def acquire(self, scene_id: str, worker_id: str, *, after: int | None = None) -> Lease | None:
        """See ``Leases``."""
        try:
            lease = super().acquire(scene_id, worker_id, after=self._newest if after is None else after)
        except StaleLeaseError:
            self._replaced()
        if lease is not None:
            self._newest = lease.token
        return lease

    def extend(self, lease: Lease, endpoint: str | None = None) -> Lease:
        """See ``Leases``."""
        try:
            return super().extend(lease, endpoint)
        except StaleLeaseError:
            self._replaced()
