"""Checks of the options of filters."""

from __future__ import annotations

from typing import Any

import numpy as np

from depthwarp.errors import InputError

__all__ = ["check_options", "check_truth"]


def check_options(method: str, given: dict[str, Any], known: tuple[str, ...]) -> dict[str, Any]:
    """The options that were given, all of them known to the method.

    Raises:
        InputError: An option of another method; the message names those of this one.
    """
    options = {name: value for name, value in given.items() if value is not None}
    for name in options:
        if name not in known:
            there = f"its options are {', '.join(known)}" if known else "it has no options"
            raise InputError(f"method '{method}' has no {name}: {there}")
    return options


def check_truth(name: str, value: bool) -> bool:
    """Return a truth value, of Python or NumPy; a number is none."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} must be one of True, False, got {value!r}")
    return bool(value)
