// SPDX-License-Identifier: Apache-2.0
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
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

namespace trocar::runtime {

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

}  // namespace trocar::runtime
