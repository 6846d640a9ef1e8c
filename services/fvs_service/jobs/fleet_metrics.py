"""Metrics of the fleet, read from the database when Prometheus asks."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from fvs_service.errors import ServiceError, StorageUnavailableError
from fvs_service.jobs.fleet import longest_wait_s, open_jobs, workers_of
from fvs_service.storage.database import Database


class FleetCollector(Collector):
    """Workers and their heartbeats, jobs, the queue, free space on the disk of ``root``, and the blob store.

    ``require_store`` raises a ``ServiceError`` when the store cannot be reached.
    """

    def __init__(self, database: Database, root: Path, require_store: Callable[[], object]) -> None:
        self._database = database
        self._root = root
        self._require_store = require_store

    def describe(self) -> Iterator[Metric]:
        """Nothing, so that registering the collector does not read the database."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        """The metrics as they are now; without the database only that it cannot be reached."""
        room = shutil.disk_usage(self._root).free
        yield GaugeMetricFamily("fvs_disk_free_bytes", "Free bytes on the disk of the root.", room)
        reached = GaugeMetricFamily("fvs_database_up", "Whether the database can be reached.")
        try:
            yield from self._fleet()
        except StorageUnavailableError:
            reached.add_metric((), 0)
        else:
            reached.add_metric((), 1)
        yield reached
        yield self._store()

    def _store(self) -> Metric:
        stored = GaugeMetricFamily("fvs_blobs_up", "Whether the blob store can be reached.")
        try:
            self._require_store()
        except ServiceError:
            stored.add_metric((), 0)
        else:
            stored.add_metric((), 1)
        return stored

    def _fleet(self) -> Iterator[Metric]:
        with self._database.reading() as session:
            workers = workers_of(session)
            jobs, wait_s = open_jobs(session), longest_wait_s(session)
        alive = GaugeMetricFamily(
            "fvs_worker_alive", "Whether the worker sends heartbeats.", labels=["worker"]
        )
        age = GaugeMetricFamily(
            "fvs_worker_heartbeat_age_seconds", "Time since the last heartbeat.", labels=["worker"]
        )
        runners = GaugeMetricFamily("fvs_runners", "Scenes whose model is loaded.", labels=["worker"])
        memory = GaugeMetricFamily("fvs_runner_bytes", "Resident memory of runners.", labels=["worker"])
        for worker in workers:
            alive.add_metric([worker.id], worker.alive)
            age.add_metric([worker.id], worker.heartbeat_age_s)
            runners.add_metric([worker.id], worker.runners)
            memory.add_metric([worker.id], worker.runner_bytes)
        open_ = GaugeMetricFamily("fvs_jobs", "Queued and running jobs.", labels=["kind", "state", "stage"])
        for labels, count in jobs.items():
            open_.add_metric(labels, count)
        queued = sum(count for (_, state, _), count in jobs.items() if state == "queued")
        yield from (alive, age, runners, memory, open_)
        yield GaugeMetricFamily("fvs_queue_length", "Jobs that wait.", queued)
        yield GaugeMetricFamily("fvs_queue_oldest_seconds", "How long the oldest has waited.", wait_s)
