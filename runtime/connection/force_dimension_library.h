// SPDX-License-Identifier: Apache-2.0
// The functions of Force Dimension's SDK, found at run time in the library that the user has installed. Nothing of
// the SDK is linked or copied: the names and types below are those of its public list of functions (SDK 3.16).
// Tests: tests/runtime/connection/force_dimension_test.cpp
#pragma once

#include <string>
#include <utility>

#include "formats/base/result.h"

namespace trocar::runtime {

/// `id` is the device that dhdOpen or dhdOpenID has returned. A negative result is an error, whose text
/// error_get_last_str() returns in the same thread. Results above 0 are not errors. The result 1 means that
/// the SDK has answered from its last measurement, which is recent enough, and 2 that a motor cannot give
/// the whole force.
struct ForceDimensionLibrary {
  const char* (*error_get_last_str)();
  int (*get_device_count)();
  int (*open)();
  int (*open_id)(char index);
  int (*close)(char id);
  const char* (*get_system_name)(char id);
  int (*get_status)(int* status, char id);
  bool (*has_wrist)(char id);
  bool (*has_active_wrist)(char id);
  int (*enable_force)(unsigned char enable, char id);
  int (*get_position)(double* x_m, double* y_m, double* z_m, char id);
  int (*get_position_and_orientation_frame)(double* x_m, double* y_m, double* z_m,
                                            double (*frame)[3], char id);
  unsigned (*get_button_mask)(char id);
  int (*set_force)(double x_N, double y_N, double z_N, char id);
  int (*set_force_and_torque)(double x_N, double y_N, double z_N, double x_Nm, double y_Nm,
                              double z_Nm, char id);
};

/// Entries of the array that get_status fills. The array's length depends on the release of the SDK.
inline constexpr int kStatusReset = 3;  ///< 1: the device waits for its calibration
inline constexpr int kStatusRoom = 64;  ///< more than any release writes

/// The environment variable that names the library's file. If it is not set, the system's search path is used.
inline constexpr const char* kForceDimensionVariable = "TROCAR_FORCEDIMENSION_LIBRARY";

/// An error of the library or of a device behind it, without the device's URI.
inline Error sdk_error(std::string message) {
  return {ExitCode::kDeviceFault, std::move(message)};
}

/// Loads the library for the rest of the process. The library is never unloaded, because it starts threads, and
/// because a call that hangs would later return into unloaded code. Errors: (device fault) the library or a
/// function in it is missing; the message says what to install.
Result<ForceDimensionLibrary> load_force_dimension_library();

}  // namespace trocar::runtime
