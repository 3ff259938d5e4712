// SPDX-License-Identifier: Apache-2.0
#include "sample_ct/random.h"

#include <cmath>

namespace trocar::sample {

double value_noise(std::uint64_t seed, double x, double y, double z) {
  const double fx = std::floor(x), fy = std::floor(y), fz = std::floor(z);
  const auto i = static_cast<std::int64_t>(fx), j = static_cast<std::int64_t>(fy),
             k = static_cast<std::int64_t>(fz);
  const auto fade = [](double t) { return t * t * t * (t * (t * 6 - 15) + 10); };
  const double u = fade(x - fx), v = fade(y - fy), w = fade(z - fz);
  // These are the states of hash_at() after i and j. Two corners share each.
  std::uint64_t columns[4];
  for (int di = 0; di < 2; ++di) {
    const std::uint64_t h = mix64(mix64(seed) ^ static_cast<std::uint64_t>(i + di));
    for (int dj = 0; dj < 2; ++dj)
      columns[di + 2 * dj] = mix64(h ^ static_cast<std::uint64_t>(j + dj));
  }
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int di = corner & 1, dj = (corner >> 1) & 1, dk = corner >> 2;
    const double weight = (di ? u : 1 - u) * (dj ? v : 1 - v) * (dk ? w : 1 - w);
    sum += weight * signed_unit(mix64(columns[corner & 3] ^ static_cast<std::uint64_t>(k + dk)));
  }
  return sum;
}

}  // namespace trocar::sample
