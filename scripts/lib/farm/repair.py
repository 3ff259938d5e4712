# SPDX-License-Identifier: Apache-2.0
"""What keeps tasks from running after a daemon was killed: nodes that Slurm has drained ("Duplicate jobid"), tasks that it holds
("launch failed requeued held"), and tasks that have ended without its notice and so take a slot. Returning a node needs Slurm's
administrator: on a cluster of its own scripts/farm does it; on another one it names the node, cancels the held task and submits
its chunk again. Everybody may cancel a task of their own that has ended."""
import time

import slurm

ENDED_S = 4  # from a task's result to its end by Slurm; a task ends as soon as its result is there


class Repair:
    def __init__(self, own, partition, say):
        self.own, self.partition, self.say = own, partition, say
        self.named = set()
        self.ended = {}  # task: when it was first seen to run although its result is there
        self.count = 0

    def nodes(self):
        """False if no node takes tasks."""
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
        """Of those that are held, the ones that can only be submitted again."""
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
        """`tasks` run, by Slurm, and have a result."""
        now = time.monotonic()
        self.ended = {(task.job, task.index): self.ended.get((task.job, task.index), now) for task in tasks}
        for (job, index), since in self.ended.items():
            if now - since > ENDED_S:
                self.count += 1
                slurm.ask("scancel", f"{job}_{index}")
