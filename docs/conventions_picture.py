"""Draws `docs/images/conventions.png`: `python docs/conventions_picture.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from depthwarp.plots.page import open_page

FORWARD, LEFT, UP = "#c1272d", "#1a7f37", "#0b5fa5"
INK, GREY = "#222222", "#9aa3ad"


def draw_frames(axes: Any) -> None:
    """The camera frame and the optical frame at one camera."""
    axes.set_title("one camera, two frames", fontsize=12)
    ahead, left, up = np.array((0.95, 0.32)), np.array((-0.55, 0.5)), np.array((0, 1.0))
    arrows = [
        (ahead, "X forward", FORWARD, (0.04, 0.03)),
        (left, "Y left", LEFT, (-0.28, 0.05)),
        (up, "Z up", UP, (-0.13, 0.05)),
    ]
    for vector, name, color, beside in arrows:
        axes.annotate(
            "", vector, (0, 0), arrowprops={"arrowstyle": "-|>", "color": color, "lw": 2.4}
        )
        axes.text(*(vector + beside), name, color=color, fontsize=11)
    for vector, name, beside in (
        (-0.75 * left, "x right", (0.02, -0.14)),
        (-0.8 * up, "y down", (0.05, -0.02)),
        (0.62 * ahead, "z forward", (-0.06, -0.16)),
    ):
        axes.annotate(
            "", vector, (0, 0),
            arrowprops={"arrowstyle": "-|>", "color": GREY, "lw": 2, "ls": "--"},
        )  # fmt: skip
        axes.text(*(vector + beside), name, color="#6a737d", fontsize=10)
    axes.plot(0, 0, "o", color=INK, ms=7)
    axes.text(
        -0.9, -1.12, "solid: camera and world frame\ndashed: OpenCV's optical frame", fontsize=10
    )
    axes.set(xlim=(-1.0, 1.45), ylim=(-1.2, 1.25), aspect="equal")
    axes.axis("off")


def draw_pixels(axes: Any) -> None:
    """The first pixels of an image, with their centres and borders."""
    axes.set_title("pixels", fontsize=12)
    columns, rows = 4, 3
    for u in np.arange(columns + 1) - 0.5:
        axes.plot((u, u), (-0.5, rows - 0.5), color=GREY, lw=1.2)
    for v in np.arange(rows + 1) - 0.5:
        axes.plot((-0.5, columns - 0.5), (v, v), color=GREY, lw=1.2)
    for v in range(rows):
        for u in range(columns):
            axes.plot(u, v, "o", color=INK, ms=3.5)
            axes.text(u, v + 0.28, f"({u}, {v})", ha="center", fontsize=9.5, color=INK)
    axes.annotate("", (1.2, -0.82), (-0.5, -0.82), arrowprops={"arrowstyle": "-|>", "color": LEFT})
    axes.text(1.3, -0.76, "u, columns", color=LEFT, fontsize=11)
    axes.annotate("", (-0.95, 1.2), (-0.95, -0.5), arrowprops={"arrowstyle": "-|>", "color": UP})
    axes.text(-0.95, 2.35, "v, rows", color=UP, fontsize=11, rotation=90, ha="center")
    right, bottom = columns - 0.5, rows - 0.5
    for u, name, side in ((-0.5, "-0.5", "center"), (right, f"width - 0.5 = {right}", "right")):
        axes.plot((u, u), (bottom, bottom + 0.12), color=INK, lw=1.2)
        axes.text(u, bottom + 0.36, name, ha=side, fontsize=10, color=LEFT)
    for v, name, side in (
        (-0.5, "-0.5", "center"),
        (bottom, f"height\n- 0.5\n= {bottom}", "bottom"),
    ):
        axes.plot((right, right + 0.12), (v, v), color=INK, lw=1.2)
        axes.text(right + 0.2, v, name, va=side, fontsize=10, color=UP)
    axes.text(0.5 * (right - 0.5), bottom + 0.75, "centres are (u, v)", ha="center", fontsize=10)
    axes.set(xlim=(-1.2, columns + 0.55), ylim=(rows + 0.45, -1.1), aspect="equal")
    axes.axis("off")


def draw_depths(axes: Any) -> None:
    """Range and z depth of one point."""
    axes.set_title("two kinds of depth", fontsize=12)
    point = np.array((3.0, 1.5))
    axes.annotate("", (3.9, 0), (0, 0), arrowprops={"arrowstyle": "-|>", "color": GREY, "lw": 1.4})
    axes.text(3.1, -0.38, "optical axis", color="#6a737d", fontsize=10)
    axes.plot((0, point[0]), (0, point[1]), color=FORWARD, lw=2.4)
    axes.plot((0, point[0]), (0, 0), color=UP, lw=4)
    axes.plot((point[0], point[0]), (0, point[1]), color=GREY, lw=1.2, ls=":")
    axes.plot(*point, "o", color=INK, ms=7)
    axes.plot(0, 0, "s", color=INK, ms=8)
    axes.text(1.0, 0.95, "range", color=FORWARD, fontsize=12, rotation=26)
    axes.text(1.2, -0.38, "z depth", color=UP, fontsize=12)
    axes.text(3.12, 1.5, "point", fontsize=10)
    axes.text(-0.25, 0.25, "camera", fontsize=10)
    axes.set(xlim=(-0.4, 4.1), ylim=(-0.9, 2.1), aspect="equal")
    axes.axis("off")


def main() -> None:
    """Draw the page."""
    path = Path(__file__).parent / "images" / "conventions.png"
    with open_page(path, "Frames, pixels and depths", (1440, 520)) as figure:
        for place, draw in ((0.02, draw_frames), (0.35, draw_pixels), (0.68, draw_depths)):
            draw(figure.add_axes((place, 0.02, 0.3, 0.84)))


if __name__ == "__main__":
    main()
