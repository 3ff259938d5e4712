// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/lattice.h"

namespace trocar {
namespace {

int sign(std::int64_t v) {
  return (v > 0) - (v < 0);
}

// Is p, which is collinear with ab, strictly between a and b?
bool strictly_between(LatticePoint a, LatticePoint b, LatticePoint p) {
  return diametral_dot(a, b, p) < 0;
}

}  // namespace

std::string to_text(LatticePoint p) {
  return "lattice point (" + std::to_string(p.x) + ", " + std::to_string(p.y) + ")";
}

bool segments_cross(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  const int abc = sign(orient2d(a, b, c)), abd = sign(orient2d(a, b, d));
  const int cda = sign(orient2d(c, d, a)), cdb = sign(orient2d(c, d, b));
  if (abc * abd < 0 && cda * cdb < 0) return true;
  if (abc == 0 && strictly_between(a, b, c)) return true;
  if (abd == 0 && strictly_between(a, b, d)) return true;
  if (cda == 0 && strictly_between(c, d, a)) return true;
  if (cdb == 0 && strictly_between(c, d, b)) return true;
  // The two are the same segment, in either direction.
  return a != b && ((a == c && b == d) || (a == d && b == c));
}

}  // namespace trocar
