// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/telemetry_histogram.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace trocar::runtime {
namespace {

constexpr unsigned kFirstOctave = 8;  // 2^8 ns = 256 ns

}  // namespace

std::size_t TelemetryHistogram::bin(std::int64_t duration_ns) noexcept {
  if (duration_ns < std::int64_t{1} << kFirstOctave) return 0;
  const auto value = static_cast<std::uint64_t>(duration_ns);
  const unsigned octave = static_cast<unsigned>(std::bit_width(value)) - 1;
  const std::uint64_t quarter = (value >> (octave - 2)) & 3U;
  return std::min<std::size_t>(std::size_t{4} * (octave - kFirstOctave) + quarter, kBins - 1);
}

double TelemetryHistogram::lower_us(std::size_t i) noexcept {
  if (i == 0) return 0;
  return std::ldexp(1 + 0.25 * static_cast<double>(i % 4), static_cast<int>(kFirstOctave + i / 4)) *
         1e-3;
}

}  // namespace trocar::runtime
