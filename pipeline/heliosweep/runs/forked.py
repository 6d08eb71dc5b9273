"""Imported by the process that workers are forked from: when it ends, it removes the folder of its socket.

It ends after a run that was killed, too, which can then remove nothing: what is sent to the group of that run does not
reach it, nor its workers, which end with the run.
"""

import atexit
import os
import shutil
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

os.setpgid(0, 0)


@atexit.register
def _remove_folder() -> None:
    server: Any = getattr(forkserver, "_forkserver", None)
    address = getattr(server, "_forkserver_address", None)
    if address and Path(address).parent.name.startswith("pymp-"):
        shutil.rmtree(Path(address).parent, ignore_errors=True)
