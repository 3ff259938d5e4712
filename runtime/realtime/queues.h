// SPDX-License-Identifier: Apache-2.0
// Queues between two threads, without locks.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

namespace trocar::runtime {

// A ring buffer with the latest values of one writing thread. The writer never waits; it overwrites
// the oldest value. One reading thread copies values out, and detects whether the writer has
// overwritten them during the copying. The method is a sequence lock, after H.-J. Boehm, "Can
// seqlocks get along with programming language memory models?", 2012.
//
// Values are stored as atomic 64-bit words. Therefore it is no data race if the reader reads a
// value while the writer overwrites it. On x86 atomic words cost as much as plain words. Words are
// stored with memory order release and loaded with memory order acquire. Therefore the reader
// detects overwriting: if it has loaded a word of a newer value, with number c (counted from 0), it
// then finds that at least c values have been pushed.

template <typename T>
class RingBuffer {
  static_assert(std::is_trivially_copyable_v<T> && sizeof(T) % sizeof(std::uint64_t) == 0);
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

 public:
  /// Makes a buffer of `capacity` >= 1 values. Only this constructor and copy() allocate.
  explicit RingBuffer(std::size_t capacity) : capacity_(capacity), words_(capacity * kWords) {}

  /// The writer calls this. Appends a value.
  void push(const T& value) noexcept {
    std::array<std::uint64_t, kWords> words;
    std::memcpy(words.data(), &value, sizeof value);
    std::atomic<std::uint64_t>* to = slot(pushed_);
    for (std::size_t w = 0; w < kWords; ++w)
      to[w].store(words[w], std::memory_order_release);
    count_.store(++pushed_, std::memory_order_release);
  }
  /// The writer calls this. Returns the number of values that have been pushed.
  std::uint64_t pushed() const noexcept { return pushed_; }

  /// The reader calls this. Appends copies of the values with numbers `first` to `end - 1` to
  /// `out`; the first value that was pushed has number 0. Precondition: all these values have been
  /// pushed. If the writer has overwritten one of the values, or may be overwriting one now, the
  /// function returns false and appends nothing.
  bool copy(std::uint64_t first, std::uint64_t end, std::vector<T>& out) const {
    const auto overwritten = [&] {
      // The writer may be writing value number `count` now.
      return count_.load(std::memory_order_acquire) >= first + capacity_;
    };
    if (overwritten()) return false;
    const std::size_t before = out.size();
    out.resize(before + static_cast<std::size_t>(end - first));
    for (std::uint64_t i = first; i < end; ++i) {
      std::array<std::uint64_t, kWords> words;
      const std::atomic<std::uint64_t>* from = slot(i);
      for (std::size_t w = 0; w < kWords; ++w)
        words[w] = from[w].load(std::memory_order_acquire);
      std::memcpy(static_cast<void*>(&out[before + static_cast<std::size_t>(i - first)]),
                  words.data(), sizeof(T));
    }
    if (!overwritten()) return true;
    out.resize(before);
    return false;
  }

 private:
  static constexpr std::size_t kWords = sizeof(T) / sizeof(std::uint64_t);

  std::atomic<std::uint64_t>* slot(std::uint64_t i) { return &words_[i % capacity_ * kWords]; }
  const std::atomic<std::uint64_t>* slot(std::uint64_t i) const {
    return &words_[i % capacity_ * kWords];
  }

  std::size_t capacity_;
  std::vector<std::atomic<std::uint64_t>> words_;
  std::uint64_t pushed_ = 0;  // only the writer uses this
  std::atomic<std::uint64_t> count_{0};
};

// A bounded queue from one writing to one reading thread. It uses no lock, never waits and never
// allocates. The algorithm is L. Lamport's ring: the writer advances one index, the reader another.
// To save time, each thread keeps a copy of the other thread's index. It reads the index itself
// only if the queue is full or empty according to the copy.

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

// Passes the latest value from one writing to one reading thread. Neither thread waits. The reader
// receives only complete values, and never an older value after a newer one.

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
