// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/front.h"

#include "runtime/haptics/bone/holes.h"

namespace trocar::runtime {
namespace {

constexpr double kSlabEndSlack_m = 1e-9;

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

using Eigen::Vector2d;

bool is_whole_below(const SoftLayer& layer, const SoftLayerState& s) noexcept {
  return s.cut_m < layer.bottom_m;
}

// Enters the nearest hole within the tool's radius; if there is none, starts on uncut tissue.
void enter(const Tick& tick, const SoftLayer& layer, SoftLayerState& s) noexcept {
  s.is_punctured = false;
  s.cut_m = layer.top_m;
  const Vector2d at = crossing(tick.tip, tick.axis, layer.top_m);
  double nearest = tick.options.tool.radius_m;
  for (SoftHole& hole : s.holes) {
    if (hole.last_used == 0) continue;
    const double distance = (hole.at_m - at).norm();
    if (distance > nearest) continue;
    nearest = distance;
    s.is_punctured = true;
    s.cut_m = hole.cut_m;
    s.at_m = hole.at_m;
  }
}

void leave(const Tick& tick, SoftLayerState& s) noexcept {
  if (!s.is_punctured || s.holes.empty()) return;
  SoftHole* to = s.holes.data();
  for (SoftHole& hole : s.holes) {
    if (hole.last_used != 0 && hole.at_m == s.at_m) {
      to = &hole;
      break;
    }
    if (hole.last_used < to->last_used) to = &hole;
  }
  *to = {s.at_m, s.cut_m, tick.state.tick};
}

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

Advance scan(const Tick& tick, double R, double K_s) noexcept {
  Advance a;
  double at = tick.front_m,
         left_m = std::max(0.0, most_cut_m(tick.options.interval_s) - tick.cut_m);
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
      const bool must_wait = dl >= left_m;
      dl = std::min(dl, left_m);
      left_m -= dl;
      a.work_J += dl * (Y + 0.5 * slope * dl);
      a.strength_N = Y + slope * dl;
      a.length_m += dl;
      a.cut_m += dl;
      if (dl < length || must_wait) return a;
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
  tick.cut_m += a.cut_m;
  tick.state.stretch_m -= a.length_m;
  tick.front_m += a.length_m * tick.down;
  tick.is_free = a.ends_free;
}

FrontMemory remember(const Tick& tick, const CuttingResult& out) noexcept {
  return {tick.state.stretch_m, tick.front_m, tick.cut_m, out.cut_J, tick.is_free};
}

void take_back(Tick& tick, const FrontMemory& was, CuttingResult& out) noexcept {
  tick.state.stretch_m = was.stretch_m;
  tick.front_m = was.front_m;
  tick.cut_m = was.cut_m;
  out.cut_J = was.cut_J;
  tick.is_free = was.is_free;
}

double stretch_at(const SoftLayer& layer, double force_N) noexcept {
  const double a1 = layer.stiffness_N_per_m, a2 = layer.stiffening_N_per_m2;
  if (force_N <= 0) return 0;
  const double root = a1 + std::sqrt(a1 * a1 + 4 * a2 * force_N);
  return root > 0 ? 2 * force_N / root : std::numeric_limits<double>::infinity();
}

void find_layers(Tick& tick) noexcept {
  const double tip_m = -tick.tip.z();
  for (std::size_t i = 0; i < tick.layers.size(); ++i) {
    const SoftLayer& layer = tick.layers[i];
    SoftLayerState& s = tick.state.layers[i];
    if (s.stretch_m > 0) {
      s.is_in = true;
      continue;
    }
    const bool is_in = tip_m > layer.top_m;
    if (s.is_in && !is_in) leave(tick, s);
    if (!s.is_in || !is_in) enter(tick, layer, s);
    s.is_in = is_in;
    // If the tip is below a layer that it has not cut, it came from the side: the layer is not
    // stretched.
    s.stretch_m = std::min((tip_m - s.cut_m) / tick.down, 0.0);
  }
}

SoftSpring spring_of_layers(const Tick& tick, double slide_m) noexcept {
  SoftSpring sum;
  for (std::size_t i = 0; i < tick.layers.size(); ++i) {
    const SoftLayerState& s = tick.state.layers[i];
    if (!is_whole_below(tick.layers[i], s)) continue;
    const SoftSpring one = soft_spring(tick.layers[i], s.stretch_m + slide_m);
    sum.energy_J += one.energy_J;
    sum.force_N += one.force_N;
    sum.stiffness_N_per_m += one.stiffness_N_per_m;
  }
  return sum;
}

double friction_of_layers(const Tick& tick) noexcept {
  const double tip_m = -tick.tip.z();
  double sum = 0;
  for (std::size_t i = 0; i < tick.layers.size(); ++i) {
    const SoftLayer& layer = tick.layers[i];
    const double low = std::min({tick.state.layers[i].cut_m, tip_m, layer.bottom_m});
    sum += layer.friction_N_per_m * std::max(low - layer.top_m, 0.0);
  }
  return sum / tick.down;
}

int pressed_layer(const Tick& tick, double slide_m) noexcept {
  for (std::size_t i = 0; i < tick.layers.size(); ++i) {
    const SoftLayerState& s = tick.state.layers[i];
    if (is_whole_below(tick.layers[i], s) && s.stretch_m + slide_m > 0) return static_cast<int>(i);
  }
  return -1;
}

LayerAdvance scan_layers(Tick& tick, double slide_m, double bone_N, double falling,
                         CuttingResult& out) noexcept {
  LayerAdvance a;
  const int pressed = pressed_layer(tick, slide_m);
  if (pressed < 0) return a;
  const auto i = static_cast<std::size_t>(pressed);
  const SoftLayer& layer = tick.layers[i];
  SoftLayerState& s = tick.state.layers[i];
  const double z = s.stretch_m + slide_m;
  const SoftSpring own = soft_spring(layer, z);
  // All layers above the pressed one are cut through or not reached, so all forces act on it.
  const double on_it = spring_of_layers(tick, slide_m).force_N + bone_N;
  if (!s.is_punctured) {
    if (on_it <= layer.puncture_N) return a;
    s.is_punctured = true;
    out.layers_punctured |= std::uint64_t{1} << i;
    s.at_m = crossing(tick.tip, tick.axis, layer.top_m);
  }
  const double Y = layer.cutting_N, below = on_it - own.force_N;
  if (on_it <= Y * (1 + 1e-12)) return a;
  a.layer = pressed;
  a.stiffness_N_per_m = own.stiffness_N_per_m;
  const double room = std::max((layer.bottom_m - s.cut_m) / tick.down, 0.0);
  if (below >= Y) {
    a.length_m = room;  // the force from below suffices to cut the whole layer
  } else if (falling >= 1) {
    a.length_m = std::min(z - stretch_at(layer, Y - below), room);
  } else {
    // The spring's force falls less steeply than its tangent, so this advance is not too long.
    a.length_m = std::min((on_it - Y) / (falling * own.stiffness_N_per_m), room);
  }
  a.ends_layer = a.length_m >= room;
  if (falling < 1 && below <= 0 && !a.ends_layer) {
    a.work_J = Y * a.length_m;  // the tip follows: the force is at least Y up to the end
    return a;
  }
  // If the layer's own force is less than its cutting force, the elements below supply the rest.
  // Then only the layer's own energy is counted.
  const double end = std::clamp(z - a.length_m, 0.0, z);
  const double enough = std::clamp(stretch_at(layer, Y), end, z);
  a.work_J =
      Y * (z - enough) + soft_spring(layer, enough).energy_J - soft_spring(layer, end).energy_J;
  return a;
}

void take(Tick& tick, const LayerAdvance& advance, CuttingResult& out) noexcept {
  if (advance.layer < 0) return;
  const auto i = static_cast<std::size_t>(advance.layer);
  SoftLayerState& s = tick.state.layers[i];
  s.stretch_m -= advance.length_m;
  s.cut_m += advance.length_m * tick.down;
  if (advance.ends_layer) s.cut_m = tick.layers[i].bottom_m;
  out.layer_cut_J += advance.work_J;
}

void finish_layers(Tick& tick, double slide_m, CuttingResult& out) noexcept {
  for (std::size_t i = 0; i < tick.layers.size(); ++i) {
    SoftLayerState& s = tick.state.layers[i];
    const bool is_whole = is_whole_below(tick.layers[i], s);
    if (is_whole) out.layer_N += soft_spring(tick.layers[i], s.stretch_m + slide_m).force_N;
    s.stretch_m = is_whole ? s.stretch_m + slide_m : std::min(s.stretch_m + slide_m, 0.0);
  }
}

}  // namespace trocar::runtime
