// SPDX-License-Identifier: Apache-2.0
// The field for which the newest state of a device was refused. One thread writes it, another reads
// it; neither waits.
#pragma once

#include <atomic>
#include <cstdint>

#include "formats/session/fault_words.h"

namespace trocar::runtime {

class RefusedContents {
 public:
  /// Stores the fault kRefusedState with its field, or no fault if the newest state was accepted.
  void set(const FaultDetail& refused) noexcept {
    value_.store(refused.value, std::memory_order_relaxed);
    limit_.store(refused.limit, std::memory_order_relaxed);
    field_.store({refused.quantity, refused.index, refused.fault == Fault::kRefusedState},
                 std::memory_order_release);
  }
  /// The number can be that of an older refusal if both threads are here at the same time.
  FaultDetail get() const noexcept {
    const Field field = field_.load(std::memory_order_acquire);
    if (!field.is_refused) return {};
    return {Fault::kRefusedState, field.quantity, field.index,
            value_.load(std::memory_order_relaxed), limit_.load(std::memory_order_relaxed)};
  }

 private:
  struct alignas(std::uint32_t) Field {  // aligned: clang calls a library for others
    FaultQuantity quantity = FaultQuantity::kNone;
    std::int8_t index = -1;
    bool is_refused = false;
  };
  std::atomic<Field> field_{Field{}};
  std::atomic<double> value_{0}, limit_{0};
  static_assert(std::atomic<Field>::is_always_lock_free &&
                std::atomic<double>::is_always_lock_free);
};

}  // namespace trocar::runtime
