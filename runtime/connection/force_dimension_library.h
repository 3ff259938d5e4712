// SPDX-License-Identifier: Apache-2.0
// The functions of Force Dimension's SDK, found at run time in the library that the user has
// installed. Nothing of the SDK is linked or copied: the functions and types below follow the SDK's
// public list of functions (SDK 3.16). For example, get_status is the SDK's dhdGetStatus.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "formats/base/result.h"

namespace trocar::runtime {

/// The SDK's functions. `id` is the number of a device that open() or open_id() has returned. A
/// negative result is an error. error_get_last_str(), called in the same thread, then returns
/// the error's text. Results above 0 are not errors. A function that measures returns
/// kSameMeasurement if the SDK gave its last measurement again, because that measurement is recent
/// enough. A function that sets forces returns 2 if a motor cannot give the whole force.
struct ForceDimensionLibrary {
  const char* (*error_get_last_str)();
  int (*get_device_count)();
  int (*open)();
  int (*open_id)(char index);
  int (*close)(char id);
  const char* (*get_system_name)(char id);
  int (*get_serial_number)(std::uint16_t* number, char id);  ///< null if the library has none
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

/// The result of a function that measures if the SDK gave its last measurement again.
inline constexpr int kSameMeasurement = 1;
/// Index of the entry for calibration in the array of get_status(): 0 if the device is calibrated.
inline constexpr int kStatusReset = 3;
/// Length of the array for get_status(), which is more than any release of the SDK fills.
inline constexpr int kStatusLength = 64;

/// The environment variable that names the library's file. If the variable is not set, the library
/// is searched for in the system's search path.
inline constexpr const char* kForceDimensionVariable = "TROCAR_FORCEDIMENSION_LIBRARY";

/// Returns an error of the library or of a device, without the device's URI, which the caller adds.
inline Error sdk_error(std::string message) {
  return {ExitCode::kDeviceFault, std::move(message)};
}

/// Loads the library for the rest of the process. The library is never unloaded, because it starts
/// threads, and because a call that hangs would later return into unloaded code. Errors:
/// kDeviceFault if the library or one of its functions is missing, or if the library cannot be
/// loaded. The message says what to install or what is wrong.
Result<ForceDimensionLibrary> load_force_dimension_library();

}  // namespace trocar::runtime
