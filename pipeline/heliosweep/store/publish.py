"""From a working store that holds every part to the result: `result.nc`, or `result.zarr`."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from heliosweep.config.blocks import Output
from heliosweep.grid.plan import Plan
from heliosweep.store import zarr_result
from heliosweep.store.manifest import DESCRIPTIONS
from heliosweep.store.netcdf import ResultWriter
from heliosweep.store.raw import RESULTS
from heliosweep.store.skeleton import Skeleton
from heliosweep.store.temporary import remove, sync, temporary_name
from heliosweep.store.working import WorkingStore, writing


def publish(store: WorkingStore, skeleton: Skeleton, plan: Plan, output: Output, folder: Path) -> Path:
    """Leave the result in its folder, whole or not at all; it takes the place of one of either format.

    Parameters
    ----------
    store : WorkingStore
        With every part.
    skeleton : Skeleton
        Of the result.
    plan : Plan
        How it was cut.
    output : Output
        Format and compression.
    folder : pathlib.Path
        Result folder.

    Returns
    -------
    pathlib.Path
        The result.

    Raises
    ------
    HeliosweepError
        Where it cannot be written, or a part was damaged since it was stored.
    """
    path = folder / dict(zip(("netcdf", "zarr"), RESULTS, strict=True))[output.format]
    if output.format == "zarr":
        _publish_zarr(store, skeleton, plan, output, path)
    else:
        _publish_netcdf(store, skeleton, plan, output, path)
    with writing(folder):
        for other in (folder / name for name in RESULTS if folder / name != path):
            remove_result(other)
        sync(folder)
    return path


def _publish_netcdf(store: WorkingStore, skeleton: Skeleton, plan: Plan, output: Output, path: Path) -> None:
    level = output.compression_level if output.compression != "none" else 0
    with ResultWriter(
        path,
        skeleton.sizes,
        skeleton.coordinates,
        skeleton.variables,
        skeleton.attributes,
        level,
        replaces=DESCRIPTIONS,
    ) as writer:
        for part in plan.parts():
            writer.write(store.read(part), part.region)


def _publish_zarr(store: WorkingStore, skeleton: Skeleton, plan: Plan, output: Output, path: Path) -> None:
    temporary = temporary_name(path)
    with writing(path), _removed(temporary):
        compression: Any = output.compression
        skeleton.create_zarr(temporary, plan.cut, compression, output.compression_level)
        if store.holds(compression, output.compression_level):
            for part in plan.parts():
                store.read(part)  # or else it is damaged: nobody reads the chunks that are linked
            for name in skeleton.variables:
                for chunk in (store.values / name).iterdir():
                    if chunk.name.replace(".", "").isdecimal():  # not what a killed run has begun to write
                        _link(chunk, temporary / name / chunk.name)
        else:
            arrays = zarr_result.arrays(temporary)
            for part in plan.parts():
                store.write_to(arrays, part)
        zarr_result.finish(temporary)
        for place in (*temporary.rglob("*"), temporary):
            sync(place)
        for name in DESCRIPTIONS:
            path.with_name(name).unlink(missing_ok=True)
        remove_result(path)
        temporary.rename(path)


def remove_result(path: Path) -> None:
    """Remove a result of either format, where there is one: first its name, so that none is half removed."""
    if path.exists():
        doomed = temporary_name(path)
        path.rename(doomed)
        remove(doomed)


def _link(source: Path, target: Path) -> None:
    """Give a file a second name, or copy it where the file system knows no such."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


@contextmanager
def _removed(folder: Path) -> Iterator[None]:
    try:
        yield
    finally:
        shutil.rmtree(folder, ignore_errors=True)
