// SPDX-License-Identifier: Apache-2.0
// The table of published forces: its rows are complete, predictions are those of the formulas, and a row that is
// not fitted has no part in the fit.
#include "tests/bench/published_forces.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

namespace trocar::test {
namespace {

using nlohmann::json;

std::vector<PublishedForce> all() {
  return read_published_forces(TROCAR_PUBLISHED_FORCES);
}

PublishedForce row_of(const json& model) {
  PublishedForce row;
  row.mean = row.low = row.high = 100;
  row.model = model;
  return row;
}

TEST(PublishedForces, EachRowSaysWhatItIsAndWhereItIsFrom) {
  const auto rows = all();
  std::set<std::string> ids;
  for (const PublishedForce& row : rows) {
    EXPECT_TRUE(ids.insert(row.id).second) << row.id;
    for (const std::string* text : {&row.study, &row.mechanism, &row.tool, &row.specimen, &row.unit,
                                    &row.spread, &row.source, &row.evidence, &row.assumed})
      EXPECT_FALSE(text->empty()) << row.id;
    EXPECT_GT(row.low, 0) << row.id;
    EXPECT_LE(row.low, row.mean) << row.id;
    EXPECT_LE(row.mean, row.high) << row.id;
  }
  EXPECT_GE(
      std::count_if(rows.begin(), rows.end(),
                    [](const PublishedForce& row) { return row.standing == Standing::kCounted; }),
      20);
}

TEST(PublishedForces, ExactInputsGiveTheFormulas) {
  // 37.4 * 0.2^1.39 MPa, times 1.2, on 3 mm with cot(15 deg) * 0.3 of friction.
  const double pressure_Pa = 1.2e6 * 37.4 * std::pow(0.2, 1.39), pi = std::acos(-1.0);
  const json tip = {{"kind", "tip"},   {"density_g_per_cm3", 0.2}, {"pressure_over_yield", 1.2},
                    {"friction", 0.3}, {"diameter_mm", 3},         {"half_angle_deg", 15},
                    {"twist", 0}};
  const double tip_N = pressure_Pa * pi * 1.5e-3 * 1.5e-3 * (1 + 0.3 / std::tan(15 * pi / 180));
  Prediction p = predict(row_of(tip), 1);
  EXPECT_NEAR(p.median, tip_N, 1e-9);
  EXPECT_EQ(p.low, p.high);
  const json wall = {{"kind", "wall"},    {"thickness_mm", 0.5},  {"apparent_g_per_cm3", 1.9},
                     {"flow_factor", 1},  {"tip_radius_mm", 1.5}, {"free_radius_mm", 4},
                     {"shear_MPa", 51.6}, {"clamping", 3}};
  const double bending_N = 3 * pi * 100e6 * 0.25e-6 / 4 / (1 - 3.0 / 12);
  EXPECT_NEAR(predict(row_of(wall), 1).median, bending_N, 1e-9);
  const json both = {{"kind", "tip_and_wall"},
                     {"density_g_per_cm3", 0.2},
                     {"pressure_over_yield", 1.2},
                     {"friction", 0.3},
                     {"diameter_mm", 3},
                     {"half_angle_deg", 15},
                     {"twist", 0},
                     {"wall", wall}};
  EXPECT_NEAR(predict(row_of(both), 1).median, tip_N + bending_N, 1e-9);
  const json shaft = {{"kind", "shaft"},
                      {"density_g_per_cm3", 0.2},
                      {"pressure_over_yield", 1.2},
                      {"friction", 0.3},
                      {"outer_mm", 4},
                      {"bore_mm", 3},
                      {"twist", 0},
                      {"depth_mm", 20}};
  const double edge_N = pressure_Pa * pi * (4 - 2.25) * 1e-6,
               friction_N = 0.3 * 0.5 * pressure_Pa * 2 * pi * 3.5e-3 * 20e-3;
  EXPECT_NEAR(predict(row_of(shaft), 0.5).median, edge_N + friction_N, 1e-9);
  json fraction = shaft;
  fraction["kind"] = "friction_fraction";
  EXPECT_NEAR(predict(row_of(fraction), 0.5).median, friction_N / 2 / (edge_N + friction_N / 2),
              1e-12);
  const json tear = {{"kind", "tear"},     {"tip", "needle-conical"}, {"toughness_J_per_m2", 1200},
                     {"thickness_mm", 10}, {"diameter_mm", 0.5},      {"half_angle_deg", 10}};
  EXPECT_NEAR(predict(row_of(tear), 1).median, 1200 * 0.5e-3 / 0.61, 1e-9);
  EXPECT_THROW(predict(row_of({{"kind", "magic"}}), 1), std::exception);
}

// The band of a product of distributions, against their closed forms.
TEST(PublishedForces, BandsAreThoseOfTheDistributions) {
  json tear = {{"kind", "tear"},
               {"tip", "needle-conical"},
               {"toughness_J_per_m2", {{"span", {500, 2000}}}},
               {"thickness_mm", 100},
               {"diameter_mm", 0.61},
               {"half_angle_deg", 45}};
  Prediction p = predict(row_of(tear), 1);
  EXPECT_NEAR(p.low, 0.5, 0.02);
  EXPECT_NEAR(p.median, 1, 0.02);
  EXPECT_NEAR(p.high, 2, 0.08);
  tear["toughness_J_per_m2"] = {{"uniform", {1000, 2000}}};
  p = predict(row_of(tear), 1);
  EXPECT_NEAR(p.low, 1.05, 0.02);
  EXPECT_NEAR(p.high, 1.95, 0.02);
  tear["toughness_J_per_m2"] = {{"normal", {1000, 100}}, {"least", 900}};
  p = predict(row_of(tear), 1);
  EXPECT_NEAR(p.low, 0.9, 1e-12) << "cut off";
  EXPECT_NEAR(p.high, 1.1645, 0.01);
  // Bending grows with the square of the thickness.
  p = predict(row_of({{"kind", "wall"},
                      {"thickness_mm", {{"uniform", {0.1, 0.3}}}},
                      {"apparent_g_per_cm3", 1.9},
                      {"flow_factor", 1},
                      {"tip_radius_mm", 1.5},
                      {"free_radius_mm", 4},
                      {"shear_MPa", 51.6},
                      {"clamping", 3}}),
              1);
  EXPECT_NEAR(p.high / p.low, 0.29 * 0.29 / (0.11 * 0.11), 0.3);
}

TEST(PublishedForces, OneConstantIsFittedOnOneRow) {
  const auto rows = all();
  const double as_is = fit(rows);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    auto changed = rows;
    changed[i].mean *= 1.3;
    EXPECT_EQ(fit(changed) == as_is, rows[i].standing != Standing::kFitted) << rows[i].id;
    if (rows[i].standing == Standing::kFitted) {
      EXPECT_NEAR(predict(rows[i], as_is).median, rows[i].mean, 1e-3 * rows[i].mean);
    }
  }
  auto none = rows;
  for (PublishedForce& row : none)
    row.standing = Standing::kCounted;
  EXPECT_THROW(fit(none), std::invalid_argument);
  none[0].standing = none[1].standing = Standing::kFitted;
  EXPECT_THROW(fit(none), std::invalid_argument);
}

}  // namespace
}  // namespace trocar::test
