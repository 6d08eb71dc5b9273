"""The working store: what a run has computed so far, on disk, part by part.

It is a folder ``working/`` in the result folder while the study is unfinished. A part is done when its chunks are in
``values.zarr`` and on the disk, and then its digest in the journal: whatever kills a run, no other part is lost, and
none is half there. There is one Zarr chunk for each part and variable, so that no two parts ever share a file.

Icechunk would make the same promises; with parts of eight small variables it took 22 ms a part against 5 ms here, and
its store of local files is not meant for two writers at a time.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from heliosweep.errors import FORCE, HeliosweepError
from heliosweep.grid.slabs import Part
from heliosweep.store import raw, records, temporary, zarr_result
from heliosweep.store.digest import file_digest, part_digest
from heliosweep.store.encoding import numbers
from heliosweep.store.full import why_not_written
from heliosweep.store.journal import Journal
from heliosweep.store.skeleton import Skeleton
from heliosweep.store.temporary import sync

#: Folder of an unfinished study in its result folder.
NAME = raw.WORKING
#: Version of this layout on disk.
FORMAT = 1
#: Letters of a message about what is damaged.
_LONG = 300


class WorkingStore:
    """Parts of an unfinished result.

    Parameters
    ----------
    folder : pathlib.Path
        The folder ``working/``, made by `create`.

    Attributes
    ----------
    identity : dict
        What the parts belong to: study, output, code and cut.
    journal : Journal
        What is done.

    Raises
    ------
    HeliosweepError
        Where the folder holds no working store of this version.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.identity = read_identity(folder)
        try:
            self.journal = Journal.read(folder / "journal.jsonl")
            counts = part_counts(folder, self.identity)
            self.journal.keep(lambda name: raw.is_part(name, counts))
            whole = file_digest(self.values / zarr_result.CONSOLIDATED) == self.identity["metadata"]
            arrays = zarr_result.arrays(self.values) if whole else {}
            self._arrays = {name: arrays[name] for name in self.identity["variables"]}
        except (OSError, KeyError, TypeError, ValueError) as error:
            said = f"{type(error).__name__}: {error}"
            raise HeliosweepError(f"{folder}: is damaged ({said}); {FORCE} removes it and starts anew") from error
        found: dict[str, Any] = {name: array.attrs["_ARRAY_DIMENSIONS"] for name, array in self._arrays.items()}
        self._dims: dict[str, tuple[str, ...]] = {name: tuple(dims) for name, dims in found.items()}
        self._clock = time.monotonic()

    @classmethod
    def create(
        cls,
        folder: Path,
        identity: Mapping[str, Any],
        skeleton: Skeleton,
        cut: Mapping[str, Mapping[str, int]],
        compression: zarr_result.Compression = "none",
        level: int = 1,
    ) -> WorkingStore:
        """Make an empty working store, whole or not at all.

        Parameters
        ----------
        folder : pathlib.Path
            Where it shall stand.
        identity : mapping
            What its parts belong to.
        skeleton : Skeleton
            Dimensions, coordinates, variables and attributes of the result.
        cut : mapping of str to mapping of str to int
            Lengths of a part, by kind.
        compression, level : str, int
            Of the values.
        """
        unfinished = temporary.temporary_name(folder)
        with writing(folder):
            try:
                unfinished.mkdir()
                skeleton.create_zarr(unfinished / "values.zarr", cut, compression, level)
                (unfinished / "journal.jsonl").touch()
                metadata = file_digest(unfinished / "values.zarr" / zarr_result.CONSOLIDATED)
                said = {
                    "format": FORMAT,
                    "variables": list(skeleton.variables),
                    "metadata": metadata,
                    "compression": _codec(compression, level),
                    "cut": cut,
                    **identity,
                }
                text = json.dumps(said, indent=2, sort_keys=True, ensure_ascii=False)
                (unfinished / "study.json").write_text(text + "\n", encoding="utf-8", errors="backslashreplace")
                for place in (*unfinished.rglob("*"), unfinished):
                    sync(place)
                unfinished.rename(folder)
                sync(folder.parent)
            except BaseException:
                for place in (unfinished, folder):
                    temporary.discard(place)
                raise
        return cls(folder)

    def holds(self, compression: str, level: int) -> bool:
        """Whether the values are compressed in this way."""
        return self.identity.get("compression") == _codec(compression, level)

    @property
    def values(self) -> Path:
        """The Zarr group with the values."""
        return self.folder / "values.zarr"

    def commit(self, part: Part, values: Mapping[str, np.ndarray]) -> None:
        """Store a part; when this returns, it is done for good.

        Parameters
        ----------
        part : Part
            Which one.
        values : mapping of str to ndarray
            Its variables, whole over the part.
        """
        encoded = {name: numbers(array) for name, array in values.items()}
        with writing(self.folder):
            for name, array in encoded.items():
                target = self._arrays[name]
                index = self._index(name, part)
                target[index] = array
                sync(self._chunk(name, index))
            for name in encoded:
                sync(self.values / name)
            self._write(part, sha256=part_digest(encoded))

    def write_to(self, arrays: Mapping[str, Any], part: Part) -> None:
        """Write a part that is done to other arrays of the same shape."""
        for name, values in self.read(part).items():
            arrays[name][self._index(name, part)] = values

    def fail(self, part: Part, why: str) -> None:
        """Note that a part failed."""
        with writing(self.folder):
            self._write(part, failed=why)

    def read(self, part: Part) -> dict[str, np.ndarray]:
        """Values of a part that is done, as stored, checked against their digest.

        Raises
        ------
        HeliosweepError
            Where they are not what was stored.
        """
        values = self._read(part)
        if values is None:
            raise HeliosweepError(f"{self.folder}: {part.name} was damaged on the disk; run again to compute it anew")
        return values

    def drop_damaged(self, parts: Iterable[Part]) -> list[Part]:
        """Check the parts that are done, and count those as not done that are not what was stored.

        Returns
        -------
        list of Part
            The damaged ones.
        """
        known = {part.name: part for part in parts}
        for name in self.journal.done.keys() - known.keys():  # a name that was damaged
            del self.journal.done[name]
        damaged = [part for name, part in known.items() if name in self.journal.done and self._read(part) is None]
        with writing(self.folder):
            for part in damaged:
                for name in self._of(part):
                    temporary.remove(self._chunk(name, self._index(name, part)))
                self._write(part, dropped="damaged on the disk")
        return damaged

    def remove(self) -> None:
        """Remove the folder."""
        remove(self.folder)

    def _read(self, part: Part) -> dict[str, np.ndarray] | None:
        places = {name: self._index(name, part) for name in self._of(part)}
        if not all(self._chunk(name, index).is_file() for name, index in places.items()):
            return None  # read as nothing but NaN
        try:
            values = {name: np.asarray(self._arrays[name][index]) for name, index in places.items()}
        except Exception:  # a chunk that is short or no compressed data: every codec has errors of its own
            return None
        return values if part_digest(values) == self.journal.done[part.name] else None

    def _of(self, part: Part) -> Iterator[str]:
        """Variables of the kind of a part."""
        return (name for name, dims in self._dims.items() if ("time" in dims) == (part.kind == "series"))

    def _index(self, name: str, part: Part) -> tuple[slice, ...]:
        sizes = zip(self._dims[name], self._arrays[name].shape, strict=True)
        return tuple(part.region.get(dim, slice(0, size)) for dim, size in sizes)

    def _chunk(self, name: str, index: tuple[slice, ...]) -> Path:
        lengths = self._arrays[name].chunks
        numbers = [str(span.start // length) for span, length in zip(index, lengths, strict=True)]
        return self.values / name / (".".join(numbers) or "0")

    def _write(self, part: Part, **said: Any) -> None:
        now = time.monotonic()
        seconds, self._clock = now - self._clock, now
        self.journal.write(part.name, **said, seconds=round(seconds, 6))


def _codec(compression: str, level: int) -> str:
    return compression if compression == "none" else f"{compression} {level}"


def read_identity(folder: Path) -> dict[str, Any]:
    """What the parts of a working store belong to.

    Raises
    ------
    HeliosweepError
        Where the folder holds no working store of this version, or one whose description is damaged.
    """
    what = "is no working store"
    try:
        identity = records.read_json(folder / "study.json")
        if identity["format"] != FORMAT:
            raise ValueError(f"its format is {str(identity['format'])[:20]}, not {FORMAT}")
        what = "is damaged"
        records.check(identity, records.Store)
        if file_digest(folder / "values.zarr" / zarr_result.CONSOLIDATED) != identity["metadata"]:
            raise ValueError("the metadata of its values are others")
        record = zarr_result.read_metadata(folder / "values.zarr")["heliosweep"]
        if record["variables"] != identity["variables"]:
            raise ValueError("the variables of its values are others")
        if identity.get("parts") not in (None, sum(part_counts(folder, identity).values())):
            raise ValueError("its number of parts is not that of its values")
        return identity
    except (OSError, ValueError, KeyError, TypeError, HeliosweepError) as error:
        said = str(error) if type(error) is ValueError else f"{type(error).__name__}: {error}"
    raise HeliosweepError(f"{folder}: {what} ({said[:_LONG]}); {FORCE} removes it and starts anew")


def part_counts(folder: Path, identity: Mapping[str, Any]) -> dict[str, int]:
    """Number of parts of each kind of a working store, of which `read_identity` has told what it is."""
    sizes = dict(zarr_result.read_metadata(folder / "values.zarr")["heliosweep"]["sizes"])
    return raw.part_counts(identity["cut"], sizes)


def remove(folder: Path) -> None:
    """Remove a working store: first its name, so that none is half removed."""
    with writing(folder):
        if folder.exists():
            doomed = temporary.temporary_name(folder)
            folder.rename(doomed)
            temporary.remove(doomed)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Say in words why something could not be written.

    Raises
    ------
    HeliosweepError
        In place of OSError.
    """
    try:
        yield
    except OSError as error:
        raise HeliosweepError(why_not_written(path, error)) from error
