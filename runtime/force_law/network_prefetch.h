// SPDX-License-Identifier: Apache-2.0
// The prefetch worker of the force law `network`. It computes the stiffness of a sheet's spring network
// (runtime/deformation) under the tool, outside the haptic thread.
//
// The forces of the network are proportional to the depth of the tool. So a stiffness and the point
// where the force acts fully describe the response to the tool, and the haptic thread need not
// solve equations. If the scene names the solver `propagation` (runtime/deformation/propagation.h),
// the stiffness is the force per depth to which this solver converges.
// Tests: tests/runtime/session/network_session_test.cpp
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

struct PrefetchReport {
  std::uint64_t answers = 0, failures = 0;
  std::uint32_t calibrations = 0;  ///< number of distinct stiffnesses among the sheets
  Histogram prepare;               ///< wall times that the answers took
  std::uint32_t free_nodes_max = 0, free_nodes_last = 0;
  /// Largest error bounds (RingBounds) of all answers.
  double force_bound_max = 0, displacement_bound_max = 0;
  std::uint32_t negative_springs_max = 0;
};

class NetworkPrefetch final : public PrefetchWorker {
 public:
  /// Creates the worker. `tissue_of_sheet` has one tissue per sheet, in the order of
  /// place_slices(). `lattice`: the lattice of the asset. The call takes some milliseconds for each
  /// distinct stiffness, or some hundred milliseconds if the tool has many corners. Errors:
  /// kRefused if, for one of the tissues and this tool, no membrane tension and foundation
  /// stiffness give the tissue's stiffness (runtime/deformation/calibration.h).
  static Result<std::unique_ptr<NetworkPrefetch>> make(const Scene& scene,
                                                       const std::vector<Tissue>& tissue_of_sheet,
                                                       const Lattice& lattice);

  void ask(const PrefetchRequest& request) noexcept override { asked_.write(request); }
  bool latest(PrefetchedStiffness& stiffness) noexcept override {
    return answered_.read(stiffness);
  }
  void serve(const std::function<const Sheet&(std::size_t)>& sheet) override;
  /// If the solver fails, also increases PrefetchReport::failures.
  std::optional<PrefetchedStiffness> answer(const PrefetchRequest& request,
                                            const Sheet& sheet) override;
  std::shared_ptr<const SheetShape> shape() const override;

  /// Call this on the thread that calls answer(), or after that thread has ended.
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
