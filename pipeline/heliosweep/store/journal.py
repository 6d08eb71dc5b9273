"""The journal of a run: one line for each part that is done or has failed, in the order in which that happened."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

#: No part takes longer. [s]
_LONG = 1e9


@dataclass
class Journal:
    """What is known of the parts of a run.

    Parameters
    ----------
    path : pathlib.Path
        The file, one JSON object a line.

    Attributes
    ----------
    done : dict of str to str
        SHA-256 of each part that is stored.
    failed : dict of str to str
        Why each part failed that was tried and is not stored.
    seconds : float
        Time in which the parts were computed and stored, pauses between runs left out. [s]
    """

    path: Path
    done: dict[str, str] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    _length: int = 0

    @classmethod
    def read(cls, path: Path) -> Journal:
        """Read a journal; without a file it is empty.

        A killed run may leave its last line torn, and a bad disk any other: these are passed over.
        """
        journal = cls(path)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return journal
        journal._length = content.rfind(b"\n") + 1
        for line in content[: journal._length].splitlines():
            journal._take(line)
        return journal

    def keep(self, known: Callable[[str], bool]) -> None:
        """Forget what is not of the study: names that were damaged."""
        for said in (self.done, self.failed):
            for name in [name for name in said if not known(name)]:
                del said[name]

    def write(self, part: str, **said: Any) -> None:
        """Add a line, and come back when it is on the disk.

        Parameters
        ----------
        part : str
            Name of the part.
        **said
            ``sha256`` of a part that is stored, ``failed``, why a part failed, or ``dropped``, why a stored part is
            not to be used any more; ``seconds`` since the line before.
        """
        line = json.dumps({"part": part, **said}, ensure_ascii=True).encode() + b"\n"
        with self.path.open("r+b" if self.path.exists() else "xb") as file:
            file.truncate(self._length)  # a torn line must not spoil the one after it
            file.seek(self._length)
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
        self._length += len(line)
        self._take(line)

    def _take(self, line: bytes) -> None:
        """Take in a line, if it is one."""
        try:
            said = json.loads(line)
            part, digest, seconds = str(said["part"]), said.get("sha256"), float(said.get("seconds", 0.0))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
            return
        self.done.pop(part, None)
        self.failed.pop(part, None)
        if digest is not None:
            self.done[part] = str(digest)
        elif "failed" in said:
            self.failed[part] = str(said["failed"])
        if 0 <= seconds < _LONG:  # not what a flipped bit has made of it
            self.seconds += seconds
