"""What a result holds against what its manifest says, part by part.

A damaged NetCDF file can keep the HDF5 library in an endless loop, which nothing inside the process ends. What is
not known to be whole is therefore read by a process of its own (`check_apart`; `sound` asks for it).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile
from time import monotonic
from typing import Any

import numpy as np

from heliosweep.errors import HeliosweepError
from heliosweep.grid.slabs import Part
from heliosweep.store.digest import content_digest, odd, part_digest
from heliosweep.store.places import Places
from heliosweep.store.raw import Raw, open_raw, stored_parts

#: Damaged parts that are named; of more, the number is told.
_NAMED = 20
#: The process that reads what may be damaged: it is ended after so long without a piece read; address space. [s, bytes]
_PATIENCE, _ROOM = 60.0, 8 * 2**30
#: Damage may also tell of values without end. Nobody who reads so slowly, and no file packed so densely by zlib, is
#: suspected of it. [bytes/s, 1]
_SLOWEST, _DENSEST = 20e6, 1032
#: Its command, without the name of the result.
_READER = [sys.executable, "-P", "-m", "heliosweep.store.contents"]


def read_part(path: str | os.PathLike[str], part: Part, digest: str | None = None) -> dict[str, np.ndarray] | None:
    """Values of one part of a result, as stored.

    Parameters
    ----------
    path : path
        The result, of either format.
    part : Part
        Which part.
    digest : str, optional
        What `part_digest` of its values must be.

    Returns
    -------
    dict of str to ndarray, optional
        None where they cannot be read, or are others than the digest says.
    """
    return next(read_parts(path, [part], {part.name: digest} if digest else {}))


def read_parts(
    path: str | os.PathLike[str], parts: Iterable[Part], digests: Mapping[str, str]
) -> Iterator[dict[str, np.ndarray] | None]:
    """Values of several parts, as by `read_part`, one after the other; a part without a digest is not checked."""
    with ExitStack() as stack:
        try:
            raw = stack.enter_context(open_raw(path))
        except HeliosweepError:
            yield from (None for _ in parts)
            return
        for part in parts:
            try:
                values = part_values(raw, part)
            except HeliosweepError:
                yield None
                continue
            digest = digests.get(part.name)
            yield values if digest is None or part_digest(values) == digest else None


def part_values(raw: Raw, part: Part) -> dict[str, np.ndarray]:
    """Values of one part of an open result.

    Raises
    ------
    HeliosweepError
        They cannot be read.
    """
    return {name: raw.read(name, raw.index(name, part.region)) for name in raw.of_kind(part.kind)}


def check_parts(raw: Raw, cut: Mapping[str, Any], digests: Mapping[str, str]) -> tuple[int, list[str]]:
    """Compare the digests of parts with those of the values.

    Parameters
    ----------
    raw : Raw
        Open result.
    cut : mapping
        How it was cut.
    digests : mapping of str to str
        SHA-256 by name of the part; parts that are not named are passed over.

    Returns
    -------
    int
        Parts that there are.
    list of str
        What is wrong, one line for each damaged part.
    """
    places, count, wrong = Places(raw), 0, []
    for part in stored_parts(cut, raw.sizes):
        count += 1
        if part.name not in digests:
            continue
        try:
            damage = "" if part_digest(part_values(raw, part)) == digests[part.name] else "is not what was computed"
        except HeliosweepError as error:
            damage = str(error).removeprefix(f"{raw.path}: ")
        if damage:
            where = places.within(part.region)
            wrong.append(f"part {part.name}{f' ({where})' if where else ''}: {damage}")
    return count, wrong


def check(path: Path, manifest: Mapping[str, Any], told: Callable[[], object] = lambda: None) -> list[str]:
    """Compare what a result holds with its manifest.

    Parameters
    ----------
    path : pathlib.Path
        The result.
    manifest : mapping
        Its manifest.
    told : callable
        Called after every piece that was read.

    Returns
    -------
    list of str
        What is wrong.
    """
    try:
        if path.is_dir() and (strange := odd(path)):
            return [f"{name} is no file" for name in strange[:_NAMED]]
        with open_raw(path, told) as raw:
            wrong = _check_identity(raw, manifest)
            parts = manifest.get("parts")
            if isinstance(parts, Mapping):
                if names := parts.get("variables"):
                    raw = replace(raw, record={**raw.record, "variables": names})
                digests = parts["digests"]
                count, damaged = check_parts(raw, parts["cut"], digests)
                wrong += damaged[:_NAMED]
                if len(damaged) > _NAMED:
                    wrong.append(f"and {len(damaged) - _NAMED:,} more parts are damaged")
                if len(digests) != count:
                    wrong.append(f"manifest.json has digests of {len(digests):,} parts, the result has {count:,}")
            expected = manifest["result"].get("content_digest")
            if not wrong and expected and content_digest(path, told) != expected:
                wrong.append("attributes or coordinates are not those that were written (the values are)")
    except HeliosweepError as error:
        return [str(error).removeprefix(f"{path}: ")]
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        return [f"manifest.json does not fit the result ({type(error).__name__}: {error})"]
    return wrong


def _check_identity(raw: Raw, manifest: Mapping[str, Any]) -> list[str]:
    said, found = manifest.get("study_id"), raw.attributes.get("study_id")
    return [] if said == found else [f"is of study {found}, manifest.json of study {said}"]


def _check_readable(path: Path, told: Callable[[], object]) -> list[str]:
    """Read a result of which nothing is known to its end."""
    try:
        content_digest(path, told)
    except HeliosweepError as error:
        return [str(error).removeprefix(f"{path}: ")]
    return []


def check_apart(path: Path, manifest: Mapping[str, Any] | None) -> list[str]:
    """Do `check` of a file in a process of its own, which may hang or die of what it reads.

    It is waited for as long as it goes on reading, for how long that takes depends on how the values are packed.

    Parameters
    ----------
    path : pathlib.Path
        The result.
    manifest : mapping, optional
        Its manifest; None to learn only whether everything in it can be read.

    Returns
    -------
    list of str
        What is wrong.
    """
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


def _tell() -> None:
    print(flush=True)


def main() -> int:
    """Check the result named on the command line against the manifest on standard input, or ``null``.

    Standard output has an empty line for every piece that was read, and in the end what is wrong, as JSON.
    """
    if os.name == "posix":
        import resource

        with_limit = (_ROOM, resource.getrlimit(resource.RLIMIT_AS)[1])
        resource.setrlimit(resource.RLIMIT_AS, with_limit)
    path, manifest = Path(sys.argv[1]), json.load(sys.stdin)
    wrong = _check_readable(path, _tell) if manifest is None else check(path, manifest, _tell)
    print(json.dumps(wrong))
    return 0


if __name__ == "__main__":
    sys.exit(main())
