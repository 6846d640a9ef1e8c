"""A gateway without workers: it takes images and jobs, which wait until workers come, and cannot rank."""

from fvs_service.application import Backend
from fvs_service.errors import UnavailableError
from fvs_service.jobs.port import JobTicket
from fvs_service.rankings.port import DrawView, RankedViews, RankViews


class _NoEngine:
    def submit(self, ticket: JobTicket) -> None:
        raise UnavailableError(f"No worker serves this gateway; job {ticket.job_id} waits.")

    def request_cancel(self, ticket: JobTicket) -> None:
        """Nothing was queued outside of the database."""

    def run_worker(self, worker_id: str) -> None:
        raise UnavailableError(f"This process cannot run worker {worker_id}.")

    def reap(self, worker_id: str) -> int:  # noqa: ARG002 - the port's name
        return 0


class _NoRunners:
    @property
    def methods(self) -> tuple[str, ...]:
        return ("median-frequency",)

    def rank(self, request: RankViews) -> RankedViews:
        raise _no_worker(request.scene_id)

    def draw(self, request: DrawView) -> bytes:
        raise _no_worker(request.scene_id)


def _no_worker(scene_id: str) -> UnavailableError:
    return UnavailableError(
        f"No worker serves this gateway, so nobody has the model of scene {scene_id}.", retry_after_s=30
    )


DETACHED = Backend(engine=lambda _storage: _NoEngine(), runners=lambda _storage: _NoRunners())
