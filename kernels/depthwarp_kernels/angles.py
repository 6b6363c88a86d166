"""Angles from +, -, *, / and sqrt alone, because libraries round trigonometry differently.

All devices give the same bits; the error is below 2 units in the last place of pi.
"""

import warp as wp

PI = wp.constant(wp.float32(3.14159265358979))
HALF_PI = wp.constant(wp.float32(1.57079632679490))
QUARTER_PI = wp.constant(wp.float32(0.785398163397448))
TAN_EIGHTH_PI = wp.constant(wp.float32(0.414213562373095))

# atan z = z + z^3 (A0 + A1 z^2 + A2 z^4 + A3 z^6) for |z| <= tan(pi / 8): fitted to the smallest
# greatest error, 2.0e-8 of the angle.
A0 = wp.constant(wp.float32(-0.33332955837249756))
A1 = wp.constant(wp.float32(0.19977925717830658))
A2 = wp.constant(wp.float32(-0.13879846036434174))
A3 = wp.constant(wp.float32(0.0806029811501503))


@wp.func
def angle_of(y: wp.float32, x: wp.float32):
    """The angle of (x, y) from the x axis, -pi to pi; 0 for (0, 0)."""
    ax = wp.abs(x)
    ay = wp.abs(y)
    small = wp.min(ax, ay)
    large = wp.max(ax, ay)
    # Above pi / 8 the angle is pi / 4 less that of the vector turned by pi / 4.
    turned = small > TAN_EIGHTH_PI * large
    z = wp.where(
        turned, (small - large) / (small + large), small / wp.where(large > 0.0, large, 1.0)
    )
    square = z * z
    series = A0 + square * (A1 + square * (A2 + square * A3))
    angle = z + z * (square * series)
    angle = wp.where(turned, QUARTER_PI + angle, angle)
    angle = wp.where(ay > ax, HALF_PI - angle, angle)
    angle = wp.where(x < 0.0, PI - angle, angle)
    return wp.where(y < 0.0, -angle, angle)
