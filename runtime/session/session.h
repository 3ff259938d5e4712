// SPDX-License-Identifier: Apache-2.0
// A session: runs the haptic loop over a scene for the scene's duration, in real or virtual time,
// with worker threads and observers, and reports what happened.
// Tests: tests/runtime/session/session_test.cpp
#pragma once

#include <functional>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/device/hand_device.h"
#include "runtime/session/session_options.h"
#include "runtime/session/session_statistics.h"
#include "runtime/session/session_workers.h"
#include "runtime/workers/remesher.h"

namespace trocar::runtime {

/// Runs a session. `advance(dt_s)` is called after each tick, on the thread of the ticks, to
/// advance a simulated device. At the end zero torques are written first; then the other threads
/// end. `workers`: result of make_workers() for the same scene, device, remesher and options.
SessionResult run_session(const Scene& scene, Remesher& remesher, HandDevice& device,
                          const std::function<void(double dt_s)>& advance,
                          const SessionOptions& options, SessionWorkers workers);

/// Like the function above, but creates the workers itself. Errors: those of make_workers(). Do not
/// use this function for a drive (the electronics of a device) behind a link. Creating the workers
/// takes time, and such a drive ends the session if the first tick is late.
Result<SessionResult> run_session(const Scene& scene, Remesher& remesher, HandDevice& device,
                                  const std::function<void(double dt_s)>& advance,
                                  const SessionOptions& options);

}  // namespace trocar::runtime
