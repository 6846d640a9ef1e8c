"""Traces: spans from a request to the stages of its job, sent to an OpenTelemetry collector.

OTEL_EXPORTER_OTLP_ENDPOINT names the collector; the SDK's other OTEL_… variables hold too. Without it nothing
is recorded, and the SDK is not imported.
"""

import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Literal, Self

import structlog

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.trace import Span as OtelSpan

_ENDPOINTS = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")
_FLUSH_S = 0.5
"""How long the end of a process waits for the collector."""

Kind = Literal["INTERNAL", "SERVER", "CLIENT", "CONSUMER"]
Attributes = Mapping[str, str | int | float | bool]

_traceparent: ContextVar[str | None] = ContextVar("traceparent", default=None)

_log = structlog.get_logger()


def traceparent() -> str | None:
    """The span that is open here, in the form of W3C Trace Context; None without one."""
    return _traceparent.get()


class Span:
    """A span that has not ended; without a collector it records nothing."""

    def __init__(self, span: "OtelSpan | None" = None) -> None:
        self._span = span

    def name(self, name: str) -> None:
        """Change the name."""
        if self._span is not None:
            self._span.update_name(name)

    def add(self, attributes: Attributes) -> None:
        """Add attributes."""
        if self._span is not None:
            self._span.set_attributes(attributes)

    def fail(self, why: str) -> None:
        """Mark the span as failed; ``why`` is an error's code, or the name of its class."""
        if self._span is not None:
            from opentelemetry.trace import StatusCode

            self._span.set_status(StatusCode.ERROR, why)
            self._span.set_attribute("error.type", why)


class Tracing:
    """The spans of one process; none without a provider."""

    def __init__(self, provider: "TracerProvider | None" = None) -> None:
        self._provider = provider
        self._tracer = None if provider is None else provider.get_tracer("fvs_service")

    @classmethod
    def of_environment(cls, process: str) -> Self:
        """Spans for the collector that the environment names; OTEL_SERVICE_NAME is ``process`` by default.

        Without the extra ``fvs[otel]`` there are none, and a warning is logged.
        """
        named = next((name for name in _ENDPOINTS if os.environ.get(name)), None)
        if named is None or os.environ.get("OTEL_SDK_DISABLED", "").strip().lower() == "true":
            return cls()
        try:
            from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
            from opentelemetry.sdk.resources import SERVICE_NAME, Resource
            from opentelemetry.sdk.trace import TracerProvider
            from opentelemetry.sdk.trace.export import BatchSpanProcessor
        except ImportError as error:
            _log.warning(f"nothing is traced: {named} needs the extra `otel` of fvs", reason=str(error))
            return cls()
        name = os.environ.get("OTEL_SERVICE_NAME") or process
        provider = TracerProvider(resource=Resource.create({SERVICE_NAME: name}), shutdown_on_exit=False)
        provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
        return cls(provider)

    @contextmanager
    def span(
        self,
        name: str,
        attributes: Attributes | None = None,
        *,
        kind: Kind = "INTERNAL",
        parent: str | None = None,
        expected: tuple[type[Exception], ...] = (),
    ) -> Iterator[Span]:
        """Record a span around a block, below the one that is open here.

        That of a server or a consumer is below ``parent``, a traceparent, instead: what is open here may be
        of an earlier request over the same connection. Exceptions mark a span as failed, unless they are
        ``expected``.
        """
        if self._tracer is None:
            yield Span()
            return
        from opentelemetry.context import Context
        from opentelemetry.trace import SpanKind
        from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

        propagator = TraceContextTextMapPropagator()
        given = None
        if kind in ("SERVER", "CONSUMER"):
            given = propagator.extract({} if parent is None else {"traceparent": parent}, Context())
        with self._tracer.start_as_current_span(
            name,
            given,
            SpanKind[kind],
            attributes,
            record_exception=False,
            set_status_on_exception=False,
        ) as opened:
            span, carrier = Span(opened), dict[str, str]()
            propagator.inject(carrier)
            token = _traceparent.set(carrier["traceparent"])
            try:
                yield span
            except Exception as error:
                if not isinstance(error, expected):
                    span.fail(type(error).__name__)
                raise
            finally:
                _traceparent.reset(token)

    def close(self) -> None:
        """Send what is left, for 0.5 s at most; to be called at the end of the process."""
        if self._provider is None:
            return
        flushing = threading.Thread(target=self._provider.force_flush, daemon=True)
        flushing.start()
        flushing.join(_FLUSH_S)
