// SPDX-License-Identifier: Apache-2.0
// The observers and workers of a session. Creating them takes longer than a drive waits for its
// first tick, so they are created before the link is opened.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/contact/force_law.h"
#include "runtime/device/hand_device.h"
#include "runtime/session/session_options.h"
#include "runtime/telemetry/black_box.h"
#include "runtime/telemetry/frame_display.h"
#include "runtime/telemetry/operator_messages.h"
#include "runtime/telemetry/recorder.h"
#include "runtime/telemetry/session_publisher.h"
#include "runtime/telemetry/tick_feed.h"
#include "runtime/workers/remesher.h"

namespace trocar::runtime {

/// Each member exists only if the options need it. Workers come first, because observers use them.
struct SessionWorkers {
  std::shared_ptr<ForceLaw> law;        ///< always exists
  std::unique_ptr<Recorder> recorder;   ///< SessionOptions::record
  std::unique_ptr<BlackBox> black_box;  ///< SessionOptions::black_box
  std::unique_ptr<OperatorMessages> messages;
  std::unique_ptr<FrameDisplay> frames;
  std::unique_ptr<SessionPublisher> publisher;  ///< SessionOptions::telemetry
  std::unique_ptr<TickFeed> tick_feed;          ///< SessionOptions::on_tick

  /// Returns the observers that exist, in the order in which they get a tick.
  std::vector<TickObserver*> observers() const;
};

/// Creates the workers and observers. Errors: (unwritable) the recording or the folder of the black
/// boxes cannot be written; (refused) the factory of the force law refuses the scene. Later
/// failures are in the session's report.
Result<SessionWorkers> make_workers(const Scene& scene, const DeviceSpecification& device,
                                    const Remesher& remesher, const SessionOptions& options);

}  // namespace trocar::runtime
