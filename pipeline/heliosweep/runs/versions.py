"""Versions of the code on the workers of a cluster: with others, numbers may change."""

from __future__ import annotations

import hashlib
import sys
from functools import cache
from typing import TYPE_CHECKING

from heliosweep.errors import HeliosweepError

if TYPE_CHECKING:
    from distributed import Client


@cache
def versions(module: str) -> dict[str, str]:
    """Versions in this process of everything that the numbers of a module depend on."""
    from heliosweep.kernels import compiled
    from heliosweep.store.code_versions import code_versions

    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    return {"python": python, **code_versions(module), "kernels": "plain" if compiled.PURE_PYTHON else "compiled"}


@cache
def versions_token(module: str) -> str:
    """Digest of `versions`."""
    return hashlib.sha256(repr(sorted(versions(module).items())).encode()).hexdigest()[:16]


def check_workers(client: Client, where: str, module: str) -> None:
    """Ask the workers of a cluster for their versions.

    Parameters
    ----------
    client : distributed.Client
        Connected client.
    where : str
        What the cluster is called in messages.
    module : str
        Module that the numbers come from.

    Raises
    ------
    HeliosweepError
        Where one has other versions than this process, or cannot run heliosweep.
    """
    own = versions(module)
    for worker, answer in client.run(versions, module, on_error="return").items():
        if isinstance(answer, OSError):
            continue  # it left
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
