"""Whether the workers of a cluster run the same code: other versions may change numbers."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from heliosweep.errors import HeliosweepError

if TYPE_CHECKING:
    from distributed import Client


def versions() -> dict[str, str]:
    """Versions in this process of everything that can change a number."""
    from heliosweep.kernels import compiled
    from heliosweep.store.fingerprint import code_versions

    # The kernels as they were imported: a worker may be older than the files on its disk.
    kernels = f"{compiled._FINGERPRINT}{' uncompiled' if compiled.PURE_PYTHON else ''}"
    return {"python": f"{sys.version_info.major}.{sys.version_info.minor}", **code_versions(), "kernels": kernels}


def check_workers(client: Client, workers: Iterable[str], where: str) -> set[str]:
    """Ask workers for their versions.

    Parameters
    ----------
    client : distributed.Client
        Connected client.
    workers : iterable of str
        Addresses of the workers to ask.
    where : str
        What the cluster is called in messages.

    Returns
    -------
    set of str
        Those that answered, and with the same versions as this process.

    Raises
    ------
    HeliosweepError
        Where one has other versions.
    """
    own = versions()
    answers = client.run(versions, workers=list(workers), on_error="return")
    for worker, answer in answers.items():
        if isinstance(answer, OSError):
            continue  # it left; who comes in its place is asked
        if isinstance(answer, Exception):
            raise HeliosweepError(
                f"worker {worker} of {where} cannot run heliosweep ({type(answer).__name__}: {answer}); "
                "install the same version there"
            )
        other = [name for name in {**own, **answer} if own.get(name) != answer.get(name)]
        if other:
            told = ", ".join(f"{name} {answer.get(name, 'missing')} instead of {own.get(name)}" for name in other)
            raise HeliosweepError(
                f"worker {worker} of {where} would compute with other versions: {told}; numbers could differ. "
                "Install the same versions there and start its workers again"
            )
    return {worker for worker, answer in answers.items() if isinstance(answer, dict)}
