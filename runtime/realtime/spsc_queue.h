// SPDX-License-Identifier: Apache-2.0
// A bounded queue from one writing to one reading thread. It uses no lock, never waits and never
// allocates. The algorithm is L. Lamport's ring: the writer advances one index, the reader another.
// To save time, each thread keeps a copy of the other thread's index. It reads the index itself
// only if the queue is full or empty according to the copy.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <type_traits>

namespace trocar::runtime {

/// Holds up to `Capacity` elements; `Capacity` must be a power of two.
template <typename T, std::size_t Capacity>
class SpscQueue {
  static_assert(Capacity >= 2 && (Capacity & (Capacity - 1)) == 0, "a power of two");
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  /// The writer calls this. Appends a value. If the queue is full, returns false and changes
  /// nothing.
  bool push(const T& value) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_seen_ == Capacity) {
      head_seen_ = head_.load(std::memory_order_acquire);
      if (tail - head_seen_ == Capacity) return false;
    }
    ring_[tail % Capacity] = value;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  /// The reader calls this. Removes the oldest value and copies it to `value`. If the queue is
  /// empty, returns false and leaves `value` unchanged.
  bool pop(T& value) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_seen_) {
      tail_seen_ = tail_.load(std::memory_order_acquire);
      if (head == tail_seen_) return false;
    }
    value = ring_[head % Capacity];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

 private:
  static constexpr std::size_t kLine = 64;
  alignas(kLine) std::atomic<std::size_t> head_{0};  // number of values popped so far
  alignas(kLine) std::size_t tail_seen_ = 0;         // the reader's copy of tail_
  alignas(kLine) std::atomic<std::size_t> tail_{0};  // number of values pushed so far
  alignas(kLine) std::size_t head_seen_ = 0;         // the writer's copy of head_
  alignas(kLine) std::array<T, Capacity> ring_{};
};

}  // namespace trocar::runtime
