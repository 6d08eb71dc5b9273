"""Results that are there already: whether one is what a run would leave, and its parts where it nearly is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from heliosweep.errors import HeliosweepError
from heliosweep.store import records, working
from heliosweep.store.digest import file_digest, tree_digest
from heliosweep.store.identity import listed
from heliosweep.store.working import read_identity

#: File of a result folder that says what its result is.
MANIFEST = "manifest.json"


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
        with suppress(HeliosweepError):
            manifest = read_manifest(folder)
            if manifest.get("identity") and manifest.get("parts"):
                found = cls(folder, manifest)
                return found if found.path.exists() else None
        return None

    @property
    def path(self) -> Path:
        """The result."""
        return self.folder / self.manifest["result"]["file"]

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


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a result folder: of the shape `records.Manifest`.

    Raises
    ------
    HeliosweepError
        There is none, or it is damaged; says what is wrong.
    """
    try:
        return records.check(records.read_json(folder / MANIFEST), records.Manifest)
    except FileNotFoundError:
        raise HeliosweepError(f"{MANIFEST}: is missing; run the study again to write it") from None
    except OSError as error:
        raise HeliosweepError(f"{MANIFEST}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise HeliosweepError(f"{MANIFEST}: is damaged: {error}") from None


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
