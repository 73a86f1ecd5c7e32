"""Shares of a method's work: each is done by one worker in a separate folder, and then merged."""

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
"""Name of the folder in a method's folder that holds a folder for each share while several workers run."""


@dataclass(frozen=True)
class Share:
    """A share of the work of a method.

    Attributes:
        keys: Keys of the pieces of work in this share, such as queries.
        folder: Folder to which the result rows of these pieces are written.
    """

    keys: Sequence[tuple[Any, ...]]
    folder: Path


def split_work(keys: Sequence[tuple[Any, ...]], workers: int, folder: Path) -> list[Share]:
    """Split the pieces of work, such as queries, with these keys into at most `workers` shares.

    A share holds consecutive pieces, since these use the same maps. A single share works in the method's folder.
    """
    count = max(1, min(workers, len(keys)))
    if count == 1:
        return [Share(keys, folder)]
    bounds = [len(keys) * number // count for number in range(count + 1)]
    return [
        Share(keys[first:end], folder / SHARES / f"{number:04d}")
        for number, (first, end) in enumerate(pairwise(bounds))
    ]


def share_folders(folder: Path) -> list[Path]:
    """Return the folders of the shares that are not joined yet, in the order of their pieces."""
    return sorted((folder / SHARES).glob("*"))


def join_shares(folder: Path) -> None:
    """Append the rows and logs of all shares, finished or not, to the files in the method's folder."""
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
    """Append the rows that are missing from the target. Several shares may record the same map."""
    existing = set(map(json.dumps, read_rows(target, Row)))
    with RowWriter(target) as rows:
        for row in read_rows(source, Row):
            if json.dumps(row) not in existing:
                rows.append(row)


def join_outcomes(outcomes: Sequence[Outcome]) -> Outcome:
    """Return the outcome of a method from the outcomes of its parts: the worst status, and all reasons."""
    status = max((outcome.status for outcome in outcomes), key=list(MethodStatus).index)
    reasons = dict.fromkeys(outcome.reason for outcome in outcomes if outcome.reason)
    parts = max((outcome.input for outcome in outcomes), key=len)
    return Outcome(status, "; ".join(reasons) or None, parts)
