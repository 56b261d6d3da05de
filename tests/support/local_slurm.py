"""A SLURM of one's own: controller, nodes and authentication, all in a folder, for as long as a test lasts. It needs no root and
nothing in /etc, and disturbs no other SLURM on the machine. Debian has it as the packages slurmctld, slurmd, slurm-client and munge."""

import contextlib
import os
import secrets
import shutil
import socket
import subprocess
import time
from pathlib import Path
from typing import Self

import psutil

from tests.support.waiting import wait_for

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "squeue", "scontrol", "sinfo")

CONF = """
ClusterName=egosplat
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort={port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool_%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd_%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd_%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory,CR_LLN
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=1
JobAcctGatherParams=OverMemoryKill
SlurmdParameters=config_overrides
SchedulerParameters=sched_interval=1,batch_sched_delay=0
MinJobAge=86400
ReturnToService=2
GresTypes=gpu
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""

NODE = "NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs=16 RealMemory=100000 Gres=gpu:2\n"
"""A node is said to be large, whatever the machine is, so that no job has to wait for room; its GPUs are none."""

GRES = """
NodeName={name} Name=gpu File=/dev/null
NodeName={name} Name=gpu File=/dev/zero
"""

START_S = 120.0

UNDER_WAY = {"PENDING", "CONFIGURING", "RUNNING", "COMPLETING"}
"""States that a job leaves again: it is COMPLETING until its node has been cleared up, however it ended."""


def missing_programs() -> list[str]:
    """The programs of SLURM that the machine lacks."""
    return [name for name in PROGRAMS if _found(name) is None]


class LocalSlurm:
    """Controller, nodes and authentication, running from ``with`` to its end. ``folder``: to make, with a
    path of few characters: a socket's may have 107. ``nodes``: number of nodes, named node1 and so on."""

    def __init__(self, folder: Path, nodes: int = 1) -> None:
        self.folder = folder
        self._nodes = [f"node{number}" for number in range(1, nodes + 1)]
        self._daemons: dict[str, subprocess.Popen[bytes]] = {}
        self._running: list[subprocess.Popen[bytes]] = []

    @property
    def environment(self) -> dict[str, str]:
        """In which SLURM's commands reach this one."""
        path = os.pathsep.join([str(self.folder / "bin"), os.environ["PATH"]])
        return {"SLURM_CONF": str(self.folder / "slurm.conf"), "PATH": path}

    def __enter__(self) -> Self:
        self._configure()
        try:
            self._start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for process in reversed(self._running):
            process.terminate()
        for process in reversed(self._running):
            process.wait(timeout=120)

    def ask(self, *command: str) -> str:
        """Output of a SLURM command."""
        done = subprocess.run(
            command,
            env=os.environ | self.environment,
            check=True,
            capture_output=True,
            text=True,
            timeout=120,
        )
        return done.stdout

    def states(self) -> dict[str, str]:
        """State of each job that SLURM remembers, by its id."""
        lines = self.ask("squeue", "--states=all", "--noheader", "--format=%i %T").splitlines()
        return dict(line.split() for line in lines)

    def end_of(self, job: str) -> str:
        """Wait until a job ends and return its state."""
        wait_for(lambda: self.states()[job] not in UNDER_WAY)
        return self.states()[job]

    def asked_of(self, job: str) -> dict[str, str]:
        """Properties of a job, as ``scontrol show job`` prints them."""
        text = self.ask("scontrol", "show", "job", job)
        return dict(word.partition("=")[::2] for word in text.split() if "=" in word)

    def lose(self, node: str) -> None:
        """Kill a node's daemon and all processes of its jobs, and tell the controller, as its time limit would."""
        jobs = self.ask("squeue", "--nodelist", node, "--noheader", "--format=%i").split()
        self._daemons[node].kill()
        self.ask("scontrol", "update", f"nodename={node}", "state=down", "reason=lost")
        steps = tuple(f"slurmstepd: [{job}." for job in jobs)
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.Error):
                about = process.environ()
                mine = about.get("SLURM_CONF") == str(self.folder / "slurm.conf")
                if process.name().startswith("slurmstepd") and process.cmdline()[0].startswith(steps):
                    process.kill()
                if mine and about.get("SLURMD_NODENAME") == node:
                    process.kill()

    def _configure(self) -> None:
        for name in ("state", "bin", *(f"spool_{node}" for node in self._nodes)):
            (self.folder / name).mkdir(parents=True)
        host = socket.gethostname().partition(".")[0]
        user = subprocess.run(["id", "-un"], capture_output=True, text=True, check=True).stdout.strip()
        port, *ports = _free_ports(1 + len(self._nodes))
        nodes = [
            NODE.format(name=name, host=host, port=own) for name, own in zip(self._nodes, ports, strict=True)
        ]
        conf = CONF.format(folder=self.folder, user=user, port=port) + "".join(nodes)
        (self.folder / "slurm.conf").write_text(conf)
        (self.folder / "gres.conf").write_text("".join(GRES.format(name=name) for name in self._nodes))
        (self.folder / "munge.key").write_bytes(secrets.token_bytes(128))
        (self.folder / "munge.key").chmod(0o600)
        # Within a job Snakemake takes away what begins with SLURM_; elsewhere the configuration is in /etc.
        srun = self.folder / "bin/srun"
        srun.write_text(f'#!/bin/sh\nSLURM_CONF={self.folder}/slurm.conf exec {_found("srun")} "$@"\n')
        srun.chmod(0o755)

    def _start(self) -> None:
        at, conf = self.folder, self.folder / "slurm.conf"
        self._run(
            "munged",
            *("--foreground", "--force", f"--key-file={at}/munge.key", f"--socket={at}/munge.socket"),
            *(f"--pid-file={at}/munged.pid", f"--log-file={at}/munged.log", f"--seed-file={at}/munged.seed"),
        )
        self._wait(lambda: (at / "munge.socket").exists(), "munged")
        self._run("slurmctld", "-D", "-f", str(conf))
        for node in self._nodes:
            self._daemons[node] = self._run("slurmd", "-D", "-N", node, "-f", str(conf))
        self._wait(self._idle, "slurmctld and slurmd")

    def _run(self, name: str, *arguments: str) -> "subprocess.Popen[bytes]":
        with (self.folder / f"{name}.out").open("ab") as out:
            words = [_found(name), *arguments]
            process = subprocess.Popen(words, stdout=out, stderr=out, env=os.environ | self.environment)
        self._running.append(process)
        return process

    def _idle(self) -> bool:
        try:
            return self.ask("sinfo", "--noheader", "--format=%T").split() == ["idle"]
        except subprocess.SubprocessError:
            return False

    def _said(self) -> str:
        return "\n".join(path.read_text()[-1000:] for path in sorted(self.folder.glob("*.out")))

    def _wait(self, condition, who: str) -> None:
        end = time.monotonic() + START_S
        while not condition():
            ended = any(process.poll() is not None for process in self._running)
            assert not ended and time.monotonic() < end, f"{who} did not start:\n{self._said()}"
            time.sleep(0.1)


def _found(name: str) -> str | None:
    """Daemons lie where not every user's PATH leads."""
    return shutil.which(name, path=os.pathsep.join([os.environ["PATH"], "/usr/sbin", "/sbin"]))


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports
