"""Checks of results against their manifests, before anything is read from them that a user named.

A damaged NetCDF file can keep the HDF5 library in an endless loop, which nothing inside the process ends, or end the
process. A file whose bytes are those that its manifest tells of does neither; any other is first read to its end by a
process of its own (`check_apart`), which is ended when it goes on no more. Zarr groups are read by code that raises
errors and only waits for pipes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from time import monotonic
from typing import Any

from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.store.encoding import slab_digest, slabs_of
from heliosweep.store.folder import MANIFEST
from heliosweep.store.read import (
    Places,
    Stored,
    content_digest,
    is_netcdf,
    locate,
    manifest_of,
    odd,
    open_stored,
    result_digest,
)

#: Damaged slabs that are named, and things that are wrong with a result in one message; of more, the number is told.
_NAMED, _SAID = 20, 2
#: The process that reads what may be damaged: it is ended after so long without a piece read; address space. [s, bytes]
_PATIENCE, _ROOM = 60.0, 8 * 2**30
#: Damage may also tell of values without end. Nobody who reads so slowly, and no file packed so densely by zlib, is
#: suspected of it. [bytes/s, 1]
_SLOWEST, _DENSEST = 20e6, 1032
#: Its command, without the name of the result.
_READER = [sys.executable, "-P", "-m", "heliosweep.store.checks"]


def check(path: Path, manifest: Mapping[str, Any] | None, told: Callable[[], object] = lambda: None) -> list[str]:
    """What is wrong with a result: what it holds is compared with its manifest, slab by slab.

    Without a manifest, whether everything in the result can be read. `told` is called after every piece that was read.
    """
    try:
        if path.is_dir() and (strange := odd(path)):
            return [f"{name} is no file" for name in strange[:_NAMED]]
        if manifest is None:
            content_digest(path, told)
            return []
        with open_stored(path, told) as stored:
            said, found = manifest.get("study_id"), stored.attributes.get("study_id")
            wrong = [] if said == found else [f"is of study {found}, {MANIFEST} of study {said}"]
            if slabs := manifest.get("slabs"):
                damaged = list(_damaged(stored, slabs))
                wrong += damaged[:_NAMED]
                if len(damaged) > _NAMED:
                    wrong.append(f"and {len(damaged) - _NAMED:,} more slabs are damaged")
        expected = manifest["result"].get("content_digest")
        if not wrong and expected and content_digest(path, told) != expected:
            wrong.append("attributes or coordinates are not those that were written (the values are)")
    except HeliosweepError as error:
        return [str(error).removeprefix(f"{path}: ")]
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        return [f"{MANIFEST} does not fit the result ({type(error).__name__}: {error})"]
    return wrong


def _damaged(stored: Stored, said: Mapping[str, Any]) -> Iterator[str]:
    """Slabs with other digests than the manifest says, a line for each."""
    places, digests, count = Places(stored), said["digests"], 0
    for slab in slabs_of(said["cut"], stored.sizes):
        count += 1
        try:
            right = slab_digest(stored.slab(slab)) == digests.get(slab.name)
            damage = "" if right else "is not what was computed"
        except HeliosweepError as error:
            damage = str(error).removeprefix(f"{stored.path}: ")
        if damage:
            where = places.within(slab.region)
            yield f"slab {slab.name}{f' ({where})' if where else ''}: {damage}"
    if count != len(digests):
        yield f"{MANIFEST} has digests of {len(digests):,} slabs, the result has {count:,}"


def check_apart(path: Path, manifest: Mapping[str, Any] | None) -> list[str]:
    """Do `check`, of a file in a process of its own, which may hang or die of what it reads.

    It is waited for as long as it goes on reading, for how long that takes depends on how the values are packed.
    """
    if path.is_dir():
        return check(path, manifest)
    end = monotonic() + _PATIENCE + path.stat().st_size * _DENSEST / _SLOWEST
    with TemporaryFile("w+") as question, TemporaryFile("w+") as answer:
        json.dump(manifest, question)
        question.seek(0)
        command = [*_READER, str(path)]
        with subprocess.Popen(command, stdin=question, stdout=answer, stderr=subprocess.DEVNULL) as reader:
            try:
                length = 0
                while not _ended(reader):
                    before, length = length, os.fstat(answer.fileno()).st_size
                    if length == before or monotonic() > end:
                        return ["cannot be read to its end: its structure is damaged"]
            finally:
                reader.kill()
        answer.seek(0)
        try:
            return [str(line) for line in json.load(answer)]
        except ValueError:
            return [f"cannot be read: its structure is damaged (the library ended with code {reader.returncode})"]


def _ended(process: subprocess.Popen[Any]) -> bool:
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        return False
    return True


def main() -> int:
    """Check the result named on the command line against the manifest on standard input, or ``null``.

    Standard output has an empty line for every piece that was read, and in the end what is wrong, as JSON.
    """
    if os.name == "posix":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_ROOM, resource.getrlimit(resource.RLIMIT_AS)[1]))
    print(json.dumps(check(Path(sys.argv[1]), json.load(sys.stdin), lambda: print(flush=True))))
    return 0


def sound(*paths: str | os.PathLike[str], as_written: bool = False) -> tuple[Path, ...]:
    """Make sure that results can be read in this process, side by side, and return where they are.

    `paths` are result folders, NetCDF files or Zarr groups. With `as_written` a result is refused too whose manifest
    tells of other values or attributes. Raises StudyError for a path that holds no result, HeliosweepError for a
    damaged one; says what can be done.
    """
    places = tuple(locate(path) for path in paths)
    with ThreadPoolExecutor(len(places)) as pool:
        list(pool.map(lambda place: _refuse_damaged(place, as_written), places))
    return places


def _refuse_damaged(place: Path, as_written: bool) -> None:
    manifest = manifest_of(place)
    if place.is_dir():
        wrong = [f"{name} is no file" for name in odd(place)]
    elif not is_netcdf(place):
        if not manifest:
            raise StudyError(Problem("is no result; name a result folder", file=str(place)))
        wrong = ["is no NetCDF file and no Zarr group any more"]
    else:
        wrong = []
    if not wrong and not (manifest and result_digest(place) == manifest["result"]["sha256"]):
        wrong = check_apart(place, manifest if as_written and manifest else None)
    if wrong:
        raise HeliosweepError(_damage(place, manifest, wrong))


def _damage(place: Path, manifest: Mapping[str, Any], wrong: list[str]) -> str:
    more = f", and {len(wrong) - _SAID} more" if len(wrong) > _SAID else ""
    said = "; ".join(wrong[:_SAID]) + more
    if not manifest:
        return f"{place}: is damaged: {said}. There is no {MANIFEST} for it; get the file anew from where it came from"
    folder = place.parent
    return (
        f"{place}: is damaged: {said}. All that is wrong: heliosweep verify {folder}; to compute it anew: "
        f"heliosweep run {folder / 'study.resolved.yaml'} --output {folder}"
    )


@contextmanager
def blaming_damage(path: str | os.PathLike[str]) -> Iterator[None]:
    """Tell of a damaged result, where what is done with a `sound` one without a manifest fails of what it holds."""
    try:
        yield
    except (HeliosweepError, OSError):
        raise
    except Exception as error:
        place = locate(path)
        if manifest_of(place):
            raise
        wrong = [f"cannot be understood: {type(error).__name__}: {error}"]
        raise HeliosweepError(_damage(place, {}, wrong)) from error


if __name__ == "__main__":
    sys.exit(main())
