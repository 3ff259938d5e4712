// SPDX-License-Identifier: Apache-2.0
// A drive's steps as CSV: a header that names every column and its unit, numbers in shortest
// round-trip form.
#pragma once

#include <span>
#include <string>

#include "runtime/simulation/drive.h"

namespace trocar::runtime {

/// Columns: session,t_s,mode,motor_faults,fault,command_taken,commanded_max_Nm,applied_max_Nm,
/// packets_refused. Mode is ready, torque, watchdog or emergency_stop.
std::string to_csv(std::span<const DriveStep> steps);

}  // namespace trocar::runtime
