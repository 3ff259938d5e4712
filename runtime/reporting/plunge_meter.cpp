// SPDX-License-Identifier: Apache-2.0
#include "runtime/reporting/plunge_meter.h"

#include <algorithm>
#include <utility>

namespace trocar::runtime {
namespace {

std::optional<Punctured> punctured_at(const ResistanceFall& found) {
  if (found.layer >= 0) return Punctured{true, static_cast<std::size_t>(found.layer)};
  if (found.sheet >= 0) return Punctured{false, static_cast<std::size_t>(found.sheet)};
  return std::nullopt;
}

}  // namespace

double height_of(const Punctured& what, const Scene& scene,
                 const std::vector<ReportSheet>& sheets) {
  return what.is_layer ? scene.layers[what.index].top_z_m : sheets[what.index].z_m;
}

PlungeMeter::PlungeMeter(const Scene& scene, const std::vector<ReportSheet>& sheets, double rate_Hz)
    : scene_(scene), sheets_(sheets), max_ticks_(ticks_of(kPlunge_s, rate_Hz)) {}

void PlungeMeter::observe(const RecordingRow& row, const BreakThroughTick& tick,
                          SessionFigures& figures) {
  if (!tick.is_running) return end(PlungeEnd::kFault, row.t_s, figures);
  if (tick.comes_back) end(PlungeEnd::kReversed, row.t_s, figures);
  const double z_m = row.tool_m[2];
  // A fall that is a break-through, but began so long ago that it is not measured any more.
  const bool is_late = tick.found && (open_.empty() || open_.back().is_break_through);
  if (tick.begun || is_late) {
    const ResistanceFall& fall = tick.begun ? *tick.begun : *tick.found;
    Open& open = open_.emplace_back();
    open.made.plunge_m = fall.run_m;
    open.made.hand_m = fall.run_hand_m;
    open.reference_N = open.made.tip_N = fall.reference_N;
    open.made.lowest_t_s = row.t_s;
    open.lowest_z_m = z_m;
    open.ticks_left = max_ticks_;
  }
  if (tick.found) {
    Open& open = open_.back();
    open.is_break_through = true;
    open.made.what = punctured_at(*tick.found);
    open.made.t_s = row.t_s;
    open.ticks_left = max_ticks_;
  }
  std::erase_if(open_, [&](Open& open) {
    const double loss = loss_of_resistance(tick.force_N, open.reference_N);
    open.made.plunge_m += loss * tick.advance_m;
    open.made.hand_m += loss * tick.hand_m;
    if (z_m < open.lowest_z_m) open.made.lowest_t_s = row.t_s;
    open.lowest_z_m = std::min(open.lowest_z_m, z_m);
    if (open.ticks_left == 0) {
      close(open, PlungeEnd::kTime, row.t_s, figures);
      return true;
    }
    --open.ticks_left;
    return false;
  });
}

void PlungeMeter::end(PlungeEnd end, double t_s, SessionFigures& figures) {
  for (const Open& open : std::exchange(open_, {}))
    close(open, end, t_s, figures);
}

void PlungeMeter::close(const Open& open, PlungeEnd end, double t_s,
                        SessionFigures& figures) const {
  figures.plunge_max_m = std::max(figures.plunge_max_m, open.made.plunge_m);
  if (!open.is_break_through) return;
  BreakThrough made = open.made;
  if (made.what) {
    made.below_m = height_of(*made.what, scene_, sheets_) - open.lowest_z_m;
    if (made.what->is_layer) *made.below_m -= scene_.layers[made.what->index].thickness_m;
  }
  made.ended_by = end;
  made.ended_t_s = t_s;
  figures.break_throughs.add(made);
}

}  // namespace trocar::runtime
