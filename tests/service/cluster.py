# SPDX-License-Identifier: Apache-2.0
"""A Slurm of its own: munge, a controller and node daemons, as ordinary processes of this machine, in their own
directories and on their own ports. Each is ended by its process number."""
import contextlib
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import tempfile
import time

from service import PATIENCE_S, processes, wait_until

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "scontrol", "sinfo")
PATH = os.environ.get("PATH", "") + ":/usr/sbin:/sbin"

CONF = """ClusterName=hexad
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={base}/munge/socket,cred_expire=5
CryptoType=crypto/munge
StateSaveLocation={base}/state
SlurmdSpoolDir={base}/spool.%n
SlurmctldPidFile={base}/slurmctld.pid
SlurmdPidFile={base}/slurmd.%n.pid
SlurmctldLogFile={base}/slurmctld.log
SlurmdLogFile={base}/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin={task_plugin}
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=1
{over_memory}
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
ReturnToService=2
SwitchType=switch/none
MpiDefault=none
SchedulerType=sched/backfill
SchedulerParameters=sched_min_interval=100000,bf_interval=1
SlurmdTimeout={node_timeout}
InactiveLimit=0
KillWait=2
MinJobAge=300
MaxJobCount={most_jobs}
MessageTimeout=5
TCPTimeout=2
AccountingStorageType=accounting_storage/{accounting}
JobCompType=jobcomp/none
{nodes}
PreemptType=preempt/partition_prio
PreemptMode=CANCEL
PartitionName=farm Nodes=ALL Default=YES MaxTime=INFINITE State=UP
PartitionName=urgent Nodes=ALL PriorityTier=9 State=UP
"""


def missing():
    """The first program of Slurm that this machine lacks; None: it has all, and root may run them."""
    lacks = [p for p in PROGRAMS if not shutil.which(p, path=PATH)]
    if lacks:
        return f"no {lacks[0]} (slurmctld, slurmd, slurm-client, munge)"
    return None if os.geteuid() == 0 else "node daemons need root"


ACCOUNTING = """slurmdbd
AccountingStorageHost=localhost
AccountingStoragePort={port}
AccountingStoragePass={base}/munge/socket
AccountingStorageEnforce=limits"""
ACCOUNTS_PROGRAMS = ("slurmdbd", "sacctmgr", "mariadbd", "mariadb-install-db")
SLURMDBD_CONF = """AuthType=auth/munge
AuthInfo=socket={base}/munge/socket
DbdHost=localhost
DbdPort={port}
SlurmUser=root
PidFile={base}/slurmdbd.pid
StorageType=accounting_storage/mysql
StorageHost=127.0.0.1
StoragePort={storage}
StorageUser=root
StorageLoc=accounts
"""


def lacks_accounts():
    """Why there can be no slurmdbd here; None: there can."""
    lacks = [p for p in ACCOUNTS_PROGRAMS if not shutil.which(p, path=PATH)]
    return f"no {lacks[0]} (slurmdbd, mariadb-server)" if lacks else None


# The kernel keeps the memory limits of jobs. Slurm makes and removes groups of its own.
MEMORY_GROUPS = pathlib.Path("/sys/fs/cgroup/memory")
CGROUP_CONF = """CgroupPlugin=cgroup/v1
CgroupMountpoint=/sys/fs/cgroup
CgroupAutomount=no
ConstrainRAMSpace=yes
"""


def lacks_groups():
    """Why Slurm cannot limit memory by control groups here; None: it can."""
    return None if os.access(MEMORY_GROUPS / "cgroup.procs", os.W_OK) else "no control groups of version 1 for memory"


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Cluster:
    def __init__(self, nodes=2, cpus=2, memory_mb=4000, node_timeout=300, most_jobs=10000, groups=False, accounts=None):
        """accounts: limits of each account that there is (words of sacctmgr), kept by slurmdbd on a MariaDB; None: no slurmdbd."""
        self.base = pathlib.Path(tempfile.mkdtemp(prefix="slurm."))  # short: sockets are made below it
        self.base.chmod(0o755)
        self.nodes = [f"n{i}" for i in range(nodes)]
        self.environment = {**os.environ, "PATH": PATH, "SLURM_CONF": str(self.base / "slurm.conf")}
        self.running = {}
        self.accounts_port = free_port()
        self.next_look = 0
        self.past = set()  # numbers of jobs that were forgotten
        lines = [f"NodeName={n} NodeHostname={socket.gethostname().split('.')[0]} NodeAddr=127.0.0.1 Port={free_port()}"
                 f" CPUs={cpus} RealMemory={memory_mb} State=UNKNOWN" for n in self.nodes]
        (self.base / "slurm.conf").write_text(CONF.format(
            host=socket.gethostname().split(".")[0], controller=free_port(), base=self.base,
            node_timeout=node_timeout, most_jobs=most_jobs, nodes="\n".join(lines),
            task_plugin="task/cgroup" if groups else "task/none",
            over_memory="" if groups else "JobAcctGatherParams=OverMemoryKill",
            accounting="none" if accounts is None else ACCOUNTING.format(base=self.base, port=self.accounts_port)))
        self.accounts = accounts
        if groups:
            (self.base / "cgroup.conf").write_text(CGROUP_CONF)

    def begin(self, name, *words):
        """A process in a session of its own."""
        with open(self.base / f"{name}.out", "ab") as log:
            self.running[name] = subprocess.Popen(words, env=self.environment, stdout=log, stderr=log,
                                                  stdin=subprocess.DEVNULL, start_new_session=True)

    def start(self):
        munge = self.base / "munge"
        munge.mkdir(mode=0o755)
        key = munge / "key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        self.begin("munged", "munged", "--foreground", "--force", f"--key-file={key}", f"--socket={munge}/socket",
                   f"--pid-file={munge}/pid", f"--log-file={munge}/log", f"--seed-file={munge}/seed")
        wait_until(lambda: (munge / "socket").exists(), "munged")
        (self.base / "state").mkdir()
        if self.accounts is not None:
            self.start_accounts()
        self.start_controller()
        for node in self.nodes:
            self.start_node(node)
        wait_until(self.all_are_idle, "idle nodes")
        return self

    def all_are_idle(self):
        for node in self.nodes:  # without /sys/fs/cgroup, say, there are none
            words = (self.base / f"{node}.out").read_text()
            assert self.running[node].poll() is None, f"slurmd ended: {words[-1000:]}"
        return set(self.call("sinfo", "-h", "-N", "-t", "idle", "-o", "%N").split()) == set(self.nodes)

    def start_accounts(self):
        data, storage = self.base / "accounts", free_port()
        subprocess.run(["mariadb-install-db", "--no-defaults", "--user=root", f"--datadir={data}", "--auth-root-authentication-method=normal",
                        "--skip-test-db"], env=self.environment, check=True, capture_output=True, timeout=PATIENCE_S)
        self.begin("mariadbd", "mariadbd", "--no-defaults", "--user=root", f"--datadir={data}", "--bind-address=127.0.0.1", f"--port={storage}",
                   f"--socket={data}/socket", f"--pid-file={data}/pid")
        wait_until((data / "socket").exists, "MariaDB")
        conf = self.base / "slurmdbd.conf"
        conf.write_text(SLURMDBD_CONF.format(base=self.base, port=self.accounts_port, storage=storage))
        conf.chmod(0o600)
        self.begin("slurmdbd", "slurmdbd", "-D")
        wait_until(lambda: "hexad" in self.call("sacctmgr", "-ni", "add", "cluster", "hexad"), "slurmdbd")
        for name, limits in self.accounts.items():
            self.call("sacctmgr", "-i", "add", "account", name)
            self.call("sacctmgr", "-i", "add", "user", "root", f"account={name}")
            self.call("sacctmgr", "-i", "modify", "account", name, "set", *limits)

    def start_controller(self):
        self.begin("slurmctld", "slurmctld", "-D")
        wait_until(lambda: subprocess.run(["squeue", "-h"], env=self.environment, capture_output=True).returncode == 0,
                   "the controller")

    def start_node(self, node):
        self.begin(node, "slurmd", "-D", "-N", node)

    def end(self, name, number=signal.SIGKILL):
        process = self.running.pop(name)
        process.send_signal(number)
        process.wait(PATIENCE_S)

    def call(self, *words):
        done = subprocess.run(words, env=self.environment, text=True, capture_output=True, timeout=PATIENCE_S)
        return done.stdout

    def submit(self, *options, script="exec sleep 1"):
        """A job of somebody else; its number."""
        done = subprocess.run(["sbatch", "--parsable", "--mem=10", "--output=/dev/null", "--chdir=/", *options], text=True,
                              input=f"#!/bin/sh\n{script}\n", capture_output=True, env=self.environment)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    def jobs(self, form="%j %T"):
        # squeue is expensive: tests that wait for a state call it every 0.1 s
        time.sleep(max(0, self.next_look - time.monotonic()))
        self.next_look = time.monotonic() + 0.1
        rows = [row.partition("|") for row in self.call("squeue", "-h", "-r", "--states=all", "-o", f"%F|{form}").splitlines()]
        return [words for number, _, words in rows if number not in self.past]

    def forget(self):
        """Ends all jobs; jobs() tells of later ones. Nodes and partition are as at first."""
        self.call("scancel", "--user=root", "--full", "--signal=KILL")
        self.call("scancel", "--user=root")
        wait_until(lambda: not self.call("squeue", "-h"), "the end of all jobs of Slurm")
        self.past |= set(self.jobs("%F"))
        self.call("scontrol", "update", "partition=farm", "state=UP")
        self.call("scontrol", "update", f"nodename={','.join(self.nodes)}", "state=RESUME")

    def steps(self):
        """Processes of Slurm that hold jobs (they outlive their daemon), and what they run: pid -> command line. A worker has
        another environment, and is a child of one of them."""
        seen, parents = {}, {pid: parent for pid, (parent, _, _) in processes().items()}
        for pid in parents:
            with contextlib.suppress(OSError):
                seen[pid] = [pathlib.Path(f"/proc/{pid}/{name}").read_bytes() for name in ("environ", "cmdline")]
        mark = f"SLURM_CONF={self.environment['SLURM_CONF']}".encode()

        def is_of_slurm(pid):
            return pid in seen and (mark in seen[pid][0].split(b"\0") or is_of_slurm(parents[pid]))

        return {pid: words.decode().split("\0") for pid, (_, words) in seen.items() if is_of_slurm(pid)}

    def clean_up(self):
        for name in list(self.running):
            if name != "munged":
                self.end(name)
        for pid in self.steps():
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
        if "munged" in self.running:
            self.end("munged", signal.SIGTERM)
        for node in self.nodes:
            for group in sorted(MEMORY_GROUPS.glob(f"slurm_{node}/**/"), reverse=True):
                with contextlib.suppress(OSError):
                    group.rmdir()
        shutil.rmtree(self.base)
