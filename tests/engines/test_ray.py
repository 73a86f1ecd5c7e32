"""The engine `ray`, on this machine and on two nodes: its answers are those of the others."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conformance import conforms
from loky import cpu_count
from salframe_ray import QUIET, Ray
from work_items import answer

import salframe
from salframe.framework.components.registry import registry
from salframe.framework.engines.worker import ONE_THREAD
from salframe.framework.errors import ConfigError, RequirementMissing

os.environ.update(QUIET)
ray = pytest.importorskip("ray", reason="needs salframe[ray]")
pytestmark = pytest.mark.slow

ADDRESS = "127.0.0.1:1"
TIMES = {"query_ms", "describe_ms", "peak_memory_mb"}


@pytest.fixture(scope="module", autouse=True)
def importable():
    """Workers have what the environment says on their path, and not the folder that a command is started in."""
    before = os.environ.get("PYTHONPATH")
    tests = Path(__file__).parent.parent
    os.environ["PYTHONPATH"] = os.pathsep.join([str(tests), str(tests / "engines"), *([before] if before else [])])
    yield
    ray.shutdown()
    os.environ["PYTHONPATH"] = before or ""


@pytest.fixture
def rooms(fakes, monkeypatch):
    """The components of fake_plugin, the engines and this one."""
    monkeypatch.setenv("SALFRAME_PLUGINS", f"{os.environ['SALFRAME_PLUGINS']},salframe_ray")
    registry.cache_clear()


def node_of(item: object) -> tuple[str, int, dict[str, str | None], str, str]:
    time.sleep(0.2)
    threads = {name: os.environ.get(name) for name in ONE_THREAD}
    node = ray.get_runtime_context().get_node_id()
    return node, os.getpid(), threads, str(Path(salframe.__file__).parent), os.getcwd()


def rows_of(run: Path, label: str) -> list[dict]:
    lines = (run / "methods" / label / "rows.jsonl").read_text().splitlines()
    return [{key: value for key, value in json.loads(line).items() if key not in TIMES} for line in lines]


def test_it_keeps_the_rules_of_engines():
    assert conforms(Ray)


def test_an_item_costs_only_itself_and_nothing_is_printed(capfd):
    engine = Ray(Ray.Config(workers=2))
    first, died, left, locked, last = engine.map(answer, ["a", "die", "leave", "lock", "b"])
    assert (first, last) == ("a", "b")
    assert str(died) == "the worker process died: it was killed, ran out of memory, or crashed in a library"
    assert isinstance(left, SystemExit)
    assert "cannot pickle '_thread.lock' object" in str(locked)
    assert capfd.readouterr() == ("", "")


def test_one_worker_leaves_room_for_as_many_as_there_are_processors():
    ray.shutdown()
    assert list(Ray(Ray.Config(workers=1)).map(answer, ["a"])) == ["a"]
    assert list(Ray(Ray.Config(workers=cpu_count())).map(answer, ["a", "b"])) == ["a", "b"]


@pytest.mark.parametrize("workers", [None, 1, 2])
def test_workers_take_salframe_from_its_installation_and_have_one_thread_each(workers, tmp_path, monkeypatch):
    """Where the command is started in a checkout too; relative paths mean what they mean there."""
    ray.shutdown()
    (tmp_path / "salframe").mkdir()
    (tmp_path / "salframe" / "__init__.py").write_text("raise ImportError('the folder of the command')")
    monkeypatch.chdir(tmp_path)
    found = list(Ray(Ray.Config(workers=workers)).map(node_of, range(8)))
    assert len({process for _, process, *_ in found}) == (workers or min(cpu_count(), 8))
    for _, _, threads, installed, directory in found:
        assert threads == ONE_THREAD
        assert installed == str(Path(salframe.__file__).parent)
        assert directory == str(tmp_path)


def test_more_workers_than_processors_of_a_cluster_are_refused():
    ray.shutdown()
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        with pytest.raises(ConfigError, match=r"engine\.workers=3, expected at most 1"):
            list(Ray(Ray.Config(workers=3, address=cluster.address)).map(answer, ["a"]))
    finally:
        ray.shutdown()
        cluster.shutdown()


def test_no_cluster_at_an_address_is_one_line():
    ray.shutdown()
    with pytest.raises(RequirementMissing, match=r"^no Ray cluster answers at auto: "):
        list(Ray(Ray.Config(address="auto")).map(answer, ["a"]))


def test_a_cluster_whose_token_is_not_at_hand_is_one_line(tmp_path):
    code = f"from salframe_ray import Ray; list(Ray(Ray.Config(address={ADDRESS!r})).map(abs, [1]))"
    environment = os.environ | {"HOME": str(tmp_path), "RAY_AUTH_MODE": "token"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120)
    assert re.search(rf"RequirementMissing: no Ray cluster answers at {ADDRESS}: .*token", done.stderr.splitlines()[-1])


def test_two_nodes_answer_as_one_process(rooms, monkeypatch):
    from ray.cluster_utils import Cluster

    ray.shutdown()
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        cluster.add_node(num_cpus=1)
        engine = Ray(Ray.Config(workers=2, address=cluster.address))
        assert len({node for node, *_ in engine.map(node_of, range(8))}) == 2
        runs = []
        for name, settings in (("inline", ()), ("ray", ("engine.workers=2", f"engine.address={cluster.address}"))):
            monkeypatch.setenv("SALFRAME_CACHE", f"cache-{name}")
            request = salframe.Request(
                ["reader", "weightless"],
                "rooms",
                settings=("data.leave_one_out=true", *settings),
                engine=name,
                runs=Path(f"runs-{name}"),
            )
            runs.append(salframe.compare(request))
        assert rows_of(runs[0].run, "reader") == rows_of(runs[1].run, "reader")
        assert [row.ended for row in runs[0].rows] == [row.ended for row in runs[1].rows]
    finally:
        ray.shutdown()
        cluster.shutdown()


def test_an_interrupt_ends_the_command(rooms, tmp_path):
    asked = ("compare", "--methods", "reader", "--data", "rooms", "--set", "sleep_s=0.3", "--engine", "ray")
    process = subprocess.Popen(
        [sys.executable, "-c", "from salframe.cli import main; main()", *asked],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell in the background ignores it
    )
    while not any(path.stat().st_size for path in tmp_path.glob("runs/*/methods/reader/rows.jsonl")):
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")
    assert err.splitlines()[-1].startswith("interrupted: finished work is stored")
    assert "Traceback" not in err
