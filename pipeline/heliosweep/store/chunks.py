"""Computed chunks of a result: one ``.npz`` file each, in a folder named by the study and the code.

A file appears under its name when it is complete, and each array in it carries a CRC-32. A killed run therefore leaves
complete chunks only, and a damaged chunk is noticed when it is read, and computed again.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from zipfile import BadZipFile
from zlib import error as ZlibError

import numpy as np

from heliosweep.files import writing
from heliosweep.grid.regions import Cut

#: Beginning of the names of folders with chunks; and the file in such a folder that describes the study and its cuts.
CHUNKS, RECORD = "chunks-", "plan.json"


def unfinished(folder: Path) -> ChunkStore | None:
    """Return the chunks in a result folder that were written last, or None."""
    with suppress(OSError):
        found = [place for place in folder.glob(f"{CHUNKS}*") if (place / RECORD).is_file()]
        return ChunkStore(max(found, key=lambda place: place.stat().st_mtime)) if found else None
    return None


class ChunkStore:
    """Folder of chunks; `create` makes it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def create(self, cuts: Mapping[str, Cut], **about: Any) -> dict[str, Cut]:
        """Make the folder if necessary and return its cuts: cuts of the run that made it, else `cuts`."""
        with suppress(OSError, ValueError, TypeError, KeyError):
            return {kind: Cut(**lengths) for kind, lengths in self.record["cuts"].items()}
        content = {"cuts": {kind: vars(cut) for kind, cut in cuts.items()}, **about}
        content["chunks"] = sum(cut.chunk_count for cut in cuts.values())
        with writing(self.folder):
            self.remove()
            self.folder.mkdir(parents=True)
            (self.folder / RECORD).write_text(json.dumps(content, indent=1), encoding="utf-8")
        return dict(cuts)

    @property
    def record(self) -> dict[str, Any]:
        """Study and cuts of the chunks. Raises OSError or ValueError if the file is damaged."""
        content: dict[str, Any] = json.loads((self.folder / RECORD).read_text(encoding="utf-8"))
        return content

    def done(self) -> set[str]:
        """Return the names of the stored chunks."""
        return {path.stem for path in self.folder.glob("*.npz")}

    def save(self, name: str, values: Mapping[str, np.ndarray]) -> None:
        """Store the arrays of a chunk. Raises HeliosweepError if they cannot be written."""
        temporary = self.folder / f"{name}.tmp"
        with writing(self.folder):
            with temporary.open("wb") as file:
                np.savez(file, **values)  # type: ignore[arg-type]
            temporary.replace(self.folder / f"{name}.npz")

    def load(self, name: str, keys: Iterable[str] | None = None) -> dict[str, np.ndarray] | None:
        """Return the arrays of a chunk, or some of them; None if it is missing or damaged."""
        try:
            with (self.folder / f"{name}.npz").open("rb") as stream, np.load(stream) as file:
                return {key: file[key] for key in keys or file.files}
        except (OSError, ValueError, KeyError, EOFError, BadZipFile, ZlibError, NotImplementedError):
            return None

    def seconds_left(self) -> float | None:
        """Return the time for the missing chunks at the speed of the last ones; None if unknown. [s]"""
        times = sorted(path.stat().st_mtime for path in self.folder.glob("*.npz"))
        missing = self.record.get("chunks", 0) - len(times)
        last = times[-20:]
        return (last[-1] - last[0]) / (len(last) - 1) * max(missing, 0) if len(last) > 1 else None

    def remove(self) -> None:
        """Remove the folder with all chunks."""
        shutil.rmtree(self.folder, ignore_errors=True)
