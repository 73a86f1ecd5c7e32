"""Metrics of the service in the text format of Prometheus."""

from __future__ import annotations

from collections.abc import Callable

from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Counter, Gauge, Histogram, generate_latest

METRICS_TYPE = CONTENT_TYPE_LATEST
_BUCKETS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60)


class ServiceMetrics:
    """Counters and times of the service.

    Attributes:
        requests: Number of requests by path template, method and HTTP status.
        request_s: Time in seconds from the arrival of the headers of a request to the end of its response, by path
            template.
        localize_s: Computing time of an answer in seconds.
        answers: Number of answers by status of the localization.
    """

    def __init__(
        self, num_pending: Callable[[], int], num_sessions: Callable[[], int], num_reloads: Callable[[], int]
    ) -> None:
        self._registry = CollectorRegistry()
        self.requests = Counter("salframe_requests", "Requests", ("path", "method", "status"), registry=self._registry)
        self.request_s = Histogram(
            "salframe_request_seconds", "Time of a request", ("path",), buckets=_BUCKETS, registry=self._registry
        )
        self.localize_s = Histogram(
            "salframe_localize_seconds",
            "Time of the computation of an answer",
            buckets=_BUCKETS,
            registry=self._registry,
        )
        self.answers = Counter("salframe_answers", "Answers by status", ("status",), registry=self._registry)
        for name, help, value in (
            ("salframe_pending_requests", "Requests that run or wait for a worker", num_pending),
            ("salframe_sessions", "Open sessions", num_sessions),
            ("salframe_map_reloads", "Versions of the map that were opened after the first one", num_reloads),
        ):
            Gauge(name, help, registry=self._registry).set_function(value)

    def text(self) -> bytes:
        """Return the metrics in the text format of Prometheus."""
        return generate_latest(self._registry)
