// SPDX-License-Identifier: Apache-2.0
// Contract 1 of cutting_law.h in random sessions: bodies, tools, hands with mass, rates; push,
// hold, hammer, twist, drag sideways, slide on the surface under load, withdraw, enter again; with
// soft layers or without, on slopes that change or level, with a bevelled tip or another.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <random>
#include <vector>

#include "runtime/haptics/bone/cutting_law.h"
#include "tests/support/campaign.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

class Draws {
 public:
  explicit Draws(unsigned seed) : engine_(seed) {}
  double uniform(double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(engine_);
  }
  double power(double a, double b) { return std::pow(10.0, uniform(a, b)); }
  bool chance(double p) { return uniform(0, 1) < p; }
  int integer(int most) { return static_cast<int>(uniform(0, most)); }

 private:
  std::mt19937 engine_;
};

struct Session {
  CuttingOptions options;
  std::vector<CuttingSlab> slabs;
  std::vector<SoftLayer> layers;
  CuttingState state;
};

Session random_session(Draws& random) {
  Session s;
  const int count = 1 + random.integer(40);
  const double thickness = random.power(-3.6, -2.7);
  const double friction = random.chance(0.3) ? 0 : random.uniform(0, 300);
  const double wall = random.power(5.5, 8), strength = random.power(3, 4.7);
  const double clearance = random.chance(0.5) ? 0 : random.power(-5, -3.7);
  const bool gaps = random.chance(0.2), sheets = random.chance(0.1);
  double before = random.uniform(5, 100);
  for (int i = 0; i < count; ++i) {
    CuttingSlab slab;
    slab.top_m = i * thickness;
    slab.bottom_m = slab.top_m + (sheets ? 0 : thickness * (gaps ? random.uniform(0, 1) : 1));
    slab.strength_top_N = before;
    slab.strength_bottom_N = before =
        random.chance(0.2) ? random.uniform(0, 100) : before * random.uniform(0.8, 1.1);
    slab.friction_N_per_m = friction;
    slab.wall_N_per_m2 = wall;
    slab.wall_strength_N_per_m = strength;
    slab.clearance_m = clearance;
    s.slabs.push_back(slab);
  }
  CuttingOptions& o = s.options;
  o.tool.tip_plate_m = {0, 0, -random.uniform(0.05, 0.15)};
  o.tool.radius_m = random.power(-3.3, -2.5);
  o.coupling.translation_N_per_m = random.power(3, 4.5);
  o.coupling.rotation_Nm_per_rad = random.power(0.5, 2);
  if (random.chance(0.5)) {
    o.coupling.max_force_N = random.uniform(5, 60);
    o.coupling.max_moment_Nm = random.uniform(0.2, 3);
  }
  o.coupling.is_rigid = random.chance(0.25);
  o.tip_N_per_m = random.power(3.7, 6.3);
  o.presliding_m = random.power(-5, -3.5);
  o.same_hole_m = random.power(-5, -3);
  o.max_steps = random.chance(0.2) ? 1 + random.integer(4) : 12;
  s.state = make_cutting_state(s.slabs.size(), static_cast<std::size_t>(random.integer(4)));
  return s;
}

// Cortical walls in some slabs, some of them up to the whole slab.
void add_walls(Draws& random, Session& s) {
  for (CuttingSlab& slab : s.slabs) {
    const double thickness = slab.bottom_m - slab.top_m;
    slab.cortex_N = random.uniform(0, 150);
    if (random.chance(0.3)) slab.upper_wall_to_m = slab.top_m + random.uniform(0, 1.1) * thickness;
    if (random.chance(0.2))
      slab.lower_wall_from_m = slab.bottom_m - random.uniform(0, 1.1) * thickness;
  }
}

// Soft tissue over the bone, into it and within.
void add_layers(Draws& random, Session& s) {
  double at = random.uniform(-0.001, 0.004);
  for (int i = 0, count = 1 + random.integer(3); i < count; ++i) {
    SoftLayer layer;
    layer.top_m = at;
    layer.bottom_m = at + random.power(-3.7, -2.2);
    layer.stiffness_N_per_m = random.chance(0.1) ? 0 : random.power(1, 3.7);
    layer.stiffening_N_per_m2 = random.chance(0.2) ? 0 : random.power(3, 6);
    layer.puncture_N = random.power(-1, 1.5);
    layer.cutting_N = layer.puncture_N * random.uniform(0, 1);
    layer.friction_N_per_m = random.chance(0.3) ? 0 : random.uniform(0, 300);
    at = layer.bottom_m + (random.chance(0.5) ? 0 : random.uniform(0, 0.003));
    s.layers.push_back(layer);
  }
  s.options.layers = s.layers;
  s.state.layers.resize(s.layers.size());
  for (SoftLayerState& layer : s.state.layers)
    layer.holes.resize(static_cast<std::size_t>(random.integer(3)));
}

// Target of a hand: the tip's position and the tool's attitude.
struct Aim {
  int kind = 0;
  double depth = 0, speed = 0, side = 0, tilt = 0, turn = 0, f1 = 0, f2 = 0;
  Pose at(double t, const Vector3d& tip_plate) const {
    if (kind == 6) t = std::floor(t / 0.1) * 0.05 + std::min(std::fmod(t, 0.1), 0.05);  // and waits
    double d = std::min(speed * t, depth) - 0.002, x = 0, y = 0;
    const double ramp = std::min(3 * t, 1.0);
    double lean = tilt * ramp, twist = 0;
    if (kind == 1) d = depth * (0.6 - 0.6 * std::cos(6.28 * f1 * t)) - 0.002;  // out and in
    if (kind == 2 && t > 0.25) d -= speed * (t - 0.25);                        // withdraws
    if (kind == 3) d = std::min(d, 5e-4);                                      // on the surface
    if (kind == 4) twist = turn * std::sin(6.28 * f1 * t);
    if (kind != 5) {
      x = side * std::sin(6.28 * f2 * t) * ramp;
      y = 0.3 * side * std::sin(5 * t);
    } else {
      lean = 0;
      const double phase = std::fmod(t, 0.15);  // enters again beside
      x = side * std::floor(t / 0.15);
      d = depth * std::min(phase, 0.15 - phase) / 0.075 - 0.002;
    }
    Pose X;
    X.q = from_rotation_vector({0.3 * lean * std::sin(f2 * t), lean, twist});
    X.p_m = Vector3d(x, y, -d) - X.q * tip_plate;
    return X;
  }
};

// The plate in a hand of a mass that springs pull to the aim.
struct Hand {
  double mass = 1, inertia = 1e-3, spring = 1000, turn_spring = 10, damping = 1;
  Pose X;
  Twist v = Twist::Zero();
  void move(const Pose& aim, const Wrench& on_plate, double dt) {
    constexpr int kParts = 10;
    for (int k = 0; k < kParts; ++k) {
      const Twist e = displacement(X, aim);
      const Vector3d f = spring * e.head<3>() - 2 * damping * v.head<3>() + on_plate.head<3>();
      const Vector3d n =
          turn_spring * e.tail<3>() - 0.01 * damping * v.tail<3>() + on_plate.tail<3>();
      v.head<3>() += f / mass * dt / kParts;
      v.tail<3>() += n / inertia * dt / kParts;
      X.p_m += v.head<3>() * dt / kParts;
      X.q = (from_rotation_vector(v.tail<3>() * dt / kParts) * X.q).normalized();
    }
  }
};

Vector2d crossing_of(const Pose& X, const CuttingTool& tool, double depth) {
  const Vector3d tip = X * tool.tip_plate_m, axis = X.q * tool.inward_plate;
  return (tip + axis * ((-depth - tip.z()) / axis.z())).head<2>();
}

// The direction in which a displacement of the tip stretches its spring by its length: along the axis, or along a
// surface's normal, scaled to 1 along the axis. The angle between them is at most 60 degrees. `bevel`: to the side.
Vector3d pressed_along(const Vector3d& axis, const Vector3d& bevel,
                       const std::optional<Vector2d>& slope) {
  if (!slope) return axis + bevel;
  const Vector3d inwards = -Vector3d(slope->x(), slope->y(), 1);
  const double along = inwards.dot(axis);
  const Vector3d across = inwards - along * axis;
  if (across.norm() < std::sqrt(3.0) * along) return inwards / along;
  return axis + std::sqrt(3.0) * across.normalized();
}

// An upper bound of what holding the wrench from pose A to B leaks where the coupling is rigid: for
// each spring k of force f half of k times the square of its path, and f times the part of the path
// that the held wrench, being straight, does not know. `was` and `is`: the states at A and B.
double rigid_leak(const Session& s, const CuttingState& was, const CuttingState& is, const Pose& A,
                  const Pose& B) {
  const CuttingTool& tool = s.options.tool;
  const Twist dx = displacement(A, B);
  const Vector3d axis = A.q * tool.inward_plate, lever = A.q * tool.tip_plate_m,
                 omega = dx.tail<3>();
  const double along = axis.dot(B * tool.tip_plate_m - A * tool.tip_plate_m);
  const double straight = axis.dot(dx.head<3>() + omega.cross(lever));
  const Eigen::Quaterniond turned = B.q * A.q.conjugate();
  const double around = 2 * tool.radius_m * axis.dot(turned.vec()) * (turned.w() < 0 ? -1 : 1);
  const double tip_N = s.options.tip_N_per_m * std::max(was.stretch_m, 0.0);
  const Vector3d slipped = B * tool.tip_plate_m - A * tool.tip_plate_m,
                 straight_slip = dx.head<3>() + omega.cross(lever);
  const Vector3d press = pressed_along(axis, A.q * tool.bevel_plate, was.slope),
                 normal = pressed_along(axis, Vector3d::Zero(), was.slope);
  const double pressed = press.dot(slipped), pressed_straight = press.dot(straight_slip);
  double leak =
      0.5 * s.options.tip_N_per_m * pressed * pressed + tip_N * (pressed - pressed_straight);
  const double k = std::max(was.friction_N_per_m, is.friction_N_per_m);
  const Vector2d f = was.friction_N_per_m * was.presliding_m;
  leak += 0.5 * k * (along * along + around * around) + f[0] * (along - straight) +
          f[1] * (around - tool.radius_m * axis.dot(omega));
  const double shear = std::max(was.tip_friction_N_per_m, is.tip_friction_N_per_m);
  leak += 0.5 * shear *
              (slipped - normal * (normal.dot(slipped) / normal.squaredNorm())).squaredNorm() +
          was.tip_friction_N_per_m * was.tip_slip_m.dot(slipped - straight_slip);
  leak += 0.5 * std::max(was.torsion_N_per_m, is.torsion_N_per_m) * around * around +
          was.torsion_N_per_m * was.torsion_slip_m * (around - tool.radius_m * axis.dot(omega));
  leak += 0.5 * std::max(was.hold_N_per_m, is.hold_N_per_m) * pressed * pressed +
          was.hold_N_per_m * was.hold_slip_m * (pressed - pressed_straight);
  for (std::size_t i = 0; i < s.layers.size(); ++i) {
    const double z = std::max(was.layers[i].stretch_m, 0.0);
    const double stiffest = soft_spring(s.layers[i], z + std::abs(along)).stiffness_N_per_m;
    const double least = std::max(soft_spring(s.layers[i], z).force_N, 0.0);
    leak += 0.5 * stiffest * along * along + least * (along - straight);
  }
  const int hole = std::max(was.hole, is.hole);
  if (hole < 0) return leak;
  const auto h = static_cast<std::size_t>(hole);
  for (std::size_t i = 0; i < s.slabs.size(); ++i) {
    const CuttingHoleSlab &a = was.holes[h].slabs[i], &b = is.holes[h].slabs[i];
    const double stiffness =
        std::max(a.embedded_m > 0 ? a.wall_N_per_m : 0, b.embedded_m > 0 ? b.wall_N_per_m : 0);
    if (stiffness <= 0) continue;
    for (std::size_t g = 0; g < 2; ++g) {
      const double depth = b.embedded_m > 0 ? b.depth_m[g] : a.depth_m[g];
      const Vector2d u = crossing_of(A, tool, depth), du = crossing_of(B, tool, depth) - u;
      leak += 0.5 * stiffness * du.squaredNorm();
      if (a.embedded_m <= 0) continue;
      const Vector3d to =
          A * tool.tip_plate_m + axis * ((-depth - (A * tool.tip_plate_m).z()) / axis.z()) - A.p_m;
      const Vector3d moved = dx.head<3>() + omega.cross(to);
      const Vector2d flat = (moved - axis * (moved.z() / axis.z())).head<2>();
      const Slot::Reach r = a.walls[g].reach(u);
      leak += a.wall_N_per_m * r.distance_m * r.away.dot(du - flat);
    }
  }
  return leak;
}

// Contract 2: a lower bound of the tip's force after an advance, which is the strength just above the
// front. The bound is 0 if the front stopped where bone begins below a gap, or below the cut of an
// earlier visit to the hole. `was`: the state before the advance.
double strength_above(const Session& s, const CuttingState& was, double front_m) {
  const double above = front_m - 1e-9;  // rounding may put the front on either side of a boundary
  for (std::size_t i = 0; i < s.slabs.size(); ++i) {
    const CuttingSlab& slab = s.slabs[i];
    if (above <= slab.top_m || above > slab.bottom_m) continue;
    const bool has_hole = s.state.hole >= 0;
    if (has_hole && was.holes[static_cast<std::size_t>(s.state.hole)].slabs[i].cut_m >= above)
      return 0;
    if (above <= slab.upper_wall_to_m || above > slab.lower_wall_from_m) return slab.cortex_N;
    return slab.strength_top_N + (slab.strength_bottom_N - slab.strength_top_N) *
                                     (front_m - slab.top_m) / (slab.bottom_m - slab.top_m);
  }
  return 0;
}

TEST(CuttingEnergy, NoTickGivesMoreThanHoldingLeaks) {
  Draws random(11), layers(12), tips(13), holds(14), slopes(15), twists(16), bevels(17), walls(18);
  long ticks = 0, cutting = 0, stopped = 0, too_far = 0, unconverged = 0, gained = 0, torn = 0,
       slipped = 0, held = 0, sloped = 0, twisted = 0, bevelled = 0;
  const int sessions = test::campaign(1500);
  for (int n = 0; n < sessions; ++n) {
    Session s = random_session(random);
    if (layers.chance(0.4)) add_layers(layers, s);
    if (walls.chance(0.3)) add_walls(walls, s);
    if (tips.chance(0.4)) {
      s.options.tip_friction = tips.uniform(0.05, 0.8);
      s.options.tip_presliding_m = tips.power(-5, -3.5);
    }
    if (holds.chance(0.4)) s.options.tip_hold = holds.uniform(0.05, 1);
    const bool resists_twist = twists.chance(0.3);
    if (bevels.chance(0.3)) {
      const double way = bevels.uniform(0, 6.28);
      s.options.tool.bevel_plate =
          bevels.uniform(0, kMaxSlope) * Vector3d(std::cos(way), std::sin(way), 0);
    }
    // Level, a plane, or a surface that turns under the tip.
    const int surface = slopes.integer(4);
    const double steepness = slopes.uniform(0, 2.5);
    Aim aim;
    aim.kind = random.integer(7);
    aim.depth = random.uniform(0.002, 0.05);
    aim.speed = random.power(-1.7, 0);
    aim.side = random.power(-4, -1.8);
    aim.tilt = random.chance(0.3) ? 0 : random.uniform(-0.3, 0.3);
    aim.turn = random.uniform(0, 2);
    aim.f1 = random.uniform(0.5, 8);
    aim.f2 = random.uniform(0.5, 8);
    const double dt = 1 / random.power(2.7, 3.9);
    const bool in_hand = random.chance(0.5), varies = random.chance(0.3),
               has_free = random.chance(0.2);
    Slot free;
    Hand hand;
    hand.mass = random.power(-1, 0.7);
    hand.inertia = 2e-3 * (1 + hand.mass);
    hand.spring = random.chance(0.3) ? random.uniform(0, 300) : random.uniform(0, 8000);
    hand.turn_spring = random.uniform(0, 60);
    hand.X = aim.at(0, s.options.tool.tip_plate_m);
    if (random.chance(0.2)) hand.v[2] = -random.uniform(0.3, 3);  // a blow
    Pose before;
    CuttingState was;
    Wrench w = Wrench::Zero();
    double stored = 0;
    CuttingResult out;
    const int last = std::min(static_cast<int>(0.5 / dt), 600);
    for (int k = 0; k < last; ++k) {
      const Pose X = in_hand ? hand.X : aim.at(k * dt, s.options.tool.tip_plate_m);
      const Vector3d axis = X.q * s.options.tool.inward_plate;
      if (!X.p_m.allFinite() || X.p_m.norm() > 1 || axis.z() > -0.75) break;  // out of the hand
      if (varies) {
        for (CuttingSlab& slab : s.slabs) {
          slab.share = random.chance(0.5) ? 1 : random.uniform(0, 1);
          slab.share_to_m = random.chance(0.5) ? slab.bottom_m : random.uniform(0, 0.05);
        }
      }
      if (has_free && random.chance(0.05)) {  // bone beside the tool, seen anew
        const double x = random.uniform(-0.002, 0.01), y = random.uniform(-0.02, 0.02);
        free.open({-1, -1}, 0);
        for (const Vector2d& corner : {Vector2d(x + y, -1), {x - y, 1}, {-1, 1}})
          free.include(corner);
        for (CuttingSlab& slab : s.slabs) {
          slab.free = &free;
          ++slab.free_version;
        }
      }
      if (resists_twist && twists.chance(0.1))
        s.options.torsion_Nm = twists.chance(0.2) ? 0 : twists.power(-4, -1);
      if (surface == 2 && k == 0) {
        const double way = slopes.uniform(0, 6.28);
        s.options.slope = steepness * Vector2d(std::cos(way), std::sin(way));
      } else if (surface == 3 && slopes.chance(0.1)) {
        s.options.slope.reset();
        if (slopes.chance(0.8))
          s.options.slope = Vector2d(slopes.uniform(-3, 3), slopes.uniform(-3, 3));
      }
      was = s.state;
      cutting_tick(s.options, X, s.slabs, s.state, out);
      ASSERT_TRUE(out.wrench_device.allFinite());
      ASSERT_GE(out.cut_J, 0);
      ASSERT_GE(out.layer_cut_J, 0);
      torn += out.layer_cut_J > 0;
      slipped += s.state.tip_slip_m.norm() > 0;
      held += s.state.hold_slip_m < 0;
      twisted += s.state.torsion_slip_m != 0;
      sloped += s.state.slope && s.state.stretch_m > 0;
      bevelled += !s.options.tool.bevel_plate.isZero(0) && !s.state.slope && out.cut_J > 0;
      if (out.cut_J > 0 && out.has_converged && !varies && !has_free) {
        const double Y = strength_above(s, was, out.front_m);
        const bool is_too_far = out.tip_N < Y - 1e-4 * std::max(1.0, Y);
        EXPECT_FALSE(is_too_far && s.options.coupling.is_rigid) << out.tip_N << " of " << Y << " N";
        too_far += is_too_far;
        ++stopped;
      }
      if (k > 0) {
        const Twist dx = displacement(before, X);
        double leak = 0.5 * s.options.coupling.translation_N_per_m * dx.head<3>().squaredNorm() +
                      0.5 * s.options.coupling.rotation_Nm_per_rad * dx.tail<3>().squaredNorm();
        if (s.options.coupling.is_rigid) leak = rigid_leak(s, was, s.state, before, X);
        const double gain = out.stored_J - stored + out.cut_J + out.layer_cut_J + w.dot(dx);
        gained += gain > 0;
        ASSERT_LE(gain - leak, 1e-12) << "session " << n << " tick " << k << " kind " << aim.kind
                                      << " rigid " << s.options.coupling.is_rigid;
      }
      before = X;
      w = out.wrench_device;
      stored = out.stored_J;
      ++ticks;
      cutting += out.cut_J > 0;
      unconverged += !out.has_converged && s.options.max_steps >= 12;
      if (in_hand) hand.move(aim.at(k * dt, s.options.tool.tip_plate_m), w, dt);
    }
  }
  EXPECT_GT(cutting, ticks / 50);
  EXPECT_GT(torn, ticks / 1000);
  EXPECT_GT(slipped, ticks / 50);
  EXPECT_GT(held, ticks / 100);
  EXPECT_GT(sloped, ticks / 20);
  EXPECT_GT(bevelled, cutting / 10);
  EXPECT_GT(twisted, ticks / 50);
  EXPECT_GT(stopped, cutting / 4);
  // With a compliant coupling, a tool that tilts over while the front advances loses force by that.
  // Compilers and processors round differently, and the hands amplify it, so this count may differ.
  EXPECT_LE(too_far, stopped / 2000);
  EXPECT_GT(gained, ticks / 20);  // or the bound would not be tried
  EXPECT_LT(unconverged, ticks / 200);
}

}  // namespace
}  // namespace trocar::runtime
