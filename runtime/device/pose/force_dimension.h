// SPDX-License-Identifier: Apache-2.0
// The connection to a haptic device of Force Dimension (omega, delta, sigma, lambda) or to a Novint
// Falcon. It uses Force Dimension's SDK, which the user installs. Nothing of the SDK is linked or
// copied: its functions are found at run time.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "formats/base/result.h"
#include "runtime/device/pose/connected_device.h"

namespace trocar::runtime {

/// The environment variable that names the library's file. If the variable is not set, the library
/// is searched for in the system's search path.
inline constexpr const char* kForceDimensionVariable = "TROCAR_FORCEDIMENSION_LIBRARY";

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
