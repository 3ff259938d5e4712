// SPDX-License-Identifier: Apache-2.0
#include "runtime/reporting/plunge_meter.h"

#include <algorithm>
#include <utility>

#include "runtime/reporting/vector3.h"

namespace trocar::runtime {

double height_of(const Punctured& what, const Scene& scene,
                 const std::vector<ReportSheet>& sheets) {
  return what.is_layer ? scene.layers[what.index].top_z_m : sheets[what.index].z_m;
}

PlungeMeter::PlungeMeter(const Scene& scene, const std::vector<ReportSheet>& sheets, double rate_Hz)
    : scene_(scene),
      sheets_(sheets),
      stop_ticks_(ticks_of(kPlungeStop_s, rate_Hz)),
      max_ticks_(ticks_of(kPlunge_s, rate_Hz)) {
  recent_m_.resize(stop_ticks_);
}

void PlungeMeter::observe(const RecordingRow& row, const std::optional<Punctured>& punctured,
                          SessionFigures& figures) {
  constexpr double kFallen = 0.5;
  const double wanted_N =
      length({row.wrench_wanted[0], row.wrench_wanted[1], row.wrench_wanted[2]});
  const bool breaks_through = wanted_N <= kFallen * last_wanted_N_;
  last_wanted_N_ = wanted_N;
  if (punctured && breaks_through) {
    end(PlungeEnd::kNext, row.t_s, figures);
    open_.emplace();
    open_->what = *punctured;
    open_->t_s = open_->lowest_t_s = row.t_s;
    from_m_ = lowest_m_ = row.tool_m[2];
    ticks_ = 0;
  }
  if (open_) follow(row, figures);
}

void PlungeMeter::interrupt(double t_s, SessionFigures& figures) {
  last_wanted_N_ = 0;
  end(PlungeEnd::kFault, t_s, figures);
}

/// Takes the row of the break-through and the rows after it.
void PlungeMeter::follow(const RecordingRow& row, SessionFigures& figures) {
  const double z_m = row.tool_m[2];
  double& earlier_m = recent_m_[ticks_ % recent_m_.size()];
  const bool stops = ticks_ >= stop_ticks_ && earlier_m - z_m < kPlungeStep_m;
  earlier_m = z_m;
  if (z_m < lowest_m_) {
    lowest_m_ = z_m;
    open_->lowest_t_s = row.t_s;
  }
  if (z_m - lowest_m_ > kPlungeStep_m) {
    end(PlungeEnd::kReversed, row.t_s, figures);
  } else if (stops) {
    end(PlungeEnd::kStopped, row.t_s, figures);
  } else if (ticks_ >= max_ticks_) {
    end(PlungeEnd::kTime, row.t_s, figures);
  }
  ++ticks_;
}

void PlungeMeter::end(PlungeEnd end, double t_s, SessionFigures& figures) {
  if (!open_) return;
  BreakThrough made = *std::exchange(open_, std::nullopt);
  made.plunge_m = from_m_ - lowest_m_;
  made.below_m = height_of(made.what, scene_, sheets_) - lowest_m_;
  if (made.what.is_layer) made.below_m -= scene_.layers[made.what.index].thickness_m;
  made.ended_by = end;
  made.ended_t_s = t_s;
  figures.plunge_max_m = std::max(figures.plunge_max_m, made.plunge_m);
  keep(figures.break_throughs, kMaxReportPunctures, figures.break_throughs_count, made);
}

}  // namespace trocar::runtime
