"""Damaged input of every kind that salframe reads gets one clear line, and costs nothing else."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections import Counter
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from commands import COMMANDS, write_place
from readers import READERS, write_network, write_sound
from worker import Workshop

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="it makes FIFOs")
FAULTS = ("traceback", "hang", "died", "memory", "wrong")
SEEDS = [int(seed) for seed in os.environ.get("SALFRAME_TEST_SEEDS", "1,2,3").split(",")]


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    root = tmp_path_factory.mktemp("robustness")
    kept = os.environ.get("SALFRAME_CACHE")
    os.environ["SALFRAME_CACHE"] = str(root / "kept")
    write_sound(root / "sound")
    write_place(root / "sound" / "place", root / "sound" / "folder")
    if importlib.util.find_spec("onnx") is not None:
        write_network(root / "sound" / "network" / "net.onnx")
    made = Workshop(root / "sound", root / "scratch")
    yield made
    made.close()
    os.environ.pop("SALFRAME_CACHE") if kept is None else os.environ.update(SALFRAME_CACHE=kept)


def judge(workshop: Workshop, cases: int, seed: int) -> None:
    """Damage so many files by a seed; of ten, one is read by a command, in the process that calls the readers too."""
    readers = [name for name in READERS if name != "network" or importlib.util.find_spec("onnx") is not None]
    findings = []
    for case in range(cases):
        tenth, names = case // 10, list(COMMANDS) if case % 10 == 9 else readers
        number = tenth if case % 10 == 9 else case - tenth
        findings.append(workshop.judge(names[number % len(names)], seed * cases + case))
    count = Counter(finding.verdict for finding in findings)
    print(f"seed {seed}, {cases} damaged inputs: " + ", ".join(f"{count[fault]} {fault}" for fault in FAULTS))
    print(f"{count['refused']} refused in one line, {count['same']} read as before, {count['changed']} as another:")
    print(*(f"  {finding.what}" for finding in findings if finding.verdict == "changed"), sep="\n")
    faults = [finding for finding in findings if finding.verdict in FAULTS]
    assert not faults, "\n".join(f"{finding.verdict}: {finding.what}" for finding in faults[:60])
    assert count["refused"] > cases / 3


def test_200_damaged_inputs(workshop):
    judge(workshop, 200, 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_2000_damaged_inputs(workshop, seed):
    judge(workshop, 2000, seed)
