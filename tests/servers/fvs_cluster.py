"""The service on a throw-away Ray cluster, with PostgreSQL, an object store, a gateway and a dispatcher."""

import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

from fvs_service.serving.process_tree import command_of, descendants
from object_store_server import ACCESS_KEY_ID, SECRET_ACCESS_KEY, ObjectStoreServer
from postgresql_server import PostgresqlServer
from ray_cluster import RayCluster

FVS = [sys.executable, "-c", "from fvs_engine.cli import main; main()"]
SETTINGS = {
    "FVS_WORKER__INITIAL_ITERATIONS": "120",
    "FVS_WORKER__ITERATIONS_PER_IMAGE": "30",
    "FVS_WORKER__LONG_SIDE_PX": "160",
    "FVS_WORKER__FINE_MAX_GAUSSIANS": "20000",
    "FVS_WORKER__THREADS": "1",
    "FVS_LEASE_S": "6",
    "FVS_RESERVE_BYTES": "0",
}


class FvsCluster:
    """A gateway at ``url`` and a dispatcher, on this machine, with a cluster of nodes; ends with its block.

    ``cpus``: of each node; a scene takes one of them and 1 GiB.
    """

    def __init__(self, folder: Path, nodes: int, cpus: int) -> None:
        self._folder, self._count, self._cpus = folder, nodes, cpus
        self._stack = ExitStack()

    def __enter__(self) -> "FvsCluster":
        with self._stack as stack:
            self.ray = stack.enter_context(RayCluster(self._folder))
            for _ in range(self._count):
                self.add_node()
            here = self.ray.network.address
            database = PostgresqlServer(self._folder / "postgresql", here)
            database.start()
            stack.callback(database.stop)
            store = ObjectStoreServer(self._folder / "store", here)
            store.start()
            stack.callback(store.stop)
            store.create_bucket("fvs")
            self.create_database = database.create_database
            self.database_url = self.create_database("fvs")
            self.settings = {
                **SETTINGS,
                "FVS_DATABASE_URL": self.database_url,
                "FVS_BLOBS__URL": "s3://fvs/service",
                "FVS_BLOBS__ENDPOINT": store.endpoint,
                "FVS_BLOBS__REGION": "us-east-1",
                "FVS_BLOBS__ACCESS_KEY_ID": ACCESS_KEY_ID,
                "FVS_BLOBS__SECRET_ACCESS_KEY": SECRET_ACCESS_KEY,
                "FVS_CLUSTER": self.ray.url,
            }
            self.gateway = self._serve("gateway", "--port", "0")
            assert self.gateway.stdout is not None
            self.url = self.gateway.stdout.readline().strip()
            if not self.url:
                raise RuntimeError(f"The gateway does not start: see {self._folder / 'gateway.log'}")
            self.dispatcher = self._serve("worker")
            for node in self.ray.nodes:
                node.wait()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def add_node(self) -> None:
        """Add a node, which is starting."""
        self.ray.add_node(self._cpus, memory_bytes=self._cpus << 30)

    def workers(self) -> list[int]:
        """The id of the dispatcher's worker process."""
        found = descendants(self.dispatcher.pid)
        return [pid for pid in found if "serving.process worker" in command_of(pid)]

    def restart_lost(self) -> None:
        """Start every machine of the cluster again that has ended, as an init system does."""
        for machine in (self.ray.head, *self.ray.nodes):
            if not machine.runs:
                machine.kill()  # what is left of it
                machine.start()

    def _serve(self, role: str, *options: str) -> "subprocess.Popen[str]":
        command = [*FVS, "serve", "--log-json", "--role", role, "--root", str(self._folder / role), *options]
        with (self._folder / f"{role}.log").open("a") as log:
            process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=log, text=True, env={**os.environ, **self.settings}
            )
        self._stack.enter_context(process)
        self._stack.callback(process.terminate)
        return process
