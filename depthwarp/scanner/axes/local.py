"""What the axes without a controller share: being connected or not, and the `with` block."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self

from depthwarp.scanner.axis import AxisLostError

__all__ = ["LocalAxis"]


class LocalAxis(ABC):
    """An axis that no line leads to.

    Args:
        name: Its greeting, and what error messages call it.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._connected = False

    def connect(self) -> str:
        """See `Axis.connect`."""
        self._connected = True
        return self._name

    @abstractmethod
    def stop(self) -> None:
        """See `Axis.stop`."""

    def close(self) -> None:
        """See `Axis.close`."""
        self.stop()
        self._connected = False

    def __enter__(self) -> Self:
        """Connect."""
        self.connect()
        return self

    def __exit__(self, *exception: object) -> None:
        """Close, on every way out."""
        self.close()

    def _check(self) -> None:
        if not self._connected:
            raise AxisLostError(f"the {self._name} is not connected: call connect() first")
