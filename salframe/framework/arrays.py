"""Validation of arrays in the fields of frozen dataclasses."""

from __future__ import annotations

import numpy as np

from salframe.framework.errors import DataError, SalframeError


def check_array(
    owner: object, name: str, dtype: type, *shape: int | None, error: type[SalframeError] = DataError
) -> np.ndarray:
    """Check the array in a field and replace it by a read-only array.

    Args:
        owner: The object that has the field.
        name: The name of the field.
        dtype: The dtype of the new array. The old dtype must be castable to it ("same_kind").
        shape: The length of each axis, None for any length.
        error: The exception to raise.

    Returns:
        The new array.

    Raises:
        error: The dtype or shape is not the expected one.
    """
    value = np.asarray(getattr(owner, name))
    fits = value.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, value.shape, strict=False))
    if not fits:
        want = "(" + ", ".join("*" if n is None else str(n) for n in shape) + ")"
        raise error(f"{type(owner).__name__}.{name} has shape {value.shape}, expected {want}")
    if not np.can_cast(value.dtype, dtype, "same_kind"):
        raise error(f"{type(owner).__name__}.{name} has dtype {value.dtype}, expected {np.dtype(dtype)}")
    value = value.astype(dtype, copy=False).view()
    value.flags.writeable = False
    object.__setattr__(owner, name, value)
    return value
