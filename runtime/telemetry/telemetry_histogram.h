// SPDX-License-Identifier: Apache-2.0
// A histogram of durations for the console. Each range from 2^k ns to 2^(k + 1) ns is
// divided into four bins of equal width.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

namespace trocar::runtime {

/// The first bin begins at 256 ns and also counts shorter durations. The last bin counts all
/// durations above 14.7 ms. One thread writes, and any thread may read.
class TelemetryHistogram {
 public:
  static constexpr std::size_t kBins = 64;

  void add(std::int64_t duration_ns) noexcept {
    std::atomic<std::uint64_t>& count = counts_[bin(duration_ns)];
    count.store(count.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }
  std::uint64_t count(std::size_t i) const noexcept {
    return counts_[i].load(std::memory_order_relaxed);
  }
  /// Returns the bin of a duration.
  static std::size_t bin(std::int64_t duration_ns) noexcept;
  /// Returns the lower end of bin i; 0 for the first bin.
  static double lower_us(std::size_t i) noexcept;

 private:
  std::array<std::atomic<std::uint64_t>, kBins> counts_{};
};

}  // namespace trocar::runtime
