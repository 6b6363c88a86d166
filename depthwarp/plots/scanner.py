"""The scanner's set-up, drawn to scale from its geometry."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from depthwarp.plots.layout import SetUp, lay_out
from depthwarp.plots.page import HEIGHT, VIEW_COLOR, WIDTH, Array, PngPath, open_page

if TYPE_CHECKING:
    from depthwarp.scanner.geometry import ScannerGeometry

__all__ = ["plot_setup"]

LASER, CAMERA, BODY, WALL = "#159a3a", "#1565c0", "#37424d", "#dfe2e5"

FAN = 90.0
"""Opening angle of the laser's fan in the paper [degrees]."""

FLOOR, CEILING = -0.79, 0.85
"""Heights relative to the camera, in distances to the wall: in the reference set-up 1.25 m below
and 1.35 m above it."""


def plot_setup(
    geometry: ScannerGeometry, path: PngPath, title: str = "3D range scanning system"
) -> None:
    """Draw the scanner from above and square to its laser plane, both to scale (Figure 1).

    The room and the tripod are examples; the numbers are the geometry's.
    """
    setup = lay_out(geometry)
    with open_page(path, title) as figure:
        above, aside = _panels(figure, setup)
        _draw_above(above, setup)
        _draw_aside(aside, setup)
        for number, (text, color) in enumerate(_facts(geometry, setup)):
            x = 0.06 + 0.235 * number
            figure.text(x, 0.155, text, va="top", fontsize=9.5, linespacing=1.5, color=color)


def _facts(geometry: ScannerGeometry, setup: SetUp) -> list[tuple[str, str]]:
    """What the geometry says in numbers, and the colours to write it in."""
    (width, height), (across, high) = geometry.lens.size, setup.view
    n_x, n_y, n_z = geometry.plane_normal
    column, row = setup.pixel
    return [
        (
            f"Camera\n{width} x {height} px\nfocal length {geometry.lens.fx:.0f} px\n"
            f"sees {across:.1f}° x {high:.1f}°",
            CAMERA,
        ),
        (
            f"Laser\nfan {FAN:.0f}°, toe-in {setup.toe_in:z.1f}°\nplane n · X = d = "
            f"{geometry.plane_distance:.3f} m\nn = ({n_x:.3f}, {n_y:z.3f}, {n_z:z.3f})",
            LASER,
        ),
        (
            f"Measured point\ncolumn {column:.1f}, row {row:.1f} px\nrange {setup.range:.2f} m\n"
            f"kept up to {geometry.max_range:g} m",
            VIEW_COLOR,
        ),
        (f"Head\nbaseline {setup.baseline:.3f} m\nturns 360°\nboth views are to scale", BODY),
    ]


def _panels(figure: Any, setup: SetUp) -> list[Any]:
    """Axes for the view from above and for the one from the side [m], of one scale."""
    unit, turn = setup.unit, _turning_radius(setup)
    edges, reach = setup.above(setup.rim)[:, 0], setup.aside(setup.point)[0]
    along = [1.08 * reach, -0.4 * unit]  # the wall on the side that it has from above
    names = ("seen from above", "seen from the side, square to the laser plane")
    spans = np.array(
        [
            [min(*edges, -turn) - 0.05 * unit, max(*edges, turn) + 0.05 * unit],
            [-turn - 0.22 * unit, setup.point[0] + 0.16 * unit],
            along[:: int(setup.side)],
            [(FLOOR - 0.09) * unit, (CEILING + 0.09) * unit],
        ]
    )
    sizes = np.ptp(spans, axis=1).reshape(2, 2)  # m
    room = np.array([WIDTH - 90, HEIGHT - 270])
    sizes *= min(room / (sizes[:, 0].sum(), sizes[:, 1].max()))  # px
    gap = (WIDTH - sizes[:, 0].sum()) / 3
    panels = []
    for number, (name, (width, height)) in enumerate(zip(names, sizes, strict=True)):
        x, y = gap + number * (gap + sizes[0, 0]), 160 + (room[1] - height) / 2
        panel = figure.add_axes((x / WIDTH, y / HEIGHT, width / WIDTH, height / HEIGHT))
        panel.set(xlim=spans[2 * number], ylim=spans[2 * number + 1])
        panel.axis("off")
        figure.text((x + width / 2) / WIDTH, 1 - 88 / HEIGHT, name, ha="center", fontsize=11)
        panels.append(panel)
    return panels


def _turning_radius(setup: SetUp) -> float:
    """Radius of the circle on which the camera turns [m]."""
    return float(np.hypot(*setup.above(setup.camera)))


def _draw_above(axes: Any, setup: SetUp) -> None:
    """Camera, laser and wall from above: baseline and toe-in are true."""
    unit, side, wall = setup.unit, setup.side, setup.point[0]
    camera, laser, crossing, point, left, right = map(
        setup.above, (setup.camera, setup.laser, setup.crossing, setup.point, *setup.rim)
    )
    _wall(axes, [(left[0], wall), (right[0], wall)], (0.0, 0.05 * unit))
    axes.fill(*np.array([left, camera, right]).T, color=CAMERA, alpha=0.07, lw=0)
    for edge in (left, right):
        _line(axes, camera, edge, CAMERA, lw=1)
    _line(axes, camera, (camera[0], wall), CAMERA, lw=0.8, ls="-.")
    _line(axes, laser, laser + (0, 0.6 * unit), LASER, lw=0.8, ls="--")
    _line(axes, laser, point, LASER, lw=2.2)
    _line(axes, camera, point, VIEW_COLOR, lw=1.6)
    _turn(axes, _turning_radius(setup), math.atan2(camera[1], camera[0]))
    _head(axes, camera, laser, unit)
    axes.plot(*point, "o", ms=8, color=VIEW_COLOR, mec="white", zorder=8)

    toward = math.atan2(*(point - laser)[::-1])
    arc = laser + 0.42 * unit * _on_circle(np.linspace(math.pi / 2, toward, 40))
    axes.plot(*arc.T, color=LASER, lw=1)
    _label(axes, arc[20], f"toe-in {setup.toe_in:z.1f}°", (0, 6), LASER, va="bottom")
    _dimension(axes, camera, crossing, -0.14 * unit, f"baseline {setup.baseline:.3f} m")
    _label(axes, camera, "camera", (-16 * side, -3), CAMERA, ha=_end(side), va="top")
    _label(axes, laser, "laser", (16 * side, 3), LASER, ha=_end(-side), va="bottom")
    free = right if point[0] < camera[0] else left
    seen = f"field of view\n{setup.view[0]:.1f}° across,\n{setup.view[1]:.1f}° high"
    _label(axes, (0.42 * free[0] + 0.58 * camera[0], 0.8 * wall), seen, (0, 0), CAMERA)
    _label(axes, 0.9 * free, "wall", (0, 42), va="bottom")
    _label(axes, (0, -_turning_radius(setup)), "the head turns 360°", (0, -6), va="top")
    _label(
        axes,
        point,
        f"measured point,\nrange {setup.range:.2f} m",
        (-4, 16),
        VIEW_COLOR,
        va="bottom",
    )


def _draw_aside(axes: Any, setup: SetUp) -> None:
    """The laser plane: its fan and the lit line on floor, wall and ceiling are true."""
    unit, side = setup.unit, setup.side
    camera, laser, point = map(setup.aside, (setup.camera, setup.laser, setup.point))
    (wall, _), thick, back = point, 0.045 * unit, -0.36 * unit
    floor, ceiling = camera[1] + FLOOR * unit, camera[1] + CEILING * unit
    _wall(axes, [(back, floor), (wall + thick, floor)], (0.0, -thick))
    _wall(axes, [(back, ceiling), (wall + thick, ceiling)], (0.0, thick))
    _wall(axes, [(wall, floor), (wall, ceiling)], (thick, 0.0))

    slope = math.tan(math.radians(FAN / 2))
    low, high = max(floor, laser[1] - slope * wall), min(ceiling, laser[1] + slope * wall)
    near, far = (laser[1] - low) / slope, (high - laser[1]) / slope
    lit = np.array([(near, low), (wall, low), (wall, high), (far, high)])
    axes.fill(*np.array([laser, *lit]).T, color=LASER, alpha=0.10, lw=0)
    _line(axes, laser, lit[0], LASER, lw=1)
    _line(axes, laser, lit[-1], LASER, lw=1)
    axes.plot(*lit.T, color=LASER, lw=3.2, solid_joinstyle="miter", zorder=5)
    arc = laser + 0.43 * unit * _on_circle(np.radians(np.linspace(-FAN / 2, FAN / 2, 40)))
    axes.plot(*arc.T, color=LASER, lw=1)
    _line(axes, camera, point, VIEW_COLOR, lw=1.6)
    axes.plot(*point, "o", ms=8, color=VIEW_COLOR, mec="white", zorder=8)

    _tripod(axes, floor, unit, side)
    _head(axes, camera, laser, unit)
    _label(axes, arc[8], f"fan {FAN:.0f}°", (-6 * side, -2), LASER, ha=_end(side), va="top")
    _label(axes, camera, "camera", (8 * side, -11), CAMERA, ha=_end(side), va="top")
    _label(axes, laser, "laser", (16 * side, 0), LASER, ha=_end(-side))
    _label(axes, (0, 0.5 * unit), "turning axis,\n360°", (10 * side, 0), ha=_end(-side))
    _label(axes, (0, -0.14 * unit), "stepping\nmotor", (16 * side, 0), ha=_end(-side))
    _label(axes, (-0.16 * unit, 0.7 * floor), "tripod", (14 * side, 0), ha=_end(-side))
    seen = f"measured point,\nrange {setup.range:.2f} m"
    _label(axes, point, seen, (10 * side, 10), VIEW_COLOR, ha=_end(-side), va="bottom")
    _label(axes, (wall, 0.55 * floor), "lit line", (10 * side, 0), LASER, ha=_end(-side))


def _tripod(axes: Any, floor: float, unit: float, side: float) -> None:
    """Turning axis, motor and three legs below the origin, with an arrow around the axis."""
    _line(axes, np.array([0, 0.62 * unit]), (0, floor), BODY, lw=0.8, ls="-.")
    for foot in (-0.26, 0.05, 0.26):
        _line(axes, np.array([0, -0.2 * unit]), (foot * unit, floor), BODY, lw=3)
    _line(axes, np.zeros(2), (0, -0.2 * unit), BODY, lw=5)
    axes.plot(0, -0.14 * unit, "s", ms=15, color=BODY, zorder=6)
    ellipse = (-0.11 * side, 0.03)  # to the right in front, on a page whose X may be mirrored
    ring = unit * ((0.0, 0.34) + np.array(ellipse) * _on_circle(np.linspace(1.9, 7.3, 60)))
    _arrow(axes, ring)


def _head(axes: Any, camera: Array, laser: Array, unit: float) -> None:
    """Camera and laser on their common bar."""
    _line(axes, camera, laser, BODY, lw=5)
    for place, color in ((camera, CAMERA), (laser, LASER)):
        axes.plot(*place, "s", ms=15, color=color, mec="white", zorder=7)
        axes.plot(*place, "o", ms=6, color="white", zorder=8)


def _turn(axes: Any, radius: float, start: float) -> None:
    """The camera's way about the turning axis, counter-clockwise."""
    _arrow(axes, radius * _on_circle(start + np.linspace(0.25, 2 * math.pi - 0.3, 120)))


def _arrow(axes: Any, curve: Array) -> None:
    """An arrow along a curve, (N, 2)."""
    axes.plot(*curve[:-2].T, color=BODY, lw=1.2, zorder=2)
    style = {"arrowstyle": "-|>", "color": BODY, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", curve[-1], curve[-4], arrowprops=style)


def _on_circle(angles: Array) -> Array:
    """Points of the unit circle, (N, 2), at angles [rad]."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _wall(axes: Any, face: list[tuple[float, float]], behind: tuple[float, float]) -> None:
    """A hatched solid behind its face, a line between two points."""
    solid = np.array([*face, *(np.array(face[::-1]) + behind)])
    axes.fill(*solid.T, facecolor=WALL, edgecolor="#b4bac0", hatch="////", lw=0, zorder=1)
    axes.plot(*np.array(face).T, color="#8d949b", lw=1.2, zorder=2)


def _line(axes: Any, start: Array, end: Any, color: str, **style: Any) -> None:
    """A straight line between two points."""
    axes.plot(*np.array([start, end]).T, color=color, zorder=4, **style)


def _dimension(axes: Any, first: Array, last: Array, height: float, text: str) -> None:
    """A measure between the columns of two points, drawn at a height."""
    ends = np.array([(first[0], height), (last[0], height)])
    for place, end in zip((first, last), ends, strict=True):
        _line(axes, place, end * (1, 1.15), BODY, lw=0.8)
    style = {"arrowstyle": "<->", "color": BODY, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", ends[0], ends[1], arrowprops=style)
    _label(axes, ends.mean(axis=0), text, (0, -5), va="top")


def _end(side: float) -> str:
    """The end of a text that touches its point, when the text lies left (1) or right of it."""
    return "right" if side > 0 else "left"


def _label(
    axes: Any, place: Any, text: str, offset: tuple[float, float], color: str = BODY, **style: Any
) -> None:
    """A text at an offset [1/72 inch] from a point."""
    from matplotlib.patheffects import withStroke

    look: Any = {"ha": "center", "va": "center", "fontsize": 10, "zorder": 9, **style}
    look["path_effects"] = [withStroke(linewidth=3, foreground="white")]
    axes.annotate(text, place, xytext=offset, textcoords="offset points", color=color, **look)
