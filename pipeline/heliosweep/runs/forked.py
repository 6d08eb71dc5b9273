"""Imported by the process that workers are forked from, which removes the folder of its socket when it ends.

It ends after a run that was killed, too, which can then remove nothing: it has a group of processes of its own, with
its workers, which end with the run. They ignore Ctrl-C: the run acts on it.
"""

import atexit
import shutil
import signal
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

signal.signal(signal.SIGINT, signal.SIG_IGN)


@atexit.register
def _remove_folder() -> None:
    server: Any = getattr(forkserver, "_forkserver", None)
    address = getattr(server, "_forkserver_address", None)
    if address and Path(address).parent.name.startswith("pymp-"):
        shutil.rmtree(Path(address).parent, ignore_errors=True)
