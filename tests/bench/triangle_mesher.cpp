// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/triangle_mesher.h"

#include <array>
#include <cstdio>

#ifdef TROCAR_TRIANGLE
extern "C" {
#define REAL double       // NOLINT(cppcoreguidelines-macro-usage): its header needs both
#define VOID void         // NOLINT(cppcoreguidelines-macro-usage)
#define ANSI_DECLARATORS  // NOLINT(cppcoreguidelines-macro-usage)
#include <triangle.h>
#undef REAL
#undef VOID
}
#endif

namespace trocar::bench {

TriangleInput::TriangleInput(const CgalInput& input) {
  for (const LatticePoint p : input.points) {
    points.push_back(p.x);
    points.push_back(p.y);
  }
  for (const auto& [from, to] : input.edges) {
    segments.push_back(static_cast<int>(from));
    segments.push_back(static_cast<int>(to));
  }
  for (const auto& seed : input.hole_seeds)
    holes.insert(holes.end(), seed.begin(), seed.end());
}

#ifdef TROCAR_TRIANGLE

bool has_triangle() {
  return true;
}

std::size_t triangle_mesh(TriangleInput& input, double min_angle_deg, double max_area_steps2,
                          std::vector<double>* corners) {
  if (input.points.empty()) return 0;
  triangulateio in{}, out{};
  in.pointlist = input.points.data();
  in.numberofpoints = static_cast<int>(input.points.size() / 2);
  in.segmentlist = input.segments.data();
  in.numberofsegments = static_cast<int>(input.segments.size() / 2);
  in.holelist = input.holes.data();
  in.numberofholes = static_cast<int>(input.holes.size() / 2);
  // p: of segments; z: numbered from 0; Q: quiet; B, P: no markers and segments; q, a: the bounds.
  std::array<char, 80> switches{};
  if (min_angle_deg > 0) {
    std::snprintf(switches.data(), switches.size(), "pzQBPq%.6fa%.6f", min_angle_deg,
                  max_area_steps2);
  } else {
    std::snprintf(switches.data(), switches.size(), "pzQBP");
  }
  ::triangulate(switches.data(), &in, &out, nullptr);
  if (corners != nullptr) {
    corners->clear();
    for (int k = 0; k < 3 * out.numberoftriangles; ++k) {
      const int v = out.trianglelist[k];
      corners->push_back(out.pointlist[2 * v]);
      corners->push_back(out.pointlist[2 * v + 1]);
    }
  }
  trifree(out.pointlist);
  trifree(out.trianglelist);
  return static_cast<std::size_t>(out.numberoftriangles);
}

#else

bool has_triangle() {
  return false;
}

std::size_t triangle_mesh(TriangleInput& /*input*/, double /*min_angle_deg*/,
                          double /*max_area_steps2*/, std::vector<double>* /*corners*/) {
  return 0;
}

#endif

}  // namespace trocar::bench
