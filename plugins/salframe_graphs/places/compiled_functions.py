"""Functions of numbers in single precision whose loops a compiler turns into vector instructions (Cephes, Moshier)."""

from __future__ import annotations

import numba
import numpy as np

FREE = {"reassoc", "contract", "arcp", "nsz"}
"""What rounding is left to the compiler; infinite and unknown stay what they are."""
_F4, _I4 = np.float32, np.int32
_compile = numba.njit(nogil=True, error_model="numpy", fastmath=FREE)


@_compile
def exp(x):  # type: ignore[no-untyped-def]
    """exp(x) for -87 < x < 88."""
    whole = np.floor(x * _F4(1.44269504) + _F4(0.5))
    r = x - whole * _F4(0.693359375) + whole * _F4(2.12194440e-4)
    value = _F4(1.9875691500e-4) * r + _F4(1.3981999507e-3)
    value = (value * r + _F4(8.3334519073e-3)) * r + _F4(4.1665795894e-2)
    value = (value * r + _F4(1.6666665459e-1)) * r + _F4(5.0000001201e-1)
    return (value * r * r + r + _F4(1)) * _I4((_I4(whole) + _I4(127)) << _I4(23)).view(_F4)


@_compile
def log(x):  # type: ignore[no-untyped-def]
    """The natural logarithm of x > 1e-37."""
    bits = _F4(x).view(_I4)
    whole = _F4((bits >> _I4(23)) - _I4(126))
    r = _I4((bits & _I4(0x007FFFFF)) | _I4(0x3F000000)).view(_F4)  # 0.5 to 1
    low = r < _F4(0.70710678)
    whole, r = whole - (_F4(1) if low else _F4(0)), r + (r if low else _F4(0)) - _F4(1)
    value = _F4(7.0376836292e-2) * r - _F4(1.1514610310e-1)
    value = (value * r + _F4(1.1676998740e-1)) * r - _F4(1.2420140846e-1)
    value = (value * r + _F4(1.4249322787e-1)) * r - _F4(1.6668057665e-1)
    value = (value * r + _F4(2.0000714765e-1)) * r - _F4(2.4999993993e-1)
    value = (value * r + _F4(3.3333331174e-1)) * r - _F4(0.5)
    return value * r * r - whole * _F4(2.12194440e-4) + r + whole * _F4(0.693359375)
