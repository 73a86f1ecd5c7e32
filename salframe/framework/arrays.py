"""Arrays as fields of frozen values."""

from __future__ import annotations

import numpy as np

from salframe.framework.errors import DataError, SalframeError


def check_array(
    owner: object, name: str, dtype: type, *shape: int | None, error: type[SalframeError] = DataError
) -> np.ndarray:
    """Bring a field to a read-only array of this dtype and shape (None: any length). Raises `error` where it is not."""
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
