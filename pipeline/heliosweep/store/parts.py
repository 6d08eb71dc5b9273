"""The working store of a run that is not finished: the values of its parts, and a journal of which are done.

It is the folder ``working`` in the result folder, of three files. ``study.json`` says what the parts belong to, how
the result is cut and what is stored of each part. ``values.bin`` holds the values: those of a part are the bytes of
its variables, one variable after the other. ``journal.jsonl`` has a line for each part that is stored, with its place
in ``values.bin`` and a digest, or that has failed. Both only grow.

A process that is killed loses no part whose `PartStore.commit` came back. What was committed in the last half second
(`SYNC_SECONDS`) may be lost when the machine crashes, and nothing else: a part whose values did not reach the disk has
another digest, and is computed again.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import threading
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from pydantic_core import from_json

from heliosweep.errors import FORCE, HeliosweepError
from heliosweep.files import discard, remove_at_once, sync, temporary_name, writing
from heliosweep.grid.regions import Cut, Part, Variable, of_kind, part_name, parts_of, shape_of

if TYPE_CHECKING:
    import xarray as xr

#: Name of the folder in the result folder, and of the files in it.
WORKING = "working"
DESCRIPTION, VALUES, JOURNAL = "study.json", "values.bin", "journal.jsonl"
#: Version of this layout.
FORMAT = 2
#: What is written waits for the disk at the latest after this time, or when it is so much. [s, bytes]
SYNC_SECONDS, SYNC_BYTES = 0.5, 32 * 2**20
#: Where a part is stored: whether at all, offset and length [bytes] in the file of values, and SHA-256.
_PLACE = np.dtype([("stored", "?"), ("offset", "i8"), ("bytes", "i8"), ("sha256", "V32")])
_NOWHERE = False, 0, 0, bytes(32)
#: No part takes longer. [s]
_LONG = 1e9
#: Binary files, where the system knows others.
_BINARY = getattr(os, "O_BINARY", 0)
#: Where a file is written, no link is followed out of the folder.
_NO_LINKS = getattr(os, "O_NOFOLLOW", 0)


class PartStore:
    """Parts of a result that is not finished; made by `create` or `open`. The methods may be called from any thread.

    `identity` is what the parts belong to, `cuts` how the result is cut, by kind of part, `variables` what is stored of
    the parts; `done` has the names of the parts that are stored, `failed` the reasons why others are not. `seconds` is
    the time in which parts were computed and stored, pauses between runs left out. [s]
    """

    def __init__(self, folder: Path, said: Mapping[str, Any]) -> None:
        self.folder = folder
        self.identity: dict[str, Any] = said["identity"]
        self.sizes: dict[str, int] = dict(said["sizes"])
        self.cuts = {kind: Cut(*lengths) for kind, lengths in said["cuts"].items()}
        self.variables = {name: Variable(tuple(dims), {}, np.dtype(dt)) for name, dims, dt in said["variables"]}
        self.failed: dict[str, str] = {}
        self.seconds = 0.0
        self.done = _Done(self.cuts)
        self._kinds = {kind: of_kind(self.variables, kind) for kind in self.cuts}
        self._lock = threading.RLock()
        self._clock = time.monotonic()
        self._reading = self._values = self._journal = -1  # descriptors of the open files
        self._values_end = self._journal_end = 0
        self._waiting = 0  # bytes that were written since the last `sync`
        self._timer: threading.Timer | None = None
        self._error: HeliosweepError | None = None
        self._read_journal()

    @classmethod
    def create(
        cls,
        folder: Path,
        identity: Mapping[str, Any],
        cuts: Mapping[str, Cut],
        variables: Mapping[str, Variable],
        sizes: Mapping[str, int],
    ) -> Self:
        """Make an empty store, whole or not at all.

        `identity` is what its parts belong to, as plain data; `cuts` tells, by kind of part, how the result of these
        dimensions is cut. Of its variables those that are `finished` from others are not stored. Raises HeliosweepError
        where it cannot be written.
        """
        said = {
            "format": FORMAT,
            "identity": identity,
            "sizes": dict(sizes),
            "cuts": {kind: [dict(each) for each in (cut.sizes, cut.slab, cut.part)] for kind, cut in cuts.items()},
            "variables": [[name, one.dims, one.dtype.str] for name, one in variables.items() if not one.finished],
        }
        text = json.dumps({**said, "sha256": _digest_of(said)}, indent=1)
        unfinished = temporary_name(folder)
        with writing(folder):
            try:
                unfinished.mkdir()
                for name, content in ((DESCRIPTION, text), (VALUES, ""), (JOURNAL, "")):
                    (unfinished / name).write_text(content, encoding="utf-8")
                    sync(unfinished / name)
                sync(unfinished)
                unfinished.rename(folder)
                sync(folder.parent)
            except BaseException:
                for place in (unfinished, folder):
                    discard(place)
                raise
        return cls.open(folder)

    @classmethod
    def open(cls, folder: Path) -> Self:
        """Open a store; nothing in it is changed before something is committed.

        Raises HeliosweepError where the folder holds none of this version, or its description is damaged; says what to
        do.
        """
        what = "is no working store"
        try:
            for path in (folder / name for name in (DESCRIPTION, VALUES, JOURNAL)):
                if path.exists() and not path.is_file():
                    raise ValueError(f"{path.name} is no file")
            said = json.loads((folder / DESCRIPTION).read_bytes())
            if said["format"] != FORMAT:
                raise ValueError(f"its format is {str(said['format'])[:20]}, not {FORMAT}")
            what = "is damaged"
            if said.pop("sha256", "") != _digest_of(said):
                raise ValueError(f"{DESCRIPTION} is not what was written")
            return cls(folder, said)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            why = str(error) if type(error) is ValueError else f"{type(error).__name__}: {error}"
        raise HeliosweepError(f"{folder}: {what} ({why[:300]}); {FORCE} removes it and starts anew")

    @property
    def part_count(self) -> int:
        """Number of parts of the whole result."""
        return sum(cut.part_count for cut in self.cuts.values())

    def commit(self, part: Part, values: Mapping[str, Any] | xr.Dataset) -> None:
        """Store a part: its variables by name, in the order of their dimensions; then it outlives this process.

        Raises HeliosweepError where it cannot be written, as on a full disk; what was stored before is still there.
        """
        pieces = []
        for name, variable in self._kinds[part.kind].items():
            given, shape = np.asarray(values[name]), shape_of(variable, part.region, self.sizes)
            if given.shape != shape or given.dtype != variable.dtype:
                raise ValueError(f"{name}: {given.dtype} of shape {given.shape}, not {variable.dtype} of shape {shape}")
            pieces.append(given.tobytes())
        content = b"".join(pieces)
        digest = _part_digest(part.name, content)
        with self._lock:
            self._open_for_writing()
            self._write(part, content, offset=self._values_end, bytes=len(content), sha256=digest.hex())

    def fail(self, part: Part, why: str) -> None:
        """Note that a part failed. Raises as `commit`."""
        with self._lock:
            self._open_for_writing()
            self._write(part, b"", failed=why.encode(errors="backslashreplace").decode())

    def read(self, part: Part) -> dict[str, np.ndarray]:
        """Values of a part that is done. Raises HeliosweepError where they are not what was stored."""
        content, start, values = self._content(part.name), 0, {}
        shapes = {name: shape_of(one, part.region, self.sizes) for name, one in self._kinds[part.kind].items()}
        sizes = {name: math.prod(shape) * self.variables[name].dtype.itemsize for name, shape in shapes.items()}
        if content is None or len(content) != sum(sizes.values()):
            raise HeliosweepError(f"{self.folder}: {part.name} was damaged on the disk; run again to compute it anew")
        for name, shape in shapes.items():
            values[name] = np.frombuffer(content, self.variables[name].dtype, math.prod(shape), start).reshape(shape)
            start += sizes[name]
        return values

    def damaged(self) -> Iterator[Part]:
        """Read the parts that are done, and yield those that are not what was stored."""
        return (part for part in parts_of(self.cuts) if part.name in self.done and self._content(part.name) is None)

    def drop_damaged(self) -> list[Part]:
        """Count the parts that are `damaged` as not done, and return them. Raises as `commit`."""
        found = list(self.damaged())
        with self._lock:
            for part in found:
                self._open_for_writing()
                self._write(part, b"", dropped="damaged on the disk")
        return found

    def sync(self) -> None:
        """Wait until everything that was committed is on the disk. Raises as `commit`."""
        with self._lock, writing(self.folder):
            if self._timer:
                self._timer.cancel()
            self._timer = None
            if self._waiting:
                os.fsync(self._values)
                os.fsync(self._journal)
            self._waiting = 0
            self._raise_earlier()

    def close(self) -> None:
        """Wait as `sync` does, and let go of the files."""
        try:
            self.sync()
        finally:
            with self._lock:
                for descriptor in (self._reading, self._values, self._journal):
                    if descriptor >= 0:
                        os.close(descriptor)
                self._reading = self._values = self._journal = -1

    def remove(self) -> None:
        """Close it, and remove the folder."""
        with suppress(HeliosweepError):
            self.close()
        remove_at_once(self.folder)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
            return
        with suppress(HeliosweepError):  # it would hide what went wrong before
            self.close()

    def _write(self, part: Part, content: bytes, **said: Any) -> None:
        """Write the values of a part, if any, and then its line in the journal."""
        now = time.monotonic()
        seconds, self._clock = now - self._clock, now
        line = json.dumps({"part": part.name, **said, "seconds": round(seconds, 6)}).encode() + b"\n"
        with writing(self.folder):
            self._raise_earlier()
            try:
                _write_at(self._values, self._values_end, content)
                _write_at(self._journal, self._journal_end, line)
            except BaseException:
                with suppress(OSError):  # what is left there is passed over when it is read
                    self._cut_off()
                raise
        self._values_end += len(content)
        self._journal_end += len(line)
        self._take(line, self._values_end)
        self._waiting += len(content) + len(line)
        if self._waiting >= SYNC_BYTES:
            self.sync()
        elif self._timer is None:
            self._timer = threading.Timer(SYNC_SECONDS, self._sync_later)
            self._timer.daemon = True
            self._timer.start()

    def _sync_later(self) -> None:
        try:
            self.sync()
        except HeliosweepError as error:  # whoever writes next is told
            self._error = error

    def _raise_earlier(self) -> None:
        if self._error:
            error, self._error = self._error, None
            raise error

    def _open_for_writing(self) -> None:
        """Open the files, and cut off what a killed process has left at their ends."""
        if self._values < 0:
            with writing(self.folder):
                self._values = os.open(self.folder / VALUES, os.O_RDWR | os.O_CREAT | _BINARY | _NO_LINKS)
                self._journal = os.open(self.folder / JOURNAL, os.O_RDWR | os.O_CREAT | _BINARY | _NO_LINKS)
                self._cut_off()

    def _cut_off(self) -> None:
        os.ftruncate(self._journal, self._journal_end)
        os.ftruncate(self._values, self._values_end)

    def _content(self, name: str) -> bytes | None:
        """Bytes of a part that is done; None where they are not what was stored."""
        _, offset, length, digest = self.done[name]
        content = b""
        with self._lock, suppress(OSError):
            if self._reading < 0:
                self._reading = os.open(self.folder / VALUES, os.O_RDONLY | _BINARY)
            os.lseek(self._reading, offset, os.SEEK_SET)
            while piece := os.read(self._reading, length - len(content)):
                content += piece
        return content if _part_digest(name, content) == digest else None

    def _read_journal(self) -> None:
        """Take in all lines that are whole; a killed process may leave the last one torn."""
        with suppress(FileNotFoundError):
            size = (self.folder / VALUES).stat().st_size
            with (self.folder / JOURNAL).open("rb") as file:
                for line in file:
                    if line.endswith(b"\n"):
                        self._journal_end += len(line)
                        self._take(line, size)

    def _take(self, line: bytes, size: int) -> None:
        """Take in a line of the journal, where there are so many bytes of values; pass over what is none."""
        try:
            said = from_json(line)
            name, seconds, place, end = said["part"], float(said.get("seconds", 0.0)), _NOWHERE, 0
            if "sha256" in said:
                place = True, index(said["offset"]), index(said["bytes"]), bytes.fromhex(said["sha256"])
                end = place[1] + place[2]
                if not 0 <= place[1] <= end <= size or len(place[3]) != len(_NOWHERE[3]):
                    return
            self.done[name] = place
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
            return
        self._values_end = max(self._values_end, end)
        self.failed.pop(name, None)
        if "failed" in said:
            self.failed[name] = str(said["failed"])
        if 0 <= seconds < _LONG:  # not what a flipped bit has made of it
            self.seconds += seconds


class _Done(Collection[str]):
    """Names of the parts that are stored, with their places and digests; in little memory, for there are millions."""

    def __init__(self, cuts: Mapping[str, Cut]) -> None:
        self._places = {kind: np.zeros(cut.part_count, _PLACE) for kind, cut in cuts.items()}

    def __contains__(self, name: object) -> bool:
        try:
            return self[str(name)][0]
        except (KeyError, ValueError):
            return False

    def __iter__(self) -> Iterator[str]:
        for kind, places in self._places.items():
            yield from (part_name(kind, int(number)) for number in np.flatnonzero(places["stored"]))

    def __len__(self) -> int:
        return sum(int(np.count_nonzero(places["stored"])) for places in self._places.values())

    def __getitem__(self, name: str) -> tuple[bool, int, int, bytes]:
        """Where a part is stored. Raises KeyError or ValueError where there is no such part."""
        kind, number = self._at(name)
        place: tuple[bool, int, int, bytes] = self._places[kind][number].item()
        return place

    def __setitem__(self, name: str, place: tuple[bool, int, int, bytes]) -> None:
        kind, number = self._at(name)
        self._places[kind][number] = place

    def _at(self, name: str) -> tuple[str, int]:
        kind, _, digits = name.partition("-")
        number = int(digits)
        if not 0 <= number < len(self._places[kind]) or name != part_name(kind, number):
            raise KeyError(name)
        return kind, number


def _write_at(descriptor: int, start: int, content: bytes) -> None:
    left = memoryview(content)
    os.lseek(descriptor, start, os.SEEK_SET)
    while left:
        left = left[os.write(descriptor, left) :]  # a disk that is nearly full takes some


def _part_digest(name: str, content: bytes) -> bytes:
    """SHA-256 of a part; also of its name, so that no part is taken for another one."""
    digest = hashlib.sha256(name.encode() + b"\0")
    digest.update(content)
    return digest.digest()


def _digest_of(said: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()
