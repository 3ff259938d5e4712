// SPDX-License-Identifier: Apache-2.0
// The observers and workers of a session. The program creates them before it opens the link to a
// drive (the electronics of a device). The reason is that a drive waits only a short time for the
// first tick, and creating the workers takes longer.
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

/// The comment of each observer names an option. If this option is not set, the observer is null.
/// Members are destroyed in reverse order: the force law last, because the observers use its prefetch
/// worker, and the recorder after the publisher, which reads it.
struct SessionWorkers {
  std::shared_ptr<ForceLaw> law;                ///< never null
  std::unique_ptr<Recorder> recorder;           ///< SessionOptions::record
  std::unique_ptr<BlackBox> black_box;          ///< SessionOptions::black_box
  std::unique_ptr<OperatorMessages> messages;   ///< SessionOptions::on_message
  std::unique_ptr<FrameDisplay> frames;         ///< SessionOptions::on_frame
  std::unique_ptr<SessionPublisher> publisher;  ///< SessionOptions::telemetry
  std::unique_ptr<TickFeed> tick_feed;          ///< SessionOptions::on_tick

  /// Returns the observers that are not null, in the order in which the session calls them.
  std::vector<TickObserver*> observers() const;
};

/// Creates the workers and observers. Errors: kUnwritable if the recording, the folder of the black
/// boxes or the telemetry cannot be written; kRefused if the force law refuses the scene. Later
/// failures, during the session, are reported in SessionResult.
Result<SessionWorkers> make_workers(const Scene& scene, const DeviceSpecification& device,
                                    const Remesher& remesher, const SessionOptions& options);

}  // namespace trocar::runtime
