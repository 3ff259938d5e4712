// SPDX-License-Identifier: Apache-2.0
// A device of Force Dimension (omega, delta, sigma, lambda), or a Novint Falcon, driven through Force
// Dimension's SDK, which the user installs (force_dimension_library.h).
// Tests: tests/runtime/connection/force_dimension_test.cpp
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "runtime/connection/call_thread.h"
#include "runtime/connection/pose_connection.h"

namespace trocar::runtime {

struct ForceDimensionOptions {
  int id =
      -1;  ///< index of the device, 0 to 15, as the SDK counts them; -1: the first one that is free
  SayLine say;                 ///< called only inside open(); may be empty
  bool wants_rotation = true;  ///< measure the orientation if the device can
  bool wants_moment = true;    ///< render the moment if the device can
  bool needs_all = false;      ///< open() fails if the device cannot do what is wanted of these two
};

/// Parses the address part of a URI `forcedimension:[ID]`: empty, or the index of a device. Usage errors quote it.
Result<int> parse_force_dimension_address(std::string_view address);

/// The frame is that of the SDK, with its origin near the middle of the workspace. The sign of the orientation's
/// quaternion is arbitrary.
///
/// The SDK compensates the weight of the device as long as the device is commanded, even with zero force, and
/// stops after close(). If the device's own protection (speed, the button on its base, its watchdog) turns its
/// forces off, the session continues without forces, because nothing in the exchange shows this.
class ForceDimension final : public PoseConnection {
 public:
  explicit ForceDimension(ForceDimensionOptions options);
  ~ForceDimension() override;

  /// Loads the library, opens the device, enables its forces and commands zero. Reports in one line what was
  /// found. It is also an error if a call of an earlier exchange has not returned yet.
  Result<void> open() override;
  /// Moments are ignored if renders_moment() is false. Further errors: the wrench is not finite, or a call does
  /// not return within kExchangeTimeout_s.
  Result<PoseReading> exchange(const HandleWrench& wrench) override;
  /// If a call hangs, the device is set to zero force as soon as that call returns.
  void close() noexcept override;

  /// True after open() if exchange() returns a measured orientation.
  bool senses_rotation() const noexcept { return senses_rotation_; }
  /// True after open() if the device renders the moment of exchange().
  bool renders_moment() const noexcept { return renders_moment_; }

 private:
  struct Device;  // used by the calls' thread alone
  Error fault(const std::string& message) const;

  ForceDimensionOptions options_;
  std::string uri_;
  std::shared_ptr<Device> device_;
  CallThread calls_;
  bool senses_rotation_ = false;
  bool renders_moment_ = false;
};

}  // namespace trocar::runtime
