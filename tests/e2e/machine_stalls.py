# SPDX-License-Identifier: Apache-2.0
"""How late this machine wakes a program that only sleeps, at the highest realtime priority if that is granted.

No machine of the tests guarantees realtime: a virtual one may stand still for tens of ms, longer than a drive's watchdog waits. What
a standing machine explains is judged only where the machine was on time."""
import json
import os
import signal
import subprocess
import sys
import time

PERIOD_S = 0.002
STALL_S = 0.005
MOST_STALLS_PER_S = 0.1  # of a machine that is on time


class MachineStalls:
    """`with MachineStalls() as machine:` watches the machine meanwhile; afterwards the fields have values."""

    def __enter__(self):
        self.process = subprocess.Popen([sys.executable, "-B", __file__], stdout=subprocess.PIPE, text=True)
        self.process.stdout.readline()  # it has begun
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGTERM)
        told = json.loads(self.process.communicate(timeout=30)[0])
        self.p99_s, self.worst_s, self.stalls_per_s = told["p99_s"], told["worst_s"], told["stalls_per_s"]
        self.is_on_time = self.stalls_per_s <= MOST_STALLS_PER_S


    def __str__(self):
        return (f"this machine wakes a sleeping program late: p99 {1e3 * self.p99_s:.2f} ms, worst {1e3 * self.worst_s:.0f} ms, "
                f"{self.stalls_per_s:.2f} times a second by more than {1e3 * STALL_S:.0f} ms")


def watch():
    is_over = []
    signal.signal(signal.SIGTERM, lambda *_: is_over.append(True))
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_max(os.SCHED_FIFO)))
    except PermissionError:
        pass
    print("begun", flush=True)
    begin = due = time.monotonic()
    late = []
    while not is_over or not late:
        due = max(due + PERIOD_S, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))
        late.append(time.monotonic() - due)
    end = time.monotonic()
    late.sort()
    print(json.dumps({"p99_s": late[int(0.99 * (len(late) - 1))], "worst_s": late[-1],
                      "stalls_per_s": sum(l > STALL_S for l in late) / (end - begin)}))


if __name__ == "__main__":
    watch()
