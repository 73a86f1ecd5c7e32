"""Calls of a component, and errors that describe a wrong answer."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np


class ConformanceError(AssertionError):
    """A component breaks a rule of its role. The message is one line: what was checked, received and expected."""


class DoesNotApply(Exception):
    """A rule does not apply to a component. The message is one line that says why."""


def expect(holds: object, checked: str, received: object, expected: str) -> None:
    """Raise ConformanceError unless a condition holds.

    Args:
        holds: The condition.
        checked: What was checked, such as "detect in the bedroom".
        received: What the component returned.
        expected: What the rule expects.
    """
    if not holds:
        raise ConformanceError(" ".join(f"{checked}: received {received}, expected {expected}".split()))


def attempt(checked: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return function(*arguments). Any exception is raised again as a ConformanceError."""
    try:
        return function(*arguments)
    except Exception as error:
        line = " ".join(f"{type(error).__name__}: {error}".split())
        raise ConformanceError(
            f"{checked}: received {line}, expected an answer without an exception (checks make input arrays "
            "read-only: copy an array before you change it)"
        ) from error


def call_twice(checked: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return function(*arguments), and check that the function is pure.

    The function is called twice with read-only arrays. Both answers must be equal, and the arguments must not change.

    Raises:
        ConformanceError: The function raised, changed its arguments or gave two different answers.
    """
    for value in arguments:
        lock(value)
    before = copy.deepcopy(arguments)
    answer = attempt(checked, function, *arguments)
    expect(same(arguments, before), checked, "a changed input", "an unchanged input")
    again = attempt(checked, function, *arguments)
    expect(same(answer, again), checked, "two different answers to the same input", "the same answer twice")
    return answer


def same(a: Any, b: Any, tolerance: float = 0.0) -> bool:
    """Return whether two values are equal. Floats may differ by a relative and absolute tolerance; NaN equals NaN.

    A field of a dataclass with `compare=False` is ignored.
    """
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
        names = [field.name for field in dataclasses.fields(a) if field.compare]
        return all(same(getattr(a, name), getattr(b, name), tolerance) for name in names)
    if isinstance(a, float) and a == a:
        return math.isclose(a, b, rel_tol=tolerance, abs_tol=tolerance)
    return bool(a == b) or bool(a != a and b != b)


def lock(value: Any) -> None:
    """Make every array in a value read-only."""
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            lock(getattr(value, field.name))
    elif isinstance(value, Mapping):
        for part in value.values():
            lock(part)
    elif isinstance(value, tuple | list):
        for part in value:
            lock(part)
