// SPDX-License-Identifier: Apache-2.0
// Finds how a sheet's spring network answers the tool (runtime/deformation), off the haptic thread:
// that says each tick where the tool is about to be, and takes the latest answer there is.
//
// The network is linear in the depth, so an answer is a stiffness and a point: nothing is left
// for the haptic thread to solve. `propagation` is answered with the stiffness that it settles at.
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
#include "runtime/contact/puncture.h"
#include "runtime/deformation/propagation.h"
#include "runtime/deformation/response.h"
#include "runtime/realtime/histogram.h"
#include "runtime/realtime/triple_buffer.h"

namespace trocar::runtime {

/// The sheet around the tool, with the tool's outline cut out. With the tool d deep a vertex stands
/// at z_m - d w.
struct SheetShape {
  int slice_index = 0;                            ///< AssetSlice::index
  std::uint32_t cuts = 0;                         ///< holes the sheet had
  double z_m = 0;                                 ///< of the sheet at rest
  std::vector<std::array<double, 2>> vertices_m;  ///< x, y in {B}
  std::vector<Triangle> triangles;
  std::vector<double> w;  ///< of each vertex: 1 under the tool's rim, towards 0 far from it
};

struct ResponderReport {
  std::uint64_t answers = 0, failures = 0;
  std::uint32_t calibrations = 0;  ///< by make(): one for each stiffness among the sheets
  Histogram prepare;               ///< wall time of an answer
  std::uint32_t free_nodes_max = 0, free_nodes_last = 0;
  double force_bound_max = 0, displacement_bound_max = 0;  ///< RingBounds of all answers
  std::uint32_t negative_springs_max = 0;
};

class Responder {
 public:
  /// For the tissues of sheets as from place_slices, on the asset's lattice. Some ms (a tool of
  /// many corners: some hundred) for each stiffness among them. Refused: a tool or tissue for which
  /// no membrane can be found.
  static Result<std::unique_ptr<Responder>> make(const Scene& scene,
                                                 const std::vector<Tissue>& tissue_of_sheet,
                                                 const Lattice& lattice);

  // Haptic thread.

  void ask(const ResponseRequest& request) noexcept { asked_.write(request); }
  /// False, and `response` stays as it is, if there is no newer one.
  bool latest(SheetResponse& response) noexcept { return answered_.read(response); }

  // One other thread.

  /// Answers the latest request; `sheet` gives the version of a sheet to be asked.
  void serve(const std::function<const Sheet&(std::size_t)>& sheet);
  /// The answer to one request. None if place and sheet are those of the last one, if the sheet has
  /// nothing there, or if it cannot be found (counted).
  std::optional<SheetResponse> answer(const ResponseRequest& request, const Sheet& sheet);

  // Any thread but the haptic one.

  /// Of the last answer; null if there was none.
  std::shared_ptr<const SheetShape> shape() const;

  // After the other thread has ended.

  const ResponderReport& report() const noexcept { return report_; }

 private:
  Responder() = default;

  ForceLaw law_;
  std::vector<Membrane> membrane_;  ///< of each sheet
  TripleBuffer<ResponseRequest> asked_;
  TripleBuffer<SheetResponse> answered_;
  ResponseRequest last_;
  std::uint32_t last_cuts_ = 0;
  RegionWorkspace workspace_;
  std::vector<std::uint32_t> seeds_;
  ResponderReport report_;
  mutable std::mutex shape_mutex_;
  std::shared_ptr<const SheetShape> shape_;
};

}  // namespace trocar::runtime
