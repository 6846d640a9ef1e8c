"""Metrics for Prometheus."""

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from prometheus_client.gc_collector import GCCollector
from prometheus_client.process_collector import ProcessCollector

_LAGS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)


class Metrics:
    """The metrics of one process, in their own registry."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        GCCollector(registry=self.registry)
        self.requests = Counter(
            "fvs_requests", "Responses to requests.", ("method", "route", "status"), registry=self.registry
        )
        self.seconds = Histogram(
            "fvs_request_seconds",
            "Time from the first byte of a request to the last one of its response.",
            ("method", "route"),
            buckets=_SECONDS,
            registry=self.registry,
        )
        self.received_bytes = Counter(
            "fvs_received_bytes", "Bytes of request bodies.", registry=self.registry
        )
        self.images = Counter("fvs_images", "New images, by verdict.", ("verdict",), registry=self.registry)
        self.rankings = Histogram(
            "fvs_ranking_seconds",
            "Time of scoring a ranking's candidates.",
            ("method",),
            buckets=_SECONDS,
            registry=self.registry,
        )
        self.ranking_waits = Histogram(
            "fvs_ranking_wait_seconds",
            "Time that a ranking waited for others of its scene.",
            buckets=_SECONDS,
            registry=self.registry,
        )
        self.rankings_open = Gauge(
            "fvs_rankings_open", "Rankings and renders that are waited for.", registry=self.registry
        )
        self.streams = Gauge("fvs_event_streams", "Event streams that are open.", registry=self.registry)
        self.holds = Counter(
            "fvs_key_holds",
            "Times that an API key was put on hold, because too many of its requests were refused.",
            registry=self.registry,
        )
        self.held_requests = Counter(
            "fvs_held_requests", "Requests refused because their API key was on hold.", registry=self.registry
        )
        self.loop_lag = Histogram(
            "fvs_loop_lag_seconds",
            "Delay of the event loop's tasks that are due.",
            buckets=_LAGS,
            registry=self.registry,
        )

    def count_ranking(self, method: str, seconds: float, waited_s: float) -> None:
        """Count a ranking, with the times of scoring and of waiting for others."""
        self.rankings.labels(method).observe(seconds)
        self.ranking_waits.observe(waited_s)
