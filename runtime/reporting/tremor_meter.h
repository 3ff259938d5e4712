// SPDX-License-Identifier: Apache-2.0
// Measures the tremor of the tip (definition 5 of session_figures.h).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/reporting/session_figures.h"
#include "runtime/reporting/vector3.h"

namespace trocar::runtime {

class TremorMeter {
 public:
  TremorMeter(const Scene& scene, double rate_Hz);
  /// Call this for each counted row (definition 1 of session_figures.h). Filters the tip's
  /// position, and adds the squares of the output to the sums in `figures`.
  void observe(const RecordingRow& row, SessionFigures& figures);
  /// Call this for each row that is not counted. Resets the filters before the next row.
  void restart() noexcept { filtered_ = 0; }

 private:
  /// One filter of the second order, for three coordinates.
  struct Filter {
    std::array<double, 3> b{}, a{};
    std::array<Vector3, 2> x{}, y{};
    Vector3 pass(const Vector3& in) noexcept;
  };
  Eigen::Vector3d axis_plate_;    ///< up the shaft
  std::array<Filter, 2> filter_;  ///< the high-pass, then the low-pass
  Vector3 origin_{};              ///< position of the tip in the first row after a reset
  // filtered_: number of rows since the last reset. settle_ticks_: number of rows that are left out
  // of the sums after a reset.
  std::uint64_t filtered_ = 0, settle_ticks_ = 0;
};

}  // namespace trocar::runtime
