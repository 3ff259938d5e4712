// SPDX-License-Identifier: Apache-2.0
// A stress case of meshing (tests/corpus/pslg): an outline on the lattice, or a picture to be
// outlined. Format: tests/corpus/README.md.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tests/cases/stress_case.h"
#include "tests/support/motions.h"

namespace trocar::test {

/// Pixels from 0 to 100; 50 and more are material.
struct Picture {
  int width = 0, height = 0;
  std::vector<float> values;
  bool is_mask = false;    ///< 0 and 1, given as labels
  bool as_chains = false;  ///< outlined by pixel chains rather than by the iso-contour
  std::array<double, 2> pixel_mm{1, 1};
  std::array<double, 3> origin_mm{};  ///< origin of the first slice's plane, patient frame
  std::vector<double> z_mm{0};        ///< positions of the slices, which have the same picture
};

struct PslgExpectation {
  bool meshed = true;
  std::string because;  ///< text of the error, if refused
  std::optional<std::int64_t> rings, holes, doubled_area_steps2, triangles;
  std::int64_t refined_triangles_max = 0;  ///< 0: not checked
  std::string refinement = "refined";
  /// Largest number of triangles below the wanted angle.
  std::int64_t sharp_max = 0;
  std::int64_t negative_stiffness_max = 0;
  std::optional<double> min_angle_deg_min;  ///< bound of the smallest angle
};

struct PslgCase {
  std::string right;
  Pslg outline;                    ///< if there is no picture
  std::optional<Picture> picture;  ///< outlined with the options below
  Lattice lattice;
  double tolerance_mm = 0.25, min_angle_deg = 30, max_area_mm2 = 50, min_region_mm2 = 0;
  /// A translation in steps: the translated outline must give the translated mesh.
  std::optional<LatticePoint> also_at;
  PslgExpectation expect;
};

namespace detail {

// A square with `cells` x `cells` square holes on a grid: many cocircular vertices.
inline Pslg grid_of_holes(std::int32_t cells, std::int32_t cell, std::int32_t hole) {
  Pslg out;
  const std::int32_t side = cells * cell, margin = (cell - hole) / 2;
  out.rings.push_back({{0, 0}, {side, 0}, {side, side}, {0, side}});
  for (std::int32_t j = 0; j < cells; ++j) {
    for (std::int32_t i = 0; i < cells; ++i) {
      const std::int32_t x = i * cell + margin, y = j * cell + margin;
      out.rings.push_back({{x, y}, {x, y + hole}, {x + hole, y + hole}, {x + hole, y}});
    }
  }
  return out;
}

// A square with a vertex every `every` steps along its sides.
inline Pslg beaded_square(std::int32_t side, std::int32_t every) {
  Ring ring;
  for (std::int32_t i = 0; i < side; i += every)
    ring.push_back({i, 0});
  for (std::int32_t i = 0; i < side; i += every)
    ring.push_back({side, i});
  for (std::int32_t i = side; i > 0; i -= every)
    ring.push_back({i, side});
  for (std::int32_t i = side; i > 0; i -= every)
    ring.push_back({0, i});
  return {{ring}};
}

inline Pslg read_made_outline(const nlohmann::json& value, const std::string& path,
                              JsonErrors& errors) {
  StrictObject o(value, path, errors);
  const std::string kind = o.string("kind");
  Pslg out;
  if (kind == "grid of holes") {
    const auto cells = static_cast<std::int32_t>(o.integer("cells", 1, 40));
    const auto cell = static_cast<std::int32_t>(o.integer("cell", 4, 10'000));
    const auto hole = static_cast<std::int32_t>(o.integer("hole", 1, cell - 2));
    out = grid_of_holes(cells, cell, hole);
  } else if (kind == "beaded square") {
    const auto side = static_cast<std::int32_t>(o.integer("side", 2, 100'000));
    out = beaded_square(side, static_cast<std::int32_t>(o.integer(
                                  "every", std::max<std::int64_t>(1, side / 4000), side)));
  } else {
    errors.add(path + "/kind", "is \"grid of holes\" or \"beaded square\"");
  }
  o.finish();
  return out;
}

// '.' is 0, '#' is 100, a digit ten times itself.
inline void read_rows(const nlohmann::json& rows, const std::string& path, Picture& out,
                      JsonErrors& errors) {
  out.height = static_cast<int>(rows.size());
  for (const nlohmann::json& row : rows) {
    const std::string text = row.is_string() ? row.get<std::string>() : "";
    if (text.empty() || text.size() > 1000 ||
        (out.width != 0 && text.size() != static_cast<std::size_t>(out.width))) {
      errors.add(path, "rows must be strings of one length");
      return;
    }
    out.width = static_cast<int>(text.size());
    for (const char c : text) {
      const bool digit = c >= '0' && c <= '9';
      if (!digit && c != '.' && c != '#') errors.add(path, "pixels are '.', '#' or a digit");
      out.values.push_back(digit ? static_cast<float>(10 * (c - '0')) : c == '#' ? 100.0F : 0.0F);
    }
  }
}

inline Picture read_picture(const nlohmann::json& value, const std::string& path,
                            JsonErrors& errors) {
  StrictObject o(value, path, errors);
  Picture out;
  if (o.has("rows")) {
    if (const nlohmann::json* rows = o.array("rows", 1, 1000))
      read_rows(*rows, path + "/rows", out, errors);
  } else {
    // Single pixels, one at every `every`-th row and column; with 1 all pixels.
    out.width = static_cast<int>(o.integer("width", 1, 1000));
    out.height = static_cast<int>(o.integer("height", 1, 1000));
    const auto every = static_cast<int>(o.integer("every", 1, 1000));
    for (int y = 0; y < out.height; ++y) {
      for (int x = 0; x < out.width; ++x)
        out.values.push_back(x % every == 0 && y % every == 0 ? 100.0F : 0.0F);
    }
  }
  const std::string kind = o.has("outlined") ? o.string("outlined") : "grey";
  if (kind != "grey" && kind != "mask" && kind != "chains")
    errors.add(path + "/outlined", "is \"grey\", \"mask\" or \"chains\"");
  out.is_mask = kind == "mask";
  out.as_chains = kind == "chains";
  o.numbers("pixel_mm", out.pixel_mm, 1e-6, 1e6, false);
  o.numbers("origin_mm", out.origin_mm, -1e9, 1e9, false);
  if (o.has("z_mm")) {
    if (const nlohmann::json* z = o.array("z_mm", 1, 16)) {
      out.z_mm.assign(z->size(), 0);
      o.numbers("z_mm", out.z_mm, -1e6, 1e6, true);
    }
  }
  o.finish();
  return out;
}

inline PslgExpectation read_pslg_expectation(const nlohmann::json& value, JsonErrors& errors) {
  StrictObject o(value, "/expect", errors);
  PslgExpectation out;
  const std::string outcome = o.string("outcome");
  out.meshed = outcome == "meshed";
  if (!out.meshed) {
    if (outcome != "refused") errors.add("/expect/outcome", "is \"meshed\" or \"refused\"");
    out.because = o.string("because");
  }
  constexpr std::int64_t kLargest = std::int64_t{1} << 62;
  out.rings = optional_integer(o, "rings", 0, kLargest);
  out.holes = optional_integer(o, "holes", 0, kLargest);
  out.doubled_area_steps2 = optional_integer(o, "doubled_area_steps2", 0, kLargest);
  out.triangles = optional_integer(o, "triangles", 0, kLargest);
  out.refined_triangles_max = o.integer("refined_triangles_max", 0, kLargest, 0);
  if (o.has("refinement")) out.refinement = o.string("refinement");
  out.sharp_max = o.integer("sharp_max", 0, kLargest, 0);
  out.negative_stiffness_max = o.integer("negative_stiffness_max", 0, kLargest, 0);
  out.min_angle_deg_min = optional_number(o, "min_angle_deg_min", 0, 60);
  o.finish();
  return out;
}

}  // namespace detail

/// Refused: anything that tests/corpus/README.md does not describe.
inline Result<PslgCase> parse_pslg_case(std::string_view text, const std::string& name) {
  auto json = parse_strict_json(text, name);
  if (!json) return json.error();
  JsonErrors errors{name, {}};
  StrictObject o(*json, "", errors);
  PslgCase out;
  out.right = o.string("right");
  // Coordinates beyond the lattice's range are read too; the correct result is then a refusal.
  constexpr std::int64_t kLargest = INT32_MAX;
  if (o.has("rings")) {
    out.outline.rings = read_rings(*o.optional_value("rings"), "/rings", kLargest, errors);
  } else if (o.has("made")) {
    out.outline = detail::read_made_outline(*o.optional_value("made"), "/made", errors);
  } else if (o.has("picture")) {
    out.picture = detail::read_picture(*o.optional_value("picture"), "/picture", errors);
  } else {
    errors.add("", "needs rings, made or a picture");
  }
  out.lattice.bits = static_cast<int>(
      o.integer("lattice_bits", kMinLatticeBits, kMaxLatticeBits, out.lattice.bits));
  out.tolerance_mm = o.number("tolerance_mm", 0, 1000, out.tolerance_mm);
  out.min_angle_deg = o.number("min_angle_deg", 0, 60, out.min_angle_deg);
  out.max_area_mm2 = o.number("max_area_mm2", 1e-6, 1e12, out.max_area_mm2);
  out.min_region_mm2 = o.number("min_region_mm2", 0, 1e9, out.min_region_mm2);
  if (o.has("also_at")) {
    const Ring at = read_ring(nlohmann::json::array({*o.optional_value("also_at")}), "/also_at",
                              kMaxCoordinate, errors);
    if (at.size() == 1) out.also_at = at[0];
  }
  if (o.has("expect")) {
    out.expect = detail::read_pslg_expectation(*o.optional_value("expect"), errors);
  } else {
    errors.add("/expect", "is missing");
  }
  o.finish();
  if (errors.first) return *errors.first;
  return out;
}

/// The triangles by their points, translated, in a canonical order.
inline std::vector<Corners> triangles_of(const SliceMesh& mesh, LatticePoint moved = {}) {
  return canonical(Motion{0, moved}(mesh));
}

}  // namespace trocar::test
