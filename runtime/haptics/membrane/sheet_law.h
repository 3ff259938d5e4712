// SPDX-License-Identifier: Apache-2.0
// The force laws `hooke` and `network`, and the prefetch worker of `network`.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/haptics/contact_design.h"
#include "runtime/haptics/force_law.h"
#include "runtime/haptics/membrane/region.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/queues.h"

namespace trocar::runtime {

// Finds the two constants of a sheet with which it has a given stiffness K under the tool. The
// constants are the membrane tension T (force per length) and the stiffness f per area of the
// Winkler foundation, which consists of a spring between each node and a fixed ground (network.h).
// The sheet has no hole, and the tool is far from any edge. The decay length lambda = sqrt(T / f),
// over which a displacement decays, is given for the continuum.
//
// The mesh of a sheet is stiffer than the continuum. The excess stiffness arises mostly along the
// tool's outline and at its corners. It is nearly the same at every position of the tool: 4 to 5 %
// of K with the default grading (triangle sizes, region.h), with a spread of 0.3 %
// (tests/runtime/haptics/membrane/deformation_accuracy_test.cpp). The excess comes from the springs
// along the edges of the mesh, which represent the membrane, and not from the foundation. (Under a
// tool that covers the whole sheet, only the foundation acts, and the stiffness is exactly f times
// the area.) Therefore the calibration corrects only T:
//  1. T and f are computed from the exact solution of the continuum for K and lambda (network.h).
//  2. T is lowered until the mesh of a very large sheet has the stiffness K on average over twelve
//     positions of the tool. The stiffness f is kept.
// Step 2 lowers T by 5 to 8 %, and thereby shortens lambda by 2 to 4 %, if the given lambda is at
// least 1.5 circumradii of the tool.

struct Calibration {
  Membrane membrane;  ///< calibrated T and f
  double excess = 0;  ///< mean excess of the mesh's stiffness before T is lowered, divided by K
  double spread = 0;  ///< largest relative difference of one position's stiffness from the mean
};

/// Finds T and f. K is `stiffness_N_per_m`, and lambda of the exact solution is `decay_length_m`.
/// `tool`: outline of the upright tool on the lattice, at any position. If grading.graded is false,
/// a region keeps the triangles of the session's sheet. The excess then depends on the position of
/// the tool and is not known in advance, so the function returns T and f of the exact solution.
/// Otherwise the function takes about 30 ms, because twelve regions are meshed and each region is
/// solved seven times. Errors: kRefused if the stiffness or the decay length is not positive, if
/// the decay length exceeds 2^26 steps, or if the outline is not a simple polygon or is too large
/// for the lattice; kBug if a region cannot be solved.
Result<Calibration> calibrate(double stiffness_N_per_m, double decay_length_m, const Ring& tool,
                              const Lattice& lattice, const Grading& grading = {});

// Computes the response of a sheet to the tool at one position: the stiffness under the tool, the
// point where the force acts, and the shape of the sheet. Usually only a region of the sheet around
// the tool is computed, so the response also has bounds on the errors of stiffness and shape. A
// worker computes the response in advance. The force is linear in the depth, so a haptic tick only
// multiplies the stiffness by the depth.

struct ResponseOptions {
  /// If positive, the radius of the region is chosen so that both bounds of RingBounds are
  /// at most this value, and region.radius_m is ignored. If 0, region.radius_m is used,
  /// whatever the bounds.
  double error_bound = 0.01;
  RegionOptions region;
};

/// The numbers of a response.
struct RegionResponse {
  double stiffness_N_per_m = 0;  ///< force on the tool per depth; 0: the tool misses the sheet
  /// Point in the slice plane where the total force on the tool acts, in lattice
  /// steps (not rounded).
  Eigen::Vector2d centre_steps = Eigen::Vector2d::Zero();
  double radius_m = 0;  ///< radius of the region; infinite if it is the whole sheet
  RingBounds bounds;    ///< `force` is relative to stiffness_N_per_m
  std::uint32_t nodes = 0, free_nodes = 0;  ///< number of all nodes, and of the free ones (kFree)
  std::uint32_t negative_springs = 0;       ///< number of negative springs at free nodes
};

/// Mesh, network, solution and response for one position of the tool.
struct Region {
  RegionMesh mesh;
  Network network;
  LocalSolution solution;  ///< solution.w: the shape for depth 1, for the display
  RegionResponse response;
};

/// Computes the response. `sheet`, `seeds`, `tool`, `lattice` and `workspace` are as for
/// make_region(). Allocates. Takes about 300 us for 200 free nodes. Errors: those of make_region();
/// also kBug if the region cannot be solved.
Result<Region> prepare_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                              const Ring& tool, const Lattice& lattice, const Membrane& membrane,
                              const ResponseOptions& options, RegionWorkspace& workspace);

// The prefetch worker of the force law `network`. Outside the haptic thread it computes how stiff a
// sheet's spring network (runtime/haptics/membrane) is under the tool.
//
// The forces of the network are proportional to the depth of the tool. So the haptic thread needs
// only two results: the stiffness, which is the force per depth, and the point where the force
// acts. A direct solver computes the stiffness. If the scene names the solver `propagation`
// (runtime/haptics/membrane/region.h), this solver computes it instead. The solver is then iterated
// until the force per depth has converged, but at most 500 times.

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
  /// (above) once for each distinct stiffness of a tissue. calibrate()
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

// The two force laws that treat each slice as a separate elastic sheet. With `hooke`, the stiffness
// of a sheet is the tissue's spring constant. With `network`, the stiffness is that of the sheet's
// spring network under the tool, and a prefetch worker computes it. In all other respects the two
// laws are the same: runtime/haptics/puncture.h defines contact and puncture, and a virtual
// coupling (runtime/haptics/virtual_coupling.h) can connect the tool to the plate.

/// The rule for stiffness on the stiffest contact that the sheets can give: the stiffest sheet,
/// with the dry friction and the rims of the holes in all sheets above it, in series with the
/// coupling. Errors: those of design_contact().
Result<ContactDesign> design_sheets(const ForceLawSetup& setup);

/// The force law `hooke`, and the common part of `hooke` and `network`.
class SheetLaw : public ForceLaw {
 public:
  /// `force_scale`: SceneForceLaw::force_scale.
  explicit SheetLaw(const ContactModel& model, const CouplingOptions& coupling = {},
                    double force_scale = 1, const ContactDesign& design = {})
      : model_(model), coupling_options_(coupling), force_scale_(force_scale), design_(design) {}

  FaultDetail update(const ForceLawInput& input, ContactOutput& output) noexcept override;
  void reset_motion() noexcept override;
  void finish_tick(RecordingRow& row) noexcept override;
  double retract_distance_m(std::span<const Sheet* const> sheets,
                            const Pose& T_device_plate) const noexcept override;
  std::string describe() const override {
    return "force law  hooke\n" + runtime::describe(design_);
  }
  PoseEstimator estimator() const noexcept override { return design_.estimator; }
  std::string contact_warning() const override { return runtime::contact_warning(design_); }
  TipForce tip_force(std::size_t /*index*/, const Sheet& sheet) const override {
    return {sheet.tissue.stiffness_N_per_m, sheet.tissue.threshold_N, force_scale_};
  }

  ContactModel& model() noexcept { return model_; }
  const ContactDesign& design() const noexcept { return design_; }
  CouplingOptions& coupling_options() noexcept { return coupling_options_; }
  ContactState& contact() noexcept { return contact_; }
  const ContactState& contact() const noexcept { return contact_; }

 private:
  ContactModel model_;
  CouplingOptions coupling_options_;
  double force_scale_;
  ContactDesign design_;
  ContactState contact_;
  CouplingState coupling_;
  /// Tip on which the tissue acted in the last update(); nullopt after reset_motion().
  std::optional<Eigen::Vector3d> tip_m_;
  double last_force_N_ = 0;              ///< tip force in the previous tick
  std::int32_t last_active_sheet_ = -1;  ///< index of the sheet that exerted last_force_N_
};

/// The force law `network`.
class NetworkLaw final : public SheetLaw {
 public:
  NetworkLaw(const ContactModel& model, const CouplingOptions& coupling, const SceneForceLaw& law,
             std::unique_ptr<NetworkPrefetch> prefetch, const ContactDesign& design = {})
      : SheetLaw(model, coupling, law.force_scale, design),
        law_(law),
        prefetch_(std::move(prefetch)) {}

  PrefetchWorker* prefetch_worker() noexcept override { return prefetch_.get(); }
  std::string describe() const override;
  std::string describe_sheet(std::size_t index, const Sheet& sheet,
                             const Pose& T_device_plate) override;
  SummarySection summary() const override;

 private:
  SceneForceLaw law_;
  std::unique_ptr<NetworkPrefetch> prefetch_;
};

/// Errors of both: those of design_sheets(); of the second, those of NetworkPrefetch::make().
Result<std::unique_ptr<ForceLaw>> make_hooke_law(const ForceLawSetup& setup);

Result<std::unique_ptr<ForceLaw>> make_network_law(const ForceLawSetup& setup);

}  // namespace trocar::runtime
