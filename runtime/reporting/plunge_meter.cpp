// SPDX-License-Identifier: Apache-2.0
#include "runtime/reporting/plunge_meter.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <utility>

#include "runtime/contact/tool.h"
#include "runtime/reporting/vector3.h"

namespace trocar::runtime {

double height_of(const Punctured& what, const Scene& scene,
                 const std::vector<ReportSheet>& sheets) {
  return what.is_layer ? scene.layers[what.index].top_z_m : sheets[what.index].z_m;
}

PlungeMeter::PlungeMeter(const Scene& scene, const std::vector<ReportSheet>& sheets, double rate_Hz)
    : scene_(scene),
      sheets_(sheets),
      tip_plate_m_(make_tool(scene.tool).tip_plate_m),
      stop_ticks_(ticks_of(kPlungeStop_s, rate_Hz)),
      max_ticks_(ticks_of(kPlunge_s, rate_Hz)) {
  recent_m_.resize(stop_ticks_);
}

PlungeMeter::Heights PlungeMeter::heights_of(const RecordingRow& row) const {
  const Eigen::Quaterniond q(row.q[0], row.q[1], row.q[2], row.q[3]);
  return {row.tool_m[2], row.p_m[2] + (q * tip_plate_m_).z()};
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
    from_ = lowest_ = last_.value_or(heights_of(row));
    ticks_ = 0;
  }
  if (open_) follow(row, figures);
  last_ = heights_of(row);
}

void PlungeMeter::interrupt(double t_s, SessionFigures& figures) {
  last_wanted_N_ = 0;
  last_.reset();
  end(PlungeEnd::kFault, t_s, figures);
}

/// Takes the row of the break-through and the rows after it.
void PlungeMeter::follow(const RecordingRow& row, SessionFigures& figures) {
  const Heights here = heights_of(row);
  const double z_m = here.tip_m;
  double& earlier_m = recent_m_[ticks_ % recent_m_.size()];
  const bool stops = ticks_ >= stop_ticks_ && earlier_m - z_m < kPlungeStep_m;
  earlier_m = z_m;
  if (z_m < lowest_.tip_m) {
    lowest_ = here;
    open_->lowest_t_s = row.t_s;
  }
  if (z_m - lowest_.tip_m > kPlungeStep_m) {
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
  made.plunge_m = from_.tip_m - lowest_.tip_m;
  made.hand_m = from_.plate_m - lowest_.plate_m;
  made.below_m = height_of(made.what, scene_, sheets_) - lowest_.tip_m;
  if (made.what.is_layer) made.below_m -= scene_.layers[made.what.index].thickness_m;
  made.ended_by = end;
  made.ended_t_s = t_s;
  figures.plunge_max_m = std::max(figures.plunge_max_m, made.plunge_m);
  figures.break_throughs.add(made);
}

}  // namespace trocar::runtime
