"""Validation of arrays in the fields of frozen dataclasses."""

from __future__ import annotations

from typing import Any

import numpy as np

from salframe.framework.errors import DataError, SalframeError


def as_array(value: Any, where: str, error: type[SalframeError] = DataError) -> np.ndarray:
    """Return a value as a numeric numpy array. Lists are converted.

    Args:
        value: An array, or anything that numpy converts.
        where: Name of the value in errors.
        error: The class of the exception to raise.

    Raises:
        error: The value is not a rectangular array of numbers (it is a path, for example), or it has masked values.
    """
    if np.ma.is_masked(value):
        raise error(f"{where} has masked values, expected an array without a mask: fill them with array.filled(value)")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):  # lists of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "biufc":
        received = f"dtype {value.dtype}" if isinstance(value, np.ndarray) else f"type {type(value).__name__}"
        raise error(f"{where} has the {received}, expected an array of numbers")
    return array


def check_array(
    owner: object, name: str, dtype: type, *shape: int | None, error: type[SalframeError] = DataError
) -> np.ndarray:
    """Check the array in a field and replace it by a read-only array.

    Args:
        owner: The object that has the field.
        name: The name of the field.
        dtype: The dtype of the new array. numpy must be able to cast the old array to it with casting="same_kind".
        shape: The length of each axis, None for any length.
        error: The class of the exception to raise.

    Returns:
        The new array.

    Raises:
        error: The dtype or shape is not the expected one, or an integer does not fit into the dtype.
    """
    value = getattr(owner, name)
    if type(value) is not np.ndarray or value.dtype != dtype or not _fits(value.shape, shape):
        value = _convert(value, f"the field {type(owner).__name__}.{name}", dtype, shape, error)
    value = value.view()
    value.flags.writeable = False
    object.__setattr__(owner, name, value)
    return value


def _fits(shape: tuple[int, ...], expected: tuple[int | None, ...]) -> bool:
    return len(shape) == len(expected) and shape == tuple(map(_known, expected, shape))


def _known(expected: int | None, got: int) -> int:
    return got if expected is None else expected


def _convert(
    value: Any, where: str, dtype: type, shape: tuple[int | None, ...], error: type[SalframeError]
) -> np.ndarray:
    """Return a value as an array of a dtype and shape. Raises the same errors as `check_array`."""
    value = as_array(value, where, error)
    if not _fits(value.shape, shape):
        want = "(" + ", ".join("*" if n is None else str(n) for n in shape) + ")"
        legend = " (*: any length)" if None in shape else ""
        raise error(f"{where} has shape {value.shape}, expected {want}{legend}")
    if not np.can_cast(value.dtype, dtype, "same_kind"):
        raise error(f"{where} has dtype {value.dtype}, expected {np.dtype(dtype)}")
    if value.size and np.dtype(dtype).kind in "iu" and not np.can_cast(value.dtype, dtype):
        low, high, limits = value.min(), value.max(), np.iinfo(dtype)
        if low < limits.min or high > limits.max:
            raise error(f"{where} has values from {low} to {high}, expected {limits.min} to {limits.max}")
    converted: np.ndarray = value.astype(dtype, copy=False)
    return converted


def check_mask(owner: object, name: str) -> np.ndarray:
    """Check the mask (H, W) in a field, replace it by a read-only bool array, and return that array.

    A mask of integers, such as 0 and 255, is true where the value is not 0. Raises the same errors as `check_array`.
    """
    value = as_array(getattr(owner, name), f"the field {type(owner).__name__}.{name}")
    if value.dtype.kind in "iu":
        object.__setattr__(owner, name, value != 0)
    return check_array(owner, name, np.bool_, None, None)
