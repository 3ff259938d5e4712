// SPDX-License-Identifier: Apache-2.0
#include "runtime/reporting/tremor_meter.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "runtime/contact/tool.h"

namespace trocar::runtime {

TremorMeter::TremorMeter(const Scene& scene, double rate_Hz)
    : axis_plate_(make_tool(scene.tool).axis_plate),
      settle_ticks_(ticks_of(kTremorSettle_s, rate_Hz)) {
  for (std::size_t i = 0; i < filter_.size(); ++i) {
    const bool is_high_pass = i == 0;
    const double w =
        2 * std::numbers::pi * (is_high_pass ? kTremorLow_Hz : kTremorHigh_Hz) / rate_Hz;
    const double cosine = std::cos(w), alpha = std::sin(w) / std::numbers::sqrt2;
    filter_[i].a = {1 + alpha, -2 * cosine, 1 - alpha};
    const double b = is_high_pass ? (1 + cosine) / 2 : (1 - cosine) / 2;
    filter_[i].b = {b, is_high_pass ? -(1 + cosine) : 1 - cosine, b};
  }
}

Vector3 TremorMeter::Filter::pass(const Vector3& in) noexcept {
  Vector3 out{};
  for (std::size_t k = 0; k < 3; ++k)
    out[k] =
        (b[0] * in[k] + b[1] * x[0][k] + b[2] * x[1][k] - a[1] * y[0][k] - a[2] * y[1][k]) / a[0];
  x = {in, x[0]};
  y = {out, y[0]};
  return out;
}

void TremorMeter::observe(const RecordingRow& row, SessionFigures& figures) {
  if (filtered_ == 0) {
    origin_ = row.tool_m;
    for (Filter& each : filter_)
      each.x = each.y = {};
  }
  const Vector3 passed = filter_[1].pass(filter_[0].pass(minus(row.tool_m, origin_)));
  if (filtered_++ < settle_ticks_) return;
  Tremor* tremor = row.phase == ContactPhase::kFree      ? &figures.tremor_free
                   : row.phase == ContactPhase::kContact ? &figures.tremor_contact
                                                         : nullptr;
  if (tremor == nullptr) return;
  ++tremor->ticks;
  const Eigen::Quaterniond q(row.q[0], row.q[1], row.q[2], row.q[3]);
  tremor->squares_m2 += (q * axis_plate_).cross(Eigen::Vector3d(passed.data())).squaredNorm();
}

}  // namespace trocar::runtime
