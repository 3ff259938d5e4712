// SPDX-License-Identifier: Apache-2.0
#include "runtime/bone_cutting/law/front.h"

#include <algorithm>

#include "runtime/bone_cutting/law/holes.h"

namespace trocar::runtime {
namespace {

constexpr double kSlabEndSlack_m = 1e-9;

}  // namespace

void find_front(Tick& tick) noexcept {
  const double tip_m = -tick.tip.z();
  if (tick.state.stretch_m > 0) {
    const int i = tick.state.bearing;
    tick.front_m = i >= 0 && i < tick.slab_count() ? tick.slab(i).top_m
                                                   : tip_m - tick.state.stretch_m * tick.down;
    tick.first_front_m = tick.front_m;
    return;
  }
  tick.front_m = std::numeric_limits<double>::infinity();
  for (int i = tick.slab_at(tip_m - kSlabEndSlack_m); i < tick.slab_count(); ++i) {
    const CuttingSlab& slab = tick.slab(i);
    if (std::max({slab.strength_top_N, slab.strength_bottom_N, slab.cortex_N}) <= 0) continue;
    const double cut = cut_of(tick, i);
    if (cut >= slab.bottom_m) continue;
    if (slab.share <= 0 && slab.share_to_m >= slab.bottom_m) continue;
    tick.front_m = std::max({slab.top_m, cut, tip_m});
    if (slab.share <= 0) tick.front_m = std::max(tick.front_m, slab.share_to_m);
    tick.front_m = std::min(tick.front_m, slab.bottom_m);
    break;
  }
  tick.first_front_m = tick.front_m;
  tick.state.stretch_m = std::min((tip_m - tick.front_m) / tick.down, 0.0);
}

namespace {

Advance to_rest(Advance a, double R, double K_s) noexcept {
  a.length_m = std::max(a.length_m, R / K_s);
  a.strength_N = 0;
  a.ends_free = true;
  return a;
}

// Returns the end of the part of a slab that begins at the depth `top`. Within a part the share is constant and the
// strength is linear.
double part_end(const CuttingSlab& slab, double top) noexcept {
  double end = slab.bottom_m;
  for (const double change : {slab.share_to_m, slab.upper_wall_to_m, slab.lower_wall_from_m})
    if (change > top) end = std::min(end, change);
  return end;
}

bool is_cortex(const CuttingSlab& slab, double depth) noexcept {
  return depth < slab.upper_wall_to_m || depth >= slab.lower_wall_from_m;
}

}  // namespace

Advance scan(const Tick& tick, double R, double K_s) noexcept {
  Advance a;
  double at = tick.front_m;
  // If the front is at the boundary of two slabs, the lower slab counts.
  for (int i = tick.slab_at(tick.front_m); i < tick.slab_count(); ++i) {
    const CuttingSlab& slab = tick.slab(i);
    const double thickness = slab.bottom_m - slab.top_m;
    if (thickness > 0 && slab.bottom_m <= at) continue;
    const double cut = cut_of(tick, i);
    if (cut >= slab.bottom_m) continue;
    const double slope_depth =
        thickness > 0 ? (slab.strength_bottom_N - slab.strength_top_N) / thickness : 0;
    if (thickness <= 0 && slab.share_to_m < slab.top_m) continue;
    double bottom = slab.top_m;
    do {
      const double top = bottom;
      bottom = part_end(slab, top);
      if (thickness > 0 && bottom <= at) continue;
      const double share = top < slab.share_to_m || thickness <= 0 ? slab.share : 1;
      const double from = std::max({top, cut, at});
      if (thickness > 0 && from >= bottom) continue;
      if (from > at) {  // nothing to cut up to there
        const double gap = (from - at) / tick.down;
        if (R - K_s * (a.length_m + gap) <= 0) return to_rest(a, R, K_s);
        a.length_m += gap;
        at = from;
      }
      const bool cortex = is_cortex(slab, top);
      const double Y =
          share * (cortex ? slab.cortex_N : slab.strength_top_N + slope_depth * (at - slab.top_m));
      const double slope = cortex ? 0 : share * slope_depth * tick.down;
      const double excess = R - K_s * a.length_m - Y;
      if (excess <= 0) return a;
      const double length = (bottom - at) / tick.down;
      double dl = length;
      if (K_s + slope > 0) dl = std::min(excess / (K_s + slope), length);
      a.work_J += dl * (Y + 0.5 * slope * dl);
      a.strength_N = Y + slope * dl;
      a.length_m += dl;
      if (dl < length) return a;
      at = bottom;
    } while (bottom < slab.bottom_m);
  }
  return to_rest(a, R, K_s);
}

int bearing_slab(const Tick& tick) noexcept {
  if (tick.state.stretch_m <= 0 || tick.is_free) return -1;
  const int i = tick.slab_at(tick.front_m - kSlabEndSlack_m);
  const bool rests = i < tick.slab_count() && tick.slab(i).bottom_m <= tick.slab(i).top_m &&
                     tick.slab(i).top_m < tick.front_m + kSlabEndSlack_m;
  return rests ? i : -1;
}

void take(Tick& tick, const Advance& a, CuttingResult& out) noexcept {
  out.cut_J += a.work_J;
  tick.state.stretch_m -= a.length_m;
  tick.front_m += a.length_m * tick.down;
  tick.is_free = a.ends_free;
}

FrontMemory remember(const Tick& tick, const CuttingResult& out) noexcept {
  return {tick.state.stretch_m, tick.front_m, out.cut_J, tick.is_free};
}

void take_back(Tick& tick, const FrontMemory& was, CuttingResult& out) noexcept {
  tick.state.stretch_m = was.stretch_m;
  tick.front_m = was.front_m;
  out.cut_J = was.cut_J;
  tick.is_free = was.is_free;
}

}  // namespace trocar::runtime
