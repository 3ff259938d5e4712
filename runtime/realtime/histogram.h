// SPDX-License-Identifier: Apache-2.0
// A histogram of durations up to 18 minutes; longer durations are counted in the last bucket. Below
// 128 ns each nanosecond has a bucket. From 128 ns on, each octave (a factor of 2) has 64 buckets,
// so a bucket is at most 1.6 % wide. The histogram has a fixed size and does not allocate.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>

namespace trocar::runtime {

class Histogram {
 public:
  void add(std::int64_t duration_ns) noexcept {
    const std::uint64_t value = static_cast<std::uint64_t>(std::max<std::int64_t>(duration_ns, 0));
    ++count_[std::min(bucket(value), kBuckets - 1)];
    ++samples_;
    max_ns_ = std::max(max_ns_, value);
  }
  std::uint64_t samples() const noexcept { return samples_; }
  double max_us() const noexcept { return static_cast<double>(max_ns_) * 1e-3; }

  /// Returns a quantile: at least this fraction of the samples is not longer than the result. The
  /// result is the upper end of a bucket, but at most max_us(). Returns 0 if there are no samples.
  double quantile_us(double fraction) const noexcept {
    if (samples_ == 0) return 0;
    const double wanted = fraction * static_cast<double>(samples_);
    std::uint64_t seen = 0;
    for (std::size_t i = 0; i < kBuckets; ++i) {
      seen += count_[i];
      if (static_cast<double>(seen) >= wanted && seen > 0)
        return static_cast<double>(std::min(upper_end(i), max_ns_)) * 1e-3;
    }
    return max_us();
  }

  /// Calls `found(upper_us, count)` for each quarter of an octave that has samples, in ascending
  /// order. Below 64 ns, a range of 16 ns takes the place of a quarter. `count` is the number of
  /// samples in the quarter, and `upper_us` is the quarter's longest duration in us.
  template <typename Found>
  void each_quarter_octave(Found&& found) const {
    constexpr std::size_t kPerQuarter = (std::size_t{1} << kBits) / 4;
    for (std::size_t i = 0; i < kBuckets; i += kPerQuarter) {
      std::uint64_t sum = 0;
      for (std::size_t k = i; k < std::min(i + kPerQuarter, kBuckets); ++k)
        sum += count_[k];
      if (sum > 0)
        found(static_cast<double>(upper_end(std::min(i + kPerQuarter, kBuckets) - 1)) * 1e-3, sum);
    }
  }

 private:
  static constexpr unsigned kBits = 6;                            // 64 buckets per octave
  static constexpr std::size_t kExact = std::size_t{2} << kBits;  // below it, one bucket per ns
  static constexpr std::size_t kBuckets = kExact + (std::size_t{33} << kBits);

  static std::size_t bucket(std::uint64_t value) noexcept {
    if (value < kExact) return value;
    const unsigned shift = static_cast<unsigned>(std::bit_width(value)) - (kBits + 1);
    return (std::size_t{shift} << kBits) + (value >> shift);
  }
  static std::uint64_t upper_end(std::size_t index) noexcept {
    if (index < kExact) return index;
    const std::size_t shift = (index >> kBits) - 1;
    const std::uint64_t mantissa = index - (shift << kBits);
    return ((mantissa + 1) << shift) - 1;
  }

  std::array<std::uint64_t, kBuckets> count_{};
  std::uint64_t samples_ = 0;
  std::uint64_t max_ns_ = 0;
};

}  // namespace trocar::runtime
