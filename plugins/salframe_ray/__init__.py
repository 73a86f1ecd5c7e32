"""The engine `ray`: workers on all machines of a Ray cluster, or on this one."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from contextlib import chdir, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from loky import cpu_count
from pydantic import Field

import salframe
from salframe.framework.component import Component
from salframe.framework.engines.worker import ONE_THREAD, become_worker, work
from salframe.framework.engines.worker_engine import WorkerEngine, WorkerProcess
from salframe.framework.errors import ConfigError, RequirementMissing, WorkerDied, describe_error
from salframe.framework.files.cache import cache_home

QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    "RAY_DEDUP_LOGS_SKIP_REGEX": "^A worker died or was killed",
}
"""Ray tells nobody that it is used, warns of no change to come in workers without a GPU, and does not print on stdout
that a worker died, which its item's answer says. It reads these when it is imported."""


class Ray(WorkerEngine):
    """On the machines of a Ray cluster, or on this one alone; a worker has one processor, also where it is alone."""

    name = "ray"
    version = "1"
    requires = ("ray",)
    extra = "salframe[ray]"

    class Config(WorkerEngine.Config):
        address: str | None = Field(
            None,
            description="HOST:PORT of a cluster that runs, or auto for the one of this machine; null: one of this "
            "machine alone, for as long as the command takes",
        )

    def ready(self) -> int:
        """Connect to the cluster; how many work at a time. Raises ConfigError where it has fewer processors,
        RequirementMissing where there is none at the address."""
        os.environ.update(QUIET)
        import ray

        if not ray.is_initialized():
            self._connect()
        processors = int(ray.cluster_resources().get("CPU", 0))
        if (self.workers or 1) > processors:
            raise ConfigError(f"received engine.workers={self.workers}, expected at most {processors}, the processors")
        return self.workers or processors

    def start(self, alone: bool) -> WorkerProcess:
        return _Remote()

    def _connect(self) -> None:
        import ray

        quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
        processors = max(self.workers or 1, cpu_count())
        own: dict[str, Any] = {} if self.config.address else {"include_dashboard": False, "num_cpus": processors}
        # Workers have the directory that this is called in on their path: a checkout there would shadow salframe.
        with TemporaryDirectory() as empty, chdir(empty):
            try:
                ray.init(self.config.address or "local", **quiet, **own)
            except (ConnectionError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
                raise RequirementMissing(f"no Ray cluster at {self.config.address}: {describe_error(error)}") from None


class _Worker:
    """What runs in a worker; `directory`: where it works, as far as its machine has that."""

    def __init__(self, directory: str) -> None:
        become_worker()
        with suppress(OSError):
            os.chdir(directory)

    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        try:
            return work(function, item)
        except BaseException as error:  # SystemExit too: it is the item's, not ours
            return error


class _Remote(WorkerProcess):
    """A worker somewhere in the cluster, with the environment variables of salframe."""

    def __init__(self) -> None:
        import ray

        own = {key: value for key, value in os.environ.items() if key.startswith("SALFRAME_")}
        known = {**own, "SALFRAME_CACHE": str(cache_home().absolute()), **ONE_THREAD}
        made: Any = ray.remote(num_cpus=1, runtime_env={"env_vars": known})(_Worker)
        self._worker = made.remote(str(Path.cwd()))

    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        import ray

        try:
            return ray.get(self._worker.answer.remote(function, item))
        except ray.exceptions.RayActorError:
            return WorkerDied()
        except BaseException as error:  # what cannot be pickled
            return error

    def stop(self) -> None:
        import ray

        ray.kill(self._worker)


@salframe.hookimpl
def salframe_provides() -> list[type[Component]]:
    return [Ray]
