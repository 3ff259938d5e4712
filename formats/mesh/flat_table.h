// SPDX-License-Identifier: Apache-2.0
// Containers for code that must not allocate: their memory is allocated once and never grows.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace trocar {

/// Empties the list, reserves capacity for `size` elements and writes to the whole capacity. Later
/// uses then cause no page fault, the delay at the first access to a page of memory.
template <typename T>
void reserve_touched(std::vector<T>& list, std::size_t size) {
  list.resize(size);
  list.clear();
}

/// Appends the element. If the list's capacity is used up, returns false and changes nothing.
template <typename T>
bool push_within(std::vector<T>& list, const T& element) noexcept {
  if (list.size() == list.capacity()) return false;
  list.push_back(element);
  return true;
}

/// A map from 64-bit keys to 32-bit values, a hash table with linear probing. Single keys cannot be
/// removed. The slots of the table hold indices into a dense list of entries. While the table has
/// few keys, it uses only a small part of its memory, and this part stays in the processor's cache.
class FlatTable {
 public:
  static constexpr std::uint32_t kAbsent = 0xffffffff;

  /// Allocates memory for `capacity` keys and discards the content.
  void allocate(std::size_t capacity) {
    reserve_touched(entries_, capacity);
    slots_.assign(std::bit_ceil(std::max<std::size_t>(2 * capacity, kMinSlots)), 0);
    capacity_ = capacity;
    clear();
  }

  /// Discards the content and keeps the memory. O(1).
  void clear() noexcept {
    entries_.clear();
    use_slots(kMinSlots);
  }

  std::size_t size() const noexcept { return entries_.size(); }

  /// Returns the value at the key, or kAbsent if the key is not in the table.
  std::uint32_t find(std::uint64_t key) const noexcept {
    for (std::size_t slot = home(key);; slot = (slot + 1) & mask_) {
      const std::uint32_t entry = slots_[slot];
      if (entry == 0) return kAbsent;
      if (entries_[entry - 1].key == key) return entries_[entry - 1].value;
    }
  }
  bool contains(std::uint64_t key) const noexcept { return find(key) != kAbsent; }

  /// Inserts `value` unless the key already has a value. Returns a pointer to the key's value,
  /// which is valid until the next insert(). Returns null if the key is new and the capacity is
  /// used up.
  std::uint32_t* insert(std::uint64_t key, std::uint32_t value) noexcept {
    std::size_t slot = home(key);
    for (; slots_[slot] != 0; slot = (slot + 1) & mask_) {
      Entry& entry = entries_[slots_[slot] - 1];
      if (entry.key == key) return &entry.value;
    }
    if (entries_.size() == capacity_) return nullptr;
    entries_.push_back({key, value});
    slots_[slot] = static_cast<std::uint32_t>(entries_.size());
    if (2 * entries_.size() > mask_) grow();
    return &entries_.back().value;
  }

 private:
  static constexpr std::size_t kMinSlots = 256;

  struct Entry {
    std::uint64_t key;
    std::uint32_t value;
  };

  std::size_t home(std::uint64_t key) const noexcept {
    return static_cast<std::size_t>((key * 0x9e3779b97f4a7c15U) >> shift_) & mask_;
  }

  void use_slots(std::size_t count) noexcept {
    mask_ = count - 1;
    shift_ = 64 - std::countr_zero(count);
    std::fill_n(slots_.begin(), count, 0U);
  }

  void grow() noexcept {
    if (2 * (mask_ + 1) > slots_.size()) return;  // full length; at least half stays empty
    use_slots(std::min(8 * (mask_ + 1), slots_.size()));
    for (std::size_t i = 0; i < entries_.size(); ++i) {
      std::size_t slot = home(entries_[i].key);
      while (slots_[slot] != 0)
        slot = (slot + 1) & mask_;
      slots_[slot] = static_cast<std::uint32_t>(i + 1);
    }
  }

  std::vector<Entry> entries_;
  std::vector<std::uint32_t> slots_ =
      std::vector<std::uint32_t>(kMinSlots, 0);  ///< 0: empty; otherwise 1 + index in entries_
  std::size_t capacity_ = 0;
  std::size_t mask_ = kMinSlots - 1;
  int shift_ = 56;
};

/// Returns a key for an ordered pair of numbers.
inline std::uint64_t pair_key(std::uint32_t a, std::uint32_t b) noexcept {
  return std::uint64_t{a} << 32 | b;
}

}  // namespace trocar
