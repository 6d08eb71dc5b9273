"""Faults in values, independent of the positions of the values in a file.

Functions that read values raise :class:`Invalid`. The module :mod:`heliosweep.config.load` converts the faults to
problems with a line and a column.
"""

from __future__ import annotations

import datetime as dt
import difflib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

#: Maximum number of reported faults in one list.
MAX_FAULTS = 100

#: Terms from other programs and the literature, with hints about the corresponding keys.
SYNONYMS = {
    **dict.fromkeys(
        ("slurm", "pbs", "sge", "lsf", "oar", "htcondor"),
        "write 'scheduler: distributed' and 'cluster: {class: dask_jobqueue.SLURMCluster, ...}' with the class of your "
        "queue and its keywords; if these differ between machines, write them in a separate file for 'include'",
    ),
    "diameter": "give 'radius', which is half the diameter",
    "external": "an external receiver is 'kind: cylinder'",
    "facing": "the direction that the receiver faces is 'receiver.azimuth', clockwise from north",
    "orientation": "the direction that the receiver faces is 'receiver.azimuth', clockwise from north",
    "emissivity": "give the radiation and convection losses in 'receiver.thermal_losses'",
    **dict.fromkeys(("cost", "costs"), "specify costs in the block 'economics'"),
    "tower_height": "give 'receiver.height', the height of the aim point above the tower's base",
    "tower": "give 'receiver.height', the height of the aim point above the tower's base",
    "reflectance": "give 'optics.reflectivity'",
    "slope": "give 'optics.slope_error', in mrad",
    "pixel": "specify the dimensions of the camera in 'camera'; spot positions are in metres",
    "dni": "specify the direct irradiance in 'weather', or in 'design_point.dni' for a single instant",
    "haurwitz": "the haurwitz model computes only the global irradiance, not the direct irradiance",
    "related": "list publications in 'references'",
    "contact": "give the 'email' of a creator",
    "frames": "give one 'image', such as the median of sun images shifted to a common centre",
    "sweep": "to sweep a key, replace its value with a list or a range: [15, 30] or {start: 15, stop: 60, num: 4}",
    "optimise": "use the block 'search' to find the best point",
    "optimize": "use the block 'search' to find the best point",
}

#: The numbers 0 to 4 as words.
COUNTS = ("no", "one", "two", "three", "four")

T = TypeVar("T")

#: Path to a value in a study: keys and list indices, starting at the top level.
Path = tuple[str | int, ...]


@dataclass(frozen=True)
class Fault:
    """Fault in a value or in part of a value.

    Parameters
    ----------
    message : str
        Text that follows the key in the complete message.
    path : tuple of str or int
        Path of the invalid part, relative to the value; empty if the whole value is invalid.
    show_value : bool
        If True, the complete message ends with the value, for instance ``(got 91)``.
    """

    message: str
    path: Path = ()
    show_value: bool = True


class Invalid(ValueError):
    """Error that lists all faults of an invalid value."""

    def __init__(self, faults: str | Fault | Iterable[Fault]) -> None:
        if isinstance(faults, str):
            faults = Fault(faults)
        self.faults = (faults,) if isinstance(faults, Fault) else tuple(faults)
        super().__init__("; ".join(fault.message for fault in self.faults))


def require(holds: object, message: str, *path: str | int, show_value: bool = True) -> None:
    """Raise Invalid with a fault at `path` unless `holds` is true."""
    if not holds:
        raise Invalid(Fault(message, path, show_value))


def when(*rules: tuple[object, Fault]) -> Iterator[Fault]:
    """Return the faults whose conditions are true."""
    return (fault for wrong, fault in rules if wrong)


def each(entries: Iterable[Any], read: Callable[[Any], T]) -> list[T]:
    """Read the entries of a list. Raises Invalid with the faults of all entries."""
    return collect((((place,), partial(read, entry)) for place, entry in enumerate(entries)), [])


def collect(parts: Iterable[tuple[Path, Callable[[], T]]], faults: list[Fault]) -> list[T]:
    """Read the part of a value at each path. Raises Invalid with `faults` and the faults of all parts, if any."""
    found = list[T]()
    for path, read in parts:
        try:
            found.append(read())
        except Invalid as error:
            faults += (replace(fault, path=(*path, *fault.path)) for fault in error.faults)
        if len(faults) > MAX_FAULTS:
            break
    if faults:
        raise Invalid(faults)
    return found


def to_pydantic(faults: Iterable[Fault]) -> ValidationError:
    """Return the faults as a pydantic ValidationError, which preserves their paths within a value."""
    return ValidationError.from_exception_data(
        "study",
        [
            InitErrorDetails(
                type=PydanticCustomError("fault" if fault.show_value else "rule", "{text}", {"text": fault.message}),
                loc=fault.path,
                input=None,
            )
            for fault in faults
        ],
    )


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that the user probably meant, or None if no known word is similar."""
    known = list(known)
    near = difflib.get_close_matches(word[:50], known, n=1)
    if not near and len(word) >= 3:  # such as lat for latitude
        longer = [name for name in known if name.startswith(word.casefold())]
        near = longer if len(longer) == 1 else []
    return near[0] if near else None


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return ``; did you mean '...'?`` with the most similar known word, or an empty string."""
    meant = nearest(word, known)
    return f"; did you mean '{meant}'?" if meant else ""


def one_of(names: Iterable[str], word: str = "or") -> str:
    """Return the names as a phrase: ``'a', 'b' or 'c'``, or with another word before the last name."""
    *most, last = (f"'{name}'" for name in names)
    return f"{', '.join(most)} {word} {last}" if most else last


def few_of(values: Iterable[object]) -> str:
    """Return a string with the first ten values and the number of remaining values."""
    texts = list(map(str, values))
    return ", ".join(texts[:10]) + (f" and {len(texts) - 10:,} more" if len(texts) > 10 else "")


def in_short(text: str) -> str:
    """Shorten text to one line of at most 60 characters and escape control characters."""
    text = "".join(one if one.isprintable() else one.encode("unicode_escape").decode("ascii") for one in text[:100])
    return text if len(text) <= 60 else f"{text[:57]}..."


def shown(value: object) -> str:
    """Return a short form of a value for messages, on one line and in the syntax of a study file."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a mapping" if value else "an empty mapping"
    if isinstance(value, list | tuple):
        text = f"[{', '.join(shown(entry) for entry in value[:10])}]"
        return text if len(value) <= 10 and len(text) <= 40 else f"a list of {len(value)}"
    if isinstance(value, int) and value.bit_length() > 100:
        return "a huge number"
    text = str(value) if isinstance(value, dt.date) else " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
