# SPDX-License-Identifier: Apache-2.0
"""A Slurm cluster on this machine, with a new folder that is removed at its end."""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

from errors import GET_SLURM, USAGE, WRITE, FarmError

KEEPER = pathlib.Path(__file__).with_name("keeper.py")
NODES_MAX = 64
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "scontrol")


class LocalCluster:
    """A context manager, as in `with LocalCluster(3) as cluster`. It sets SLURM_CONF of this process while the cluster runs."""

    def __init__(self, nodes, parent=None):
        self.nodes, self.parent = nodes, parent
        self.folder = None
        self.keeper = None
        self.conf_before = os.environ.get("SLURM_CONF")

    def __enter__(self):
        # Debian keeps the daemons where only root's PATH leads.
        os.environ["PATH"] = os.environ.get("PATH", "") + ":/usr/sbin:/sbin"
        missing = [name for name in PROGRAMS if shutil.which(name) is None]
        if missing:
            raise FarmError(USAGE, f"--local-cluster: {missing[0]} is not installed; {GET_SLURM} installs Slurm")
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="trocar-farm.", dir=self.parent))
        self.folder.chmod(0o755)  # munged and slurmd require it
        try:
            self.keeper = subprocess.Popen([sys.executable, "-B", KEEPER, self.folder, str(self.nodes)], stdin=subprocess.PIPE,
                                           stdout=subprocess.PIPE, text=True, start_new_session=True)
            said = self.keeper.stdout.readline().strip()
            if said != "ready":
                raise FarmError(WRITE, f"--local-cluster: {said or 'the cluster did not start'}")
        except BaseException:
            self.__exit__()
            raise
        os.environ["SLURM_CONF"] = str(self.folder / "slurm.conf")
        return self

    def __exit__(self, *_):
        if self.keeper is not None:
            self.keeper.stdin.close()
            self.keeper.wait()
        else:
            shutil.rmtree(self.folder, ignore_errors=True)
        if self.conf_before is None:
            os.environ.pop("SLURM_CONF", None)
        else:
            os.environ["SLURM_CONF"] = self.conf_before
