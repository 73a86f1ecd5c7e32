"""A method's work in shares: each done by a worker of its own into a folder of its own, then put together."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from salframe.evaluation.runs.rows import Row, RowWriter, read_rows
from salframe.evaluation.runs.run_folder import CRASH_LOG, DESCRIPTIONS, MAPS, ROWS, MethodStatus, Outcome
from salframe.framework.files.reading import read_text
from salframe.framework.files.writing import write_text

SHARES = "shares"
"""In a method's folder, while several workers are at it: a folder a share."""


@dataclass(frozen=True)
class Share:
    """Pieces of a method's work by what they are known by, and the folder for what is made of them."""

    keys: Sequence[tuple[Any, ...]]
    folder: Path


def split_work(keys: Sequence[tuple[Any, ...]], workers: int, folder: Path) -> list[Share]:
    """So many shares of pieces that follow one another, as these are asked of the same maps; a single one works in the
    method's own folder."""
    count = max(1, min(workers, len(keys)))
    if count == 1:
        return [Share(keys, folder)]
    bounds = [len(keys) * number // count for number in range(count + 1)]
    return [
        Share(keys[first:end], folder / SHARES / f"{number:04d}")
        for number, (first, end) in enumerate(pairwise(bounds))
    ]


def share_folders(folder: Path) -> list[Path]:
    """The folders of the shares that are not joined yet, in the order of their pieces."""
    return sorted((folder / SHARES).glob("*"))


def join_shares(folder: Path) -> None:
    """Put what shares have made, finished or not, to what there is in the method's folder."""
    for share in share_folders(folder):
        for name in (ROWS, DESCRIPTIONS, MAPS):
            if (share / name).exists():
                _append(share / name, folder / name)
        if (share / CRASH_LOG).exists():
            logs = [log for log in (folder / CRASH_LOG, share / CRASH_LOG) if log.exists()]
            write_text(folder / CRASH_LOG, "".join(map(read_text, logs)))
        shutil.rmtree(share)
    shutil.rmtree(folder / SHARES, ignore_errors=True)


def _append(source: Path, target: Path) -> None:
    """Append rows that are not there: each share tells of the map that it was given."""
    known = set(map(json.dumps, read_rows(target, Row)))
    with RowWriter(target) as rows:
        for row in read_rows(source, Row):
            if json.dumps(row) not in known:
                rows.append(row)


def join_outcomes(outcomes: Sequence[Outcome]) -> Outcome:
    """How a method's work ended of which shares ended so: as the worst of them, with what each of them says."""
    status = max((outcome.status for outcome in outcomes), key=list(MethodStatus).index)
    reasons = dict.fromkeys(outcome.reason for outcome in outcomes if outcome.reason)
    given = max((outcome.given for outcome in outcomes), key=len)
    return Outcome(status, "; ".join(reasons) or None, given)
