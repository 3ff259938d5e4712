// SPDX-License-Identifier: Apache-2.0
// The prefetch worker of the force law `network`. Outside the haptic thread it computes how stiff a
// sheet's spring network (runtime/deformation) is under the tool.
//
// The forces of the network are proportional to the depth of the tool. So the haptic thread needs
// only two results: the stiffness, which is the force per depth, and the point where the force
// acts. A direct solver computes the stiffness. If the scene names the solver `propagation`
// (runtime/deformation/propagation.h), this solver computes it instead. The solver is then iterated
// until the force per depth has converged, but at most 500 times.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/contact/prefetch_worker.h"
#include "runtime/deformation/propagation.h"
#include "runtime/deformation/response.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/triple_buffer.h"

namespace trocar::runtime {

/// Figures of a session, for its summary. An answer is a stiffness that was computed for a request.
/// A failure is a request for which the solver failed.
struct PrefetchReport {
  std::uint64_t answers = 0, failures = 0;
  std::uint32_t calibrations = 0;  ///< number of calls of calibrate() (see make())
  Histogram prepare;               ///< wall times that the answers took
  /// Number of nodes of the spring network that the solver could move: maximum of all answers, and
  /// value of the last answer.
  std::uint32_t free_nodes_max = 0, free_nodes_last = 0;
  /// Bounds of the relative errors of force and displacement (RingBounds): maximum of all answers.
  double force_bound_max = 0, displacement_bound_max = 0;
  /// Number of springs of negative stiffness (RegionResponse::negative_springs): maximum
  /// of all answers.
  std::uint32_t negative_springs_max = 0;
};

class NetworkPrefetch final : public PrefetchWorker {
 public:
  /// Creates the worker. `tissue_of_sheet` has one tissue per sheet, in the order of
  /// place_slices(). `lattice`: the lattice of the asset. The function calls calibrate()
  /// (runtime/deformation/calibration.h) once for each distinct stiffness of a tissue. calibrate()
  /// finds the membrane tension and the foundation's stiffness with which a sheet has the tissue's
  /// stiffness. One call takes tens of milliseconds, or hundreds if the tool has many corners.
  /// Errors: those of calibrate().
  static Result<std::unique_ptr<NetworkPrefetch>> make(const Scene& scene,
                                                       const std::vector<Tissue>& tissue_of_sheet,
                                                       const Lattice& lattice);

  void ask(const PrefetchRequest& request) noexcept override { asked_.write(request); }
  bool latest(PrefetchedStiffness& stiffness) noexcept override {
    return answered_.read(stiffness);
  }
  void serve(const std::function<const Sheet&(std::size_t)>& sheet) override;
  /// Counts a failure of the solver in PrefetchReport::failures.
  std::optional<PrefetchedStiffness> answer(const PrefetchRequest& request,
                                            const Sheet& sheet) override;
  std::shared_ptr<const SheetShape> shape() const override;

  /// Call this on the thread that calls answer() or serve(), or after that thread has ended.
  const PrefetchReport& report() const noexcept { return report_; }

 private:
  NetworkPrefetch() = default;

  SceneForceLaw law_;
  std::vector<Membrane> membrane_;  ///< one per sheet
  TripleBuffer<PrefetchRequest> asked_;
  TripleBuffer<PrefetchedStiffness> answered_;
  PrefetchRequest last_;
  std::uint32_t last_cuts_ = 0;
  RegionWorkspace workspace_;
  std::vector<std::uint32_t> seeds_;
  PrefetchReport report_;
  mutable std::mutex shape_mutex_;
  std::shared_ptr<const SheetShape> shape_;
};

}  // namespace trocar::runtime
