// SPDX-License-Identifier: GPL-3.0-or-later
// Places at which a test can kill or stop a process. The environment variable TROCAR_BATCH_FAULT is
// WHO:WHERE or WHO:WHERE:stop. WHO: `worker` (the process of a scan), `batch` (its parent), or
// `both` (a worker that first kills its parent). WHERE: a number k, the k-th place that the
// process comes to, from 1; or the name of a place, when it first comes to it. The process is
// killed by SIGKILL, or with `stop` stopped by SIGSTOP. Without the variable nothing happens.
#pragma once

namespace trocar::farm {

enum class ProcessRole { kBatch, kWorker };

/// To be called by a worker after fork(): its places are counted from 1.
void take_role(ProcessRole role);

void fault_point(const char* name);

}  // namespace trocar::farm
