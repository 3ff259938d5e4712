// SPDX-License-Identifier: Apache-2.0
// The body of a session by the force law `cutting`, on its device.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "formats/session/device_description.h"
#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"
#include "runtime/cutting/device_coupling.h"

namespace trocar::runtime {

struct SessionBody {
  std::shared_ptr<const Body> body;  ///< with the coupling as the device allows
  DeviceCoupling coupling;
};

/// The device is judged with the tip on the topmost sheet, over the anchor. Refused, naming the
/// asset: as make_body().
Result<SessionBody> make_session_body(const Scene& scene, const DeviceDescription& device,
                                      std::span<const Sheet* const> sheets, double rate_Hz);

/// Lines, each with its line feed: slabs, coupling, and what is assumed or not used.
std::string describe(const Scene& scene, const SessionBody& body,
                     std::span<const Sheet* const> sheets);

}  // namespace trocar::runtime
