// SPDX-License-Identifier: Apache-2.0
// A stress case of the sheet's mechanics (tests/corpus/cut): a sheet, a sequence of cuts, and
// forces of the law `network` on the remaining sheet. Format: tests/corpus/README.md.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tests/cases/stress_case.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::test {

/// The largest coordinate in an asset, and so in a sheet.
inline constexpr std::int64_t kMaxSheetCoordinate = 1 << 24;
inline constexpr std::size_t kMaxCuts = 2000;

struct ForceCase {
  std::vector<double> stiffness_N_per_m;  ///< the response must be proportional to it
  double reach_mm = 8;
  Ring tool;
  std::string refused;  ///< not empty: calibration must fail with this message
  std::optional<double> over_K_min, over_K_max;  ///< bounds of response over wanted stiffness
  /// The same over the stiffness of the Winkler foundation under the full sheet.
  std::optional<double> over_bed_min, over_bed_max;
  /// Bound of the stiffness after 1,000 sweeps of propagation, over the response.
  double propagated_max = 1.002;
};

struct CutCase {
  std::string right;
  Lattice lattice;
  Pslg outline;     ///< outline to be triangulated, if has_outline
  SliceMesh sheet;  ///< the mesh itself otherwise
  bool has_outline = false;
  std::vector<Ring> cuts;
  std::vector<ForceCase> forces;  ///< on the sheet after all cuts

  bool valid_sheet = true;
  std::string because;  ///< text of the error if the sheet must be refused
  std::int64_t cut = 0, nothing_met = 0, refused = 0;  ///< numbers of cuts by outcome
  std::optional<std::int64_t> doubled_area_left, triangles_left, islands, holes;
};

namespace detail {

inline SliceMesh read_mesh(StrictObject& o, JsonErrors& errors) {
  SliceMesh out;
  out.vertices =
      read_ring(*o.optional_value("vertices"), "/sheet/vertices", kMaxSheetCoordinate, errors);
  const nlohmann::json* triangles = o.array("triangles", 0, kMaxParts);
  if (triangles == nullptr) return out;
  for (const nlohmann::json& t : *triangles) {
    Triangle read{};
    const bool three = t.is_array() && t.size() == 3;
    if (!three) errors.add("/sheet/triangles", "a triangle must be three vertices");
    for (std::size_t i = 0; three && i < 3; ++i) {
      const bool index = t[i].is_number_unsigned() && t[i].get<std::uint64_t>() < kMaxPoints;
      if (!index) errors.add("/sheet/triangles", "a vertex must be a small number");
      if (index) read[i] = t[i].get<std::uint32_t>();
    }
    out.triangles.push_back(read);
  }
  return out;
}

inline void read_sheet(const nlohmann::json& value, CutCase& out, JsonErrors& errors) {
  StrictObject o(value, "/sheet", errors);
  if (o.has("rings")) {
    out.has_outline = true;
    out.outline.rings =
        read_rings(*o.optional_value("rings"), "/sheet/rings", kMaxSheetCoordinate, errors);
  } else if (o.has("vertices")) {
    out.sheet = read_mesh(o, errors);
  } else {
    // A square of cells around the origin, each of two triangles.
    const auto cells = static_cast<int>(o.integer("cells", 1, 60));
    const auto cell = static_cast<std::int32_t>(o.integer("cell", 2, 100'000));
    const std::int32_t low = -(cells * cell) / 2;
    out.sheet = square_mesh({low, low}, cell, cells);
  }
  o.finish();
}

inline void read_cuts(const nlohmann::json& value, CutCase& out, JsonErrors& errors) {
  if (!value.is_array() || value.size() > kMaxCuts) {
    errors.add("/cuts", "must be an array");
    return;
  }
  for (const nlohmann::json& each : value) {
    StrictObject o(each, "/cuts", errors);
    if (!o.has("polygon")) errors.add("/cuts/polygon", "is missing");
    if (errors.first) return;
    Ring tool =
        read_ring(*o.optional_value("polygon"), "/cuts/polygon", kMaxSheetCoordinate, errors);
    const std::int64_t times = o.integer("times", 1, kMaxCuts, 1);
    LatticePoint step;
    if (o.has("step")) {
      const Ring read =
          read_ring(nlohmann::json::array({*o.optional_value("step")}), "/cuts/step",
                    kMaxSheetCoordinate / static_cast<std::int64_t>(kMaxCuts), errors);
      if (read.size() == 1) step = read[0];
    }
    o.finish();
    for (std::int64_t i = 0; i < times && out.cuts.size() < kMaxCuts; ++i) {
      out.cuts.push_back(tool);
      for (LatticePoint& p : tool)
        p = {p.x + step.x, p.y + step.y};
    }
  }
}

inline void read_forces(const nlohmann::json& value, CutCase& out, JsonErrors& errors) {
  if (!value.is_array() || value.size() > 16) {
    errors.add("/forces", "must be an array");
    return;
  }
  for (const nlohmann::json& each : value) {
    StrictObject o(each, "/forces", errors);
    ForceCase force;
    if (const nlohmann::json* stiffness = o.array("stiffness_N_per_m", 1, 16)) {
      force.stiffness_N_per_m.assign(stiffness->size(), 0);
      o.numbers("stiffness_N_per_m", force.stiffness_N_per_m, -1e12, 1e12, true);
    }
    force.reach_mm = o.number("reach_mm", -1e9, 1e9);
    if (o.has("tool"))
      force.tool =
          read_ring(*o.optional_value("tool"), "/forces/tool", kMaxSheetCoordinate, errors);
    force.refused = optional_string(o, "refused");
    force.over_K_min = optional_number(o, "over_K_min", 0, 1e9);
    force.over_K_max = optional_number(o, "over_K_max", 0, 1e9);
    force.over_bed_min = optional_number(o, "over_bed_min", 0, 1e9);
    force.over_bed_max = optional_number(o, "over_bed_max", 0, 1e9);
    force.propagated_max = o.number("propagated_max", 1, 1e9, force.propagated_max);
    o.finish();
    out.forces.push_back(force);
  }
}

}  // namespace detail

/// Refused: anything that tests/corpus/README.md does not describe.
inline Result<CutCase> parse_cut_case(std::string_view text, const std::string& name) {
  auto json = parse_strict_json(text, name);
  if (!json) return json.error();
  JsonErrors errors{name, {}};
  StrictObject o(*json, "", errors);
  CutCase out;
  out.right = o.string("right");
  out.lattice.bits = static_cast<int>(
      o.integer("lattice_bits", kMinLatticeBits, kMaxLatticeBits, out.lattice.bits));
  if (const nlohmann::json* sheet = o.optional_value("sheet")) {
    detail::read_sheet(*sheet, out, errors);
  } else {
    errors.add("/sheet", "is missing");
  }
  if (const nlohmann::json* cuts = o.optional_value("cuts")) detail::read_cuts(*cuts, out, errors);
  if (const nlohmann::json* forces = o.optional_value("forces"))
    detail::read_forces(*forces, out, errors);
  if (const nlohmann::json* value = o.optional_value("expect")) {
    StrictObject e(*value, "/expect", errors);
    out.because = optional_string(e, "sheet_refused");
    out.valid_sheet = out.because.empty();
    constexpr std::int64_t kLargest = std::int64_t{1} << 62;
    out.cut = e.integer("cut", 0, kLargest, 0);
    out.nothing_met = e.integer("nothing_met", 0, kLargest, 0);
    out.refused = e.integer("refused", 0, kLargest, 0);
    out.doubled_area_left = optional_integer(e, "doubled_area_left", 0, kLargest);
    out.triangles_left = optional_integer(e, "triangles_left", 0, kLargest);
    out.islands = optional_integer(e, "islands", 0, kLargest);
    out.holes = optional_integer(e, "holes", 0, kLargest);
    e.finish();
  } else {
    errors.add("/expect", "is missing");
  }
  o.finish();
  if (errors.first) return *errors.first;
  return out;
}

}  // namespace trocar::test
