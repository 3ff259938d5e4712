// SPDX-License-Identifier: Apache-2.0
// Interface of the worker that computes a sheet's stiffness at the tool outside the haptic thread, for
// force laws that need longer than a tick for it. In each tick the haptic thread requests the stiffness
// for the tool's present position in the sheet that it touches or will reach next, and uses the latest
// stiffness that is ready.
// Tests: tests/runtime/session/network_session_test.cpp
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "runtime/contact/puncture.h"

namespace trocar::runtime {

/// The mesh around the tool, with the tool's outline cut out. If the tool is at depth d below the
/// sheet, vertex i is at the height z_m - d w[i].
struct SheetShape {
  int slice_index = 0;                            ///< AssetSlice::index
  std::uint32_t cuts = 0;                         ///< number of holes in the sheet
  double z_m = 0;                                 ///< height of the sheet at rest
  std::vector<std::array<double, 2>> vertices_m;  ///< x, y in {B}
  std::vector<Triangle> triangles;
  std::vector<double> w;  ///< 1 at the tool's outline, falling to 0 away from it
};

class PrefetchWorker {
 public:
  virtual ~PrefetchWorker() = default;

  // The haptic thread calls these functions. They do not lock or allocate.

  virtual void ask(const PrefetchRequest& request) noexcept = 0;
  /// Returns false and leaves `stiffness` unchanged if there is no newer result.
  virtual bool latest(PrefetchedStiffness& stiffness) noexcept = 0;

  // One other thread calls these functions.

  /// Answers the latest request. `sheet(i)` must return the current version of sheet i.
  virtual void serve(const std::function<const Sheet&(std::size_t)>& sheet) = 0;
  /// Returns the stiffness for one request. Returns none if request and sheet equal the previous ones,
  /// if the tool misses the sheet, or if the solver fails.
  virtual std::optional<PrefetchedStiffness> answer(const PrefetchRequest& request,
                                                    const Sheet& sheet) = 0;

  // Any thread except the haptic thread may call this function.

  /// Shape of the sheet for the latest answer; null before the first answer.
  virtual std::shared_ptr<const SheetShape> shape() const = 0;
};

}  // namespace trocar::runtime
