# SPDX-License-Identifier: Apache-2.0
"""The configuration of a Slurm cluster on one machine, for trial and test: one slurmctld and N slurmd, each with a port of
its own and one processor to give, whatever the machine has. No cgroups, so that it runs in containers and without root."""
import contextlib
import getpass
import socket

# A requeue waits for cred_expire (120 s by default), and a dead slurmctld's tasks for SlurmdTimeout: short, since all is near.
TEMPLATE = """\
ClusterName=trocar
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/run/munge.sock,cred_expire=5
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool.%n
SlurmctldPidFile={folder}/run/slurmctld.pid
SlurmdPidFile={folder}/run/slurmd.%n.pid
SlurmctldLogFile={folder}/log/slurmctld.log
SlurmdLogFile={folder}/log/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/filetxt
JobCompLoc={folder}/log/jobcomp.log
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=5,bf_interval=5,batch_sched_delay=0
ReturnToService=2
SlurmdTimeout=5
SlurmctldTimeout=10
MessageTimeout=3
BatchStartTimeout=3
KillWait=2
MinJobAge=60
MaxArraySize=10001
MaxJobCount=20000
FirstJobId={first_job_id}
JobRequeue=1
MpiDefault=none
SwitchType=switch/none
SlurmdParameters=config_overrides
DebugFlags=NO_CONF_HASH
{nodes}
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def node_names(count):
    return [f"n{i + 1}" for i in range(count)]


def free_ports(count):
    """Ports that no process listened on just now."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]


def conf_text(folder, ports, first_job_id):
    """`ports`: the controller's, then one for each node."""
    host = socket.gethostname().split(".")[0]
    nodes = "\n".join(f"NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs=1 RealMemory=1000 State=UNKNOWN"
                      for name, port in zip(node_names(len(ports) - 1), ports[1:]))
    return TEMPLATE.format(host=host, controller_port=ports[0], user=getpass.getuser(), folder=folder, first_job_id=first_job_id,
                           nodes=nodes)
