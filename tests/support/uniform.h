// SPDX-License-Identifier: Apache-2.0
// Uniform random numbers that are the same with every standard library, unlike those of std::uniform_real_distribution.
#pragma once

#include <random>

namespace trocar::test {

/// In [0, 1), a multiple of 2^-53.
inline double uniform(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1p-53;
}
/// Between `low` and `high`.
inline double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * uniform(random);
}

}  // namespace trocar::test
