"""Whether a result that somebody names can be read in this process, and is what its manifest tells of.

A damaged NetCDF file can keep the HDF5 library in an endless loop, or end the process. A file whose bytes are those
that its manifest tells of does neither; any other is first read to its end by a process of its own, which is ended
when it goes on no more (`contents.check_apart`). Zarr groups are read by code that raises errors and only waits for
pipes, but takes a chunk that is missing for one of NaN: where it matters (`as_written`), the bytes of the group are
compared with its manifest, and where they are others, its values and attributes. A group without a manifest, or under
another name than its manifest has, is only looked through for pipes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.store.contents import check, check_apart
from heliosweep.store.digest import file_digest, odd, tree_digest
from heliosweep.store.finished import MANIFEST, read_manifest
from heliosweep.store.raw import is_netcdf, is_zarr, locate

#: Things that are wrong with a result and are named; `heliosweep verify` names all.
_NAMED = 2


class Sound(NamedTuple):
    """A result that can be read.

    Parameters
    ----------
    path : pathlib.Path
        The file or Zarr group, as `raw.locate` finds it.
    digest : str
        SHA-256 of a file that was compared with its manifest, else empty.
    """

    path: Path
    digest: str = ""


def sound(*paths: str | os.PathLike[str], as_written: bool = False) -> tuple[Sound, ...]:
    """Make sure that results can be read in this process, side by side.

    Parameters
    ----------
    *paths : path
        Result folders, NetCDF files or Zarr groups.
    as_written : bool
        Whether a result whose manifest tells of other values or attributes is refused too. Zarr groups are hashed for
        it, at about the speed of SHA-256, as NetCDF files always are.

    Returns
    -------
    tuple of Sound
        Their results.

    Raises
    ------
    StudyError
        A path that holds no result.
    HeliosweepError
        A result that is damaged; says what can be done.
    """
    places = tuple(locate(path) for path in paths)
    with ThreadPoolExecutor(len(places)) as pool:
        return tuple(pool.map(lambda place: _checked(place, as_written), places))


@contextmanager
def with_remedy(*places: Path) -> Iterator[None]:
    """Add what can be done to errors that name one of these results: what its reader says knows nothing of it."""
    try:
        yield
    except StudyError:
        raise
    except HeliosweepError as error:
        for place in places:
            said = str(error).removeprefix(f"{place}: ")
            if said != str(error) and not said.startswith("is damaged: "):
                raise HeliosweepError(_damage(place, _manifest(place), [said])) from error
        raise


@contextmanager
def blaming_damage(path: str | os.PathLike[str]) -> Iterator[None]:
    """Tell of a damaged result, where what is done with a `sound` one fails for no other reason that is known."""
    place = locate(path)
    try:
        with with_remedy(place):
            yield
    except (HeliosweepError, OSError):
        raise
    except Exception as error:  # what values and attributes that make no sense lead to
        manifest = _manifest(place)
        wrong = check(place, manifest) if manifest else [f"cannot be understood: {type(error).__name__}: {error}"]
        if not wrong:
            raise
        raise HeliosweepError(_damage(place, manifest, wrong)) from error


def _checked(place: Path, as_written: bool) -> Sound:
    manifest = _manifest(place)
    if is_zarr(place):
        if names := odd(place):
            raise HeliosweepError(_damage(place, manifest, [f"{name} is no file" for name in names]))
        changed = as_written and manifest and tree_digest(place) != manifest["result"]["sha256"]
        if changed and (wrong := check(place, manifest)):
            raise HeliosweepError(_damage(place, manifest, wrong))
        return Sound(place)
    if not is_netcdf(place):
        if not manifest:
            raise StudyError(Problem("is no result; name a result folder", file=str(place)))
        raise HeliosweepError(_damage(place, manifest, ["is no NetCDF file and no Zarr group any more"]))
    expected = manifest["result"] if manifest else {}
    digest = file_digest(place) if place.stat().st_size == expected.get("bytes") else ""
    if digest and digest == expected.get("sha256"):
        return Sound(place, digest)
    if wrong := check_apart(place, manifest if as_written and manifest else None):
        raise HeliosweepError(_damage(place, manifest, wrong))
    return Sound(place, digest)


def _manifest(place: Path) -> dict[str, Any]:
    """The manifest that tells of a result; nothing where there is none, or of another file."""
    with suppress(HeliosweepError):
        manifest = read_manifest(place.parent)
        if manifest["result"]["file"] == place.name:
            return manifest
    return {}


def _damage(place: Path, manifest: Mapping[str, Any], wrong: list[str]) -> str:
    more = f", and {len(wrong) - _NAMED} more" if len(wrong) > _NAMED else ""
    said = "; ".join(line.removeprefix("is damaged: ") for line in wrong[:_NAMED]) + more
    if not manifest:
        return f"{place}: is damaged: {said}. There is no {MANIFEST} for it; get the file anew from where it came from"
    folder = place.parent
    return (
        f"{place}: is damaged: {said}. All that is wrong: heliosweep verify {folder}; to compute it anew: "
        f"heliosweep run {folder / 'study.resolved.yaml'} --output {folder}"
    )
