// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/live_hand.h"

#include "formats/base/text.h"
#include "runtime/session/open_device.h"
#include "runtime/session/pose_session.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr double kTimeConstant_s = 0.012, kReleaseSpeed_m_per_s = 0.3;
constexpr std::int64_t kSilent_ns = 250'000'000;
constexpr double kBoxMargin_m = 5e-3, kLevel_m = 0.01, kNarrowest_m = 0.02;
// The target is ahead of the tip by the force over the stiffness: in all 16 mm for a sheet of 35 N.
constexpr double kBelowSlices_m = 0.02;
constexpr double kMaxStated_m = 1, kMaxStated_rad = 7;
constexpr std::size_t kMaxTargets = std::size_t{1} << 18;
constexpr double kPathTolerance_m = 5e-6, kPathTolerance_rad = 5e-5;

Vector3d shortened(const Vector3d& v, double longest) noexcept {
  const double length = v.norm();
  return length > longest ? Vector3d(v * (longest / length)) : v;
}

struct Box {
  Vector3d min_m, max_m;
};

/// Returns a box of tip positions at heights around that of the start, all of which the tip reaches with the
/// start's rotation, less the margin. It goes down to `low_m` if it is then at least kNarrowest_m wide, or
/// else as far as possible. Of such boxes it is the largest.
std::optional<Box> largest_box(const DeviceSpecification& device, const SafetyLimits& limits,
                               const Tool& tool, const Pose& start, double low_m) {
  const auto heights = workspace_heights(device, limits, tool, start.q);
  if (!heights) return std::nullopt;
  struct Level {
    double z_m;
    WorkspaceRectangle rectangle;
  };
  std::vector<Level> levels;
  // One of the levels is where the box should end below.
  const double wanted_m = std::clamp(low_m - kBoxMargin_m, heights->min_m, heights->max_m);
  const int below = static_cast<int>((wanted_m - heights->min_m) / kLevel_m);
  for (int i = -below; wanted_m + i * kLevel_m <= heights->max_m; ++i) {
    const double z_m = wanted_m + i * kLevel_m;
    if (const auto r = workspace_rectangle(device, limits, tool, z_m, start.q))
      levels.push_back({z_m, *r});
  }
  std::optional<Box> best;
  double lowest_m = 0, largest = 0;
  for (std::size_t low = 0; low < levels.size(); ++low) {
    WorkspaceRectangle common = levels[low].rectangle;
    for (std::size_t high = low; high < levels.size(); ++high) {
      common.min_m = common.min_m.cwiseMax(levels[high].rectangle.min_m);
      common.max_m = common.max_m.cwiseMin(levels[high].rectangle.max_m);
      const Box box{{common.min_m.x() + kBoxMargin_m, common.min_m.y() + kBoxMargin_m,
                     levels[low].z_m + kBoxMargin_m},
                    {common.max_m.x() - kBoxMargin_m, common.max_m.y() - kBoxMargin_m,
                     levels[high].z_m - kBoxMargin_m}};
      const Vector3d size_m = box.max_m - box.min_m;
      if (!(size_m.head<2>().minCoeff() >= kNarrowest_m) || !(start.p_m.z() >= box.min_m.z()) ||
          !(start.p_m.z() <= box.max_m.z()))
        continue;
      const double down_to_m = std::max(low_m, box.min_m.z());
      if (best && !(down_to_m < lowest_m || (down_to_m == lowest_m && size_m.prod() > largest)))
        continue;
      lowest_m = down_to_m;
      largest = size_m.prod();
      best = box;
    }
  }
  return best;
}

}  // namespace

Result<LiveHandLimits> live_hand_limits(const Scene& scene, const DeviceSpecification& device,
                                        const SafetyLimits& limits) {
  LiveHandLimits out;
  out.T_device_tool_start = hand_trajectory(scene).keyframes.front().T_device_tool;
  const Vector3d& at_m = out.T_device_tool_start.p_m;
  const std::string begins = text_line("hand: a live hand cannot start at (%.4f, %.4f, %.4f) m",
                                       at_m.x(), at_m.y(), at_m.z());
  double low_m = at_m.z();
  for (const SceneSlice& slice : scene.slices)
    low_m = std::min(low_m, slice.z_m - kBelowSlices_m);
  const auto box =
      largest_box(device, limits, make_tool(scene.tool), out.T_device_tool_start, low_m);
  if (!box)
    return refused(
        begins + ": at that height the tip can move by less than 30 mm without turning the plate");
  out.min_m = box->min_m;
  out.max_m = box->max_m;
  if ((at_m.array() < out.min_m.array()).any() || (at_m.array() > out.max_m.array()).any())
    return refused(begins +
                   text_line(": it reaches x %.4f to %.4f, y %.4f to %.4f, z %.4f to %.4f m",
                             out.min_m.x(), out.max_m.x(), out.min_m.y(), out.max_m.y(),
                             out.min_m.z(), out.max_m.z()));
  out.turn_max_rad = limits.plate_tilt_max_rad - kHandMargin.angle_rad;
  return out;
}

TargetPath::TargetPath(double duration_s, double interval_s)
    : interval_s_(std::max(interval_s, duration_s / static_cast<double>(kMaxTargets - 2))) {
  if (duration_s > 0)
    targets_.reserve(std::min(kMaxTargets, static_cast<std::size_t>(duration_s / interval_s_) + 2));
}

void TargetPath::add(double t_s, const Pose& T_device_tool) noexcept {
  if (targets_.size() == targets_.capacity()) return;
  // A tolerance for the rounding of times keeps the interval regular.
  if (!targets_.empty() && t_s - targets_.back().t_s < interval_s_ * (1 - 1e-6)) return;
  targets_.push_back({t_s, T_device_tool});
}

HandTrajectory TargetPath::keyframes() const {
  HandTrajectory path;
  for (double factor = 1;; factor *= 2) {
    // Each keyframe is the last one to which a straight motion is within the tolerance of the targets in between.
    path.keyframes.clear();
    for (std::size_t from = 0; from < targets_.size();) {
      path.keyframes.push_back(targets_[from]);
      const auto is_straight = [&](std::size_t to) {
        const HandTrajectory straight{{targets_[from], targets_[to]}};
        for (std::size_t i = from + 1; i < to; ++i) {
          const Twist off = displacement(hand_target(straight, targets_[i].t_s).T_device_tool,
                                         targets_[i].T_device_tool);
          if (off.head<3>().norm() > factor * kPathTolerance_m ||
              off.tail<3>().norm() > factor * kPathTolerance_rad)
            return false;
        }
        return true;
      };
      // Doubling and then halving the distance needs few tests, although it may miss a longer one.
      std::size_t step = 1;
      while (from + 2 * step < targets_.size() && is_straight(from + 2 * step))
        step *= 2;
      for (std::size_t more = step / 2; more > 0; more /= 2) {
        if (from + step + more < targets_.size() && is_straight(from + step + more)) step += more;
      }
      from += step;
    }
    if (path.keyframes.size() <= kMaxKeyframes) return path;
  }
}

LiveHand::LiveHand(const LiveHandLimits& hand_limits, const Tool& tool,
                   const DeviceSpecification& device, const SafetyLimits& limits, TargetPath path)
    : hand_limits_(hand_limits),
      tool_(tool),
      device_(device),
      margins_(limits),
      path_(std::move(path)),
      wanted_(hand_limits.T_device_tool_start),
      T_from_(wanted_),
      T_(wanted_) {
  for (std::size_t i = 0; i < 3; ++i) {
    margins_.workspace_min_m[i] += kHandMargin.box_m;
    margins_.workspace_max_m[i] -= kHandMargin.box_m;
  }
  margins_.plate_tilt_max_rad -= kHandMargin.angle_rad;
  path_.add(0, T_);
}

bool LiveHand::is_allowed(const Pose& T_device_tool) const noexcept {
  const Pose T_device_plate{T_device_tool.p_m - T_device_tool.q * tool_.tip_plate_m,
                            T_device_tool.q};
  const PoseMargins margins = pose_margins(device_, margins_, tool_, T_device_plate);
  return pose_fault(margins_, margins) == Fault::kNone &&
         margins.device.joint_rad >= kHandMargin.angle_rad &&
         margins.device.box_m >= kHandMargin.box_m &&
         margins.tool_tilt_rad + kHandMargin.angle_rad <= kMaxTilt_deg / kDegreesPerRadian;
}

/// Returns the pose in the box that is nearest to the stated one. Its rotation is reduced until it is allowed.
Pose LiveHand::nearest_allowed(const std::array<double, 6>& stated) const noexcept {
  const Eigen::Quaterniond& q_start = hand_limits_.T_device_tool_start.q;
  const Eigen::Quaterniond q = from_rotation_vector(Vector3d(stated[3], stated[4], stated[5]));
  const Vector3d turn =
      shortened(rotation_vector(q * q_start.conjugate()), hand_limits_.turn_max_rad);
  Pose T{Vector3d(stated.data()).cwiseMax(hand_limits_.min_m).cwiseMin(hand_limits_.max_m),
         q_start};
  const auto turned = [&](double share) -> Pose {
    return {T.p_m, (from_rotation_vector(share * turn) * q_start).normalized()};
  };
  if (is_allowed(turned(1))) return turned(1);
  constexpr int kBisections = 6;
  double low = 0, high = 1;
  for (int i = 0; i < kBisections; ++i) {
    const double middle = (low + high) / 2;
    (is_allowed(turned(middle)) ? low : high) = middle;
  }
  return turned(low);
}

std::optional<TelemetryEventKind> LiveHand::receive(const TelemetryHand& latest,
                                                    std::int64_t now_ns) noexcept {
  const auto is_possible = [&] {
    for (std::size_t i = 0; i < latest.target.size(); ++i) {
      if (!(std::abs(latest.target[i]) <= (i < 3 ? kMaxStated_m : kMaxStated_rad))) return false;
    }
    return true;
  };
  if (latest.count == count_ || (latest.is_held && !is_possible())) {
    if (!is_held_ || now_ns - heard_ns_ < kSilent_ns) return std::nullopt;
    is_held_ = false;
    return TelemetryEventKind::kHandLost;
  }
  count_ = latest.count;
  heard_ns_ = now_ns;
  const bool was_held = std::exchange(is_held_, latest.is_held);
  if (is_held_) {
    was_held_ = true;
    wanted_ = nearest_allowed(latest.target);
  }
  if (is_held_ == was_held) return std::nullopt;
  return is_held_ ? TelemetryEventKind::kHand : TelemetryEventKind::kHandLetGo;
}

/// Returns the step, or if it leads to a pose that is not allowed, its rotation or translation alone, or none.
Twist LiveHand::allowed_part(const Twist& step) const noexcept {
  if (is_allowed(moved(T_, step)) || !is_allowed(T_)) return step;
  Twist turn = step, shift = step;
  turn.head<3>().setZero();
  shift.tail<3>().setZero();
  if (is_allowed(moved(T_, turn))) return turn;
  return is_allowed(moved(T_, shift)) ? shift : Twist(Twist::Zero());
}

void LiveHand::begin_step(double t_s, double dt_s, const Pose& T_device_tool) noexcept {
  if (std::exchange(restarts_, false)) T_ = T_device_tool;
  const bool is_released = was_held_ && !is_held_;
  const Pose& wanted = is_released ? T_device_tool : wanted_;
  const double speed_m_per_s = is_released ? kReleaseSpeed_m_per_s : hand_limits_.speed_max_m_per_s;
  Twist step = displacement(T_, wanted) * (1 - std::exp(-dt_s / kTimeConstant_s));
  step.head<3>() = shortened(step.head<3>(), speed_m_per_s * dt_s);
  step.tail<3>() = shortened(step.tail<3>(), hand_limits_.rotation_rate_max_rad_per_s * dt_s);
  if (is_held_) step = allowed_part(step);
  T_from_ = T_;
  T_ = moved(T_, step);
  twist_ = step / dt_s;
  from_s_ = t_s;
  path_.add(t_s + dt_s, T_);
}

HandTarget LiveHand::target(double t_s) const noexcept {
  return {moved(T_from_, twist_ * (t_s - from_s_)), twist_};
}

}  // namespace trocar::runtime
