// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/tick_feed.h"

#include <utility>

namespace trocar::runtime {

TickFeed::TickFeed(std::function<void(const ObservedTick&)> observe)
    : TickObserver(std::chrono::milliseconds(20)), observe_(std::move(observe)) {}

void TickFeed::on_tick(const TickView& tick) noexcept {
  ObservedTick observed;
  observed.row = tick.result.row;
  for (const CutRequest& cut : tick.result.contact.cuts())
    (cut.is_puncture ? observed.punctured : observed.side_cut) |= std::uint64_t{1} << cut.sheet;
  observed.layers_punctured = tick.result.contact.layers_punctured;
  observed.tip_N = tick.result.contact.force_before_N;
  observed.break_through = tick.result.break_through;
  if (!ticks_.push(observed)) lost_.fetch_add(1, std::memory_order_relaxed);
}

void TickFeed::serve() {
  ObservedTick tick;
  while (ticks_.pop(tick))
    observe_(tick);
}

}  // namespace trocar::runtime
