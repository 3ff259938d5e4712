// SPDX-License-Identifier: Apache-2.0
// Passes the latest value from one writing to one reading thread. Neither thread waits. The reader
// receives only complete values, and never an older value after a newer one.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

namespace trocar::runtime {

template <typename T>
class TripleBuffer {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  /// The writer calls this. Replaces the latest value.
  void write(const T& value) noexcept {
    slots_[back_] = value;
    back_ = middle_.exchange(static_cast<std::uint8_t>(back_ | kFresh), std::memory_order_acq_rel) &
            kIndex;
  }

  /// The reader calls this. Copies the latest value to `value`. If nothing was written since the
  /// last read, returns false and leaves `value` unchanged.
  bool read(T& value) noexcept {
    if ((middle_.load(std::memory_order_relaxed) & kFresh) == 0) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kIndex;
    value = slots_[front_];
    return true;
  }

 private:
  static constexpr std::uint8_t kIndex = 3, kFresh = 4;
  std::array<T, 3> slots_{};
  std::atomic<std::uint8_t> middle_{1};
  std::uint8_t back_ = 0;   // slot owned by the writer
  std::uint8_t front_ = 2;  // slot owned by the reader
};

}  // namespace trocar::runtime
