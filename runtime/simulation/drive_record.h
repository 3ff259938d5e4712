// SPDX-License-Identifier: Apache-2.0
// Writes a drive's steps as CSV. The first line names every column with its unit. Each number has
// the fewest digits that give the same value when read again.
#pragma once

#include <span>
#include <string>

#include "runtime/simulation/drive.h"

namespace trocar::runtime {

/// Columns: session,t_s,mode,motor_faults,fault,command_taken,commanded_max_Nm,applied_max_Nm,
/// packets_refused,tool_x_m,tool_y_m,tool_z_m,tool_x_m_per_s,tool_y_m_per_s,tool_z_m_per_s. The
/// mode is ready, torque, watchdog or emergency_stop. The last six columns are the exact position
/// and velocity of the tool's tip in {B}, as the simulation knows them. The other columns are the
/// members of DriveStep with the same names.
std::string to_csv(std::span<const DriveStep> steps);

}  // namespace trocar::runtime
