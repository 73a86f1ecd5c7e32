"""Running `salframe` in this process."""

from __future__ import annotations

import io
import json
import re
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

from salframe.cli import main


@dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


def run(*arguments: object) -> Result:
    """The exit status and output of `salframe` with these arguments."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with patch.object(sys, "argv", ["salframe", *map(str, arguments)]), redirect_stdout(out), redirect_stderr(err):
        try:
            main()
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 1
    return Result(code, out.getvalue(), err.getvalue())


VOLATILE = re.compile(r"_ms$|_mb$|^ms$|seconds|^run$|^report$|^date$|^machine$|fingerprint$")
"""Keys of JSON whose values differ from one run to the next: times, memory, where it is kept, the bytes of the data."""


def without_times(value: Any) -> Any:
    """JSON without what differs from one run to the next."""
    if isinstance(value, dict):
        return {key: without_times(part) for key, part in value.items() if not VOLATILE.search(key)}
    return [without_times(part) for part in value] if isinstance(value, list) else value
