"""Damaged input of every kind that salframe reads gets one clear line, and costs nothing else."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections import Counter
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from commands import COMMANDS, write_maps, write_place
from readers import READERS, write_network, write_sound
from worker import Finding, Workshop

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="it makes FIFOs")
FAULTS = ("traceback", "hang", "died", "memory", "wrong")
VERDICTS = {
    "refused": "refused with one line",
    "same": "identical content after reading",
    "changed": "changed content, same answer",
    "reported": "changed answer with a line",
    "plausible": "changed plausible number, another answer without a line",
}
MAX_EXAMPLES = 5
CASES = int(os.environ.get("SALFRAME_TEST_CASES", "2000"))
SEEDS = [int(seed) for seed in os.environ.get("SALFRAME_TEST_SEEDS", "1,2,3").split(",")]


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    root = tmp_path_factory.mktemp("robustness")
    cache = os.environ.get("SALFRAME_CACHE")
    os.environ["SALFRAME_CACHE"] = str(root / "cache")
    write_sound(root / "sound")
    write_place(root / "sound" / "place", root / "sound" / "folder")
    write_maps(root / "sound" / "maps", root / "sound" / "folder")
    if importlib.util.find_spec("onnx") is not None:
        write_network(root / "sound" / "network" / "net.onnx")
    shop = Workshop(root / "sound", root / "scratch")
    yield shop
    shop.close()
    os.environ.pop("SALFRAME_CACHE") if cache is None else os.environ.update(SALFRAME_CACHE=cache)


def judge(workshop: Workshop, cases: int, seed: int) -> None:
    """Damage so many files by a seed; of ten, three are read by a command, in the process that calls the readers
    too."""
    readers = [name for name in READERS if name != "network" or importlib.util.find_spec("onnx") is not None]
    findings = []
    for case in range(cases):
        is_command = case % 10 >= 7
        commands_before = 3 * (case // 10) + max(case % 10 - 7, 0)
        names, number = (list(COMMANDS), commands_before) if is_command else (readers, case - commands_before)
        findings.append(workshop.judge(names[number % len(names)], seed * cases + case))
    check(findings, f"seed {seed}")


def check(findings: list[Finding], what: str) -> None:
    """Print what became of damaged files, and fail where one was not refused in one line."""
    count = Counter(finding.verdict for finding in findings)
    print(f"{what}, {len(findings)} damaged inputs: " + ", ".join(f"{count[fault]} {fault}" for fault in FAULTS))
    for verdict, meaning in VERDICTS.items():
        print(f"{count[verdict]} {meaning}")
    examples = [finding.what for finding in findings if finding.verdict == "plausible"]
    print(*examples[:MAX_EXAMPLES], sep="\n")
    faults = [finding for finding in findings if finding.verdict in FAULTS]
    assert not faults, "\n".join(f"{finding.verdict}: {finding.what}" for finding in faults[:60])
    assert count["refused"] > len(findings) / 3


def test_200_damaged_inputs(workshop):
    judge(workshop, 200, 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_2000_damaged_inputs(workshop, seed):
    judge(workshop, 2000, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_2000_damaged_inputs_of_commands(workshop, seed):
    names = list(COMMANDS)
    check([workshop.judge(names[case % len(names)], seed * 2000 + case) for case in range(CASES)], f"commands, {seed}")
