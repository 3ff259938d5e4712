// SPDX-License-Identifier: Apache-2.0
// A made-up device without joints and motors: it measures the pose of its handle, renders forces up to a limit, and
// cannot be below a stop. Its hand follows the scene's path exactly, whatever the force.
#pragma once

#include <algorithm>
#include <string>
#include <utility>

#include "formats/base/text.h"
#include "runtime/device/hand_device.h"
#include "runtime/device/simulated/hand.h"

namespace trocar::test {

class HandleSpecification final : public runtime::DeviceSpecification {
 public:
  explicit HandleSpecification(double force_max_N, double stop_z_m = 0.05)
      : force_max_N_(force_max_N), stop_z_m_(stop_z_m) {}

  std::string_view name() const noexcept override { return "handle"; }
  std::string describe_strength() const override { return text_line("%.3g N", force_max_N_); }
  bool senses_rotation() const noexcept override { return false; }
  double mass_kg() const noexcept override { return 0.2; }
  std::array<double, 3> inertia_kg_m2() const noexcept override { return {1e-4, 1e-4, 1e-4}; }
  double stiffness_max_N_per_m() const noexcept override { return 3000; }
  runtime::DeviceReadings readings() const noexcept override { return {}; }
  std::optional<Eigen::Matrix<double, 6, 6>> damping(const runtime::Pose&) const override {
    return Eigen::Matrix<double, 6, 6>::Zero();
  }
  double renderable_fraction(const runtime::Pose&, const runtime::Wrench& wrench) const override {
    return std::min(1.0, force_max_N_ / std::max(1e-9, wrench.head<3>().norm()));
  }
  std::string describe_demand(std::string_view what, const runtime::Pose&,
                              const runtime::Wrench& wrench) const override {
    return std::string(what) +
           text_line(" needs %.1f of %.1f N", wrench.head<3>().norm(), force_max_N_);
  }
  runtime::DeviceMargins margins(const runtime::Pose& T) const noexcept override {
    if (T.p_m.z() >= stop_z_m_) return {};
    return {.fault = Fault::kPoseResidual, .is_reachable = false};
  }
  std::string describe_fault(Fault fault, const runtime::Pose& T) const override {
    if (fault != Fault::kPoseResidual || T.p_m.z() >= stop_z_m_) return {};
    return describe_beyond("the handle is at", T.p_m.z(), stop_z_m_, " m", 3);
  }
  std::optional<runtime::Pose> pose_of(const RecordingRow& row) const override {
    return runtime::Pose{Eigen::Vector3d(row.encoder_rad.data()), {1, 0, 0, 0}};
  }

 private:
  double force_max_N_, stop_z_m_;
};

class HandleDevice final : public runtime::HandDevice {
 public:
  HandleDevice(const HandleSpecification& specification, runtime::HandTrajectory path)
      : specification_(specification), path_(std::move(path)) {}

  const runtime::DeviceSpecification& specification() const noexcept override {
    return specification_;
  }
  DeviceStatus read(double& t_s) noexcept override {
    t_s = measured_.t_s = t_s_;
    T_ = runtime::hand_target(path_, t_s_).T_device_tool;  // the tip is the plate's origin
    return DeviceStatus::kOk;
  }
  void use_last_reading() noexcept override {}
  FaultDetail find_pose(const runtime::ReadingInterval&,
                        runtime::PlatePose& pose) noexcept override {
    if (const Fault fault = specification_.margins(T_).fault; fault != Fault::kNone) return fault;
    pose = {T_, 0};
    return {};
  }
  const runtime::Measurement& measured() const noexcept override { return measured_; }
  bool keep_reading() noexcept override { return true; }
  FaultDetail render(const runtime::RenderInput& input, double& scale) noexcept override {
    scale = specification_.renderable_fraction(T_, input.wanted);
    next_ = scale * input.wanted;
    return {};
  }
  void stop() noexcept override { at_stop_ = next_; }
  void fade(double share) noexcept override { next_ = share * at_stop_; }
  DeviceStatus write() noexcept override { return DeviceStatus::kOk; }
  void write_zero() noexcept override { next_.setZero(); }
  runtime::Wrench delivered() const noexcept override { return next_; }
  /// The first three columns of encoders have the position in m.
  void describe(RecordingRow& row, runtime::DeviceReadout&) const noexcept override {
    std::copy(T_.p_m.data(), T_.p_m.data() + 3, row.encoder_rad.begin());
  }
  void advance(double dt_s) override { t_s_ += dt_s; }

 private:
  const HandleSpecification& specification_;
  runtime::HandTrajectory path_;
  runtime::Measurement measured_;
  runtime::Pose T_;
  runtime::Wrench next_ = runtime::Wrench::Zero(), at_stop_ = runtime::Wrench::Zero();
  double t_s_ = 0;
};

}  // namespace trocar::test
