// SPDX-License-Identifier: Apache-2.0
// Published forces of tools in bone and soft tissue (published_forces.json) beside those of the cutting law. A
// prediction is a distribution: the inputs that a source does not give are drawn from published spreads, or from
// spreads that are assumed and named. One constant is fitted, on the one row that says so.
//
// A row is a hit if the 5 to 95 % band of its prediction overlaps the published range, and the median is within a
// factor of 1.5 of the published mean; a row that states a lower bound only, if the median is above it.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace trocar::test {

enum class Standing {
  kCounted,  ///< nothing of this row was used
  kFitted,   ///< the constant is fitted on this row
  kShown,    ///< its published range, or an input that decides it, has no source
};

struct PublishedForce {
  std::string id, study, mechanism;
  Standing standing = Standing::kCounted;
  std::string tool, specimen, unit, spread, source, evidence, assumed;
  std::string miss;  ///< likely reason, if the prediction misses
  double mean = 0, low = 0, high = 0;
  bool is_at_least = false;  ///< the source states only that it is more than `low`
  nlohmann::json model;      ///< kind and inputs of the prediction
};

/// Reads the rows. Throws std::runtime_error or a JSON exception.
std::vector<PublishedForce> read_published_forces(const std::filesystem::path& file);

/// The pressure on the wall of a shaft over the pressure under the tip.
using WallPressure = double;

struct Prediction {
  double low = 0, median = 0, high = 0;  ///< 5, 50 and 95 %, in the row's unit
};
/// Predicts a row from the same draws in every run. Throws std::invalid_argument for an unknown kind or input.
Prediction predict(const PublishedForce& row, WallPressure wall_pressure);

/// Fits the constant so that the median of the fitted row is its published mean. Throws std::invalid_argument if
/// there is not exactly one such row.
WallPressure fit(const std::vector<PublishedForce>& rows);

bool is_hit(const PublishedForce& row, const Prediction& prediction);

}  // namespace trocar::test
