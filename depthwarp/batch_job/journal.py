"""The journal's lines in the order of the views, whatever the order of their writing was."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

__all__ = ["is_in_order", "lines_in_order"]


def is_in_order(journal: Path) -> bool:
    """Whether the lines stand in the order of their views."""
    last = -1
    with journal.open("rb") as lines:
        for line in lines:
            number = json.loads(line)["view"]
            if number < last:
                return False
            last = number
    return True


def lines_in_order(journal: Path) -> Iterator[bytes]:
    """The lines, by their views; one at a time, as millions of them do not fit the memory."""
    numbers, begins = [], [0]
    with journal.open("rb") as lines:
        for line in lines:
            numbers.append(json.loads(line)["view"])
            begins.append(begins[-1] + len(line))
        for place in np.argsort(numbers).tolist():
            lines.seek(begins[place])
            yield lines.read(begins[place + 1] - begins[place])
