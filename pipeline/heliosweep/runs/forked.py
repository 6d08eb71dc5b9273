"""Imported by the process that workers are forked from, which removes the folder of its socket when it ends.

It ends after a run that was killed, too, which can then remove nothing: it has a group of processes of its own, with
its workers, which end with the run. They ignore Ctrl-C: the run acts on it.
"""

import atexit
import shutil
import signal
import sys
import traceback
from multiprocessing import forkserver, synchronize
from pathlib import Path
from types import TracebackType
from typing import Any

signal.signal(signal.SIGINT, signal.SIG_IGN)


def _tell(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print why a worker could not start; not that its run had ended before, and had taken its semaphores along."""
    frames = traceback.extract_tb(trace)
    if not (isinstance(error, FileNotFoundError) and frames and frames[-1].filename == synchronize.__file__):
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _tell


@atexit.register
def _remove_folder() -> None:
    server: Any = getattr(forkserver, "_forkserver", None)
    address = getattr(server, "_forkserver_address", None)
    if address and Path(address).parent.name.startswith("pymp-"):
        shutil.rmtree(Path(address).parent, ignore_errors=True)
