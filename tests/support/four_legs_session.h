// SPDX-License-Identifier: Apache-2.0
// Sessions of the four-legged device, with the encoders and motors of a test.
#pragma once

#include <functional>
#include <utility>

#include "runtime/device/four_legs/four_legs.h"
#include "runtime/session/session.h"

namespace trocar::test {

inline Result<runtime::SessionWorkers> make_workers(
    const Scene& scene, const runtime::Remesher& remesher, const runtime::SessionOptions& options,
    const DeviceDescription& description = default_device_description()) {
  const runtime::FourLegsSpecification specification(description);
  return runtime::make_workers(scene, specification, remesher, options);
}

}  // namespace trocar::test

namespace trocar::runtime {

inline SessionResult run_session(const Scene& scene, const DeviceDescription& description,
                                 Remesher& remesher, Device& device,
                                 const std::function<void(double dt_s)>& advance,
                                 const SessionOptions& options, SessionWorkers workers) {
  FourLegs four_legs(description, device);
  return run_session(scene, remesher, four_legs, advance, options, std::move(workers));
}

inline Result<SessionResult> run_session(const Scene& scene, const DeviceDescription& description,
                                         Remesher& remesher, Device& device,
                                         const std::function<void(double dt_s)>& advance,
                                         const SessionOptions& options,
                                         const MechanismLimits& limits = {}) {
  FourLegs four_legs(description, device, limits);
  return run_session(scene, remesher, four_legs, advance, options);
}

}  // namespace trocar::runtime
