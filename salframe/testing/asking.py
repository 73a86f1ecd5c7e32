"""Asking a component something, and saying what was wrong with the answer."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np


class ConformanceError(AssertionError):
    """A component breaks a rule of its role. One line: what was checked, what was received, what was expected."""


class DoesNotApply(Exception):
    """A rule has nothing to check on a component; in one line, why."""


def expect(holds: object, checked: str, received: object, expected: str) -> None:
    """Raise ConformanceError where `holds` is not truthy."""
    if not holds:
        raise ConformanceError(" ".join(f"{checked}: received {received}, expected {expected}".split()))


def attempt(checked: str, function: Callable[..., Any], *given: Any) -> Any:
    """function(*given), whatever it raises told as a ConformanceError."""
    try:
        return function(*given)
    except Exception as error:
        line = " ".join(f"{type(error).__name__}: {error}".split())
        raise ConformanceError(
            f"{checked}: received {line}, expected an answer (arrays given are read-only)"
        ) from error


def ask(checked: str, function: Callable[..., Any], *given: Any) -> Any:
    """function(*given), asked twice with read-only arrays: the answer must be the same and `given` must not change."""
    for value in given:
        _lock(value)
    before = copy.deepcopy(given)
    answer = attempt(checked, function, *given)
    expect(same(given, before), checked, "a change of its input", "an input left as it was")
    again = attempt(checked, function, *given)
    expect(same(answer, again), checked, "two answers to the same input", "the same one twice")
    return answer


def same(a: Any, b: Any, tolerance: float = 0.0) -> bool:
    """Whether two values hold the same, floats to a tolerance, relative and absolute; NaN is NaN."""
    if isinstance(a, np.ndarray):
        if not isinstance(b, np.ndarray) or (a.dtype, a.shape) != (b.dtype, b.shape):
            return False
        if a.dtype.kind in "fc":
            return np.allclose(a, b, rtol=tolerance, atol=tolerance, equal_nan=True)
        return np.array_equal(a, b)
    if type(a) is not type(b):
        return False
    if isinstance(a, str):
        return a == b
    if isinstance(a, Mapping):
        return a.keys() == b.keys() and all(same(a[key], b[key], tolerance) for key in a)
    if isinstance(a, Sequence):
        return len(a) == len(b) and all(same(*pair, tolerance) for pair in zip(a, b, strict=True))
    if dataclasses.is_dataclass(a):
        names = [field.name for field in dataclasses.fields(a)]
        return all(same(getattr(a, name), getattr(b, name), tolerance) for name in names)
    if isinstance(a, float) and a == a:
        return math.isclose(a, b, rel_tol=tolerance, abs_tol=tolerance)
    return bool(a == b) or bool(a != a and b != b)


def _lock(value: Any) -> None:
    """Make every array in a value read-only."""
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            _lock(getattr(value, field.name))
    elif isinstance(value, Mapping):
        for part in value.values():
            _lock(part)
    elif isinstance(value, tuple | list):
        for part in value:
            _lock(part)
