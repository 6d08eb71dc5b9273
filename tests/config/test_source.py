"""Strict YAML: YAML 1.2 scalars and the place of every key and value."""

import math
from pathlib import Path

import pytest

from heliosweep.config.source import Place, parse

TEXT = """\
# a comment
family: x
site:
  latitude: 91
  list: [1, {a: 2}]
2: yes
"""


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1), ("-012", -12), ("0o17", 15), ("0x1f", 31), ("1e-3", 1e-3), (".5", 0.5), ("5.", 5.0),
        ("-.inf", -math.inf), ("true", True), ("False", False), ("~", None), ("", None), ("null", None), ("'1'", "1"),
        ('"true"', "true"),
        *((text, text) for text in ("yes", "no", "on", "12:30", "2021-06-21", "1_000", "1.2 mrad", "+08:00", "0b1")),
        ("9" * 5000, math.inf),
    ],
)  # fmt: skip
def test_scalars(text: str, value: object) -> None:
    read = parse(f"key: {text}\n", Path("s.yaml")).data["key"]
    assert read == value
    assert type(read) is type(value)


def test_places() -> None:
    source = parse(TEXT, Path("s.yaml"))
    assert source.data == {"family": "x", "site": {"latitude": 91, "list": [1, {"a": 2}]}, "2": "yes"}
    assert source.places[("site",)][0] == Place(3, 1)
    assert source.places[("site", "latitude")][1] == Place(4, 13)
    assert source.places[("site", "list", 1, "a")][1] == Place(5, 17)
    assert str(source.problem(("site", "list", 1, "b"), "is missing")) == "s.yaml:5:13: site.list[1].b: is missing"
