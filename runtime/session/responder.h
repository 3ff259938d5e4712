// SPDX-License-Identifier: Apache-2.0
// Computes the response of a sheet's spring network to the tool (runtime/deformation) outside the
// haptic thread. The haptic thread requests a response each tick for the place that the tool is
// about to reach, and uses the latest response that is ready.
//
// The network is linear in the depth, so a response is a stiffness and a point of action: the
// haptic thread solves nothing. For the solver `propagation` it is the stiffness at which
// propagation settles.
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

/// The sheet around the tool, with the tool's outline cut out. With the tool at depth d a vertex
/// has the height z_m - d w.
struct SheetShape {
  int slice_index = 0;                            ///< AssetSlice::index
  std::uint32_t cuts = 0;                         ///< holes in the sheet
  double z_m = 0;                                 ///< of the sheet at rest
  std::vector<std::array<double, 2>> vertices_m;  ///< x, y in {B}
  std::vector<Triangle> triangles;
  std::vector<double> w;  ///< of each vertex: 1 at the tool's outline, towards 0 far from it
};

struct ResponderReport {
  std::uint64_t answers = 0, failures = 0;
  std::uint32_t calibrations = 0;  ///< by make(): one per different stiffness of the sheets
  Histogram prepare;               ///< wall time of an answer
  std::uint32_t free_nodes_max = 0, free_nodes_last = 0;
  double force_bound_max = 0, displacement_bound_max = 0;  ///< largest RingBounds of the answers
  std::uint32_t negative_springs_max = 0;
};

class Responder {
 public:
  /// For the tissues of sheets as from place_slices, on the asset's lattice. Takes some ms for each
  /// different stiffness, with a tool of many corners some hundred ms. Refused: a tool or tissue
  /// for which calibration finds no membrane.
  static Result<std::unique_ptr<Responder>> make(const Scene& scene,
                                                 const std::vector<Tissue>& tissue_of_sheet,
                                                 const Lattice& lattice);

  // Haptic thread.

  void ask(const ResponseRequest& request) noexcept { asked_.write(request); }
  /// False, and `response` is unchanged, if there is no newer one.
  bool latest(SheetResponse& response) noexcept { return answered_.read(response); }

  // One other thread.

  /// Answers the latest request; `sheet` returns the version of a sheet to use.
  void serve(const std::function<const Sheet&(std::size_t)>& sheet);
  /// The response to one request. None if place and sheet are those of the previous one, if there
  /// is no material under the tool, or if the solver fails (counted in ResponderReport::failures).
  std::optional<SheetResponse> answer(const ResponseRequest& request, const Sheet& sheet);

  // Any thread but the haptic one.

  /// Of the latest answer; null before the first.
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
