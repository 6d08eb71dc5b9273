"""A second user of the machine gets to nothing of a run on a local cluster."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.faults.kills import STUDIES, done_parts, wait_for, write_study

#: What the second user tries, who has as many rights as anybody: prints what came of it. It first reaches a cluster of
#: its own, an open file and a page in the same ways, so that nothing else keeps it from those of the run.
PROGRAM = """
import contextlib, http.client, http.server, json, os, socket, sys, threading
from distributed import Client, LocalCluster, Security

told, uid = json.load(sys.stdin), 65534
logging = __import__("logging"); logging.disable()
ours = Security.temporary()
cluster = LocalCluster(n_workers=1, processes=False, security=ours, protocol="tls://", dashboard_address=None)
pages = http.server.HTTPServer(("127.0.0.1", 0), http.server.BaseHTTPRequestHandler)
threading.Thread(target=pages.serve_forever, daemon=True).start()

def submits(address, security, patience):
    done = []
    def submit():
        with contextlib.suppress(Exception), Client(address, security=security, timeout=patience) as client:
            done.append(client.submit(os.getuid).result(timeout=patience))
    thread = threading.Thread(target=submit, daemon=True)
    thread.start()
    thread.join(patience)  # a server that says nothing is waited for
    return done

def page(port, path):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=2)
    try:
        connection.request("GET", path)
        return connection.getresponse().status
    except (OSError, http.client.HTTPException):
        return None

def allowed(action, *arguments):
    try:
        action(*arguments)
    except OSError:
        return False
    return True

def tries(path, place):
    if os.path.isdir(path):
        return allowed(os.listdir, path), os.access(path, os.W_OK)
    if place.endswith("listener"):
        with socket.socket(socket.AF_UNIX) as one:
            return allowed(one.connect, path), False
    return os.access(path, os.R_OK), os.access(path, os.W_OK)

submits(cluster.scheduler_address, ours, 30)  # imports what is imported late
os.setgroups([]), os.setgid(uid), os.setuid(uid)
assert submits(cluster.scheduler_address, ours, 30) == [uid]
assert page(pages.server_port, "/") == 501
assert allowed(os.listdir, told["folder"]) and os.access(told["open"], os.R_OK)
found = {"submitted": [], "pages": [], "read": [], "written": [], "processes": []}
for port in told["ports"]:
    for protocol, security in (("tls", ours), ("tcp", None)) if port != told["dashboard"] else ():
        found["submitted"] += submits(f"{protocol}://127.0.0.1:{port}", security, 4)
    for path in told["pages"] if port == told["dashboard"] else ["/"]:
        if page(port, path) not in (None, 400, 404):
            found["pages"].append((port, path))
for path in told["paths"]:
    reads, writes = tries(path, os.path.basename(path).partition("-")[0])
    found["read"] += [path] * reads
    found["written"] += [path] * writes
for pid in told["processes"]:
    if allowed(os.kill, pid, 0) or allowed(open, f"/proc/{pid}/environ") or allowed(open, f"/proc/{pid}/mem"):
        found["processes"].append(pid)
print(json.dumps(found), flush=True)
os._exit(0)
"""
PAGES = ["/", "/status", "/info/main/workers.html", "/api/v1/get_workers", "/metrics", "/sitemap.json"]
#: Stops a run when its first part is stored.
HALT = """
import os, time
from heliosweep.store.parts import PartStore
commit = PartStore.commit
PartStore.commit = lambda *said: commit(*said) or time.sleep(600)
os.umask(0o022)
"""


@pytest.fixture
def public(nursery) -> Iterator[Path]:
    """A folder that everybody may look into; so is that for temporary files."""
    if not hasattr(os, "getuid") or os.getuid() != 0:
        pytest.skip("only root can become somebody else")
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        nursery.scratch.chmod(0o1777)
        yield Path(name)
        nursery.scratch.chmod(0o700)


def test_a_second_user_gets_to_nothing(nursery, public):
    """But to read what is stored, as everybody may where the user's mask is the usual one."""
    study = write_study(public, STUDIES["cluster"])
    (public / "open").touch()
    pid = nursery.start(["run", str(study), "--no-report", "--output", str(public / "out")], setup=HALT)
    wait_for(lambda: done_parts(public / "out"))
    tree = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
    ports = {one.laddr.port for process in tree for one in process.net_connections("tcp") if one.status == "LISTEN"}
    dashboard, secret = re.findall(r"dashboard: http://127.0.0.1:(\d+)/(\S+)/status", nursery.log())[0]
    for process in tree:
        assert secret not in " ".join(process.cmdline())  # which everybody may see
    private = {*nursery.scratch.rglob("*"), *(public / "out/working").glob("tmp*/**/*")}
    paths = {*private, *public.glob("out/**/*"), public / "out"}
    assert len(ports) >= 4  # of the scheduler, its dashboard and the workers
    assert int(dashboard) in ports
    assert any(path.is_socket() for path in private)
    told = {"folder": str(public), "open": str(public / "open"), "dashboard": int(dashboard), "pages": PAGES}
    told |= {"ports": [*ports], "paths": [*map(str, paths)], "processes": [process.pid for process in tree]}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], input=json.dumps(told), capture_output=True, text=True, check=False, cwd=public
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    read = {Path(path) for path in found.pop("read")}
    assert found == {"submitted": [], "pages": [], "written": [], "processes": []}
    assert not read & private
    assert read >= {public / "out", public / "out/working/values.bin"}
    assert nursery.signal()
    nursery.end()


def test_what_is_written_has_the_rights_that_the_mask_leaves(nursery, tmp_path):
    command = ["run", str(write_study(tmp_path, STUDIES["field"])), "-q", "--output", str(tmp_path / "out")]
    assert nursery.run(command, setup="import os; os.umask(0o077)").code == 0
    written = [tmp_path / "out", *(tmp_path / "out").rglob("*")]
    assert len(written) > 5
    assert not [path for path in written if path.stat().st_mode & 0o077]
