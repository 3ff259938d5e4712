// SPDX-License-Identifier: Apache-2.0
#include "runtime/pose_device/pose_specification.h"

#include <algorithm>

#include "formats/base/text_line.h"

namespace trocar::runtime {
namespace {

constexpr double kBoxRounding_m = 1e-9;

}  // namespace

double renderable_fraction(const PoseDeviceDescription& description,
                           const Wrench& wrench) noexcept {
  const double force_N = wrench.head<3>().norm(), moment_Nm = wrench.tail<3>().norm();
  double share = 1;
  if (force_N > description.force_max_N) share = description.force_max_N / force_N;
  if (description.moment_max_Nm > 0 && moment_Nm > description.moment_max_Nm)
    share = std::min(share, description.moment_max_Nm / moment_Nm);
  return share;
}

std::optional<BoxSide> side_beyond(const PoseDeviceDescription& description,
                                   const std::array<double, 3>& p_m) noexcept {
  for (std::size_t i = 0; i < 3; ++i) {
    const double at_m = p_m[i], min_m = description.workspace_min_m[i],
                 max_m = description.workspace_max_m[i];
    // Written so that nan is beyond a side.
    if (at_m >= min_m - kBoxRounding_m && at_m <= max_m + kBoxRounding_m) continue;
    return BoxSide{static_cast<int>(i), at_m, at_m < min_m ? min_m : max_m};
  }
  return std::nullopt;
}

std::string PoseSpecification::describe_strength() const {
  return renders_moment()
             ? text_line("%.3g N and %.3g Nm", description_.force_max_N, description_.moment_max_Nm)
             : text_line("%.3g N, no moment", description_.force_max_N);
}

std::optional<WorkspaceBox> PoseSpecification::workspace() const noexcept {
  const PoseFrame::Box box = frame_.workspace();
  return WorkspaceBox{{box.min_m.x(), box.min_m.y(), box.min_m.z()},
                      {box.max_m.x(), box.max_m.y(), box.max_m.z()}};
}

DeviceMargins PoseSpecification::margins(const Pose& T_device_plate) const noexcept {
  DeviceMargins out;
  const PoseReading at = frame_.reading(T_device_plate);
  for (std::size_t i = 0; i < 3; ++i) {
    out.box_m = std::min({out.box_m, at.p_m[i] - description_.workspace_min_m[i],
                          description_.workspace_max_m[i] - at.p_m[i]});
  }
  out.box_m += kBoxRounding_m;
  return out;
}

std::string PoseSpecification::describe_fault(Fault fault, const Pose& T_device_plate) const {
  const std::optional<BoxSide> side = side_beyond(description_, frame_.reading(T_device_plate).p_m);
  if (fault != Fault::kWorkspace || !side) return {};
  const auto axis = static_cast<std::size_t>(side->axis);
  return text_line("the handle is at %c %s m in the device's frame; its box is %.4f to %.4f m",
                   "xyz"[axis], apart_from(side->at_m, side->limit_m, 4).c_str(),
                   description_.workspace_min_m[axis], description_.workspace_max_m[axis]);
}

std::optional<Pose> PoseSpecification::pose_of(const RecordingRow& row) const {
  const auto& stated = row.pose_device;
  const Pose T = frame_.plate({row.state_t_s, stated.p_m, stated.q, stated.buttons});
  return is_finite(T) ? std::optional(T) : std::nullopt;
}

double PoseSpecification::resolution() const noexcept {
  const bool is_exact = description_.position_resolution_m == 0 ||
                        (description_.senses_rotation && description_.rotation_resolution_rad == 0);
  return is_exact ? 0 : 1;
}

std::optional<Eigen::Matrix<double, 6, 6>> PoseSpecification::damping(const Pose&) const {
  // If no moment is rendered, a rotation releases no energy, whatever its damping is.
  constexpr double kAmple_Nm_s_per_rad = 1e6;
  Eigen::Matrix<double, 6, 1> diagonal;
  diagonal << Eigen::Vector3d::Constant(description_.damping_N_s_per_m),
      Eigen::Vector3d::Constant(renders_moment() ? description_.rotation_damping_Nm_s_per_rad
                                                 : kAmple_Nm_s_per_rad);
  return Eigen::Matrix<double, 6, 6>(diagonal.asDiagonal());
}

double PoseSpecification::renderable_fraction(const Pose&, const Wrench& wrench_device) const {
  return runtime::renderable_fraction(description_, wrench_device);
}

std::string PoseSpecification::describe_demand(std::string_view what, const Pose&,
                                               const Wrench& wrench_device) const {
  const double share = runtime::renderable_fraction(description_, wrench_device);
  return text_line("%.*s needs %.2f of %.2f N%s", static_cast<int>(what.size()), what.data(),
                   wrench_device.head<3>().norm(), description_.force_max_N,
                   share < 1 ? ", and is then not given in full" : "");
}

}  // namespace trocar::runtime
