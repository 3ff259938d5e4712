// SPDX-License-Identifier: Apache-2.0
// Reads a curve of force over depth from a CSV file. A testing machine measures the curve while it
// pushes a tool into a tissue.
//
// The first line names the columns: `depth_mm` and `force_N`, and optionally `speed_mm_per_s` and
// `time_s`, in any order. Columns are separated by commas, semicolons or tabs; numbers have a
// decimal point. Depth grows while the tool moves in. Force is positive while the tissue resists
// the insertion, so it is usually negative during a withdrawal. A curve has one insertion, and one
// withdrawal may follow.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

inline constexpr std::size_t kMaxCurveBytes = std::size_t{16} << 20;
inline constexpr std::size_t kMaxCurveRows = 200'000;
inline constexpr std::size_t kMinCurveRows = 20;  ///< smallest number of rows of the insertion
/// Limits of the insertion's travel: its greatest minus its smallest depth.
inline constexpr double kMinTravel_mm = 1, kMaxTravel_mm = 500;
inline constexpr double kMaxCurveForce_N = 1e5;

struct CurvePoint {
  double depth_mm = 0, force_N = 0;
};

struct ForceCurve {
  std::vector<CurvePoint> insertion;  ///< the points up to the deepest one
  /// The points after the deepest one. Empty if the withdrawal is missing or shorter than 10 % of
  /// the insertion's travel.
  std::vector<CurvePoint> withdrawal;
  /// 5 % and 95 % quantile of the speeds during the insertion; both 0 if the file has no speeds.
  double low_speed_mm_per_s = 0, high_speed_mm_per_s = 0;
};

/// Parses a curve. Errors: kRefused for unknown, missing or repeated columns, a field that is not a
/// finite number, too few or too many rows, a travel below kMinTravel_mm or above kMaxTravel_mm, a
/// depth that goes back and forth, or a force that is constant or beyond kMaxCurveForce_N. The
/// message is one line with `name` and, if a single line of the file is wrong, the number of that
/// line.
Result<ForceCurve> parse_force_curve(std::string_view csv, const std::string& name);

/// Reads a file. Errors: those of parse_force_curve(); kRefused if the file cannot be read
/// or exceeds kMaxCurveBytes.
Result<ForceCurve> read_force_curve(const std::filesystem::path& file);

}  // namespace trocar::runtime
