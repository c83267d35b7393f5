"""A SLURM cluster of two nodes on this machine: controller, node daemons and munge, in a folder of its own."""

import os
import shutil
import socket
import subprocess
import time
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "sinfo", "scontrol")
INSTALL = "apt install slurm-wlm munge"
NODES = ("n1", "n2")
CONFIGURATION = """ClusterName=local
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.sock
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool.%n
SlurmctldPidFile={folder}/controller.pid
SlurmdPidFile={folder}/%n.pid
SlurmctldLogFile={folder}/controller.log
SlurmdLogFile={folder}/%n.log
SlurmctldPort={ports[0]}
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
MpiDefault=none
KillWait=5
MinJobAge=300
JobRequeue=1
SchedulerParameters=sched_interval=2,requeue_delay=1
NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[1]} CPUs=1 RealMemory=2000 State=UNKNOWN
NodeName=n2 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[2]} CPUs=1 RealMemory=2000 State=UNKNOWN
PartitionName=cpu Nodes=n[1-2] Default=YES MaxTime=INFINITE State=UP
"""


class SlurmCluster:
    """Runs as long as it is not stopped; `environment` is that of the commands which use it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        host, user = socket.gethostname().split(".")[0], subprocess.check_output(["id", "-un"], text=True).strip()
        sockets = [socket.socket() for _ in range(3)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        ports = [one.getsockname()[1] for one in sockets]
        for one in sockets:
            one.close()
        for name in ("state", *(f"spool.{node}" for node in NODES)):
            (folder / name).mkdir()
        (folder / "munge.key").write_bytes(os.urandom(1024))
        (folder / "munge.key").chmod(0o400)
        (folder / "slurm.conf").write_text(CONFIGURATION.format(host=host, user=user, folder=folder, ports=ports))
        self.environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}
        self.call("munged", "--force", *(f"--{name}={folder / file}" for name, file in (
            ("key-file", "munge.key"), ("socket", "munge.sock"), ("pid-file", "munged.pid"),
            ("log-file", "munged.log"), ("seed-file", "munged.seed"))))
        self.call("slurmctld")
        for node in NODES:
            self.call("slurmd", "-N", node)
        end = time.monotonic() + 60.0
        while self.call("sinfo", "-h", "-o", "%D %t") != "2 idle":
            assert time.monotonic() < end, (folder / "controller.log").read_text()[-2000:]
            time.sleep(0.5)

    def call(self, program: str, *words: str) -> str:
        done = subprocess.run([find(program) or program, *words], env=self.environment, capture_output=True, text=True,
                              timeout=60.0)
        assert done.returncode == 0, f"{program}: {done.stdout}{done.stderr}"
        return done.stdout.strip()

    def stop(self) -> None:
        for name in (*(f"{node}.pid" for node in NODES), "controller.pid", "munged.pid"):
            path = self.folder / name
            if path.is_file():
                subprocess.run(["kill", path.read_text().strip()], check=False)
        time.sleep(1.0)


def find(program: str) -> str | None:
    """Return the path of a program, also in the folders of the system's daemons."""
    return shutil.which(program, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")


def missing_programs() -> list[str]:
    return [program for program in PROGRAMS if find(program) is None]
