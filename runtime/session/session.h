// SPDX-License-Identifier: Apache-2.0
// A session runs the haptic loop with a scene and a device, in real or virtual time, until all its
// ticks are done, it is stopped, or a fault ends it. Worker threads prepare meshes and stiffness
// for the loop; observers record and show the ticks.
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

/// Runs a session and returns its result. After each tick, the thread that runs the ticks calls
/// `advance(dt_s)`, in which a simulated device advances its time. After the last tick, zero
/// torques are written before the other threads end. `workers`: the result of make_workers() for
/// the same scene, device, remesher and options.
SessionResult run_session(const Scene& scene, Remesher& remesher, HandDevice& device,
                          const std::function<void(double dt_s)>& advance,
                          const SessionOptions& options, SessionWorkers workers);

/// Creates the workers and then runs a session like the function above. Errors: those of
/// make_workers(). Do not use this function for a drive (the electronics of a device) behind a
/// link: such a drive ends the session if the first tick is late, and creating workers takes time.
Result<SessionResult> run_session(const Scene& scene, Remesher& remesher, HandDevice& device,
                                  const std::function<void(double dt_s)>& advance,
                                  const SessionOptions& options);

}  // namespace trocar::runtime
