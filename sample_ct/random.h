// SPDX-License-Identifier: Apache-2.0
// Counter-based random numbers: each number is a pure function of a seed and a position, so results
// do not depend on the order of work or the number of threads. The hash uses integers only and is
// the same on every machine.
#pragma once

#include <cstdint>

namespace trocar::sample {

/// SplitMix64's finaliser (Steele, Lea, Flood 2014).
inline std::uint64_t mix64(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

/// 64 random bits for a seed and a position (i, j, k).
inline std::uint64_t hash_at(std::uint64_t seed, std::int64_t i, std::int64_t j, std::int64_t k) {
  std::uint64_t h = mix64(seed);
  h = mix64(h ^ static_cast<std::uint64_t>(i));
  h = mix64(h ^ static_cast<std::uint64_t>(j));
  return mix64(h ^ static_cast<std::uint64_t>(k));
}

/// A number uniform in [-1, 1), made from the top 53 bits.
inline double signed_unit(std::uint64_t bits) {
  return static_cast<double>(static_cast<std::int64_t>(bits) >> 11) * 0x1.0p-52;
}

/// A nearly normal number with mean 0 and variance 1: the scaled sum of eight uniform 16-bit
/// numbers (Irwin-Hall), taken from `bits` and mix64(bits). |value| < 4.9.
inline double nearly_normal(std::uint64_t bits) {
  const std::uint64_t more = mix64(bits);
  std::int64_t sum = 0;
  for (int shift = 0; shift < 64; shift += 16) {
    sum += static_cast<std::int64_t>((bits >> shift) & 0xffff);
    sum += static_cast<std::int64_t>((more >> shift) & 0xffff);
  }
  // The mean is 8 * 65535 / 2, the variance 8 * (65536^2 - 1) / 12.
  constexpr double kInverseSigma = 1.0 / 53509.91992145008;
  return static_cast<double>(sum - std::int64_t{4} * 65535) * kInverseSigma;
}

/// Smooth noise in (-1, 1): random values at the points of an integer grid, interpolated by a
/// quintic polynomial, so that the noise has two continuous derivatives.
double value_noise(std::uint64_t seed, double x, double y, double z);

}  // namespace trocar::sample
