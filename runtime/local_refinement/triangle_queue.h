// SPDX-License-Identifier: Apache-2.0
// A priority queue of triangle slots (places of a mesh for triangles). The queue is a heap and
// stores the position of each slot in the heap, so that a slot can be removed and its key can be
// changed. The queue can hold every slot of the mesh, and each slot occurs at most once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// The slot with the smallest key comes first; the caller chooses the keys. If keys are equal, the
/// lowest slot comes first. Only the constructor allocates. For n slots in the queue, put() and
/// remove() are O(log n), and clear() is O(n).
class TriangleQueue {
 public:
  explicit TriangleQueue(std::size_t triangle_slots) : position_(triangle_slots, kNoSlot) {
    heap_.reserve(triangle_slots);
  }

  bool empty() const noexcept { return heap_.empty(); }
  std::uint32_t top() const noexcept { return heap_.front().slot; }
  std::int64_t top_key() const noexcept { return heap_.front().key; }

  /// Inserts the slot, or changes its key.
  void put(std::uint32_t slot, std::int64_t key) noexcept {
    if (position_[slot] == kNoSlot) {
      position_[slot] = static_cast<std::uint32_t>(heap_.size());
      heap_.push_back({key, slot});
    } else {
      heap_[position_[slot]].key = key;
    }
    sift(position_[slot]);
  }

  /// Removes the slot. If the slot is not in the queue, nothing happens.
  void remove(std::uint32_t slot) noexcept {
    const std::uint32_t at = position_[slot];
    if (at == kNoSlot) return;
    position_[slot] = kNoSlot;
    const Entry last = heap_.back();
    heap_.pop_back();
    if (at == heap_.size()) return;
    heap_[at] = last;
    position_[last.slot] = at;
    sift(at);
  }

  void clear() noexcept {
    for (const Entry& entry : heap_)
      position_[entry.slot] = kNoSlot;
    heap_.clear();
  }

 private:
  struct Entry {
    std::int64_t key;
    std::uint32_t slot;
    bool operator<(const Entry& other) const noexcept {
      return key != other.key ? key < other.key : slot < other.slot;
    }
  };

  void sift(std::uint32_t at) noexcept {
    for (; at > 0 && heap_[at] < heap_[(at - 1) / 2]; at = (at - 1) / 2)
      exchange(at, (at - 1) / 2);
    while (true) {
      std::uint32_t least = at;
      for (std::uint32_t child = 2 * at + 1; child <= 2 * at + 2 && child < heap_.size(); ++child) {
        if (heap_[child] < heap_[least]) least = child;
      }
      if (least == at) return;
      exchange(at, least);
      at = least;
    }
  }

  void exchange(std::uint32_t i, std::uint32_t j) noexcept {
    std::swap(heap_[i], heap_[j]);
    position_[heap_[i].slot] = i;
    position_[heap_[j].slot] = j;
  }

  std::vector<Entry> heap_;
  std::vector<std::uint32_t> position_;  // per slot: position in the heap, or kNoSlot
};

}  // namespace trocar::runtime
