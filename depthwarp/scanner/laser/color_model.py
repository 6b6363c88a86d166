"""The colour of a laser line against that of the scene: two mixtures and Bayes' rule."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.io.atomic import atomic_path
from depthwarp.scanner.json_files import JsonKind
from depthwarp.scanner.laser.colors import CHANNELS
from depthwarp.scanner.laser.mixture import GaussianMixture

__all__ = ["ColorKind", "LaserColorModel"]

FILE_KIND = JsonKind(
    "laser colour model", ("format", "depthwarp laser colour model"), 1, "fit the model again"
)


class ColorKind(StrEnum):
    """Which colours a model knows."""

    LIT = "lit"
    """Of frames with the laser on, as they are."""

    DIFFERENCE = "difference"
    """Of frames with the laser on, less a frame with the laser off."""


@dataclass(frozen=True, eq=False)
class LaserColorModel:
    """What colours the line has, what colours all else has, and how rare the line is.

    Attributes:
        laser: Colours of the line; its last component is the core where the sensor saturates.
        background: Colours of everything else.
        prior: Share of pixels that show the line, before their colour is seen.
        kind: Whether the colours are those of a lit frame or of an on/off difference.
        channel: The laser's own channel, where it is brightest: 0 blue, 1 green, 2 red.

    Raises:
        InputError: A prior that is not between 0 and 1, or an unknown channel.
    """

    laser: GaussianMixture
    background: GaussianMixture
    prior: float
    kind: ColorKind
    channel: int

    def __post_init__(self) -> None:
        if not 0.0 < self.prior < 1.0:
            raise InputError(f"prior must be above 0 and below 1, got {self.prior}")
        if self.channel not in range(len(CHANNELS)):
            raise InputError(f"channel must be 0, 1 or 2 (blue, green, red), got {self.channel}")

    def posterior(self, colors: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Probability that a colour is the line's, exact, float64.

        Args:
            colors: Shape (..., 3), blue, green, red [grey levels of 255].

        Returns:
            Shape (...), 0 to 1.
        """
        log_odds = self.laser.log_density(colors) - self.background.log_density(colors)
        log_odds += math.log(self.prior / (1.0 - self.prior))
        return np.asarray(1.0 / (1.0 + np.exp(-np.clip(log_odds, -700.0, 700.0))))

    @property
    def suppression(self) -> float:
        """Share of the other channels' mean that the line's signal may lose, 0 to 1.

        At 1 grey surfaces vanish from the signal (2G - R - B of a green laser). A saturated core
        is nearly white and would vanish with them, so the share is the largest at which the core
        component still is no darker than the other components of the laser.
        """
        own = self.laser.means[:, self.channel]
        others = (self.laser.means.sum(axis=1) - own) / 2.0
        gain, loss = own[-1] - own[:-1], others[-1] - others[:-1]
        shares = np.where(loss > 0, gain / np.where(loss > 0, loss, 1.0), 1.0)
        return float(np.clip(shares.min(initial=1.0), 0.0, 1.0))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model as JSON, whole or not at all; `load` gives back the same numbers.

        Raises:
            InputError: The file cannot be written.
        """
        content = {
            **FILE_KIND.header,
            "kind": self.kind.value,
            "channel": CHANNELS[self.channel],
            "prior": self.prior,
            "laser": _to_lists(self.laser),
            "background": _to_lists(self.background),
        }
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> LaserColorModel:
        """Read what `save` wrote.

        Raises:
            InputError: There is no such file.
            FileFormatError: It is not a colour model, or a damaged one.
        """
        return FILE_KIND.read(
            path,
            lambda content: cls(
                laser=_from_lists(content["laser"]),
                background=_from_lists(content["background"]),
                prior=float(content["prior"]),
                kind=ColorKind(content["kind"]),
                channel=CHANNELS.index(content["channel"]),
            ),
        )


def _to_lists(mixture: GaussianMixture) -> dict[str, Any]:
    return {
        "weights": mixture.weights.tolist(),
        "means": mixture.means.tolist(),
        "covariances": mixture.covariances.tolist(),
    }


def _from_lists(content: dict[str, Any]) -> GaussianMixture:
    return GaussianMixture(
        weights=np.array(content["weights"], dtype=np.float64),
        means=np.array(content["means"], dtype=np.float64),
        covariances=np.array(content["covariances"], dtype=np.float64),
    )
