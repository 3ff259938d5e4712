// SPDX-License-Identifier: Apache-2.0
// The interfaces of a force law and of its prefetch worker.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/device/hand_device.h"
#include "runtime/haptics/contact_design.h"
#include "runtime/haptics/puncture.h"
#include "runtime/haptics/virtual_coupling.h"

namespace trocar::runtime {

// Interface of a prefetch worker. The worker computes a sheet's stiffness under the tool outside
// the haptic thread, for force laws whose computation takes longer than a tick. In each tick the
// haptic thread selects the sheet that the tool touches or will reach next, requests this sheet's
// stiffness at the tool's present position, and uses the latest stiffness that is ready.

/// The deformed mesh around the tool, with the tool's outline cut out. If the tip is at depth d
/// below the undeformed sheet, vertex i is at the height z_m - d w[i].
struct SheetShape {
  int slice_index = 0;                            ///< AssetSlice::index
  std::uint32_t cuts = 0;                         ///< number of holes in the sheet
  double z_m = 0;                                 ///< height of the undeformed sheet
  std::vector<std::array<double, 2>> vertices_m;  ///< x, y in {B}
  std::vector<Triangle> triangles;
  std::vector<double> w;  ///< 1 at the tool's outline, falling to 0 away from it
};

class PrefetchWorker {
 public:
  virtual ~PrefetchWorker() = default;

  // The haptic thread calls these functions. They do not lock or allocate.

  /// Makes `request` the latest request.
  virtual void ask(const PrefetchRequest& request) noexcept = 0;
  /// Reads the latest result. If there is no result that is newer than the one read last, returns
  /// false and leaves `stiffness` unchanged.
  virtual bool latest(PrefetchedStiffness& stiffness) noexcept = 0;

  // One thread, which is not the haptic thread, calls these functions.

  /// Answers the latest request, so that latest() can read the answer. `sheet(i)` must return the
  /// current version of sheet i.
  virtual void serve(const std::function<const Sheet&(std::size_t)>& sheet) = 0;
  /// Returns the stiffness for one request. Returns nothing if neither the request nor the sheet
  /// has changed since the previous call, if the tool misses the sheet, or if the solver fails.
  virtual std::optional<PrefetchedStiffness> answer(const PrefetchRequest& request,
                                                    const Sheet& sheet) = 0;

  // Any thread except the haptic thread may call this function.

  /// Shape of the sheet for the latest answer; null before the first answer.
  virtual std::shared_ptr<const SheetShape> shape() const = 0;
};

// Interface of a force law, which computes how tissue acts on the tool during a session. The
// shipped laws are `hooke` and `network` (runtime/haptics/membrane/sheet_law.h) and `cutting`
// (runtime/haptics/bone/cutting_force_law.h). A session creates one law before its loop starts
// (runtime/session/force_law_table.h). The tick uses only this interface.
//
// To add a law to the product, follow ARCHITECTURE.md, "A force law". A test needs only one
// file with the class, and one call of add_force_law(). tests/runtime/haptics/constant_layer.h is
// an example of such a file.
//
// Contract of an implementation:
//  1. update(), finish_tick(), reset_motion() and retract_distance_m() run on the haptic thread. They do
//     not allocate, lock or throw, and they take a bounded time.
//  2. The result depends only on the construction arguments and on the sequence of calls, so that a
//     replay gives the same bits.
//  3. The law multiplies wrench_plate and stored_J by SceneForceLaw::force_scale and states it in
//     tip_force(). It applies ForceLawSetup::coupling and StiffnessLimits itself; nothing outside it
//     does.
//  4. It keeps its contact stable: its factory refuses a stiffness that design_contact() refuses,
//     and estimator() returns that design's. The default estimator is for laws that render no
//     stiffness.

/// Arguments of a law's factory. `sheets` are the sheets without holes, topmost first. The
/// references and pointers are valid only during the call of the factory.
struct ForceLawSetup {
  const Scene& scene;
  const DeviceSpecification& device;
  std::span<const Sheet* const> sheets;
  double rate_Hz = 1000;
  CouplingOptions coupling;  ///< virtual coupling between plate and proxy, if the law supports it
  StiffnessLimits stiffness;

  /// Of `rate_Hz` and of the device's delay.
  LoopTiming timing() const noexcept { return {1 / rate_Hz, device.readings().delay_s}; }
};

/// Inputs of one tick.
struct ForceLawInput {
  std::span<const Sheet* const> sheets;  ///< sheets with the meshes in use, topmost first
  PrefetchedStiffness prefetched;        ///< latest result of the law's prefetch worker
  /// Pose at which the law acts: estimated, and led by the lead of ForceLaw::estimator().
  Pose T_device_plate;
  double pose_interval_s = 0;          ///< time since the previous new pose; 0: pose is not new
  PreviousPose previous;               ///< T_device_plate a tick earlier, by the estimated twist
  Twist twist_device = Twist::Zero();  ///< estimated
  Pose T_device_measured;              ///< the reading, for accounts of the plate's real work
};

/// Stiffness and threshold of a sheet at the tip, for checks before a session and for
/// `trocar-run check`. The device renders `scale` times these values.
struct TipForce {
  double stiffness_N_per_m = 0, threshold_N = 0, scale = 1;
};

/// A JSON object (`json` is its text) that a law adds to a session's summary under `key`.
struct SummarySection {
  std::string key, json;
};

class ForceLaw {
 public:
  virtual ~ForceLaw() = default;

  // The haptic thread calls these functions.

  /// Computes the wrench, the stored energy and the hole requests of one tick in the state `running`
  /// (runtime/haptics/loop/safety.h). Returns a fault if an input cannot be used.
  virtual FaultDetail update(const ForceLawInput& input, ContactOutput& output) noexcept = 0;
  /// The loop calls this in each tick in which the state is not `running`. The next update() then starts
  /// without load, velocity and friction. Holes are kept.
  virtual void reset_motion() noexcept = 0;
  /// The loop calls this at the end of every tick. The function writes the law's own columns of the
  /// recording, if the law has any, and RecordingRow::tool_m, the tip on which the tissue acts: a
  /// lead and a coupling hold it away from the tip of the tool on the plate.
  virtual void finish_tick(RecordingRow& /*row*/) noexcept {}
  /// Height by which the tip must be raised before the state `running` can begin. If the tip
  /// were not raised, the tissue would push the tool as soon as the session runs. 0: the tip
  /// need not be raised.
  virtual double retract_distance_m(std::span<const Sheet* const> sheets,
                                    const Pose& T_device_plate) const noexcept = 0;

  // These functions are called before the loop starts.

  /// The estimator that was designed for the stiffness which the law renders.
  virtual PoseEstimator estimator() const noexcept { return {}; }
  /// The law's prefetch worker, which the session runs; null: the law needs none.
  virtual PrefetchWorker* prefetch_worker() noexcept { return nullptr; }
  /// The law's lines in the output of `check`. Each line ends with a line feed.
  virtual std::string describe() const = 0;
  /// One line that says what a hand will feel of the device's readings and delay with this law, and
  /// what helps; empty: nothing.
  virtual std::string contact_warning() const { return {}; }
  /// Stiffness and threshold of the sheet with this index.
  virtual TipForce tip_force(std::size_t /*index*/, const Sheet& sheet) const {
    return {sheet.tissue.stiffness_N_per_m, sheet.tissue.threshold_N, 1};
  }
  /// Text that `check` appends to its line about a sheet, with the plate at this pose.
  virtual std::string describe_sheet(std::size_t /*index*/, const Sheet& /*sheet*/,
                                     const Pose& /*T_device_plate*/) {
    return {};
  }

  // This function is called after the loop.

  /// The law's section of a session's summary and reports. An empty key means no section.
  virtual SummarySection summary() const { return {}; }
};

}  // namespace trocar::runtime
