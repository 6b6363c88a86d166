"""Lens distortion on the plane at distance 1: Brown-Conrady and OpenCV's rational model.

(a, b) are ideal coordinates on the plane, a to the right and b down. Source: Brown 1966; OpenCV's
documentation of `calib3d` for the names and the order of the coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.inversion import first_positive_root, invert_increasing
from depthwarp.checks import check_finite_vector
from depthwarp.errors import InputError

__all__ = ["BrownDistortion"]

Float64Array = npt.NDArray[np.float64]

LENGTHS = (4, 5, 8, 12, 14)
"""Numbers of coefficients that OpenCV knows."""

WIDEST = np.tan(np.radians(89.9))
"""Greatest distance from the axis on the plane that is looked at: rays beyond are not ahead."""

RADII, DIRECTIONS, FINE_DIRECTIONS = 512, 64, 1024
"""Radii and directions in which the edge of the domain is looked for, then made precise."""

NEWTON_STEPS = 40
"""Most rays need 4; the rest lie beside the edge of the domain, or beyond it."""


@dataclass(frozen=True)
class BrownDistortion:
    """Distortion coefficients, in OpenCV's order.

    Attributes:
        k1: Radial, of r^2.
        k2: Radial, of r^4.
        p1: Tangential.
        p2: Tangential.
        k3: Radial, of r^6.
        k4: Of r^2 in the radial denominator.
        k5: Of r^4 in the radial denominator.
        k6: Of r^6 in the radial denominator.
        s1: Thin prism, columns, of r^2.
        s2: Thin prism, columns, of r^4.
        s3: Thin prism, rows, of r^2.
        s4: Thin prism, rows, of r^4.
        tau_x: Tilt of the sensor about the columns' axis [rad].
        tau_y: Tilt of the sensor about the rows' axis [rad].
    """

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0
    s4: float = 0.0
    tau_x: float = 0.0
    tau_y: float = 0.0

    @classmethod
    def from_coefficients(cls, coefficients: Sequence[float]) -> BrownDistortion:
        """Distortion of 4, 5, 8, 12 or 14 coefficients; none is an ideal lens.

        Raises:
            InputError: Another number of them, or one that is not finite.
        """
        values = np.asarray(coefficients, dtype=np.float64).ravel()
        if values.size not in (0, *LENGTHS):
            raise InputError(
                f"distortion must be {', '.join(map(str, LENGTHS))} coefficients in OpenCV's order "
                f"(k1, k2, p1, p2[, k3[, k4, k5, k6[, s1..s4[, tau_x, tau_y]]]]), got {values.size}"
            )
        return cls(*check_finite_vector("distortion", values.tolist(), values.size))

    @property
    def coefficients(self) -> tuple[float, ...]:
        """The coefficients in OpenCV's order, cut behind the last group that is not zero."""
        values = tuple(getattr(self, field.name) for field in fields(self))
        used = max((k + 1 for k, value in enumerate(values) if value), default=0)
        return values[: next(length for length in (0, *LENGTHS) if length >= used)]

    @property
    def is_rational(self) -> bool:
        """Whether it needs more than k1, k2, k3, p1, p2."""
        return len(self.coefficients) > 5

    @cached_property
    def tilt(self) -> Float64Array:
        """Homography of the tilted sensor, shape (3, 3): the plane's points onto it."""
        cx, sx = np.cos(self.tau_x), np.sin(self.tau_x)
        cy, sy = np.cos(self.tau_y), np.sin(self.tau_y)
        about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
        about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
        turned = about_y @ about_x
        onto = np.array(
            [[turned[2, 2], 0, -turned[0, 2]], [0, turned[2, 2], -turned[1, 2]], [0, 0, 1]]
        )
        return np.asarray(onto @ turned, dtype=np.float64)

    @cached_property
    def max_radius(self) -> float:
        """Radius of the domain on the plane: within it the lens folds nowhere; infinite if ever.

        The radial part has to grow, its denominator to stay above 0, and the determinant of the
        whole Jacobian too; where that fails first, in any direction, is the edge. With more than a
        radial part, nothing beyond 89.9 degrees is in the domain.
        """
        above, below = self._radial_polynomials()
        square = np.polynomial.Polynomial([0, 1])
        growth = above * below + 2 * square * (above.deriv() * below - above * below.deriv())
        edge = np.sqrt(min(first_positive_root(growth), first_positive_root(below)))
        if self.p1 or self.p2 or self.s1 or self.s2 or self.s3 or self.s4:
            return self._first_fold(min(float(edge), float(WIDEST)))
        return float(edge)

    def apply(self, a: Float64Array, b: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Distorted coordinates of ideal ones, shape (...); NaN outside the domain."""
        inside = a * a + b * b <= self.max_radius**2
        x, y = self._bend(np.where(inside, a, np.nan), b)
        t = self.tilt
        scale = t[2, 0] * x + t[2, 1] * y + t[2, 2]
        scale = np.where(scale > 0, scale, np.nan)
        return (
            (t[0, 0] * x + t[0, 1] * y + t[0, 2]) / scale,
            (t[1, 0] * x + t[1, 1] * y + t[1, 2]) / scale,
        )

    def undo(self, x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Ideal coordinates of distorted ones, shape (...), by Newton; NaN where there are none."""
        t = np.linalg.inv(self.tilt)
        scale = t[2, 0] * x + t[2, 1] * y + t[2, 2]
        x, y = (
            (t[0, 0] * x + t[0, 1] * y + t[0, 2]) / scale,
            (t[1, 0] * x + t[1, 1] * y + t[1, 2]) / scale,
        )
        shape = np.shape(x)
        x, y = np.ravel(x), np.ravel(y)
        a, b = self._start(x, y)
        close = np.zeros(x.shape, dtype=bool)
        reduction = np.ones(x.shape)
        for _ in range(NEWTON_STEPS):
            k = np.flatnonzero(~close)
            a[k], b[k], close[k], reduction[k] = self._newton_step(
                x[k], y[k], a[k], b[k], reduction[k]
            )
        inside = a * a + b * b <= self.max_radius**2 * (1 + 1e-12)
        a, b = np.where(close & inside, a, np.nan), np.where(close & inside, b, np.nan)
        return a.reshape(shape), b.reshape(shape)

    def _newton_step(
        self,
        x: Float64Array,
        y: Float64Array,
        a: Float64Array,
        b: Float64Array,
        reduction: Float64Array,
    ) -> tuple[Float64Array, Float64Array, npt.NDArray[np.bool_], Float64Array]:
        """Ideal coordinates after one step, whether they are close enough, and how much of a step.

        A step that leads away, over the edge of the domain or across a pole, is not made; the next
        one is shorter.
        """
        fx, fy = self._bend(a, b)
        error = np.hypot(fx - x, fy - y)
        (xa, xb), (ya, yb) = self._jacobian(a, b)
        part = reduction / (xa * yb - xb * ya)
        new_a = a - part * (yb * (fx - x) - xb * (fy - y))
        new_b = b - part * (xa * (fy - y) - ya * (fx - x))
        fx, fy = self._bend(new_a, new_b)
        new_error = np.hypot(fx - x, fy - y)
        within = new_a * new_a + new_b * new_b <= self.max_radius**2
        better = (new_error < error) & within
        close = np.minimum(error, np.where(better, new_error, np.inf)) <= 1e-10 * (
            1 + np.hypot(x, y)
        )
        return (
            np.where(better, new_a, a),
            np.where(better, new_b, b),
            close,
            np.where(better, np.minimum(1.0, 2 * reduction), 0.25 * reduction),
        )

    def _radial_polynomials(self) -> tuple[np.polynomial.Polynomial, np.polynomial.Polynomial]:
        """Numerator and denominator of the radial part, in r^2."""
        return (
            np.polynomial.Polynomial([1, self.k1, self.k2, self.k3]),
            np.polynomial.Polynomial([1, self.k4, self.k5, self.k6]),
        )

    def _bend(self, a: Float64Array, b: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Everything but the tilt."""
        above, below = self._radial_polynomials()
        square = a * a + b * b
        radial = above(square) / below(square)
        x = a * radial + 2 * self.p1 * a * b + self.p2 * (square + 2 * a * a)
        y = b * radial + self.p1 * (square + 2 * b * b) + 2 * self.p2 * a * b
        return (
            x + square * (self.s1 + square * self.s2),
            y + square * (self.s3 + square * self.s4),
        )

    def _jacobian(
        self, a: Float64Array, b: Float64Array
    ) -> tuple[tuple[Float64Array, Float64Array], tuple[Float64Array, Float64Array]]:
        """Derivatives of `_bend`: ((dx/da, dx/db), (dy/da, dy/db))."""
        above, below = self._radial_polynomials()
        square = a * a + b * b
        over, under = above(square), below(square)
        radial = over / under
        # Of the radial part and of the prism by r^2, times d(r^2)/da = 2 a.
        slope = 2 * (above.deriv()(square) * under - over * below.deriv()(square)) / (under * under)
        prism_x = 2 * (self.s1 + 2 * self.s2 * square)
        prism_y = 2 * (self.s3 + 2 * self.s4 * square)
        mixed = slope * a * b + 2 * self.p1 * a + 2 * self.p2 * b
        return (
            (
                radial + slope * a * a + 2 * self.p1 * b + 6 * self.p2 * a + prism_x * a,
                mixed + prism_x * b,
            ),
            (
                mixed + prism_y * a,
                radial + slope * b * b + 6 * self.p1 * b + 2 * self.p2 * a + prism_y * b,
            ),
        )

    def _first_fold(self, limit: float) -> float:
        """Radius up to which the Jacobian's determinant is above 0 in all directions."""

        def lowest_determinant(r: Float64Array, directions: int) -> Float64Array:
            angles = np.arange(directions) * (2 * np.pi / directions)
            with np.errstate(all="ignore"):  # the edge may be a pole
                (xa, xb), (ya, yb) = self._jacobian(
                    r[:, None] * np.cos(angles), r[:, None] * np.sin(angles)
                )
                lowest: Float64Array = (xa * yb - xb * ya).min(axis=1)
            return lowest

        radii = np.tan(np.linspace(0, np.arctan(limit), RADII))
        folded = np.flatnonzero(~(lowest_determinant(radii, DIRECTIONS) > 0))
        if folded.size == 0:
            return limit
        # Between two of those directions the lens may fold a little earlier.
        good, bad = radii[max(folded[0] - 3, 0)], radii[folded[0]]
        for _ in range(40):
            middle = 0.5 * (good + bad)
            if lowest_determinant(np.array([middle]), FINE_DIRECTIONS)[0] > 0:
                good = middle
            else:
                bad = middle
        return float(good)

    def _start(self, x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Ideal coordinates as if only the radial part bent them; not on the edge: flat there."""
        above, below = self._radial_polynomials()
        bent = np.hypot(x, y)
        angle = invert_increasing(
            lambda theta: np.tan(theta) * above(np.tan(theta) ** 2) / below(np.tan(theta) ** 2),
            bent,
            float(np.arctan(min(0.99 * self.max_radius, WIDEST))),
        )
        with np.errstate(invalid="ignore"):
            stretch = np.where(bent > 0, np.tan(angle) / np.where(bent > 0, bent, 1.0), 1.0)
        return x * stretch, y * stretch
