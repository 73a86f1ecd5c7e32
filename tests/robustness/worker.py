"""A process that reads damaged files, one after the other, and is replaced where one hangs or kills it."""

from __future__ import annotations

import multiprocessing
import sys
import traceback
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil

HANG_S, POLL_S, MEMORY_MB, MAX_LINE = 20.0, 0.5, 1000.0, 12_000
_TESTS = Path(__file__).parent.parent


class Finding(NamedTuple):
    """The result of reading a damaged file, and what to report of it.

    The verdict is one of:
        "refused": One line says what is wrong.
        "same": What was read is identical to the sound content.
        "changed": Other content was read; the answer of a command is the same.
        "reported": The answer of a command differs, and a line, note, status or reason says so.
        "plausible": The answer differs without a line, and the file could be a sound one of other content.
        "wrong": The answer differs without a line, though the file could not be a sound one, or though hashes protect
            the file.
        "traceback", "hang", "died", "memory": The reader failed.
    """

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
        self._readers: set[str] = set()

    def judge(self, reader: str, seed: int) -> Finding:
        """Damage a file of a reader by a seed and have it read."""
        if reader not in self._readers:
            self._readers.add(reader)
            self._ours.send((reader, None))
            self._ours.recv()
        self._ours.send((reader, seed))
        try:
            if self._has_reply():
                return Finding(*self._ours.recv())
            finding = Finding("hang", f"{reader}, seed {seed}")
        except EOFError:
            finding = Finding("died", f"{reader}, seed {seed}")
        self.close()
        self._start()
        return finding

    def _has_reply(self) -> bool:
        """Wait for a reply; return whether it came before the process computed or slept for HANG_S. Time in which it
        waits for a core, on a machine with other work, does not count."""
        process, idle_s = psutil.Process(self._process.pid), 0.0
        computed_s = sum(process.cpu_times()[:2])
        while not self._ours.poll(POLL_S):
            if process.status() != psutil.STATUS_RUNNING:
                idle_s += POLL_S
            if sum(process.cpu_times()[:2]) - computed_s + idle_s > HANG_S:
                return False
        return True

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()


def serve(pipe, sound: Path, scratch: Path) -> None:
    """Answer requests until the pipe closes: to read sound files, seed None, or files damaged by a seed."""
    sys.path[:0] = [str(_TESTS), str(_TESTS / "robustness")]
    from answers import CommandOutput, has_new_remark, has_other_answer, is_plausible
    from commands import COMMANDS, compute_once
    from mutator import damage
    from readers import READERS
    from sound_copy import restore

    from salframe.framework.errors import SalframeError

    np.seterr(all="ignore")
    compute_once()

    def copy_sound(reader) -> Path:
        return restore(sound / reader.folder, scratch / reader.folder)

    def compare(reader, sound_content, content, file: Path) -> str:
        if reader.sealed:
            return "wrong"
        if not isinstance(content, CommandOutput) or not has_other_answer(sound_content, content):
            return "changed"
        if has_new_remark(sound_content, content):
            return "reported"
        return "plausible" if is_plausible(sound / reader.folder / file, scratch / reader.folder / file) else "wrong"

    readers, sound_results = {**READERS, **COMMANDS}, {}
    before_mb = _peak_mb()
    pipe.send("ready")
    while True:
        try:
            name, seed = pipe.recv()
        except EOFError:
            return
        reader = readers[name]
        if seed is None:
            content = reader.read(copy_sound(reader))
            sound_results[name] = content, repr(content)
            pipe.send("known")
            continue
        copy, rng = copy_sound(reader), np.random.default_rng([seed, zlib.crc32(name.encode())])
        files = sorted(path for path in copy.glob(reader.files) if path.is_file())
        path = files[rng.integers(len(files))]
        how = damage(path, rng)
        what = f"{name}, seed {seed}: {how} of {path.name}"
        if reader.reseal is not None and path.name != "map.json":
            reader.reseal(copy)
        try:
            content = reader.read(copy)
            text = repr(content)
        except SalframeError as error:
            one_line = "\n" not in str(error) and len(str(error)) < MAX_LINE
            verdict = "refused" if one_line else "traceback"
            what += f": {error}"
        except BaseException:
            verdict, what = "traceback", f"{what}\n{traceback.format_exc()}"
        else:
            sound_content, sound_text = sound_results[name]
            if text in (sound_text, "None"):
                verdict = "same"
            else:
                verdict = compare(reader, sound_content, content, path.relative_to(copy))
                what += f": {_difference(sound_text, text)}"
        peak_mb = _peak_mb()
        if peak_mb - before_mb > MEMORY_MB:
            verdict, what = "memory", f"{what}: {peak_mb - before_mb:.0f} MB"
            before_mb = peak_mb
        pipe.send((verdict, what))


def _difference(before: str, after: str) -> str:
    """Where two texts part, and how each goes on."""
    at = next((i for i, (one, other) in enumerate(zip(before, after, strict=False)) if one != other), 0)
    return f"...{before[max(at - 60, 0) : at]} [{before[at : at + 60]}] [{after[at : at + 60]}]"


def _peak_mb() -> float:
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
