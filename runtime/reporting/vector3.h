// SPDX-License-Identifier: Apache-2.0
// Points and vectors with three coordinates, in the form used by recordings and scenes.
#pragma once

#include <array>
#include <cmath>

namespace trocar::runtime {

using Vector3 = std::array<double, 3>;

inline Vector3 minus(const Vector3& a, const Vector3& b) noexcept {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline double dot(const Vector3& a, const Vector3& b) noexcept {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline double length(const Vector3& a) noexcept {
  return std::sqrt(dot(a, a));
}

}  // namespace trocar::runtime
