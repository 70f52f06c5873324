"""Two virtual hosts on this machine, which share only a network and their files, for the tests.

Each is a process with its own network, host name and IPC namespaces, which needs root. A pair of virtual
network cards joins them. mpirun runs on the first and reaches the second by a script in place of ssh.
"""

import shlex
import subprocess
from contextlib import contextmanager
from pathlib import Path

NAMES = ("alpha", "beta")
ADDRESSES = ("10.213.0.1", "10.213.0.2")
CARD = "net0"


def _run(*words) -> None:
    subprocess.run(list(map(str, words)), check=True, capture_output=True, stdin=subprocess.DEVNULL)


def _inside(host: subprocess.Popen) -> list[str]:
    """Return the start of a command line that runs on a host."""
    return ["nsenter", "-t", str(host.pid), "--net", "--uts", "--ipc"]


@contextmanager
def two_hosts(mpirun: Path, folder: Path):
    """Yield options of mpirun for one rank on each of two hosts, which exist during the block."""
    hosts = []
    try:
        for name in NAMES:
            words = f"hostname {name} && ip link set lo up && echo up && exec sleep infinity"
            hosts.append(
                subprocess.Popen(
                    ["unshare", "--net", "--uts", "--ipc", "sh", "-c", words],
                    stdout=subprocess.PIPE,
                    stdin=subprocess.DEVNULL,
                )
            )
            assert hosts[-1].stdout.readline() == b"up\n", "no namespaces for hosts of their own: needs root"
        _join(*hosts)
        yield [*_inside(hosts[0]), str(mpirun), *_settings(folder, hosts[1])]
    finally:
        for host in hosts:  # the cards and the network go with them
            host.kill()
            host.wait()
            host.stdout.close()


def _join(one: subprocess.Popen, other: subprocess.Popen) -> None:
    """Put a network card with an address into each, and a cable between them."""
    peer = ["type", "veth", "peer", "name", CARD, "netns", other.pid]
    _run(*_inside(one), "ip", "link", "add", CARD, *peer)
    for host, address in zip((one, other), ADDRESSES):
        _run(*_inside(host), "ip", "address", "add", f"{address}/24", "dev", CARD)
        _run(*_inside(host), "ip", "link", "set", CARD, "up")


def _settings(folder: Path, other: subprocess.Popen) -> list[str]:
    """Return options of mpirun, with a script that starts its daemon on the other host, and a host file."""
    script = folder / "instead_of_ssh.sh"
    script.write_text(f'#!/bin/sh\nshift\nexec {shlex.join(_inside(other))} sh -c "$*"\n')
    script.chmod(0o755)
    (folder / "hosts").write_text("".join(f"{address} slots=1\n" for address in ADDRESSES))
    settings = {
        "plm_rsh_agent": str(script),
        "pml": "ob1",
        "btl": "tcp,self",
        "btl_tcp_if_include": CARD,
        "oob_tcp_if_include": CARD,
    }
    words = [word for name, value in settings.items() for word in ("--mca", name, value)]
    return ["--hostfile", str(folder / "hosts"), "--map-by", "node", *words, "-n", "2"]
