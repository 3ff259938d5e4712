// SPDX-License-Identifier: Apache-2.0
#include "runtime/pose_device/pose_hand.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace trocar::runtime {
namespace {

constexpr double kAnyFinite = std::numeric_limits<double>::quiet_NaN();
/// Largest deviation of a measured quaternion's length from 1.
constexpr double kQuaternionTolerance = 1e-3;

double length(const std::array<double, 4>& q) noexcept {
  return std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
}

/// Returns the angle of the rotation from one unit quaternion to another.
double angle_between(const std::array<double, 4>& a, const std::array<double, 4>& b) noexcept {
  const Eigen::Quaterniond from(a[0], a[1], a[2], a[3]), to(b[0], b[1], b[2], b[3]);
  return rotation_vector((to * from.conjugate()).normalized()).norm();
}

}  // namespace

PoseHand::PoseHand(const PoseDeviceDescription& description, const PoseFrame& frame,
                   PoseDevice& device)
    : device_(device), specification_(description, frame) {}

DeviceStatus PoseHand::read(double& t_s) noexcept {
  reading_ = last_;
  const DeviceStatus status = device_.read(reading_);
  if (status == DeviceStatus::kOk) t_s = reading_.t_s;
  return status;
}

bool PoseHand::is_finite() const noexcept {
  const auto good = [](double x) { return std::isfinite(x); };
  return std::all_of(reading_.p_m.begin(), reading_.p_m.end(), good) &&
         (!description().senses_rotation ||
          std::all_of(reading_.q.begin(), reading_.q.end(), good));
}

bool PoseHand::keep_reading() noexcept {
  const bool keeps = is_finite();
  if (keeps) last_ = reading_;
  return keeps;
}

FaultDetail PoseHand::check(const ReadingInterval& interval) const noexcept {
  double farthest_m = kFarthest_m;
  for (std::size_t i = 0; i < 3; ++i)
    farthest_m = std::max(
        {farthest_m, -2 * description().workspace_min_m[i], 2 * description().workspace_max_m[i]});
  for (int i = 0; i < 3; ++i) {
    const double at_m = reading_.p_m[static_cast<std::size_t>(i)];
    if (!(std::abs(at_m) <= farthest_m))
      return {Fault::kRefusedState, FaultQuantity::kMeasuredPosition, i, at_m,
              std::copysign(farthest_m, at_m)};
  }
  const bool turns = description().senses_rotation;
  const double size = turns ? length(reading_.q) : 1;
  // Written so that nan is a fault.
  if (!(std::abs(size - 1) <= kQuaternionTolerance))
    return {Fault::kRefusedState, FaultQuantity::kMeasuredRotation, -1, size, 1};
  if (!interval.has_last) return {};
  const double step_m = std::hypot(reading_.p_m[0] - last_.p_m[0], reading_.p_m[1] - last_.p_m[1],
                                   reading_.p_m[2] - last_.p_m[2]);
  const double step_max_m =
      kMaxHandSpeed_m_per_s * interval.step_s + 2 * description().position_resolution_m;
  if (!(step_m <= step_max_m))
    return {Fault::kEncoderJump, FaultQuantity::kPositionStep, -1, step_m, step_max_m};
  const double turn_rad = turns ? angle_between(last_.q, reading_.q) : 0;
  const double turn_max_rad =
      kMaxHandRate_rad_per_s * interval.step_s + 2 * description().rotation_resolution_rad;
  if (!(turn_rad <= turn_max_rad))
    return {Fault::kEncoderJump, FaultQuantity::kRotationStep, -1, turn_rad, turn_max_rad};
  return {};
}

FaultDetail PoseHand::find_pose(const ReadingInterval& interval, PlatePose& pose) noexcept {
  // Velocities are computed from values whose unit is their resolution, so that one count is 1 for all of them.
  const bool is_exact = specification_.resolution() == 0;
  const double count_m = is_exact ? 1 : description().position_resolution_m;
  // A rotation by an angle changes a quaternion by half the angle.
  const double count_q = is_exact ? 1 : description().rotation_resolution_rad / 2;
  measured_.t_s = reading_.t_s;
  measured_.count = description().senses_rotation ? 7 : 3;
  for (std::size_t i = 0; i < 3; ++i)
    measured_.value[i] = reading_.p_m[i] / count_m;
  if (description().senses_rotation) {
    double product = 0;
    for (std::size_t i = 0; i < 4; ++i)
      product += reading_.q[i] * measured_.value[3 + i];
    const double sign = product < 0 ? -1 : 1;
    for (std::size_t i = 0; i < 4; ++i)
      measured_.value[3 + i] = sign * reading_.q[i] / count_q;
  }
  if (const FaultDetail f = check(interval); f != Fault::kNone) return f;
  pose = {frame().plate(reading_), 0};
  return {};
}

FaultDetail PoseHand::check_own_workspace() const noexcept {
  const std::optional<BoxSide> side = side_beyond(description(), reading_.p_m);
  if (!side) return {};
  return {Fault::kWorkspace, FaultQuantity::kMeasuredPosition, side->axis, side->at_m,
          side->limit_m};
}

FaultDetail PoseHand::fault_of(DeviceStatus status) const noexcept {
  const int byte = status == DeviceStatus::kMotorFault ? device_.fault_byte() : 0;
  if (byte != 0)
    return {Fault::kMotorFault, FaultQuantity::kFaultByte, -1, static_cast<double>(byte),
            kAnyFinite};
  return HandDevice::fault_of(status);
}

FaultDetail PoseHand::render(const RenderInput& input, double& scale) noexcept {
  for (int i = 0; i < 6; ++i) {
    if (!std::isfinite(input.wanted[i]))
      return {Fault::kTorqueNotFinite, FaultQuantity::kWantedWrench, i, input.wanted[i],
              kAnyFinite};
  }
  scale = renderable_fraction(description(), input.wanted);
  Wrench rendered = scale * input.wanted;
  if (description().moment_max_Nm == 0) rendered.tail<3>().setZero();
  next_ = frame().to_device(rendered);
  return {};
}

void PoseHand::fade(double share) noexcept {
  for (std::size_t i = 0; i < next_.size(); ++i)
    next_[i] = share * at_stop_[i];
}

DeviceStatus PoseHand::write() noexcept {
  written_ = next_;
  return device_.write(written_);
}

void PoseHand::describe(RecordingRow& row, DeviceReadout& readout) const noexcept {
  row.pose_device = {reading_.p_m, reading_.q, reading_.buttons, written_};
  row.state_t_s = reading_.t_s;
  readout.margin = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 3; ++i) {
    readout.margin = std::min({readout.margin, reading_.p_m[i] - description().workspace_min_m[i],
                               description().workspace_max_m[i] - reading_.p_m[i]});
  }
}

}  // namespace trocar::runtime
