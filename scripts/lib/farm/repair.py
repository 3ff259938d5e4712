# SPDX-License-Identifier: Apache-2.0
"""Repairs what keeps tasks from running after a daemon was killed: nodes that Slurm has drained ("Duplicate jobid"), tasks that it holds
("launch failed requeued held"), and ended tasks that Slurm believes to run and that therefore occupy a slot. Only Slurm's administrator
can return a node. On its own cluster scripts/farm does so; on another one it names the node, cancels the held task and submits its chunk
again. Every user may cancel their own tasks."""
import time

import slurm

ENDED_S = 4  # longest time from a task's result to its end in Slurm


class Repair:
    def __init__(self, own, partition, say):
        self.own, self.partition, self.say = own, partition, say
        self.named = set()
        self.ended = {}  # task: when it was first found running although it has a result
        self.count = 0

    def nodes(self):
        """Returns or reports nodes that are out of service. The result is false if no node takes tasks."""
        known = slurm.nodes(self.partition)
        out = [node for node in known if node.is_out]
        for node in out:
            if self.own:
                self.count += 1
                slurm.ask("scontrol", "update", f"nodename={node.name}", "state=resume")
            elif (node.name, node.reason) not in self.named:
                self.named.add((node.name, node.reason))
                self.say(f"node {node.name} is {node.state} ({node.reason}) and takes no tasks; an administrator returns it: "
                         f"scontrol update nodename={node.name} state=resume")
        self.named = {(name, reason) for name, reason in self.named if any(n.name == name for n in out)}
        return self.own or len(out) < len(known)

    def tasks(self, tasks):
        """Releases held tasks, or cancels them and returns those that must be submitted again."""
        lost = []
        for task in tasks:
            if not task.is_held:
                continue
            self.count += 1
            if self.own:
                slurm.ask("scontrol", "release", f"{task.job}_{task.index}")
            else:
                slurm.ask("scancel", f"{task.job}_{task.index}")
                lost.append(task)
        if lost:
            self.say(f"{len(lost)} tasks were held ({lost[0].reason}); they are cancelled and submitted again")
        return lost

    def ended_unnoticed(self, tasks):
        """Cancels tasks that have a result but that Slurm still reports as running."""
        now = time.monotonic()
        self.ended = {(task.job, task.index): self.ended.get((task.job, task.index), now) for task in tasks}
        for (job, index), since in self.ended.items():
            if now - since > ENDED_S:
                self.count += 1
                slurm.ask("scancel", f"{job}_{index}")
