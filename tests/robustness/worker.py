"""A process that reads damaged files, one after the other, and is replaced where one hangs or kills it."""

from __future__ import annotations

import multiprocessing
import shutil
import sys
import traceback
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

HANG_S, MEMORY_MB, LONGEST_LINE = 20.0, 1000.0, 12_000
_TESTS = Path(__file__).parent.parent


class Finding(NamedTuple):
    """What became of a damaged file: "ok", "refused", "wrong" (believed though sealed), "traceback", "hang", "died" or
    "memory", and what is to be said of it."""

    verdict: str
    what: str


class Workshop:
    """Reads damaged copies of sound files in a process of its own."""

    def __init__(self, sound: Path, scratch: Path) -> None:
        self._sound, self._scratch = sound, scratch
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, self._sound, self._scratch), daemon=True)
        self._process.start()
        theirs.close()
        self._ours.recv()

    def judge(self, reader: str, seed: int) -> Finding:
        """Damage a file of a reader by a seed and have it read."""
        self._ours.send((reader, seed))
        try:
            if self._ours.poll(HANG_S):
                return Finding(*self._ours.recv())
            finding = Finding("hang", f"{reader}, seed {seed}")
        except EOFError:
            finding = Finding("died", f"{reader}, seed {seed}")
        self.close()
        self._start()
        return finding

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()


def serve(pipe, sound: Path, scratch: Path) -> None:
    """Answer requests until the pipe closes."""
    sys.path[:0] = [str(_TESTS), str(_TESTS / "robustness")]
    from mutator import damage
    from readers import READERS

    from salframe.framework.errors import SalframeError

    np.seterr(all="ignore")
    known = {}
    for name, reader in READERS.items():
        if (sound / reader.folder).exists():
            known[name] = repr(reader.read(sound / reader.folder))
    before_mb = _peak_mb()
    pipe.send("ready")
    while True:
        try:
            name, seed = pipe.recv()
        except EOFError:
            return
        reader, rng = READERS[name], np.random.default_rng([seed, zlib.crc32(name.encode())])
        copy = scratch / reader.folder
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(sound / reader.folder, copy)
        files = sorted(path for path in copy.rglob("*") if path.is_file())
        path = files[rng.integers(len(files))]
        how = damage(path, rng)
        what = f"{name}, seed {seed}: {how} of {path.name}"
        if reader.reseal is not None and path.name != "map.json":
            reader.reseal(copy)
        try:
            read = repr(reader.read(copy))
        except SalframeError as error:
            one_line = "\n" not in str(error) and len(str(error)) < LONGEST_LINE
            verdict = "refused" if one_line else "traceback"
            what += f": {error}"
        except BaseException:
            verdict, what = "traceback", f"{what}\n{traceback.format_exc()}"
        else:
            verdict = "wrong" if reader.sealed and read not in (known[name], "None") else "ok"
        peak_mb = _peak_mb()
        if peak_mb - before_mb > MEMORY_MB:
            verdict, what = "memory", f"{what}: {peak_mb - before_mb:.0f} MB"
            before_mb = peak_mb
        pipe.send((verdict, what))


def _peak_mb() -> float:
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
