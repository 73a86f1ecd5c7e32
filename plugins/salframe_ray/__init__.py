"""The engine `ray`: worker processes on the machines of a Ray cluster, or on this machine."""

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
"""Environment variables that Ray reads when it is imported. They disable usage statistics, a warning about a future
change for workers without a GPU, and the line on stdout about a dead worker, because salframe reports dead workers."""


class Ray(WorkerEngine):
    """Runs jobs in worker processes on the machines of a Ray cluster, or on this machine only.

    Each worker uses one core.
    """

    name = "ray"
    version = "1"
    requires = ("ray",)
    extra = "salframe[ray]"

    class Config(WorkerEngine.Config):
        address: str | None = Field(
            None,
            description="address of a running Ray cluster: HOST:PORT, or auto for the cluster that this machine "
            "belongs to; null: start a new cluster of only this machine, which ends with the command",
        )

    def prepare(self) -> int:
        """Connect to the cluster and return the number of workers.

        Raises:
            ConfigError: The cluster has fewer processors than the requested number of workers.
            RequirementMissing: There is no cluster at the address.
        """
        os.environ.update(QUIET)
        import ray

        if not ray.is_initialized():
            self._connect()
        processors = int(ray.cluster_resources().get("CPU", 0))
        if (self.workers or 1) > processors:
            raise ConfigError(
                f"engine.workers is {self.workers or 1}, expected at most {processors}, the number of processors of "
                "the Ray cluster"
            )
        return self.workers or processors

    def start(self, is_only_worker: bool) -> WorkerProcess:
        return _Remote()

    def _connect(self) -> None:
        import ray

        log_options: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
        processors = max(self.workers or 1, cpu_count())
        local_options: dict[str, Any] = (
            {} if self.config.address else {"include_dashboard": False, "num_cpus": processors}
        )
        # Ray adds the current directory to the path of its workers; a checkout of salframe there would be imported.
        with TemporaryDirectory() as empty, chdir(empty):
            try:
                ray.init(self.config.address or "local", **log_options, **local_options)
            except (ConnectionError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
                raise RequirementMissing(
                    f"no Ray cluster answers at {self.config.address}: {describe_error(error)}; start it, or correct "
                    "engine.address"
                ) from None


class _RayActor:
    """The actor that runs in a worker process."""

    def __init__(self, directory: str) -> None:
        """Prepare the process.

        Args:
            directory: Working directory of the worker. It is ignored if it does not exist on the worker's machine.
        """
        become_worker()
        with suppress(OSError):
            os.chdir(directory)

    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        try:
            return work(function, item)
        except BaseException as error:  # includes SystemExit, which concerns the item only
            return error


class _Remote(WorkerProcess):
    """A worker process in the cluster, with the environment variables of salframe."""

    def __init__(self) -> None:
        import ray

        settings = {key: value for key, value in os.environ.items() if key.startswith("SALFRAME_")}
        env_vars = {**settings, "SALFRAME_CACHE": str(cache_home().absolute()), **ONE_THREAD}
        actor_class: Any = ray.remote(num_cpus=1, runtime_env={"env_vars": env_vars})(_RayActor)
        self._worker = actor_class.remote(str(Path.cwd()))

    def answer(self, function: Callable[[Any], Any], item: Any) -> Any:
        import ray

        try:
            return ray.get(self._worker.answer.remote(function, item))
        except ray.exceptions.RayActorError:
            return WorkerDied()
        except BaseException as error:  # an answer or error that cannot be pickled
            return error

    def stop(self) -> None:
        import ray

        ray.kill(self._worker)


@salframe.hookimpl
def salframe_provides() -> list[type[Component]]:
    return [Ray]
