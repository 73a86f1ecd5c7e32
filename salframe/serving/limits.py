"""Limits of the service, so that no request can exhaust the machine."""

from __future__ import annotations

import os

from pydantic import Field

from salframe.framework.validation import Settings


class ServiceLimits(Settings):
    """Limits of the service. Requests beyond a limit receive an error; other requests are not affected."""

    workers: int = Field(
        default_factory=lambda: os.cpu_count() or 1,
        ge=1,
        le=256,
        description="maximum number of queries that are localized at the same time",
    )
    max_queue: int = Field(32, ge=0, description="maximum number of requests that wait for a worker")
    max_uploads: int = Field(
        64, ge=1, description="maximum number of images that are received or localized at the same time"
    )
    max_connections: int = Field(512, ge=1, description="maximum number of open connections")
    max_body_bytes: int = Field(1 << 26, ge=1, description="maximum size of a request body in bytes")
    max_json_bytes: int = Field(1 << 20, ge=1, description="maximum size of a JSON body in bytes")
    max_pixels: int = Field(1 << 26, ge=1, description="maximum number of pixels of an image")
    max_objects: int = Field(2000, ge=1, description="maximum number of detected objects in a query")
    max_sessions: int = Field(100, ge=1, description="maximum number of open sessions; a session tracks one camera")
    max_listeners: int = Field(8, ge=1, description="maximum number of open WebSockets of a session")
    headers_s: float = Field(10.0, gt=0, description="maximum time (s) to receive the headers of a request")
    body_s: float = Field(60.0, gt=0, description="maximum time (s) to receive the body of a request")
    work_s: float = Field(60.0, gt=0, description="maximum time (s) from the arrival of a request to its answer")
    idle_s: float = Field(900.0, gt=0, description="time (s) without observations after which a session ends")
    drain_s: int = Field(30, ge=1, description="maximum time (s) to finish open requests after the signal SIGTERM")
