"""The order of turns: fair between tenants, then between a tenant's scenes; updates before fine models.

A worker gives a job a *turn*. The next turn goes to the tenant with the fewest jobs in a turn, of those to
the one whose last turn began the longest ago. Within the tenant it goes to an update before a fine model, to
a job that has begun before one that has not, then to the scene whose last turn began the longest ago. A job
whose turn has lasted ``turn_ms`` makes room for a job that the order prefers, and waits for its next turn.
So nobody starves: a waiting tenant gets a turn after at most one turn of each other tenant, and a fine model
that has waited for ``_PATIENCE`` turns counts as an update.

Everything here is a function of the open jobs; the database is in ``jobs.queue``.
"""

import heapq
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from fvs_schema.jobs import JobKind, WaitReason

_PATIENCE = 20
"""A fine model that has waited for this many turns no longer lets updates of its tenant go first."""
_USEFUL = (None, WaitReason.MEMORY, WaitReason.NODE, WaitReason.GPU)
"""What a waiting job may lack so that another one that makes room is of use to it."""
_SETTLED_MS = 1_000
"""A job that waits this long was not taken by an idle worker, so there is none."""


@dataclass(frozen=True)
class OpenJob:
    """The properties of a queued or running job that the order depends on; times are the database's.

    ``worker_id`` is the worker whose turn it is in, None while it waits. ``obstacle`` is what the last worker
    lacked, which is not tried again before ``not_before_ms``. ``served_ms``: when its scene's last turn
    began; ``begun``: it had a turn.
    """

    id: str
    tenant_id: str
    scene_id: str
    kind: JobKind
    waiting_since_ms: int
    served_ms: int = 0
    worker_id: str | None = None
    taken_at_ms: int = 0
    begun: bool = False
    cancel_requested: bool = False
    obstacle: WaitReason | None = None
    not_before_ms: int = 0


@dataclass(frozen=True)
class Place:
    """A waiting job's position in the queue, from 1; ``obstacle`` is None when it can have a turn now."""

    job: OpenJob
    number: int
    obstacle: WaitReason | None


@dataclass(frozen=True, eq=False)
class Order:
    """The order of all open ``jobs`` at ``now_ms``.

    ``tenants_served_ms``: when each tenant's last turn began. ``limit``: maximum number of jobs of a tenant
    in a turn.
    """

    jobs: Sequence[OpenJob]
    tenants_served_ms: Mapping[str, int]
    limit: int
    turn_ms: int
    now_ms: int

    @cached_property
    def running(self) -> tuple[OpenJob, ...]:
        """The jobs in a turn."""
        return tuple(job for job in self.jobs if job.worker_id is not None)

    @cached_property
    def line(self) -> tuple[Place, ...]:
        """The jobs that wait, the next one first."""
        by_tenant: defaultdict[str, list[OpenJob]] = defaultdict(list)
        for job in self.jobs:
            if job.worker_id is None:
                by_tenant[job.tenant_id].append(job)
        for jobs in by_tenant.values():
            jobs.sort(key=self._within_tenant, reverse=True)
        turns = Counter(self._turns)
        heap = [(turns[tenant], self.tenants_served_ms.get(tenant, 0), tenant) for tenant in by_tenant]
        heapq.heapify(heap)
        scenes = set(self._scenes_in_turn)
        places: list[Place] = []
        while heap:
            count, served_ms, tenant = heapq.heappop(heap)
            job = by_tenant[tenant].pop()
            obstacle = self._obstacle(job, scenes, turns[tenant])
            places.append(Place(job, len(places) + 1, obstacle))
            if obstacle is None:
                scenes.add(job.scene_id)
                turns[tenant] += 1
            if by_tenant[tenant]:
                heapq.heappush(heap, (count + 1, served_ms, tenant))
        return tuple(places)

    @property
    def next(self) -> OpenJob | None:
        """The job that a free worker takes; None when none can have a turn."""
        return next((place.job for place in self.line if place.obstacle is None), None)

    def update_of_scene_waits(self, job: OpenJob) -> bool:
        """Whether an update of its scene waits for ``job``, a fine model."""
        if job.kind is not JobKind.FINE or self._in_protected_turn(job):
            return False
        waiting = (one for one in self.jobs if one.kind is JobKind.UPDATE and one.worker_id is None)
        return any(update.scene_id == job.scene_id for update in waiting)

    def turn_ends(self, job: OpenJob) -> bool:
        """Whether the turn of ``job`` is over, and it is the one to make room for a job that waits."""
        return self._turn_is_over(job) and any(self._gives_way(job, place) for place in self.line)

    def _gives_way(self, job: OpenJob, place: Place) -> bool:
        """Whether ``job`` is the one that makes room for the waiting job of ``place``."""
        other = place.job
        if self.now_ms - other.waiting_since_ms < _SETTLED_MS:
            return False
        over = [one for one in self.running if self._turn_is_over(one)]
        if other.tenant_id != job.tenant_id:
            useful = place.obstacle in _USEFUL
            turns = self._turns[other.tenant_id]
            rivals = [one for one in over if self._turns[one.tenant_id] > turns]
        else:
            useful = place.obstacle in (*_USEFUL, WaitReason.TENANT_LIMIT)
            rank = self._rank(other)
            rivals = [
                one for one in over if one.tenant_id == job.tenant_id and (one.kind is JobKind.FINE) > rank
            ]
        return useful and bool(rivals) and max(rivals, key=self._expendable).id == job.id

    def _expendable(self, job: OpenJob) -> tuple[int, bool, int, str]:
        """Sort key: of several jobs that could make room the one with the greatest does."""
        return self._turns[job.tenant_id], job.kind is JobKind.FINE, -job.taken_at_ms, job.id

    @cached_property
    def _turns(self) -> Counter[str]:
        return Counter(job.tenant_id for job in self.running)

    @cached_property
    def _scenes_in_turn(self) -> frozenset[str]:
        return frozenset(job.scene_id for job in self.running)

    def _within_tenant(self, job: OpenJob) -> tuple[bool, bool, int, bool, int, str]:
        """The order of a tenant's jobs; those that cannot have a turn come last, begun ones before others."""
        blocked = job.scene_id in self._scenes_in_turn or job.not_before_ms > self.now_ms
        return blocked, not job.cancel_requested, self._rank(job), not job.begun, job.served_ms, job.id

    def _rank(self, job: OpenJob) -> int:
        """0 before 1: fine models let updates go first, but not forever."""
        return int(job.kind is JobKind.FINE and not self._waited_long(job, self.now_ms))

    def _waited_long(self, job: OpenJob, until_ms: int) -> bool:
        return until_ms - job.waiting_since_ms > _PATIENCE * self.turn_ms

    def _turn_is_over(self, job: OpenJob) -> bool:
        return self.now_ms - job.taken_at_ms >= self.turn_ms

    def _in_protected_turn(self, job: OpenJob) -> bool:
        """Whether a fine model has its turn because it had waited for long."""
        return not self._turn_is_over(job) and self._waited_long(job, job.taken_at_ms)

    def _obstacle(self, job: OpenJob, scenes: set[str], turns: int) -> WaitReason | None:
        if job.scene_id in scenes:
            return WaitReason.SCENE
        if job.cancel_requested:
            return None
        if job.not_before_ms > self.now_ms:
            return job.obstacle
        return WaitReason.TENANT_LIMIT if turns >= self.limit else None
