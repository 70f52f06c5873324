"""Slurm on this machine, for the tests: a cluster of one node, with its own keys, ports and folder.

munged, slurmctld and slurmd are Debian's (`apt-get install slurmctld slurmd munge slurm-client
slurm-wlm-basic-plugins`). They run as the present user, write only in their folder, and end with it.
"""

import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path

CPUS = 2  # of the node; the cores of the machine may be fewer
DAEMONS = ("munged", "slurmctld", "slurmd")
WAIT = 300.0  # s that anything may take
PATH = f"{os.environ['PATH']}:/usr/sbin:/sbin"

# cred_expire: time that a requeued job waits; the default is two minutes
CONFIGURATION = """
ClusterName=netfall
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
SlurmctldPort={controller}
SlurmdPort={node}
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=batch_sched_delay=0,sched_interval=1
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
ReturnToService=2
KillWait=10
SlurmdParameters=config_overrides
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} SocketsPerBoard=1 CoresPerSocket={cpus} ThreadsPerCore=1
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def missing() -> list[str]:
    """Return the programs that are not installed."""
    return [name for name in (*DAEMONS, "sbatch", "srun") if shutil.which(name, path=PATH) is None]


def kill_all(*variables: str) -> None:
    """Send SIGKILL to every process whose environment contains these variables, NAME=VALUE."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended, or is another user's
            entries = (process / "environ").read_bytes().split(b"\0")
            if all(each.encode() in entries for each in variables):
                os.kill(int(process.name), signal.SIGKILL)


def free_ports(count: int) -> list[int]:
    """Return unused ports."""
    held = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [each.getsockname()[1] for each in held]
    for each in held:
        each.close()
    return ports


class Cluster:
    """Commands of a running cluster, and its jobs by their numbers."""

    def __init__(self, folder: Path, environment: dict):
        """environment : variables of the commands"""
        self.folder = folder
        self.environment = environment | {"SLURM_CONF": str(folder / "slurm.conf"), "PATH": PATH}

    def command(self, *words, cwd=None, check: bool = True) -> str:
        """Return the output of a command of Slurm."""
        done = subprocess.run(
            list(map(str, words)),
            cwd=cwd,
            env=self.environment,
            text=True,
            capture_output=True,
            timeout=WAIT,
            stdin=subprocess.DEVNULL,
        )
        assert not (check and done.returncode), f"{words}: {done.stdout}{done.stderr}"
        return done.stdout.strip()

    def submit(self, *words, cwd: Path) -> int:
        """Submit a script by sbatch; return the number of the job."""
        return int(self.command("sbatch", "--parsable", *words, cwd=cwd))

    def queue(self) -> dict[str, str]:
        """Return the state of each unfinished job by its name: JOB or JOB_TASK."""
        listed = self.command("squeue", "--noheader", "--array", "--format=%i %T").splitlines()
        return dict(line.split() for line in listed)

    def facts(self, job) -> dict[str, str]:
        """Return the facts that `scontrol show job` prints for a running or recent job."""
        words = self.command("scontrol", "show", "job", job).split()
        return dict(word.split("=", 1) for word in words if "=" in word)

    def until(self, condition, what: str) -> None:
        """Wait until a condition holds."""
        end = time.monotonic() + WAIT
        while not condition():
            assert time.monotonic() < end, f"{what} within {WAIT} s; queue: {self.queue()}"
            time.sleep(0.05)

    def until_empty(self) -> None:
        """Wait until there is no job."""
        self.until(lambda: not self.queue(), "end of all jobs")

    def kill(self, variable: str) -> None:
        """Send SIGKILL to the script and all processes of jobs with a variable, NAME=VALUE."""
        kill_all(f"SLURM_CONF={self.folder}/slurm.conf", variable)

    def clear(self) -> None:
        """End all jobs."""
        self.command("scancel", *self.queue(), check=False)
        self.until_empty()


@contextmanager
def cluster(environment: dict):
    """Start a cluster for a block, and end all its processes in any case."""
    started = []
    # A socket's name has at most a hundred letters, and munged needs a path that all users can read.
    folder = Path(tempfile.mkdtemp(prefix="slurm-", dir="/tmp"))
    folder.chmod(0o755)
    try:
        _configure(folder)
        here = Cluster(folder, environment)
        for name, words in _daemons(folder).items():
            log = (folder / f"{name}.out").open("w")
            started.append(
                subprocess.Popen(
                    ["setpriv", "--pdeathsig", "TERM", *words],  # they end also if this process is killed
                    env=here.environment,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
            )
            log.close()
            if name == "munged":
                here.until((folder / "munge.socket").exists, "munged")
        here.until(lambda: "idle" in here.command("sinfo", "-h", "-o", "%t", check=False), "an idle node")
        yield here
    finally:
        _end(started, folder)


def _user() -> str:
    import pwd

    return pwd.getpwuid(os.getuid()).pw_name


def _configure(folder: Path) -> None:
    """Write the files that the daemons read, and make their folders."""
    for name in ("state", "spool"):
        (folder / name).mkdir()
    key = folder / "munge.key"
    key.touch(mode=0o600)
    key.write_bytes(os.urandom(128))
    controller, node = free_ports(2)
    text = CONFIGURATION.format(
        host=socket.gethostname().split(".")[0],
        user=_user(),
        folder=folder,
        cpus=CPUS,
        controller=controller,
        node=node,
    )
    (folder / "slurm.conf").write_text(text)


def _daemons(folder: Path) -> dict[str, list[str]]:
    """Return the commands in the order of their start, each in the foreground."""
    places = {"key": "munge.key", "seed": "munge.seed", "pid": "munge.pid", "log": "munge.log"}
    files = [f"--{name}-file={folder}/{file}" for name, file in places.items()]
    munged = ["munged", "--foreground", f"--socket={folder}/munge.socket", *files]
    return {"munged": munged, "slurmctld": ["slurmctld", "-D"], "slurmd": ["slurmd", "-D"]}


def _end(started: list[subprocess.Popen], folder: Path) -> None:
    """End the processes, the last first, and the steps that slurmd has left; remove the folder."""
    for daemon in reversed(started):
        daemon.terminate()
        try:
            daemon.wait(20)
        except subprocess.TimeoutExpired:
            daemon.kill()
            daemon.wait()
    kill_all(f"SLURM_CONF={folder}/slurm.conf")
    shutil.rmtree(folder, ignore_errors=True)
