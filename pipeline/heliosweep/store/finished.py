"""Results that are there already: whether one is what a run would leave, and its parts where it nearly is."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from heliosweep.errors import HeliosweepError
from heliosweep.store import working
from heliosweep.store.digest import file_digest, tree_digest
from heliosweep.store.identity import listed
from heliosweep.store.working import read_identity


@dataclass(frozen=True)
class Finished:
    """A finished result as its manifest describes it.

    Parameters
    ----------
    folder : pathlib.Path
        Result folder.
    manifest : mapping
        Content of ``manifest.json``.
    """

    folder: Path
    manifest: Mapping[str, Any]

    @classmethod
    def find(cls, folder: Path) -> Finished | None:
        """The finished result of a folder; None where there is none, or one that no manifest describes."""
        try:
            manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
            found = cls(folder, manifest)
            said = found.digests, found.identity, found.identity["study"], manifest["result"]["sha256"]
            if found.path.exists() and [type(one) for one in said] == [dict, dict, dict, str]:
                return found
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            pass
        return None

    @property
    def path(self) -> Path:
        """The result."""
        return self.folder / Path(self.manifest["result"]["file"]).name

    @property
    def identity(self) -> dict[str, Any]:
        """What it belongs to, as `store.identity.identity_of` says it."""
        return self.manifest["identity"]

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of each of its parts."""
        return self.manifest["parts"]["digests"]

    def is_whole(self) -> bool:
        """Whether its bytes are those that the manifest tells of."""
        try:
            return result_digest(self.path) == self.manifest["result"]["sha256"]
        except OSError:
            return False

    def changes(self, identity: Mapping[str, Any], key: str) -> str:
        """What of one aspect (``study``, ``code``, ``output``, ``attributes``) is different in another identity."""
        return listed(self.identity.get(key), identity[key])


def latest_identity(folders: Iterable[Path]) -> tuple[Path, dict[str, Any]] | None:
    """Of several result folders the one that was written last, finished or not, and what it belongs to."""
    found: list[tuple[float, Path, dict[str, Any]]] = []
    for folder in folders:
        with suppress(OSError, HeliosweepError):
            finished = Finished.find(folder)
            identity = finished.identity if finished else read_identity(folder / working.NAME)
            found.append((folder.stat().st_mtime, folder, identity))
    return max(found, key=lambda entry: entry[0])[1:] if found else None


def result_digest(path: Path) -> str:
    """SHA-256 of a result: of the file, or of the folder with all that is in it."""
    return tree_digest(path) if path.is_dir() else file_digest(path)
