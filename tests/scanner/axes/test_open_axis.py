"""The text that names an axis."""

from __future__ import annotations

import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.axes import GrblAxis, HorusAxis, ManualAxis, SimulatedAxis, open_axis


def test_each_kind_has_its_name() -> None:
    """A port is everything behind the first colon."""
    grbl = open_axis("grbl:socket://host:23")
    assert isinstance(grbl, GrblAxis)
    assert grbl.port == "socket://host:23"
    horus = open_axis("horus:/dev/ttyACM0")
    assert isinstance(horus, HorusAxis)
    assert horus.port == "/dev/ttyACM0"
    assert isinstance(open_axis("simulated"), SimulatedAxis)
    assert isinstance(open_axis("manual", ask=lambda text: None, tell=print), ManualAxis)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("", "grbl:PORT, horus:PORT, manual or simulated"),
        ("tmcl:/dev/ttyUSB0", "got 'tmcl:/dev/ttyUSB0'.*plugged in"),
        ("/dev/ttyUSB0", "grbl:PORT"),
        ("grbl", "lacks its port.*grbl:PORT"),
        ("horus:", "lacks its port"),
        ("simulated:fast", "got 'simulated:fast'"),
        ("manual", "ask and tell"),
    ],
)
def test_anything_else_is_refused_with_the_choice(spec: str, message: str) -> None:
    """The message shows what would be right."""
    with pytest.raises(InputError, match=message):
        open_axis(spec)
