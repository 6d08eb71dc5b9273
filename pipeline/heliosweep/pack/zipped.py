"""Writing zip archives whose bytes depend on what they hold alone."""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from heliosweep.store.temporary import temporary_name

#: Copied at a time. [bytes]
_PIECE = 2**20
#: The date of every file in an archive: the first that the format knows.
_DATE = (1980, 1, 1, 0, 0, 0)


class Archive:
    """A zip file under construction, all of it below one folder.

    Parameters
    ----------
    zipped : zipfile.ZipFile
        Open for writing.
    top : str
        Name of the folder.

    Attributes
    ----------
    digests : dict of str to str
        SHA-256 of each file written so far, by its name below the folder.
    sizes : dict of str to int
        Their sizes. [bytes]
    """

    def __init__(self, zipped: zipfile.ZipFile, top: str) -> None:
        self._zipped, self._top = zipped, top
        self.digests: dict[str, str] = {}
        self.sizes: dict[str, int] = {}

    def add(self, name: str, source: BinaryIO, size: int) -> None:
        """Copy a file into the archive, piece by piece."""
        info = zipfile.ZipInfo(f"{self._top}/{name}", _DATE)
        info.create_system, info.external_attr = 3, 0o100644 << 16  # the same on every system
        info.compress_type, info.file_size = zipfile.ZIP_DEFLATED, size
        digest, written = hashlib.sha256(), 0
        with self._zipped.open(info, "w", force_zip64=size >= 2**31) as target:
            while piece := source.read(_PIECE):
                digest.update(piece)
                written += target.write(piece)
        self.digests[name], self.sizes[name] = digest.hexdigest(), written

    def add_file(self, name: str, path: Path) -> None:
        """Copy a file of the disk."""
        with path.open("rb") as source:
            self.add(name, source, path.stat().st_size)

    def add_text(self, name: str, text: str) -> None:
        """Write a text file."""
        content = text.encode()
        self.add(name, io.BytesIO(content), len(content))

    @property
    def sums(self) -> str:
        """Digests as ``sha256sum -c`` reads them."""
        return "".join(f"{digest}  {name}\n" for name, digest in sorted(self.digests.items()))


@contextmanager
def writing(path: Path, top: str) -> Iterator[Archive]:
    """Write an archive that is there whole, under its name, or not at all."""
    temporary = temporary_name(path)
    try:
        with zipfile.ZipFile(temporary, "x", compresslevel=6) as zipped:
            yield Archive(zipped, top)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
