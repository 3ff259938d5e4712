// SPDX-License-Identifier: Apache-2.0
// The functions of Force Dimension's SDK, found at run time in the library that the user has
// installed. Nothing of the SDK is linked or copied: the functions and types below follow the SDK's
// public list of functions (SDK 3.16). For example, get_status is the SDK's dhdGetStatus.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "formats/base/result.h"
#include "runtime/device/pose/connected_device.h"

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

// The connection to a haptic device of Force Dimension (omega, delta, sigma, lambda) or to a Novint
// Falcon. It uses Force Dimension's SDK, which the user installs (force_dimension_library.h).

struct ForceDimensionOptions {
  /// Index of the device in the SDK's list, 0 to 15; -1: the first device that is free.
  int id = -1;
  SayLine say;                 ///< called only inside open(); may be empty
  bool wants_rotation = true;  ///< measure the orientation if the device can
  bool wants_moment = true;    ///< render the moment if the device can
  /// True: open() fails if the device cannot do what wants_rotation and wants_moment ask for.
  /// False: open() succeeds all the same, and senses_rotation() and renders_moment() say which of
  /// the two wishes are fulfilled.
  bool needs_all = false;
};

/// Parses the address part of a URI `forcedimension:[ID]`: the index of a device, or empty for -1.
/// Errors: kUsage if the address has another form; the message quotes the address.
Result<int> parse_force_dimension_address(std::string_view address);

/// Positions and wrenches are in the SDK's frame, whose origin is near the middle of the workspace.
/// The sign of the orientation's quaternion is arbitrary.
///
/// As long as exchange() is called again and again, the SDK compensates the weight of the device,
/// even if the commanded forces are zero. After close() the SDK no longer compensates the weight.
/// If the SDK gives its last measurement again, the reading has the time of that measurement.
/// If the device's own protection (speed limit, button on the base, watchdog) turns the forces off,
/// exchange() cannot detect this, and the training session continues without forces.
class ForceDimension final : public PoseConnection {
 public:
  explicit ForceDimension(ForceDimensionOptions options);
  ~ForceDimension() override;

  /// Loads the library, opens the device, enables the device's forces and commands zero force.
  /// After a first success, every later call opens the same device again, whatever index it then
  /// has. ForceDimensionOptions::say receives lines about the device, such as its name. Errors, in
  /// addition to those of PoseConnection::open(): the SDK's calls do not return in time, for
  /// example because an earlier call still hangs; the device is not calibrated, so that its
  /// positions are unknown; or it lacks what needs_all demands.
  Result<void> open() override;
  /// Moments are ignored if renders_moment() is false. Errors, in addition to those of
  /// PoseConnection::exchange(): the wrench is not finite, or the SDK's calls do not
  /// return within kExchangeTimeout_s.
  Result<PoseReading> exchange(const HandleWrench& wrench) override;
  FaultDetail refused_contents() const noexcept override { return refused_; }
  /// If a call of the SDK hangs, zero force is commanded as soon as that call returns.
  void close() noexcept override;

  /// After open(): true if ForceDimensionOptions::wants_rotation is set and the device measures
  /// orientation. exchange() then returns the measured orientation.
  bool senses_rotation() const noexcept { return senses_rotation_; }
  /// After open(): true if ForceDimensionOptions::wants_moment is set and the device can render
  /// moments.
  bool renders_moment() const noexcept { return renders_moment_; }

 private:
  struct Device;  // used only on the thread of calls_
  Error fault(const std::string& message) const;

  ForceDimensionOptions options_;
  std::string uri_;
  std::shared_ptr<Device> device_;
  CallThread calls_;
  bool senses_rotation_ = false;
  bool renders_moment_ = false;
  FaultDetail refused_;  ///< of the last exchange()
};

}  // namespace trocar::runtime
