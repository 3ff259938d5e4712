// SPDX-License-Identifier: GPL-3.0-or-later
// The numbers of a batch for a monitoring system, in the text format of Prometheus,
// version 0.0.4 (https://prometheus.io/docs/instrumenting/exposition_formats).
#pragma once

#include <chrono>
#include <string>

#include "pipeline/farm/batch_run.h"

namespace trocar::farm {

/// The metrics as text. All metrics are gauges with the label `store`: the number of scans in each
/// class of BatchSummary, the size of the assets of all scans that are done, the run's duration,
/// and the time at which the run ended. The monitoring system can compute from the end time how
/// long ago the run was.
std::string metrics_text(const BatchSummary& summary, const std::string& store,
                         std::chrono::system_clock::time_point end);

}  // namespace trocar::farm
