"""Wrong arguments of the functions of arrays are named, as ``wrong_arguments.txt`` lists them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import heliosweep

#: What expressions of the table may name.
NAMES: dict[str, Any] = {
    "np": np, "Cylinder": heliosweep.Cylinder, "CYLINDER": heliosweep.Cylinder(50.0, 3.0, 5.0),
    "RECTANGLE": heliosweep.Rectangle(height=50.0, width=6.0, height_extent=5.0),
    "PLACES": [(0.0, 60.0, 4.0), (10.0, 60.0, 4.0), (0.0, 70.0, 4.0)],
    "FIELD": [(12.0 * x, 50.0 + 12.0 * y, 4.0) for x in range(-4, 5) for y in range(6)],
    "PIVOTS": np.array([(-20.0, 150.0, 4.0), (120.0, 300.0, 5.0), (10.0, 80.0, 3.0)]),
    "LAYOUT": heliosweep.radial_stagger(clearance=14.0, inner_radius=60.0, heliostats=5),
    "SCENE": heliosweep.gazing_scene(30.0, 60.0, 0.0, 44.0),
}  # fmt: skip


def cases() -> list[Any]:
    """Function, good arguments, wrong ones, what is said."""
    found, function, good = [], "", ""
    for line in Path(__file__).with_name("wrong_arguments.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("@ "):
            function, good = line.removeprefix("@ ").split(": ", 1)
        elif line and not line.startswith("#"):
            wrong, said = line.split(" => ")
            found.append(pytest.param(function, good, wrong, said, id=f"{function}-{wrong[:40]}"))
    return found


@pytest.mark.parametrize(("function", "good", "wrong", "said"), cases())
def test_wrong_arguments_are_named(function: str, good: str, wrong: str, said: str) -> None:
    arguments = eval(f"dict({good}) | dict({wrong})", NAMES)
    with pytest.raises(ValueError, match=said):
        getattr(heliosweep, function)(**arguments)
