// SPDX-License-Identifier: Apache-2.0
// Interface of a prefetch worker. The worker computes a sheet's stiffness under the tool outside
// the haptic thread, for force laws whose computation takes longer than a tick. In each tick the
// haptic thread selects the sheet that the tool touches or will reach next, requests this sheet's
// stiffness at the tool's present position, and uses the latest stiffness that is ready.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "runtime/contact/puncture.h"

namespace trocar::runtime {

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

}  // namespace trocar::runtime
